"""Force sensors at the winch: weight and roller against integrals and differences, and what the
methods make of their readings."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from places import DATA
from scipy.integrate import solve_ivp
from scipy.optimize import root
from scipy.spatial.transform import Rotation
from scipy.stats import chi2
from simulated import EXACT, PAPER, changed

from steelyard.errors import InputError
from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run, Stream
from steelyard.experiment.write import write_experiment
from steelyard.identification.identify import identify
from steelyard.identification.methods.consistent import Consistent
from steelyard.identification.methods.instrumental_variables import InstrumentalVariables
from steelyard.identification.methods.least_squares import LeastSquares
from steelyard.identification.methods.maximum_likelihood import MaximumLikelihood
from steelyard.identification.methods.two_step import TwoStep
from steelyard.identification.solve.held_motion import fit_with_held_motion
from steelyard.identification.verdict.prediction import predict_held_out
from steelyard.instruments import Pose, Tension
from steelyard.instruments.equations import (
    following,
    means,
    predict,
    solve_for,
)
from steelyard.instruments.tension import rolled, rolled_along
from steelyard.motion.state import State, motion_of_poses
from steelyard.motion.trajectory import RestToRest
from steelyard.robot.file import read_robot
from steelyard.robot.kinematics import cables_at
from steelyard.robot.model import CableProperties
from steelyard.simulation.forward_dynamics import CablePlatform
from steelyard.simulation.recording import draw_errors, record
from steelyard.simulation.response import ExactMotion
from steelyard.simulation.sensors import read_sensors
from steelyard.simulation.simulate import simulate
from steelyard.simulation.trajectories import feasible_multisine

ROBOT = read_robot("cogiro")  # hanging cables over rollers
STRAIGHT = ROBOT.with_straight_cables()
POINTS = replace(ROBOT, pulley_radius=np.zeros(8))
HEAVY = replace(POINTS, cable=CableProperties(linear_density=0.5, axial_stiffness=2e4))
TRUTH = ROBOT.platform.body_parameters
RARE = 1e-4  # of sound data that would fail
TURNAROUND = 0.01  # [m/s]


def winch(friction=0.03, **calibration):
    """Sensors like those of the paper, but behind rollers."""
    none = {"offset": 5.0, "gain": 0.0, "common_gain": 0.0, "friction": friction}
    keys = {"kind": "tension", "end": "winch", "clock": "recorder", "rate": 25.0, "noise": 5.0}
    return Tension.model_validate({**keys, "calibration": {**none, **calibration}})


WINCH = winch()


def states(n, seed=3):
    """Poses in the robot, moving with half a metre and half a radian a second, under tensions of
    all sizes."""
    rng = np.random.default_rng(seed)
    return State(
        position=rng.uniform([-3, -2, 0.5], [3, 2, 3], (n, 3)),
        rotation=Rotation.from_euler("ZYX", rng.uniform(-0.6, 0.6, (n, 3))).as_matrix(),
        velocity=rng.normal(0, 0.5, (n, 3)),
        omega=rng.normal(0, 0.5, (n, 3)),
        specific_force=np.tile([0, 0, 9.81], (n, 1)),
        alpha=np.zeros((n, 3)),
        tension=rng.uniform(80, 2000, (n, 8)),
        wrench=np.zeros((n, 6)),
        gravity=ROBOT.gravity,
    )


def read(state, robot=ROBOT, instrument=WINCH, **errors):
    calibration = {**means(instrument, 8), **errors}
    return predict(instrument, robot, state, calibration)["tension"]


# The weight that hangs between


def rolled_up(robot, state, i, k):
    """Tension at the far end of a cable [N], by integrating its equations from the platform until
    it ends at its anchor."""
    weight, compliance = robot.cable.linear_density * 9.81, 1 / robot.cable.axial_stiffness
    corner = state.position[k] + state.rotation[k] @ robot.attachments[i]
    line = robot.anchors[i] - corner
    across = np.array([*line[:2], 0.0]) / np.linalg.norm(line[:2])

    def shape(start):
        angle, length = start
        pull = state.tension[k, i] * (np.cos(angle) * across + np.sin(angle) * np.array([0, 0, 1]))

        def element(s, y):
            force = pull + weight * s * np.array([0, 0, 1])
            return force * (1 / np.linalg.norm(force) + compliance)

        end = solve_ivp(element, (0, length), corner, method="DOP853", rtol=1e-11, atol=1e-11).y[
            :, -1
        ]
        return end, np.linalg.norm(pull + weight * length * np.array([0, 0, 1]))

    def missed(start):
        off = shape(start)[0] - robot.anchors[i]
        return [off @ across, off[2]]

    found = root(
        missed, [np.arctan2(line[2], np.linalg.norm(line[:2])), np.linalg.norm(line)], tol=1e-12
    )
    assert np.abs(missed(found.x)).max() < 1e-9
    return shape(found.x)[1]


@pytest.mark.parametrize("robot", [POINTS, HEAVY])
def test_the_winch_carries_what_the_integrated_catenary_carries_there(robot):
    state = states(2)
    readings = read(state, robot)
    for k, i in np.ndindex(2, 8):
        assert readings[k, i] == pytest.approx(rolled_up(robot, state, i, k), rel=1e-9)


@pytest.mark.parametrize("stiffness", [5e5, 1e4])
def test_along_a_cable_tension_and_stretch_trade_for_height(stiffness):
    # Whatever moves a metre of cable along itself does no work: T + T^2 / 2 EA - w z is the same at
    # both ends.
    robot = replace(ROBOT, cable=CableProperties(linear_density=0.3, axial_stiffness=stiffness))
    state = states(40)
    found = cables_at(robot, state.position, state.rotation, state.tension)
    corners = state.position[:, None] + np.einsum("nij,mj->nmi", state.rotation, robot.attachments)
    # Where the cable leaves its roller: its end square to a radius of the circle in its plane.
    outward = corners - robot.anchors
    outward[:, :, 2] = 0
    outward /= np.linalg.norm(outward, axis=2, keepdims=True)
    end = found.direction * state.tension[:, :, None] + 0.3 * 9.81 * found.length[:, :, None] * [
        0,
        0,
        1,
    ]
    slope = np.arctan2(end[:, :, 2], -np.sum(end * outward, axis=2))
    top = robot.anchors[:, 2] + robot.pulley_radius * np.sin(np.pi - (np.pi / 2 + slope))
    energy = [t + t**2 / (2 * stiffness) for t in (read(state, robot), state.tension)]
    # The cable on the roller is counted with the free one in `end`, which turns it by next to
    # nothing.
    np.testing.assert_allclose(
        energy[0] - energy[1], 0.3 * 9.81 * (top - corners[:, :, 2]), atol=1e-3
    )


def test_readings_of_slack_cables_are_numbers_and_follow_the_tension():
    # As spikes have them: below nothing, and less than a cable needs to bear itself.
    slack = np.tile(np.linspace(-60, 40, 101)[:, None], (1, 8))
    place = {
        k: np.repeat(v[:1], 101, axis=0)
        for k, v in vars(states(1)).items()
        if v is not None and k not in {"gravity", "tension"}
    }
    found = read(State(**place, tension=slack, gravity=ROBOT.gravity))
    assert (np.diff(found, axis=0) > 0.9).all()
    np.testing.assert_allclose(
        solve_for("tension", WINCH, ROBOT, {"tension": found}, place), slack, atol=1e-9
    )


# The roller


def growth(robot, state, h=1e-4):
    """Rates of the cables' lengths by differences [m/s]."""
    turn = Rotation.from_matrix(state.rotation)
    lengths = [
        cables_at(
            robot,
            state.position + s * h * state.velocity,
            (turn * Rotation.from_rotvec(s * h * state.omega)).as_matrix(),
            np.ones(8),
        ).length
        for s in (-1, 1)
    ]
    return (lengths[1] - lengths[0]) / (2 * h)


@pytest.mark.parametrize("radius", [0.0, 0.05, 0.4])
def test_a_roller_takes_its_part_by_how_the_length_of_its_cable_changes(radius):
    robot = replace(STRAIGHT, cable=CableProperties(), pulley_radius=np.full(8, radius))
    state, friction = states(50), np.linspace(0.01, 0.08, 8)
    fast, slow = (
        replace(state, velocity=c * state.velocity, omega=c * state.omega) for c in (1.0, 0.01)
    )
    for moving in (fast, slow):
        rate = growth(robot, moving)
        expected = state.tension * (1 - friction * np.tanh(rate / TURNAROUND))
        np.testing.assert_allclose(read(moving, robot, friction=friction), expected, rtol=1e-7)
        assert np.sum(np.abs(rate) < 2 * TURNAROUND) > (100 if moving is slow else 0)


def test_paying_out_lowers_the_reading_and_hauling_in_raises_it():
    still = np.zeros((1, 3))
    state = replace(
        states(1), velocity=np.array([[0, 0, -2.0]]), omega=still
    )  # all anchors are above: cables get longer
    friction = np.full(8, 0.03)
    down, rest, up = (
        read(replace(state, velocity=s * state.velocity), friction=friction) for s in (1, 0, -1)
    )
    np.testing.assert_allclose(down, 0.97 * rest, rtol=1e-9)
    np.testing.assert_allclose(up, 1.03 * rest, rtol=1e-9)
    # The weight has passed the roller too.
    np.testing.assert_allclose(
        rest, cables_at(ROBOT, state.position, state.rotation, state.tension).winch_tension
    )


@pytest.mark.integration
def test_sag_and_stretch_change_a_rate_by_little():
    # What the winches of a platform that moves in earnest feed, against straight cables: less than
    # v, and hundredths of the rate.
    motion, times = rig()[1], np.linspace(0.5, 7.5, 300)
    state = motion.at(times)
    fed = [
        cables_at(ROBOT, s.position, s.rotation, s.tension).length
        for s in (motion.at(times - 1e-3), motion.at(times + 1e-3))
    ]
    off = (fed[1] - fed[0]) / 2e-3 - growth(STRAIGHT, state)
    assert np.sqrt(np.mean(off**2)) < TURNAROUND
    assert np.sqrt(np.mean(off**2)) < 0.05 * np.sqrt(np.mean(growth(STRAIGHT, state) ** 2))


# Backwards, and how it follows the motion

STEP = 1e-6
DIFFERENCES = 1e-6  # relative to the largest


@pytest.mark.integration
@pytest.mark.parametrize("robot", [STRAIGHT, ROBOT, HEAVY])
def test_the_tension_at_the_platform_follows_pose_and_rate_as_differences_say(robot):
    rng = np.random.default_rng(2)
    n, friction = 6, np.linspace(0.01, 0.08, 8)
    state = states(n)
    quaternion = Rotation.from_matrix(state.rotation).as_quat(scalar_first=True) * rng.uniform(
        0.8, 1.2, (n, 1)
    )
    pose = np.hstack([state.position, quaternion])
    # Slow enough that rollers turn around.
    rate = np.hstack([0.02 * state.velocity, 0.02 * rng.normal(size=(n, 4))])
    calibration = {**means(WINCH, 8), "friction": friction}

    readings = {"tension": np.full((n, 8), 700.0)}

    def tension(pose, rate):
        turn = Rotation.from_quat(pose[:, 3:], scalar_first=True)
        q, dq = pose[:, 3:], rate[:, 3:]
        # 2 q* dq over the square of its length.
        turning = q[:, :1] * dq[:, 1:] - dq[:, :1] * q[:, 1:] - np.cross(q[:, 1:], dq[:, 1:])
        given = {
            "position": pose[:, :3],
            "rotation": turn.as_matrix(),
            "velocity": rate[:, :3],
            "omega": 2 * turning / np.sum(q**2, axis=1, keepdims=True),
        }
        return solve_for("tension", WINCH, robot, readings, given, calibration)

    at = tension(pose, rate)
    by_pose, by_rate = following(
        "tension", WINCH, robot, ("tension",), (pose, rate), at, calibration
    )
    for found, change in (
        (by_pose, lambda d: (pose + d, rate)),
        (by_rate, lambda d: (pose, rate + d)),
    ):
        expected = np.stack(
            [
                (tension(*change(STEP * e)) - tension(*change(-STEP * e))) / (2 * STEP)
                for e in np.eye(7)
            ],
            axis=2,
        )
        np.testing.assert_allclose(found, expected, atol=DIFFERENCES * np.abs(expected).max())


def test_at_the_platform_end_nothing_follows_the_motion():
    sensor = Tension(kind="tension")
    state = states(2)
    assert (
        following(
            "tension",
            sensor,
            ROBOT,
            ("tension",),
            (np.ones((2, 7)),) * 2,
            state.tension,
            means(sensor, 8),
        )
        is None
    )


# What the file says


def test_friction_belongs_to_the_winch(tmp_path):
    assert "friction" not in {term.key for term in Tension(kind="tension").terms(8)}
    (default,) = (t for t in Tension(kind="tension", end="winch").terms(8) if t.key == "friction")
    assert (default.unit, default.size) == ("1", 8)
    np.testing.assert_array_equal(default.mean, 0.0)
    np.testing.assert_array_equal(default.deviation, 0.02)
    (stated,) = (
        t
        for t in winch({"value": 0.03, "sigma": 0.01, "per": "run"}).terms(8)
        if t.key == "friction"
    )
    assert (stated.mean[0], stated.deviation[0], stated.prior.per) == (0.03, 0.01, "run")
    text = "instruments:\n  cables: {kind: tension, rate: 25, calibration: {friction: 0.02}}\n"
    (tmp_path / "sensors.yaml").write_text(text)
    with pytest.raises(
        InputError,
        match=r"sensors\.yaml.*cables.*no key 'friction'.*remove it, or add 'end: winch'",
    ):
        read_sensors(str(tmp_path / "sensors.yaml"), ROBOT)


def test_a_simulation_draws_friction_and_says_so(tmp_path):
    text = (
        "instruments:\n  cables: {kind: tension, end: winch, rate: 25, noise: 1, calibration:"
        " {friction: {value: 0.03, sigma: 0.005}}}\n"
    )
    (tmp_path / "sensors.yaml").write_text(text)
    move = {
        "move": RestToRest(np.array([0, 0, 2, 0, 0, 0.0]), np.array([0.3, 0, 1.7, 0, 0, 0.1]), 1.5)
    }
    made = simulate(ROBOT, move, read_sensors(str(tmp_path / "sensors.yaml"), ROBOT), seed=2)
    drawn = np.array(made.truth()["calibration"]["cables"]["friction"])
    assert drawn.shape == (8,)
    assert np.all(np.abs(drawn - 0.03) < 0.025)
    assert np.ptp(drawn) > 0
    (tmp_path / "written").mkdir()
    write_experiment(made.experiment, tmp_path / "written")
    described = (tmp_path / "written" / "experiment.yaml").read_text()
    assert "friction: {value: 0.03, sigma: 0.005}" in described
    assert "end: winch" in described


# Estimates


@cache
def rig(robot=ROBOT):
    """A command and what the platform did, on elastic cables that hang over rollers."""
    command = ExactMotion(robot, robot.platform, feasible_multisine(robot, 8.0))
    return command, CablePlatform(robot, robot.platform).move(command.trajectory)


def recorded(sensor, seed, runs=None):
    """An experiment, and what was drawn for its force sensors."""
    suite = {**PAPER, "cables": sensor}
    rng = np.random.default_rng(seed)
    runs = runs or {"run": rig()}
    drawn = draw_errors(suite, 8, list(runs), rng)
    made = []
    for name, (command, response) in runs.items():
        streams, sync = record(response, suite, drawn[name], ROBOT, command, rng)
        made.append(Run(name, streams, sync))
    cables = drawn[next(iter(runs))]["cables"].calibration
    return Experiment("winch", ROBOT, suite, tuple(made), uncertainty=EXACT), cables


def described(experiment, sensor):
    """The same recording with another description of its force sensors."""
    return replace(experiment, instruments={**experiment.instruments, "cables": sensor})


def chi_square(estimate):
    off = estimate.value - TRUTH
    return float(off @ np.linalg.solve(estimate.covariance, off))


RUBBING = winch({"value": 0.03, "sigma": 0.02})


@cache
def sound(seed):
    experiment, drawn = recorded(RUBBING, seed)
    return experiment, drawn, identify(experiment, [LeastSquares(), MaximumLikelihood()])


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("method", ["least-squares", "maximum-likelihood"])
def test_the_truth_is_within_what_is_stated(method):
    seeds = (1, 2, 3)
    ten, rollers = 0.0, 0.0
    for seed in seeds:
        _, drawn, found = sound(seed)
        estimate = found.estimates[method]
        assert estimate.verdict.accepted, estimate.verdict.reasons
        ten += chi_square(estimate)
        friction = estimate.calibration["cables"]["friction"]
        assert friction["standard_deviation"].max() < 0.002
        rollers += float(
            np.sum(((friction["value"] - drawn["friction"]) / friction["standard_deviation"]) ** 2)
        )
    low, high = chi2.ppf([RARE, 1 - RARE], 10 * len(seeds))
    assert low < ten < high
    # Frictions of one recording have part of their errors in common.
    assert rollers < chi2.ppf(1 - RARE, 8 * len(seeds))


@pytest.mark.slow
def test_the_bound_is_that_of_the_joint_fit():
    experiment, _, found = sound(1)
    alone = identify(experiment, [LeastSquares()]).bound.standard_deviation
    np.testing.assert_allclose(
        alone, found.estimates["maximum-likelihood"].standard_deviation, rtol=0.05
    )


@pytest.mark.slow
def test_other_methods_take_the_same_recording():
    experiment, _, found = sound(2)
    by_instruments = InstrumentalVariables()(experiment)
    assert by_instruments.verdict.accepted
    assert chi_square(by_instruments) < chi2.ppf(1 - RARE, 10)
    consistent = Consistent().of(fit_with_held_motion(experiment))
    assert consistent.physical
    np.testing.assert_allclose(
        consistent.value, found.estimates["least-squares"].value, rtol=1e-3, atol=1e-3
    )
    plain = TwoStep()(experiment)
    assert np.isfinite(plain.value).all()
    assert any("cables.friction" in note and "weight of the cables" in note for note in plain.notes)


FIVE = winch({"value": 0.05, "sigma": 0.0})


@pytest.mark.slow
@pytest.mark.long
def test_friction_that_is_left_out_is_noticed():
    experiment, _ = recorded(FIVE, 5)
    # With its prior it is found, two and a half times as far off as expected.
    found = LeastSquares()(described(experiment, winch(0.02)))
    assert found.verdict.accepted
    np.testing.assert_allclose(found.calibration["cables"]["friction"]["value"], 0.05, atol=0.006)
    without = MaximumLikelihood()(described(experiment, winch(0.0)))
    assert not without.verdict.accepted
    assert any("cables.friction of cable" in reason for reason in without.verdict.reasons)


@pytest.mark.slow
def test_sensors_at_the_winch_are_not_taken_for_some_at_the_platform():
    at_platform = {"kind": "tension", "clock": "recorder", "rate": 25.0, "noise": 5.0}
    experiment, _ = recorded(FIVE, 5)
    gains = {"offset": 5.0, "gain": 0.0, "common_gain": 0.0}
    wrong = LeastSquares()(
        described(experiment, Tension.model_validate({**at_platform, "calibration": gains}))
    )
    assert not wrong.verdict.accepted
    # On rollers without friction the weight of the cables is left, some newtons each: the body
    # seems to have it.
    smooth = winch({"value": 0.0, "sigma": 0.0}, offset=0.1)
    experiment, _ = recorded(smooth, 6)
    gains["offset"] = 0.1
    right, heavier = (
        LeastSquares()(described(experiment, sensor))
        for sensor in (smooth, Tension.model_validate({**at_platform, "calibration": gains}))
    )
    assert abs(right.value[0] - TRUTH[0]) < 4 * right.standard_deviation[0]
    assert heavier.value[0] - TRUTH[0] > 5 * heavier.standard_deviation[0]


@pytest.mark.integration
@pytest.mark.slow
def test_forces_of_a_run_left_out_are_predicted():
    experiment, _ = recorded(RUBBING, 8, {"a": rig(), "b": rig()})
    (found,) = predict_held_out(experiment, frozenset({"b"}))
    assert (found.error / found.noise).max() < 2.0


@pytest.mark.integration
def test_rollers_at_rest_hold_nothing_in_the_mean():
    rng = np.random.default_rng(4)
    poses = np.hstack(
        [rng.uniform([-2, -1.5, 1], [2, 1.5, 3], (30, 3)), rng.uniform(-0.4, 0.4, (30, 3))]
    )
    still = motion_of_poses(poses, np.zeros_like(poses), np.zeros_like(poses), ROBOT.gravity)
    body = ROBOT.platform
    force = body.mass * still["specific_force"]
    wrench = np.hstack([force, np.cross(body.center_of_gravity, force)])
    tension = np.full((30, 8), 600.0)
    for _ in range(4):
        W = cables_at(ROBOT, still["position"], still["rotation"], tension).structure
        missing = wrench - np.einsum("nkm,nm->nk", W, tension)
        tension = tension + np.einsum("nmk,nk->nm", np.linalg.pinv(W), missing)
    state = State(**still, tension=tension, wrench=wrench, gravity=ROBOT.gravity)
    none = {"misalignment": 0.0, "target": 0.0, "frame": {"position": 0.0, "rotation": 0.0}}
    pose = {"kind": "pose", "noise": {"position": 1e-4, "rotation": 1e-4}, "calibration": none}
    suite = {
        "cables": changed(RUBBING, calibration={"offset": 0.5}),
        "pose": Pose.model_validate(pose),
    }
    readings = read(state, friction=np.full(8, 0.05)) + rng.normal(0, 5.0, (30, 8))
    np.testing.assert_allclose(readings - read(state), 0, atol=30)
    streams = {
        "cables": Stream(np.arange(30.0), {"tension": readings}, "cables"),
        "pose": Stream(
            np.arange(30.0),
            {"position": still["position"], "orientation": still["rotation"]},
            "pose",
        ),
    }
    experiment = Experiment(
        "rest", ROBOT, suite, (Run("rest", streams, static=True),), uncertainty=EXACT
    )
    found = LeastSquares()(experiment)
    assert found.verdict.accepted, found.verdict.reasons
    assert abs(found.value[0] - TRUTH[0]) < 4 * found.standard_deviation[0]
    # They say nothing about friction.
    friction = found.calibration["cables"]["friction"]
    np.testing.assert_allclose(friction["standard_deviation"], 0.02, rtol=1e-6)


# What it remembers


@pytest.mark.integration
@pytest.mark.parametrize("start", [0.0, -0.8, 0.5])
@pytest.mark.parametrize("presliding", [0.0005, 0.003, 0.02])
def test_friction_builds_up_as_dahl_has_it(presliding, start):
    """Against a general solver of his differential equation."""
    times = np.linspace(0.0, 4.0, 401)

    def length(t):
        return 0.03 * np.sin(2 * t) + 0.01 * t

    def slope(t, z):
        rate = 0.06 * np.cos(2 * t) + 0.01
        return rate / presliding * (1 - z * np.sign(rate))

    expected = solve_ivp(
        slope, (0.0, 4.0), [start], t_eval=times, rtol=1e-8, atol=1e-10, max_step=0.001
    ).y[0]
    found = rolled(length(times)[:, None], presliding, np.array([start]))[0][:, 0]
    # Where a cable turns around between samples a travel of a tenth of a millimetre is lost.
    assert np.abs(found - expected).max() < 0.1
    assert np.sqrt(np.mean((found - expected) ** 2)) < 0.01


def test_a_cable_at_rest_forgets_nothing():
    lengths = np.array([[0.0], [0.01], [0.01], [0.01]])
    found = rolled(lengths, 0.01, np.zeros(1))[0][:, 0]
    assert found[1:] == pytest.approx(1 - np.exp(-1.0))


def wandering(seed: int, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Positions and rotations of a platform that turns around often."""
    rng = np.random.default_rng(seed)
    steps = 0.002 * np.cumsum(rng.normal(size=(n, 3)), axis=0)
    turns = 0.001 * np.cumsum(rng.normal(size=(n, 3)), axis=0)
    return steps + np.array([0.0, 0.0, 3.0]), Rotation.from_rotvec(turns).as_matrix()


@pytest.mark.parametrize("presliding", [0.003, 0.0001, -0.0002])
def test_what_rollers_remember_follows_travel_and_start_as_differences_say(presliding):
    robot, motion = read_robot("cogiro"), wandering(0, 60)
    start = np.linspace(-0.9, 0.9, robot.m)
    step = 1e-7

    def at(travel: float, begun: np.ndarray) -> np.ndarray:
        errors = {"presliding": np.array([travel]), "presliding_start": begun}
        return rolled_along(robot, *motion, errors).value

    found = rolled_along(
        robot, *motion, {"presliding": np.array([presliding]), "presliding_start": start}
    )
    np.testing.assert_array_equal(found.value, at(presliding, start))
    by_travel = (at(presliding + step, start) - at(presliding - step, start)) / (2 * step)
    np.testing.assert_allclose(found.by_travel, by_travel, rtol=1e-5, atol=1e-5)
    by_start = at(presliding, start + 0.5) - at(presliding, start - 0.5)
    np.testing.assert_allclose(found.by_start, by_start, rtol=1e-9, atol=1e-12)


def test_rollers_turn_by_the_points_that_are_believed():
    stated, motion = read_robot(DATA / "cogiro-points.yaml"), wandering(2, 60)
    rng = np.random.default_rng(2)
    anchors, attachments = (
        points + 0.01 * rng.normal(size=points.shape)
        for points in (stated.anchors, stated.attachments)
    )
    moved = replace(stated, anchors=anchors, attachments=attachments)
    errors = {"presliding": np.array([0.004]), "presliding_start": np.full(stated.m, 0.3)}
    geometry = {"anchors": anchors.ravel(), "attachments": attachments.ravel()}
    found = rolled_along(stated, *motion, errors, geometry=geometry)
    expected = rolled_along(moved, *motion, errors)
    np.testing.assert_allclose(found.length, expected.length, rtol=1e-8)
    np.testing.assert_allclose(found.value, expected.value, atol=1e-4)
    assert np.abs(found.value - rolled_along(stated, *motion, errors).value).max() > 0.01


def test_rollers_go_on_from_one_part_of_a_motion_to_the_next():
    robot, (position, rotation) = read_robot("cogiro"), wandering(1, 60)
    errors = {"presliding": np.array([0.02]), "presliding_start": np.full(robot.m, 0.7)}
    whole = rolled_along(robot, position, rotation, errors)
    first = rolled_along(robot, position[:25], rotation[:25], errors)
    second = rolled_along(robot, position[25:], rotation[25:], errors, first.last)
    for one, other, every in zip(first, second, whole, strict=True):
        np.testing.assert_allclose(np.concatenate([one, other]), every, rtol=1e-10, atol=1e-13)


def test_a_recording_says_what_the_rollers_remember():
    """A winch that turns around reads less and more, over some millimetres of travel."""
    robot = read_robot("cogiro").with_straight_cables()
    stated = {"gain": 0, "common_gain": 0, "offset": 0, "time_constant": 0}
    exact = {
        key: {"value": value, "sigma": 0}
        for key, value in (("friction", 0.1), ("presliding", 0.05))
    }
    winch = Tension.model_validate(
        {"kind": "tension", "end": "winch", "rate": 100.0, "calibration": {**stated, **exact}}
    )
    motion = ExactMotion(robot, robot.platform, feasible_multisine(robot, 6.0))
    rng = np.random.default_rng(0)
    errors = draw_errors({"cables": winch}, robot.m, ["run"], rng)["run"]

    class Pulling:
        duration = motion.duration

        def at(self, times):
            return replace(motion.at(times), tension=np.full((len(times), robot.m), 500.0))

    streams, sync = record(Pulling(), {"cables": winch}, errors, robot, motion, rng)
    time = streams["cables"].time - sync["cables"]
    state = motion.at(time)
    lengths = cables_at(robot, state.position, state.rotation, np.ones(robot.m)).length
    start = errors["cables"].calibration["presliding_start"]
    expected = 500.0 * (1 - 0.1 * rolled(lengths, 0.05, start)[0])
    found = streams["cables"].values["tension"]
    assert np.abs(found - expected)[50:].max() < 1.0
