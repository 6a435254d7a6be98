"""The design of motions against NumPy, SciPy, differences and what the estimators' own equations
say of the same instants."""

from dataclasses import dataclass, replace
from functools import cache, cached_property
from math import factorial

import casadi as ca
import numpy as np
import pytest
from scipy.interpolate import KroghInterpolator, make_interp_spline
from scipy.spatial.transform import Rotation
from simulated import EXACT, changed

from steelyard.batch import Batched
from steelyard.excitation.command.commanded_state import COMMAND, COMMAND_WITH_JERK, motion_of
from steelyard.excitation.command.motion_spline import COORDINATES, MotionSpline
from steelyard.excitation.evaluation import evaluate_motions, highest_frequency
from steelyard.excitation.information.linearisation_point import (
    LinearisationPoint,
    border_columns,
    prior_information,
)
from steelyard.excitation.information.noise_free_recording import fit_noise_free
from steelyard.excitation.information.optimality_criterion import OptimalityCriterion, Target
from steelyard.excitation.information.predicted_information import PredictedInformation
from steelyard.excitation.limits.cable_vibration import CableVibration, natural_frequencies
from steelyard.excitation.limits.motion_constraints import Margin, MotionConstraints
from steelyard.excitation.search.design_problem import DesignProblem
from steelyard.excitation.settings import DEFAULT as SETTINGS
from steelyard.experiment.model import Experiment
from steelyard.identification.banded import banded_product
from steelyard.identification.model.accumulation import accumulate
from steelyard.identification.model.balance import Forces, balance_of
from steelyard.identification.model.calibration_parameters import DRAG, CalibrationValues
from steelyard.identification.model.calibration_parameters import ROBOT as FILE
from steelyard.identification.model.force_residuals import force_residuals
from steelyard.identification.model.motion_segment import holding_rows
from steelyard.identification.model.segment import POSE
from steelyard.identification.tally import Tally
from steelyard.inertia import TEN, Inertia, body_jacobian
from steelyard.instruments import Length, Wrench
from steelyard.instruments.equations import linearised, predict
from steelyard.motion.state import State, motion_of_poses
from steelyard.motion.trajectory import Sampled, multisine
from steelyard.robot.file import read_robot
from steelyard.robot.kinematics import cables_at
from steelyard.robot.model import Robot
from steelyard.simulation.sensors import paper_sensors
from steelyard.smoothing import DEGREE

pytestmark = pytest.mark.integration

HEAVY = read_robot("cogiro")
STRAIGHT = HEAVY.with_straight_cables()
BODY = HEAVY.platform
BARE = Robot("sensor", np.zeros((0, 3)), np.zeros((0, 3)), platform=BODY)
UNSURE = {"anchor": 0.002, "attachment": 0.002, "gravity": 0.005}
DURATION = 6.0  # [s]
MOTION = multisine([0, 0, 1.5, 0, 0, 0], [0.8, 0.6, 0.4, 0.3, 0.3, 0.4], DURATION, 3)
TIGHT = 600.0  # [N]

GRID = 0.005  # relative: readings on a grid of instants, and not one by one
GRID_SAG = (
    0.02  # relative: and cables that hang straight, where those of the noise-free recording sag
)
GRID_ROLLERS = 0.03  # relative: rollers turn around between two instants of the grid
BY_SHIFT = 0.02  # of half the weight: what a shift of the centre of gravity changes of the inertia about the origin
SAGGING = 0.05  # relative to what is known of each at one instant
DIFFERENCES = 1e-6  # relative to the largest: fourth-order differences of what curves over a metre, a radian, a second


def central(function, x, way, step=1e-3):
    """Derivative along a way, of fourth order."""
    near, far = (
        np.asarray(function(x + k * step * way)) - function(x - k * step * way) for k in (1, 2)
    )
    return (8 * near - far) / (12 * step)


def in_every_way(function, rows):
    """Derivatives of what each row of an array gives, by each of its numbers, the latter on the
    last axis."""
    n, k = rows.shape
    tiled = np.repeat(rows, k, axis=0)
    found = central(function, tiled, np.tile(np.eye(k), (n, 1)))
    return np.moveaxis(found.reshape(n, k, *found.shape[1:]), 1, -1)


def over_time(function, order, reach=0.1):
    """Derivative at time 0 of an array that is smooth in time, by a polynomial through Chebyshev's
    points."""
    times = reach * np.cos(np.pi * (np.arange(13) + 0.5) / 13)
    return KroghInterpolator(times, np.array([function(t) for t in times])).derivative(0.0, order)


def assert_near(found, expected, relative):
    np.testing.assert_allclose(found, expected, rtol=0, atol=relative * np.abs(expected).max())


def random_commands(n, seed=0):
    """Poses within the robot, and their first three derivatives, as large as they may be."""
    rng = np.random.default_rng(seed)
    pose = rng.uniform([-2, -1.5, 1, -0.3, -0.3, -0.3], [2, 1.5, 2.5, 0.3, 0.3, 0.3], (n, 6))
    return np.hstack(
        [
            pose,
            0.5 * rng.normal(size=(n, 6)),
            1.0 * rng.normal(size=(n, 6)),
            rng.normal(size=(n, 6)),
        ]
    )


def moved(command):
    """Position and SciPy's rotation around the instant of a command, as functions of time: what its
    derivatives say."""
    orders = command.reshape(-1, 6)

    def pose(t):
        return sum(each * t**k / factorial(k) for k, each in enumerate(orders))

    return lambda t: pose(t)[:3], lambda t: Rotation.from_euler("ZYX", pose(t)[:2:-1])


def axial(matrix):
    """Vector whose cross product is the antisymmetric part of a matrix."""
    return (
        np.array(
            [matrix[2, 1] - matrix[1, 2], matrix[0, 2] - matrix[2, 0], matrix[1, 0] - matrix[0, 1]]
        )
        / 2
    )


def motion_in_time(command, gravity=HEAVY.gravity):
    """State of the platform, and its velocity and acceleration in the world, by differences in
    time."""
    position, rotation = moved(command)
    R = rotation(0.0).as_matrix()
    dR, ddR = (over_time(lambda t: rotation(t).as_matrix(), order) for order in (1, 2))
    velocity, acceleration = (over_time(position, order) for order in (1, 2))
    # R^T R'' is the angular acceleration's matrix and the square of the angular velocity's, which
    # is symmetric.
    return (
        position(0.0),
        R,
        velocity,
        acceleration,
        axial(R.T @ dR),
        axial(R.T @ ddR),
        R.T @ (acceleration - gravity),
    )


def motions(commands):
    """The same of all instants."""
    return [np.array(each) for each in zip(*map(motion_in_time, commands), strict=True)]


# Motion splines

START, END = np.array([0.5, -0.3, 1.5, 0.1, 0.0, -0.2]), np.array([-0.4, 0.8, 2.0, 0.0, 0.1, 0.2])
REACH = np.array([4, 3, 1.5, 0.6, 0.6, 0.6])


def some_spline(end=END, seed=1):
    spline = MotionSpline(START, end, 8.0, 7, REACH)
    return spline, 0.2 * np.random.default_rng(seed).normal(size=spline.size)


@pytest.mark.parametrize("end", [START, END], ids=["back to where it began", "to another pose"])
def test_a_motion_spline_goes_from_rest_at_one_pose_to_rest_at_the_other(end):
    spline, x = some_spline(end)
    motion = spline.trajectory(x)
    ends = np.array([0.0, spline.duration])
    np.testing.assert_allclose(motion.derivative(ends, 0), [START, end], atol=1e-12)
    inside = np.linspace(0, spline.duration, 200)
    for order in (1, 2, 3):
        largest = np.abs(motion.derivative(inside, order)).max()
        assert largest > 0.1
        np.testing.assert_allclose(motion.derivative(ends, order), 0.0, atol=1e-11 * largest)


def test_a_motion_spline_without_free_coefficients_is_the_direct_move():
    spline, _ = some_spline()
    poses = spline.trajectory(np.zeros(spline.size)).derivative(
        np.linspace(0, spline.duration, 100), 0
    )
    share = (poses - START) / (END - START)
    # All six coordinates as one, and never back.
    np.testing.assert_allclose(share, np.tile(share[:, :1], 6), atol=1e-12)
    assert np.all(np.diff(share[:, 0]) > -1e-12)


def test_commands_along_a_motion_spline_are_its_trajectory_and_its_derivatives():
    spline, x = some_spline()
    times = spline.midpoints(3)
    assert len(times) == 21
    np.testing.assert_allclose(times, (spline.duration / 21) * (np.arange(21) + 0.5))
    commands = spline.at(times).commands(x)
    for order in range(4):
        found = commands[:, COORDINATES * order : COORDINATES * (order + 1)]
        np.testing.assert_allclose(found, spline.trajectory(x).derivative(times, order), atol=1e-11)
    # And the last of these is the third derivative of the pose in time.
    middle = times[10]
    around = over_time(
        lambda t: spline.trajectory(x).derivative(np.array([middle + t]), 0)[0], 3, reach=0.05
    )
    np.testing.assert_allclose(commands[10, 18:], around, rtol=1e-5)


@pytest.mark.parametrize("numbers", [18, 24])
def test_gradients_by_commands_become_gradients_by_coefficients(numbers):
    spline, x = some_spline()
    samples = spline.at(spline.midpoints(4))
    rng = np.random.default_rng(2)
    weight = rng.normal(size=(28, numbers))

    def total(x):
        return np.sum(weight * np.sin(samples.commands(x)[:, :numbers]))

    slope = weight * np.cos(samples.commands(x)[:, :numbers])
    expected = [central(total, x, way) for way in np.eye(spline.size)]
    assert_near(samples.gradient(slope), np.array(expected), 1e-9)


@pytest.mark.parametrize("numbers", [18, 24])
def test_jacobians_by_commands_become_jacobians_by_the_coefficients_of_their_instants(numbers):
    spline, x = some_spline()
    samples = spline.at(spline.midpoints(4))
    mixed = np.random.default_rng(3).normal(size=(28, 2, numbers))

    def at(x):
        return np.sin(np.einsum("ngc,nc->ng", mixed, samples.commands(x)[:, :numbers]))

    outer = np.cos(np.einsum("ngc,nc->ng", mixed, samples.commands(x)[:, :numbers]))
    columns, there = samples.sparsity
    spread = samples.jacobian(outer[:, :, None] * mixed)
    found = np.zeros((28, 2, spline.size))
    for i in range(28):
        assert len(set(columns[i][there[i]])) == there[i].sum()
        found[i][:, columns[i][there[i]]] = spread[i][:, there[i]]
    expected = np.stack([central(at, x, way, 2e-5) for way in np.eye(spline.size)], axis=2)
    assert_near(found, expected, 1e-8)


def test_the_spline_fitted_to_a_spline_is_itself():
    spline, x = some_spline()
    np.testing.assert_allclose(spline.fitted_to(spline.trajectory(x)), x, atol=1e-10)


def test_the_spline_fitted_to_another_motion_is_the_one_of_least_squares():
    spline, _ = some_spline(START)
    motion = multisine(list(START), list(0.2 * REACH), spline.duration, 3)
    times = np.linspace(0, spline.duration, 8 * spline.intervals + 1)
    found = spline.fitted_to(motion)

    def missed(x):
        return np.sum(
            ((spline.trajectory(x).derivative(times, 0) - motion.derivative(times, 0)) / REACH) ** 2
        )

    # No way leads to a smaller sum.
    assert missed(found) < 0.2 * missed(np.zeros(spline.size))
    np.testing.assert_allclose(
        [central(missed, found, way) for way in np.eye(spline.size)], 0.0, atol=1e-9
    )


def test_the_highest_frequency_of_a_motion_has_all_but_a_hundredth_of_its_power_below():
    # Two frequencies in one coordinate; of the accelerations .5 % of the power lies above, then 1.5
    # %.
    time = np.linspace(0, 10, 2001)
    for share, expected in ((0.005, 0.5), (0.015, 2.0)):
        poses = np.zeros((2001, COORDINATES))
        poses[:, 1] = (
            np.sin(2 * np.pi * 0.5 * time) + np.sqrt(share) * np.sin(2 * np.pi * 2.0 * time) / 16
        )
        assert highest_frequency(Sampled.through(time, poses)) == pytest.approx(expected, abs=0.11)
    assert highest_frequency(Sampled.through(time, np.zeros((2001, COORDINATES)))) == 0.0


# From commands to motion


def test_a_command_moves_the_quaternion_as_scipy_turns_it_in_time():
    command = ca.SX.sym("command", COMMAND_WITH_JERK)
    function = Batched(
        "motion", {"command": command}, dict(zip("pvaj", motion_of(command), strict=True))
    )
    commands = random_commands(20)
    # Far beyond where angles of rotation are ambiguous.
    commands[10:, 3:6] *= 8
    found = function(command=commands)
    for i, each in enumerate(commands):
        position, rotation = moved(each)

        def pose(t, i=i, position=position, rotation=rotation):
            quaternion = rotation(t).as_quat(scalar_first=True)
            return np.concatenate(
                [position(t), quaternion * np.sign(quaternion @ found["p"][i, 3:])]
            )

        for order, key in enumerate("pvaj"):
            np.testing.assert_allclose(
                found[key][i], over_time(pose, order), atol=2e-9, err_msg=f"order {order}"
            )


# Readings


@dataclass(frozen=True)
class Plan:
    """An experiment with its noise-free fit."""

    experiment: Experiment
    level: float = 0.0

    @cached_property
    def joint(self):
        return fit_noise_free(self.experiment, {"run": MOTION}, self.level)

    @cached_property
    def calibration_parameters(self):
        return self.joint.fit.state.calibration.calibration_parameters

    @cached_property
    def point(self):
        return LinearisationPoint.of(self.joint, self.joint.experiment.runs[0], self.level)

    @cached_property
    def elsewhere(self):
        """The same about errors and a body that are not as stated, as an estimate may be."""
        rng = np.random.default_rng(4)
        values = (
            self.calibration_parameters.mean
            + self.calibration_parameters.deviation
            * rng.normal(size=len(self.calibration_parameters))
        )
        body = BODY.parameters * (1 + 0.1 * rng.normal(size=TEN))
        return replace(
            self.point,
            calibration=CalibrationValues(self.calibration_parameters, values),
            parameters=body,
        )

    @cached_property
    def segment(self):
        (segment,) = self.joint.fit.state.segments
        return segment

    @cached_property
    def known(self):
        return prior_information(self.calibration_parameters)

    @cached_property
    def predicted(self):
        return self.predicted_by(self.point)

    @cached_property
    def predicted_elsewhere(self):
        return self.predicted_by(self.elsewhere)

    def predicted_by(self, point):
        return PredictedInformation(point, self.segment, DURATION)

    @cached_property
    def commands(self):
        return commands_at(self.predicted.times)

    @cached_property
    def information(self):
        return self.predicted.information(self.commands)


def commands_at(times):
    return np.hstack([MOTION.derivative(times, order) for order in range(4)])


GAINS = {"gain": 0.01, "common_gain": 0.005}


@cache
def plan(which):
    robot = {"heavy": HEAVY, "bare": BARE}.get(which, STRAIGHT)
    suite = dict(paper_sensors(HEAVY).instruments)
    level = 0.0
    if which == "gains":
        suite["cables"] = changed(suite["cables"], calibration=GAINS)
    if which == "rollers":
        suite["cables"] = changed(
            suite["cables"],
            end="winch",
            calibration={**GAINS, "friction": {"value": 0.02, "sigma": 0.005}},
        )
    if which == "late":
        # The clock of the forces has an error of its own, and those of the others have none.
        suite["cables"] = changed(suite["cables"], calibration={"delay": 0.02})
        suite["imu"] = changed(suite["imu"], clock="device", calibration={"delay": 0.0})
        suite["tracker"] = changed(suite["tracker"], calibration={"delay": 0.0})
    if which == "tight":
        level = TIGHT
        suite["cables"] = changed(suite["cables"], calibration=GAINS)
        suite["encoders"] = Length.model_validate({"kind": "length", "rate": 30.0, "noise": 0.002})
    if which == "bare":
        del suite["cables"]
        suite["sensor"] = Wrench.model_validate(
            {
                "kind": "wrench",
                "clock": "recorder",
                "rate": 40.0,
                "position": (0.02, -0.01, 0.1),
                "rpy_deg": (5, -10, 30),
                "noise": {"force": 2.0, "torque": 0.4},
                "calibration": {
                    "offset": {"force": 5.0, "torque": 1.0},
                    "position": 0.001,
                    "misalignment": 0.01,
                },
            }
        )
    uncertainty = EXACT if which in {"gains", "late"} else UNSURE
    return Plan(Experiment(which, robot, suite, (), uncertainty=uncertainty), level)


ELSEWHERE = ["gains", "tight", "heavy", "rollers", "bare"]
INSTANTS = np.array([0.6, 1.7, 2.4, 3.3, 4.1, 5.2])  # [s]


def states_at(point, times):
    """State of the platform by differences in time, with the wrench that moves the body and the
    tensions that make it."""
    each = [motion_in_time(command, point.calibration.gravity) for command in commands_at(times)]
    position, R, velocity, _, omega, alpha, s = (np.array(part) for part in zip(*each, strict=True))
    wrench = moving_wrench(Inertia.from_parameters(point.parameters), s, omega, alpha)
    tension = None
    if point.experiment.robot.m:
        tension = nearest_tensions(structure_of(placed(point), position, R), wrench, point.level)
    return State(position, R, velocity, omega, s, alpha, tension, wrench, point.calibration.gravity)


def moving_wrench(body, s, omega, alpha):
    """By Newton and Euler about the centre of gravity, moved to the origin."""
    c = body.center_of_gravity
    force = body.mass * (s + np.cross(alpha, c) + np.cross(omega, np.cross(omega, c)))
    turning = alpha @ body.inertia + np.cross(omega, omega @ body.inertia)
    return np.concatenate([force, turning + np.cross(c, force)], axis=-1)


def nearest_tensions(W, wrench, level):
    """Of least squares about a level."""
    even = np.full(W.shape[:1] + W.shape[2:], level)
    return even + np.einsum(
        "nmk,nk->nm", np.linalg.pinv(W), wrench - np.einsum("nkm,nm->nk", W, even)
    )


def structure_of(robot, position, R):
    """Of straight cables: torques by arms and forces in the world, then turned into the
    platform."""
    direction = cables_at(robot.with_straight_cables(), position, R, np.ones(robot.m)).direction
    arm = np.einsum("nij,mj->nmi", R, robot.attachments)
    return np.concatenate([direction @ R, np.cross(arm, direction) @ R], axis=2).transpose(0, 2, 1)


def placed(point):
    """The robot as the systematic errors have it."""
    values, places = point.calibration.values, point.calibration.calibration_parameters.places
    where = {
        key + "s": values[places[FILE, key, None]].reshape(-1, 3)
        for key in ("anchor", "attachment")
    }
    return replace(point.experiment.robot, **where)


def quaternion_motion(times):
    """Position over quaternion, its first three derivatives, by differences in time."""

    def motion(order):
        found = []
        for command in commands_at(times):
            position, rotation = moved(command)
            found.append(
                over_time(
                    lambda t, p=position, r=rotation: np.concatenate(
                        [p(t), r(t).as_quat(scalar_first=True)]
                    ),
                    order,
                )
            )
        return np.array(found)

    return [motion(order) for order in range(4)]


@pytest.mark.slow
@pytest.mark.parametrize("which", [*ELSEWHERE, "late"])
def test_readings_of_the_motion_are_linearised_as_the_estimators_do(which):
    point = plan(which).elsewhere
    calibration_parameters, robot = point.calibration.calibration_parameters, point.experiment.robot
    state, motion = states_at(point, INSTANTS), quaternion_motion(INSTANTS)
    column_of = border_columns(calibration_parameters)
    readings_of = plan(which).predicted_elsewhere.instruments
    assert [reading.name for reading in readings_of] == [
        name for name, *_ in point.motion_readings
    ] + [point.force_readings[0]]
    for (name, quantity, sigma, rate), reading in zip(
        point.motion_readings, readings_of, strict=False
    ):
        instrument = point.experiment.instruments[name]
        errors = point.calibration.of(name, instrument, "run")
        measured = predict(instrument, displaced(point), state, errors)[quantity]
        found = linearised(
            instrument, quantity, robot, measured, motion[:3], np.concatenate(list(errors.values())),
            point.calibration.gravity, state.tension if instrument.kind == "length" else None,
            point.calibration.geometry,
        )  # fmt: skip
        np.testing.assert_allclose(found["residual"], 0.0, atol=1e-8)
        by_motion, by_border = reading.derivatives(commands_at(INSTANTS))
        by = np.concatenate([found["by_pose"], found["by_rate"], found["by_acceleration"]], axis=2)
        assert_near(by_motion * sigma, by, 1e-8)
        expected = np.zeros((*by.shape[:2], len(calibration_parameters)))
        column = 0
        for term in instrument.terms(robot.m):
            own = slice(column, column := column + term.size)
            expected[:, :, calibration_parameters.place(name, term.key, "run")] = found[
                "by_errors"
            ][:, :, own]
        for key, derivative in {
            "gravity": "by_gravity", "anchor": "by_anchors", "attachment": "by_attachments"
        }.items():  # fmt: skip
            expected[:, :, calibration_parameters.places[FILE, key, None]] = found[derivative]
        if (clock := instrument.clock or name) != "recorder":
            # The motion is in the time of the forces: if their clock is late, the others are
            # early.
            late = delayed(point, name, quantity)[:, :, None]
            expected[:, :, calibration_parameters.place(clock, "delay", "run")] = late
            expected[:, :, calibration_parameters.place("recorder", "delay", "run")] = -late
        full = np.zeros((*by.shape[:2], TEN + int((column_of >= 0).sum())))
        full[:, :, reading.columns] = by_border * sigma
        np.testing.assert_array_equal(full[:, :, :TEN], 0.0)
        wanted = expected[:, :, column_of >= 0]
        np.testing.assert_allclose(
            full[:, :, TEN:],
            wanted,
            atol=1e-8 * np.abs(wanted).max(initial=1.0),
            err_msg=f"{name} {quantity}",
        )
        assert reading.rate == pytest.approx(instrument.rate)
        assert rate == reading.rate


def displaced(point):
    """The robot with its anchors and attachments where the calibration has them."""
    geometry = point.calibration.geometry
    fixed = {key: each.reshape(-1, 3) for key, each in geometry.items()}
    return replace(point.experiment.robot, **fixed)


def delayed(point, name, quantity):
    """How readings exceed what is predicted for each second by which their clock is later: the way
    of the prediction in time."""
    instrument, gravity = point.experiment.instruments[name], point.calibration.gravity
    robot = displaced(point)
    orders = commands_at(INSTANTS).reshape(-1, 4, COORDINATES)
    tension = states_at(point, INSTANTS).tension  # taken as known

    def reading(t):
        poses = [
            sum(orders[:, k] * t ** (k - d) / factorial(k - d) for k in range(d, 4))
            for d in range(3)
        ]
        state = State(
            **motion_of_poses(*poses, gravity), tension=tension, wrench=None, gravity=gravity
        )
        return predict(instrument, robot, state, point.calibration.of(name, instrument, "run"))[
            quantity
        ]

    found = over_time(reading, 1)
    # Of a rotation it is how fast it turns, in its own axes.
    return (
        np.array([axial(R.T @ dR) for R, dR in zip(reading(0.0), found, strict=True)])
        if found.ndim == 3
        else found
    )


def spline_through(segment):
    """The commanded motion as an estimator has it, near to exact: a spline of many knots in
    position and quaternion."""
    grid = np.linspace(0, DURATION, 601)
    pose = MOTION.derivative(grid, 0)
    quaternion = Rotation.from_euler("ZYX", pose[:, :2:-1]).as_quat(scalar_first=True)
    spline = make_interp_spline(grid, np.hstack([pose[:, :3], quaternion]), k=DEGREE)
    return replace(segment, knots=spline.t, coefficients=spline.c, readings=())


def products(by_motion, by_border, columns, size):
    """Rows with themselves, instant by instant."""
    full = np.zeros((*by_border.shape[:2], size))
    full[:, :, columns] = by_border
    rows = np.concatenate([by_motion, full], axis=2)
    return np.einsum("nki,nkj->nij", rows, rows)


def assert_information(found, expected, relative):
    """Each number against the roots of its row's and column's own."""
    size = np.sqrt(np.einsum("nii->ni", expected))
    scale = np.where(size > 0, size, 1.0)
    scale = scale[:, :, None] * scale[:, None, :]
    np.testing.assert_allclose(found / scale, expected / scale, rtol=0, atol=relative)


REMEMBERING = pytest.param(
    "rollers",
    marks=pytest.mark.xfail(
        strict=True,
        reason="a design takes rollers without presliding: it knows instants, not what was before",
    ),
)
"""The estimator follows the friction of rollers over some millimetres of travel."""
STRETCHING = pytest.param(
    "tight",
    marks=pytest.mark.xfail(
        strict=True,
        reason="a design takes the tensions that stretch cables as known; the bound does not",
    ),
)
"""Three of 89 1-sigma of lengths and stiffness differ, by up to three per cent."""


@pytest.mark.slow
@pytest.mark.integration
@pytest.mark.parametrize("which", [w for w in ELSEWHERE if w != "rollers"] + [REMEMBERING])
def test_the_balance_of_forces_has_the_information_that_the_estimators_use(which):
    point, known = plan(which).elsewhere, plan(which).known
    robot, (name, quantities, sigma, rate) = point.experiment.robot, point.force_readings
    instrument = point.experiment.instruments[name]
    readings = predict(
        instrument, robot, states_at(point, INSTANTS), point.calibration.of(name, instrument, "run")
    )
    left_out = np.zeros((len(INSTANTS), len(sigma)), dtype=bool)
    forces = Forces(name, INSTANTS, {q: readings[q] for q in quantities}, sigma, left_out)
    segment = spline_through(plan(which).segment)
    if which == "heavy":
        # Cables that sag and are dragged along pull a little otherwise; readings that do not
        # balance would count less.
        for _ in range(4):
            at = balance_of(
                point.experiment, segment, forces, point.calibration, point.parameters, {}
            )
            off = np.einsum("nri,ni->nr", np.linalg.pinv(at.by_reading), at.left_over)
            forces = replace(forces, readings={"tension": forces.readings["tension"] - off})
    calibration_parameters = point.calibration.calibration_parameters
    (rows,) = force_residuals(
        point.experiment,
        segment,
        forces,
        point.calibration,
        border_columns(calibration_parameters),
        point.parameters,
        {},
        Tally(),
    )
    np.testing.assert_allclose(rows.residual, 0.0, atol=1e-4)
    reading = plan(which).predicted_elsewhere.instruments[-1]
    by_motion, by_border = reading.derivatives(commands_at(INSTANTS))
    by_order = by_motion.reshape(len(INSTANTS), 6, 3, POSE)
    along = np.einsum("oni,nkod->nkid", segment.basis(INSTANTS).values[:3], by_order).reshape(
        len(INSTANTS), 6, -1
    )
    found = products(along, by_border, reading.columns, len(known))
    expected = products(rows.by_motion, rows.by_errors, rows.columns, len(known))
    if which == "heavy":
        # That cables sag is of no account for derivatives, the module says: a few per cent of what
        # is known of body and drag.
        place = border_columns(calibration_parameters)[
            calibration_parameters.places[FILE, DRAG, None]
        ]
        own = along.shape[2] + np.concatenate([np.arange(TEN), place])
        found, expected = found[:, own][:, :, own], expected[:, own][:, :, own]
        assert expected[:, -1, -1].min() > 0
    assert_information(found, expected, SAGGING if which == "heavy" else DIFFERENCES)
    assert reading.rate == rate == pytest.approx(instrument.rate)


@pytest.mark.parametrize("which", ["tight", "bare"])
def test_derivatives_of_readings_change_along_the_command_as_differences_say(which):
    rng, commands = np.random.default_rng(5), commands_at(INSTANTS)
    for reading in plan(which).predicted_elsewhere.instruments:
        at = reading.derivatives(commands)
        # Each column in its own unit: they differ by many orders.
        unit = [np.maximum(np.sqrt(np.mean(each**2, axis=(0, 1))), 1e-6) for each in at]
        weight = [rng.normal(size=each.shape) / size for each, size in zip(at, unit, strict=True)]

        def total(rows, reading=reading, weight=weight):
            repeated = [np.repeat(each, len(rows) // len(each), axis=0) for each in weight]
            return sum(
                np.sum(w * d, axis=(1, 2))
                for w, d in zip(repeated, reading.derivatives(rows), strict=True)
            )

        assert_near(reading.gradient(commands, *weight), in_every_way(total, commands), DIFFERENCES)


# Predicted information


@pytest.mark.slow
@pytest.mark.integration
@pytest.mark.parametrize(
    "which",
    [
        *("unsure", "late"),
        *(w for w in ELSEWHERE if w not in ("rollers", "tight")),
        *(STRETCHING, REMEMBERING),
    ],
)
def test_predicted_information_is_that_of_the_bound_of_noise_free_recordings(which):
    found = plan(which)
    covariance = np.linalg.inv(found.information[0] + found.known)
    J = body_jacobian(found.joint.parameters)
    sigmas = np.sqrt(np.diag(J @ covariance[:TEN, :TEN] @ J.T))
    bound, relative = (
        found.joint.bound,
        {"heavy": GRID_SAG, "rollers": GRID_ROLLERS}.get(which, GRID),
    )
    np.testing.assert_allclose(sigmas, bound.standard_deviation, rtol=relative)
    # And so are the systematic errors known as well as they will be.
    active = found.calibration_parameters.deviation > 0
    errors = np.sqrt(np.diag(covariance)[TEN:])
    np.testing.assert_allclose(errors, np.sqrt(np.diag(bound.calibration)[active]), rtol=relative)


@pytest.mark.slow
@pytest.mark.integration
@pytest.mark.parametrize("which", ["unsure", "tight", "bare"])
def test_information_changes_along_the_commands_as_differences_say(which):
    found, rng = plan(which), np.random.default_rng(6)
    information, terms = found.information
    size = 1 / np.sqrt(np.diag(information + found.known))
    half = rng.normal(size=information.shape)
    weights = [(half + half.T) * np.outer(size, size), criterion_of(found).value(information)[1]]
    for weight in weights:
        slope = found.predicted.gradient(terms, weight)
        ways = rng.normal(size=(4, *found.commands.shape)) * np.repeat(
            [0.1, 0.3, 1.0, 1.0], COORDINATES
        )
        for way in ways:

            def total(commands, weight=weight):
                return np.sum(weight * found.predicted.information(commands)[0])

            expected = central(total, found.commands, way)
            # A sum of many signs may nearly vanish: against the size of what is summed.
            np.testing.assert_allclose(
                np.sum(slope * way),
                expected,
                rtol=1e-5,
                atol=1e-6 * np.sqrt(np.sum((slope * way) ** 2)),
            )


@pytest.mark.parametrize("which", ["unsure", "heavy", "bare"])
def test_information_of_instants_and_smoothness_add_up_to_the_whole(which):
    found = plan(which)
    information, terms = found.information
    J = body_jacobian(found.point.parameters)
    ways = np.linalg.inv(information + found.known)[:, :TEN] @ J.T
    shares = found.predicted.shares(terms, ways)
    assert shares.shape == (len(found.predicted.times), TEN)
    assert np.all(shares >= 0)
    # Motions that go with the body cost what holds them: their smoothness, and quaternions of
    # length one in a hall.
    held = holding_rows(found.segment)
    band = accumulate(len(found.segment.coefficients), 0, [held]).band
    band = band + sum(
        found.segment.jerks[part] / value for part, value in found.segment.smoothness.items()
    )
    holding = []
    for way in ways.T:
        moved = -np.linalg.solve(dense(terms.equations.band), terms.equations.side @ way)
        holding.append(moved @ banded_product(band, moved))
    whole = np.einsum("id,ij,jd->d", ways, information, ways)
    np.testing.assert_allclose(shares.sum(axis=0) + holding, whole, rtol=1e-7)
    # With the priors it is the whole of each parameter.
    variance = np.diag(J @ np.linalg.inv(information + found.known)[:TEN, :TEN] @ J.T)
    prior = np.einsum("id,ij,jd->d", ways, found.known, ways)
    np.testing.assert_allclose(whole + prior, variance, rtol=1e-7)


def dense(band):
    """A symmetric matrix in lower banded form, written out."""
    size = band.shape[1]
    found = np.diag(band[0])
    for d in range(1, len(band)):
        i = np.arange(size - d)
        found[i + d, i] = found[i, i + d] = band[d, : size - d]
    return found


@pytest.mark.slow
@pytest.mark.integration
def test_shares_of_information_and_priors_add_up_to_one():
    found = plan("bare")
    target, margin = Target.default(BODY), Margin(0.2, 1.0)
    evaluation = evaluate_motions(
        found.experiment, {"run": MOTION}, target=target, margin=margin, level=0.0
    )
    np.testing.assert_allclose(
        evaluation.standard_deviation, np.sqrt(np.diag(found.joint.body_covariance)), rtol=1e-6
    )
    # Noise in the derivatives costs next to nothing in a lively motion.
    bound = found.joint.bound.standard_deviation
    assert np.all(evaluation.standard_deviation >= bound)
    np.testing.assert_allclose(evaluation.standard_deviation, bound, rtol=2e-3)
    J = body_jacobian(found.point.parameters)
    ways = np.linalg.inv(found.information[0] + found.known)[:, :TEN] @ J.T
    known = np.einsum("id,ij,jd->d", ways, found.known, ways) / np.einsum("di,id->d", J, ways[:TEN])
    shares = evaluation.information_shares["run"]
    # Each instant stands for the time around it, all together for the whole run.
    step = shares.time[1] - shares.time[0]
    np.testing.assert_allclose([shares.time[0], DURATION - shares.time[-1]], step / 2, rtol=1e-9)
    np.testing.assert_allclose(shares.share.sum(axis=0) * step + known, 1.0, atol=0.005)
    assert known.max() > 0.01


# The criterion


def criterion_of(found):
    return OptimalityCriterion.with_floor(
        found.point.parameters, Target.default(BODY), found.known, found.information[0]
    )


def test_ratios_are_those_of_the_inverse_of_the_information():
    found = plan("unsure")
    target = Target(0.5, 0.003, 2.0)
    wanted = np.array([0.5, *[0.003] * 3, *[2.0] * 6])
    criterion = OptimalityCriterion(BODY.parameters, target, found.known, np.zeros(TEN))
    information = found.information[0]
    inverse = np.linalg.inv(information + found.known)
    assert_near(criterion.covariance(information), inverse, 1e-7)
    J = body_jacobian(BODY.parameters)
    expected = np.sqrt(np.diag(J @ inverse[:TEN, :TEN] @ J.T)) / wanted
    ratios, by = criterion.ratios(information)
    np.testing.assert_allclose(ratios, expected, rtol=1e-7)
    assert_near(by, inverse[:, :TEN] @ J.T / wanted, 1e-7)
    value, _ = criterion.value(information)
    assert value == pytest.approx(np.log(np.linalg.norm(expected, 4)), abs=1e-7)
    # The worst of them weighs most: their norm is no less, and no more than ten of its kind.
    assert np.log(expected.max()) <= value <= np.log(expected.max() * TEN**0.25)


@pytest.mark.parametrize("which", ["unsure", "gains"])
def test_the_criterion_changes_with_the_information_as_differences_say(which):
    found, rng = plan(which), np.random.default_rng(7)
    information, criterion = found.information[0], criterion_of(plan(which))
    value, slope = criterion.value(information)
    assert_near(slope, slope.T, 1e-14)
    left = criterion.ratios(information)[0] ** 2 - criterion.variance_floor
    assert value == pytest.approx(np.log(np.sqrt(np.linalg.norm(left))), abs=1e-9)
    # In units of how well each is known, or hardly any change would leave the matrix positive.
    root = np.linalg.cholesky(information + found.known)
    for _ in range(5):
        half = rng.normal(size=information.shape) / len(information)
        way = root @ (half + half.T) @ root.T
        expected = central(lambda each: criterion.value(each)[0], information, way)
        np.testing.assert_allclose(np.sum(slope * way), expected, rtol=1e-6)


def test_no_motion_identifies_a_gain_that_all_force_sensors_share():
    # Eight gains of 1 % and one of .5 % that all share: heavier bodies on sensors that read less
    # look the same. What the eight have in common no motion identifies, how they differ is.
    found = plan("gains")
    common = np.hypot(0.01 / np.sqrt(8), 0.005)
    target = Target.default(BODY)
    each = np.array([target.mass, *[target.cog] * 3, *[target.inertia] * 6])
    floor = np.sqrt(criterion_of(found).variance_floor) * each
    body = np.abs(Inertia.from_parameters(found.point.parameters).body_parameters)
    np.testing.assert_allclose(floor[[0, 4, 5, 6]], common * body[[0, 4, 5, 6]], rtol=0.01)
    # The centre of gravity is where it is on any scale.
    assert np.all(floor[1:4] < 0.02 * target.cog)


def test_the_wanted_is_a_hundredth_of_mass_and_largest_moment_and_two_millimetres():
    np.testing.assert_allclose(
        Target.default(BODY).each, [1.61058, 0.002, 0.002, 0.002, *[0.94955] * 6], rtol=1e-12
    )


# What a command constraints

LIMITED = replace(STRAIGHT, limits=replace(STRAIGHT.limits, cable_speed=1.7))
TRACKER = changed(
    paper_sensors(HEAVY).instruments["tracker"], limits={"speed": 2.5, "acceleration": 4.0}
)
MARGIN = Margin(0.2, STRAIGHT.size)
SHARE = 0.85


@cache
def constraints(level=0.0):
    suite = {**paper_sensors(HEAVY).instruments, "tracker": TRACKER}
    return MotionConstraints(LIMITED, suite, MARGIN, level, SHARE)


def constrained(commands, level=0.0):
    """Name -> values, shape (n, k)."""
    values = constraints(level).values(commands[:, :COMMAND])
    names = np.array(constraints(level).names)
    return {name: values[:, names == name] for name in dict.fromkeys(names)}


@pytest.mark.integration
def test_a_command_uses_its_part_of_every_limit():
    commands = random_commands(20)
    commands[:, 18:] = 0.0
    found = constrained(commands)
    limits = STRAIGHT.limits
    for name, six, box in (
        ("position", slice(0, 3), limits.position),
        ("orientation", slice(3, 6), limits.rpy),
    ):
        low, high = np.array(box)
        beyond = 2 * (commands[:, six] - low) / (high - low) - 1
        np.testing.assert_allclose(found[name], np.hstack([beyond, -beyond]), atol=1e-12)
    _, _, velocity, acceleration, omega, alpha, _ = motions(commands)
    target = np.array(TRACKER.target)
    flown = [lambda t, c=c: moved(c)[0](t) + moved(c)[1](t).apply(target) for c in commands]
    sizes = {
        "speed": (velocity, limits.speed),
        "acceleration": (acceleration, limits.acceleration),
        "angular speed": (omega, limits.angular_speed),
        "angular acceleration": (alpha, limits.angular_acceleration),
        "speed of the target of 'tracker'": (np.array([over_time(each, 1) for each in flown]), 2.5),
        "acceleration of the target of 'tracker'": (
            np.array([over_time(each, 2) for each in flown]),
            4.0,
        ),
    }
    for name, (vectors, limit) in sizes.items():
        used = np.linalg.norm(vectors, axis=1) / (SHARE * limit)
        np.testing.assert_allclose(found[name][:, 0], used**2, rtol=1e-8, err_msg=name)
    assert list(found) == [
        "position", "orientation", *sizes, "cable speed", "tension", "tension at rest",
    ]  # fmt: skip


@pytest.mark.integration
def test_cables_are_fed_as_fast_as_their_lengths_change_in_time():
    commands = random_commands(20)
    found = constrained(commands)["cable speed"]
    for each, command in zip(found, commands, strict=True):
        position, rotation = moved(command)

        def lengths(t, position=position, rotation=rotation):
            # From the rollers; under no tension, since those of verified cables stretch.
            R = rotation(t).as_matrix()[None]
            return cables_at(LIMITED, position(t)[None], R, np.zeros(8)).length[0]

        shorter = -over_time(lengths, 1) / (SHARE * 1.7)
        np.testing.assert_allclose(each, np.concatenate([shorter, -shorter]), atol=1e-9)


def test_what_has_no_limit_constrains_nothing():
    free = replace(LIMITED, limits=type(LIMITED.limits)(), tension_limits=(50.0, np.inf))
    names = MotionConstraints(free, paper_sensors(HEAVY).instruments, MARGIN, 0.0, SHARE).names
    # Of the least tensions alone.
    assert names == ("tension",) * 8 + ("tension at rest",) * 8
    assert MotionConstraints(replace(BARE, limits=STRAIGHT.limits), {}, MARGIN, 0.0, SHARE).names == (
        *("position",) * 6, *("orientation",) * 6, "speed", "acceleration", "angular speed", "angular acceleration",
    )  # fmt: skip


def bodies_around(n, seed=8):
    """Bodies within the margin, half of them at its edges: the share by which mass and inertia are
    scaled, and the body."""
    rng = np.random.default_rng(seed)
    for i in range(n):
        share = MARGIN.share * (rng.uniform(-1, 1) if i % 2 else rng.choice([-1, 1]))
        way = rng.normal(size=3)
        shift = (
            MARGIN.cog_offset
            * (rng.uniform() ** (1 / 3) if i % 2 else 1.0)
            * way
            / np.linalg.norm(way)
        )
        scale = 1 + share
        yield (
            scale,
            Inertia(scale * BODY.mass, BODY.center_of_gravity + shift, scale * BODY.inertia),
        )


@pytest.mark.integration
@pytest.mark.parametrize("level", [0.0, TIGHT])
@pytest.mark.parametrize("name", ["tension", "tension at rest"])
def test_bodies_within_the_margin_are_moved_by_the_tensions_that_are_constrained(name, level):
    assert MARGIN.cog_offset == pytest.approx(0.2 * LIMITED.size / 2.5)
    commands = random_commands(30)
    commands[:, COORDINATES:] *= 0.7  # as gentle as the robot's limits ask for
    found = constrained(commands, level)[name]
    low, high = LIMITED.tension_limits
    unit = BODY.mass * 9.81 / 2
    least, most = low + unit * (1 - found[:, :8]), high + unit * (found[:, 8:] - 1)
    if name == "tension at rest":
        commands[:, COORDINATES:] = 0.0
    position, R, _, _, omega, alpha, s = motions(commands)
    W = structure_of(LIMITED, position, R)
    inverse, even = np.linalg.pinv(W), np.full(8, level)
    tension, by_shift = [], []
    for scale, body in bodies_around(300):
        wrench = moving_wrench(body, s, omega, alpha)
        tension.append(even + np.einsum("nmk,nk->nm", inverse, wrench - W @ even))
        # What a shift changes of the inertia about the origin, beside the first moment, which is
        # all that is constrained.
        further = body.inertia_about_origin - scale * BODY.inertia_about_origin
        torque = alpha @ further + np.cross(omega, omega @ further)
        by_shift.append(np.einsum("nmk,nk->nm", inverse[:, :, 3:], torque))
    lowest, highest = np.min(tension, axis=0), np.max(tension, axis=0)
    slack = np.abs(by_shift).max(axis=0)
    assert slack.max() < BY_SHIFT * unit
    assert np.all(lowest > least - slack - 1e-6)
    assert np.all(highest < most + slack + 1e-6)
    # Some body needs nearly these. The light body's mass is taken to be shifted as that of the
    # heavy one would be.
    np.testing.assert_allclose(lowest, least, rtol=0, atol=0.05 * unit)
    np.testing.assert_allclose(highest, most, rtol=0, atol=0.02 * unit)


@pytest.mark.integration
@pytest.mark.parametrize("level", [0.0, TIGHT])
def test_constraints_change_along_the_command_as_differences_say(level):
    commands = random_commands(10, seed=9)[:, :COMMAND]
    values, slope = constraints(level).linearised(commands)
    np.testing.assert_allclose(values, constraints(level).values(commands), atol=1e-12)
    assert slope.shape == (10, len(constraints(level).names), COMMAND)
    assert_near(slope, in_every_way(constraints(level).values, commands), DIFFERENCES)


# Vibration on elastic cables


LIVELY = MotionSpline(START, START, 6.0, 11, REACH)


@cache
def vibration():
    return CableVibration(
        LIMITED,
        LIVELY.midpoints(SETTINGS.vibration_instants),
        natural_frequencies(LIMITED, START, 0.0)[0],
    )


def vibration_commands():
    x = 0.05 * np.random.default_rng(2).normal(size=LIVELY.size)
    return LIVELY.at(vibration().times).commands(x)[:, :COMMAND]


def stiffness_of(robot, position, R):
    """Of straight elastic cables that pull nothing, and their structure matrix."""
    W = structure_of(robot, position, R)
    corners = position[:, None] + np.einsum("nij,mj->nmi", R, robot.attachments)
    length = np.linalg.norm(robot.anchors - corners, axis=2)
    return np.einsum("nim,nm,njm->nij", W, robot.cable.axial_stiffness / length, W)


def test_natural_frequencies_follow_from_stiffness_and_mass():
    # That of the cables alone: what they pull turns with the platform, and stiffens it by another
    # per cent.
    R = Rotation.from_euler("ZYX", START[:2:-1]).as_matrix()[None]
    (stiffness,) = stiffness_of(LIMITED, START[None, :3], R)
    mass = np.array([moving_wrench(BODY, way[:3], np.zeros(3), way[3:]) for way in np.eye(6)]).T
    expected = np.sort(np.sqrt(np.linalg.eigvals(np.linalg.solve(mass, stiffness)).real)) / (
        2 * np.pi
    )
    np.testing.assert_allclose(natural_frequencies(LIMITED, START, 0.0), expected, rtol=0.02)


@pytest.mark.integration
def test_vibration_is_what_stretched_cables_add_in_the_band_of_their_resonance():
    found, commands = vibration(), vibration_commands()
    position, R, _, _, omega, alpha, s = motions(commands)
    stiffness = stiffness_of(LIMITED, position, R)
    still = np.zeros((len(R), 3))
    hanging = moving_wrench(BODY, -np.einsum("nji,j->ni", R, LIMITED.gravity), still, still)
    bent = np.linalg.solve(stiffness, (moving_wrench(BODY, s, omega, alpha) - hanging)[:, :, None])[
        :, :, 0
    ]
    bent = np.hstack([np.einsum("nij,nj->ni", R, part) for part in (bent[:, :3], bent[:, 3:])])
    # Differentiated twice and cut off below the band in frequency; the mean square of what is left,
    # without the last frequency.
    n, step = len(found.times), found.times[1] - found.times[0]
    frequency = np.fft.rfftfreq(n, step)
    spectrum = np.fft.rfft(bent, axis=0) * -((2 * np.pi * frequency[:, None]) ** 2)
    spectrum[
        (frequency < SETTINGS.vibration_band * found.lowest_frequency)
        | (np.arange(len(frequency)) >= n // 2)
    ] = 0
    accelerated = np.fft.irfft(spectrum, n, axis=0)
    limits = np.repeat([LIMITED.limits.acceleration, LIMITED.limits.angular_acceleration], 3)
    resonance = 1 / (2 * LIMITED.cable.damping_ratio)
    expected = np.sum(
        np.mean((accelerated * resonance / (SETTINGS.vibration_level * limits)) ** 2, axis=0)
    )
    value, _ = found.value(commands)
    assert expected > 1e-3
    assert value == pytest.approx(expected, rel=1e-7)


def test_vibration_changes_along_the_commands_as_differences_say():
    commands, rng = vibration_commands(), np.random.default_rng(10)
    _, slope = vibration().value(commands)
    for _ in range(6):
        way = rng.normal(size=commands.shape)
        expected = central(lambda c: vibration().value(c)[0], commands, way)
        np.testing.assert_allclose(
            np.sum(slope * way),
            expected,
            rtol=DIFFERENCES,
            atol=DIFFERENCES * np.linalg.norm(slope),
        )


# The search


@cache
def problem():
    pose = np.array([0, 0, 1.5, 0, 0, 0.0])
    spline = MotionSpline(pose, pose, DURATION, 8, REACH)
    found = plan("unsure")
    lowest = natural_frequencies(LIMITED, pose, 0.0)[0]
    vibrates = CableVibration(LIMITED, spline.midpoints(SETTINGS.vibration_instants), lowest)
    return DesignProblem(spline, found.predicted, criterion_of(found), constraints(), vibrates)


@cache
def beginning():
    """A gentle motion that keeps all limits."""
    motion = multisine([0, 0, 1.5, 0, 0, 0], [0.4, 0.3, 0.2, 0.1, 0.1, 0.15], DURATION, 3, seed=3)
    return problem().spline.fitted_to(motion)


@pytest.mark.integration
def test_the_objective_changes_with_the_motion_as_differences_say():
    x, rng = beginning(), np.random.default_rng(11)
    value, slope = problem().objective(x)
    gradient = slope()
    assert gradient.shape == x.shape
    assert value == problem().criterion.value(problem().information(x)[0])[0]
    for way in [*np.eye(len(x))[::7], *rng.normal(size=(3, len(x)))]:
        expected = central(lambda each: problem().objective(each)[0], x, way)
        np.testing.assert_allclose(
            gradient @ way, expected, rtol=1e-5, atol=1e-6 * np.linalg.norm(gradient)
        )


@pytest.mark.integration
def test_the_constraints_change_with_the_motion_as_differences_say():
    x = beginning()
    value, jacobian = problem().constraints(x)
    matrix = jacobian.toarray()
    assert len(value) == 5 * 8 * len(constraints().names) + 1
    # Each entry once, or the solver would take one of them.
    assert len(set(zip(jacobian.row, jacobian.col, strict=True))) == jacobian.nnz
    ways = np.random.default_rng(12).normal(size=(3, len(x)))
    for way in [*np.eye(len(x))[3::11], *ways]:
        expected = central(lambda each: problem().constraints(each)[0], x, way)
        assert_near((matrix @ way)[:-1], expected[:-1], DIFFERENCES)
        np.testing.assert_allclose(
            matrix[-1] @ way, expected[-1], atol=DIFFERENCES * np.linalg.norm(matrix[-1])
        )
    # They are those of the trajectory itself.
    spline = problem().spline
    times = spline.midpoints(5)
    commands = np.hstack([spline.trajectory(x).derivative(times, order) for order in range(3)])
    np.testing.assert_allclose(value[:-1], constraints().values(commands).ravel(), atol=1e-10)


STEPS = 6


@cache
def searched():
    progress = []
    return (
        problem().search(
            beginning(), steps=STEPS, seconds=600.0, progress=lambda *news: progress.append(news)
        ),
        progress,
    )


@pytest.mark.integration
def test_a_search_of_a_few_steps_makes_the_experiment_better_within_the_limits():
    found, progress = searched()
    before = problem().objective(beginning())[0]
    assert problem().constraints(beginning())[0].max() < 1
    assert found.value == problem().objective(found.x)[0]
    assert found.excess == problem().constraints(found.x)[0].max() - 1
    assert found.in_time
    assert found.steps == STEPS
    assert progress[0] == (1, before)
    assert [step for step, _ in progress] == list(range(1, len(progress) + 1))
    # A search that is broken off may stand outside the limits for the moment; then the best within
    # them is at hand.
    kept = found.best_feasible
    assert problem().constraints(kept)[0].max() <= 1.01
    # By a third at least of all 1-sigma together.
    assert problem().objective(kept)[0] < before - 0.4
    # Not above the limits between the instants either that are looked at.
    times = np.linspace(0, DURATION, 500)
    motion = problem().spline.trajectory(kept)
    commands = np.hstack([motion.derivative(times, order) for order in range(3)])
    assert constraints().values(commands).max() < 1.02


@pytest.mark.integration
def test_the_same_start_ends_in_the_same_motion_to_the_last_bit():
    found, _ = searched()
    again = problem().search(beginning(), steps=STEPS, seconds=600.0)
    np.testing.assert_array_equal(again.x, found.x)
    assert (again.value, again.excess, again.steps) == (found.value, found.excess, found.steps)
