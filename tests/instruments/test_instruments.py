"""Measurement equations against the table of the experiment format, written out in NumPy."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from steelyard.instruments import Attitude, Command, Imu, Length, Pose, Position, Tension, Wrench
from steelyard.instruments.equations import (
    follows_readings,
    linearised,
    means,
    order_of,
    predict,
    sensitivity,
    solve_for,
    term_columns,
)
from steelyard.motion.state import State
from steelyard.robot.model import CableProperties, Robot

N, M = 7, 4
TOLERANCE = 1e-10  # rounding, on readings of up to 1e3
TILTED_GRAVITY = np.array([0.4, -0.3, -9.7])

STRAIGHT = Robot(
    name="straight",
    anchors=[[-4, -3, 5], [4, -3, 5.5], [4, 3, 5], [-4, 3, 6]],
    attachments=[[-0.3, -0.2, 0.1], [0.3, -0.2, 0], [0.3, 0.25, 0], [-0.3, 0.2, 0.1]],
)
HEAVY = replace(STRAIGHT, cable=CableProperties(linear_density=0.3))
ELASTIC = replace(STRAIGHT, cable=CableProperties(axial_stiffness=4e4))


def rpy(degrees):
    """R = Rz(yaw) Ry(pitch) Rx(roll), written out."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    return z @ y @ x


def Exp(theta):
    return Rotation.from_rotvec(theta).as_matrix()


@pytest.fixture
def state():
    rng = np.random.default_rng(5)
    return State(
        position=rng.normal([0, 0, 2], 0.5, (N, 3)),
        rotation=Rotation.from_rotvec(rng.normal(0, 0.6, (N, 3))).as_matrix(),
        omega=rng.normal(0, 1, (N, 3)),
        specific_force=rng.normal([0, 0, 9.8], 2, (N, 3)),
        alpha=rng.normal(0, 3, (N, 3)),
        tension=rng.uniform(80, 900, (N, M)),
        wrench=rng.normal(0, 200, (N, 6)),
        velocity=0.01 * rng.normal(0, 1, (N, 3)),
        gravity=TILTED_GRAVITY,
    )


def rows(state):
    """The samples one by one."""
    return [
        (
            state.position[i],
            state.rotation[i],
            state.omega[i],
            state.specific_force[i],
            state.alpha[i],
            state.tension[i],
            state.wrench[i],
        )
        for i in range(N)
    ]


def draw(instrument, seed=1):
    """Errors that are far from none, of every term."""
    rng = np.random.default_rng(seed)
    return {
        # So many parts of other cables add up.
        term.key: term.nominal
        + rng.uniform(0.05, 0.3, term.size) / (1.0 if term.key != "crosstalk" else M)
        for term in instrument.terms(M)
    }


# One function a kind: what the table says, sample by sample


def tension(i, c, robot, state):
    return {
        "tension": [
            c["common_gain"] * c["gain"] * (f + of_others(c["crosstalk"], f)) + c["offset"]
            for *_, f, _ in rows(state)
        ]
    }


def of_others(parts, tensions):
    """What sensors read of the other cables, told one by one."""
    given = iter(parts)
    return np.array(
        [
            sum(next(given) * other for j, other in enumerate(tensions) if j != i)
            for i in range(len(tensions))
        ]
    )


def tension_at_the_winch(i, c, robot, state):
    readings = []
    for (p, R, w, _, _, f, _), v in zip(rows(state), state.velocity, strict=True):
        arms = robot.attachments @ R.T
        away = arms + p - robot.anchors
        paid_out = np.sum(away * (v + np.cross(R @ w, arms)), axis=1) / np.linalg.norm(away, axis=1)
        behind = f * (1 - c["friction"] * np.tanh(paid_out / 0.01)) - c["viscous"] * paid_out
        behind = behind + of_others(c["crosstalk"], behind)
        readings.append(c["common_gain"] * c["gain"] * behind + c["offset"])
    return {"tension": readings}


def wrench(i, c, robot, state):
    R = rpy(i.rpy_deg) @ Exp(c["misalignment"])
    p = np.array(i.position) + c["position"]
    sign = {"body": 1.0, "sensor": -1.0}[i.acts_on]
    force, torque = [], []
    for *_, w in rows(state):
        F, T = w[:3], w[3:]
        force.append(sign * R.T @ F + c["offset.force"])
        torque.append(sign * R.T @ (T - np.cross(p, F)) + c["offset.torque"])
    return {"force": force, "torque": torque}


def imu(i, c, robot, state):
    R = rpy(i.rpy_deg) @ Exp(c["misalignment"])
    p = np.array(i.position) + c["position"]
    angular_velocity, specific_force, orientation = [], [], []
    for _, R_world_platform, w, s, dw, _, _ in rows(state):
        angular_velocity.append((1 + c["gyro_scale"]) * (R.T @ w) + c["gyro_bias"])
        there = s + np.cross(dw, p) + np.cross(w, np.cross(w, p))
        if i.gravity == "removed":
            there = there + R_world_platform.T @ state.gravity
        scaled = (1 + c["accelerometer_scale"]) * (R.T @ there)
        specific_force.append(scaled + c["accelerometer_bias"])
        orientation.append(Exp(c["reference"]).T @ R_world_platform @ R)
    return {
        "angular_velocity": angular_velocity,
        "specific_force": specific_force,
        "orientation": orientation,
    }


def attitude(i, c, robot, state):
    R = rpy(i.rpy_deg) @ Exp(c["misalignment"])
    return {"orientation": [Exp(c["reference"]).T @ Rwp @ R for _, Rwp, *_ in rows(state)]}


def in_tracker(i, c, target, state):
    R = rpy(i.frame.rpy_deg) @ Exp(c["frame.rotation"])
    origin = np.array(i.frame.position) + c["frame.position"]
    return [R.T @ (p + Rwp @ target - origin) for p, Rwp, *_ in rows(state)], R


def position(i, c, robot, state):
    return {"position": in_tracker(i, c, np.array(i.target) + c["target"], state)[0]}


def pose(i, c, robot, state):
    place, R_world_tracker = in_tracker(i, c, np.array(i.position) + c["target"], state)
    R = rpy(i.rpy_deg) @ Exp(c["misalignment"])
    return {
        "position": place,
        "orientation": [R_world_tracker.T @ Rwp @ R for _, Rwp, *_ in rows(state)],
    }


def length(i, c, robot, state):
    compliance = 1 / robot.cable.axial_stiffness if robot.cable.axial_stiffness else 0.0
    return {
        "length": [
            [
                g * np.linalg.norm(a - (p + Rwp @ b)) / (1 + c["stretch"][0] * f * compliance)
                for a, b, f, g in zip(
                    robot.anchors, robot.attachments, tensions, c["gain"], strict=True
                )
            ]
            + c["offset"]
            for p, Rwp, *_, tensions, _ in rows(state)
        ]
    }


def command(i, c, robot, state):
    return {"position": state.position, "orientation": state.rotation}


MOUNTED = {"position": (0.31, -0.22, 0.47), "rpy_deg": (20.0, -35.0, 110.0)}
FRAME = {"position": (1.2, -3.4, 0.6), "rpy_deg": (-8.0, 12.0, 75.0)}
KINDS = {
    "tension": (Tension(kind="tension"), tension, STRAIGHT),
    "tension at the winch of straight cables": (
        Tension(kind="tension", end="winch"),
        tension_at_the_winch,
        STRAIGHT,
    ),
    "wrench": (Wrench(kind="wrench", **MOUNTED), wrench, STRAIGHT),
    "wrench on the sensor": (Wrench(kind="wrench", acts_on="sensor", **MOUNTED), wrench, STRAIGHT),
    "imu": (Imu(kind="imu", **MOUNTED), imu, STRAIGHT),
    "imu without gravity": (Imu(kind="imu", gravity="removed", **MOUNTED), imu, STRAIGHT),
    "attitude": (Attitude(kind="attitude", rpy_deg=MOUNTED["rpy_deg"]), attitude, STRAIGHT),
    "position": (
        Position(kind="position", target=MOUNTED["position"], frame=FRAME),
        position,
        STRAIGHT,
    ),
    "pose": (Pose(kind="pose", frame=FRAME, **MOUNTED), pose, STRAIGHT),
    "length": (Length(kind="length"), length, STRAIGHT),
    "length of elastic cables": (Length(kind="length"), length, ELASTIC),
    "command": (Command(kind="command"), command, STRAIGHT),
}


@pytest.mark.parametrize("kind", KINDS)
def test_readings_are_those_of_the_contract(kind, state):
    instrument, stated, robot = KINDS[kind]
    calibration = draw(instrument)
    readings = predict(instrument, robot, state, calibration)
    expected = stated(instrument, calibration, robot, state)
    assert readings.keys() == expected.keys() == {q.name for q in instrument.quantities(M)}
    for name, values in expected.items():
        np.testing.assert_allclose(
            readings[name], values, atol=TOLERANCE, rtol=TOLERANCE, err_msg=name
        )


def test_the_winch_end_of_a_heavy_cable_carries_its_weight_as_well(state):
    # Of a catenary that does not stretch, the tensions at two points differ by weight per metre
    # times difference in height.
    robot = replace(HEAVY, gravity=np.array([0.0, 0.0, -9.81]))
    instrument = Tension(kind="tension", end="winch")
    readings = predict(instrument, robot, state, means(instrument, M))["tension"]
    ends = state.position[:, None] + np.einsum("nij,mj->nmi", state.rotation, robot.attachments)
    rise = (robot.anchors - ends)[:, :, 2]
    np.testing.assert_allclose(readings, state.tension + 0.3 * 9.81 * rise, rtol=1e-9)
    assert (readings > state.tension).all()


def test_a_sensor_at_the_platform_end_does_not_see_the_weight_of_the_cable(state):
    instrument = Tension(kind="tension")
    readings = predict(instrument, HEAVY, state, means(instrument, M))["tension"]
    np.testing.assert_allclose(readings, state.tension, rtol=TOLERANCE)


def test_a_cable_with_weight_is_longer_than_its_chord_by_its_sag(state):
    # A shallow cable of weight w per metre is longer than its chord l by w^2 d^2 l / (24 T^2) over
    # the run d; T is that at mid-span, here nearly that at the end.
    robot = replace(HEAVY, gravity=np.array([0.0, 0.0, -9.81]))
    tight = replace(state, tension=20 * state.tension)
    instrument, exact = Length(kind="length"), means(Length(kind="length"), M)
    longer = (
        predict(instrument, robot, tight, exact)["length"]
        - predict(instrument, STRAIGHT, tight, exact)["length"]
    )
    ends = state.position[:, None] + np.einsum("nij,mj->nmi", state.rotation, robot.attachments)
    chord = robot.anchors - ends
    run = np.linalg.norm(chord[:, :, :2], axis=2)
    sag = (0.3 * 9.81 * run) ** 2 * np.linalg.norm(chord, axis=2) / (24 * tight.tension**2)
    np.testing.assert_allclose(longer, sag, rtol=0.02)


def test_stretch_and_rollers_are_those_of_another_robot(state):
    # Factor on the compliance of a catenary over rollers, and radii that are larger by millimetres.
    instrument = Length(kind="length")
    cable = CableProperties(axial_stiffness=4e4, linear_density=0.1)
    axes = np.tile([0.0, 0.0, 1.0], (M, 1))
    rollers = replace(STRAIGHT, cable=cable, pulley_radius=np.full(M, 0.05), pulley_axis=axes)
    larger = np.array([0.002, -0.001, 0.0, 0.003])
    leaning = np.array([[0.02, 0.0], [0.0, -0.03], [0.01, 0.04], [-0.05, 0.02]])
    other = replace(
        rollers,
        cable=replace(cable, axial_stiffness=4e4 / 1.3),
        pulley_radius=rollers.pulley_radius + larger,
        pulley_axis=np.column_stack([leaning, np.ones(M)]),
    )
    errors = {
        **means(instrument, M),
        "stretch": np.array([1.3]),
        "roller": larger,
        "roller_axis": leaning.ravel(),
    }
    found = predict(instrument, rollers, state, errors)["length"]
    expected = predict(instrument, other, state, means(instrument, M))["length"]
    np.testing.assert_allclose(found, expected, rtol=TOLERANCE)
    plain = predict(instrument, rollers, state, means(instrument, M))["length"]
    assert np.abs(found - plain).min() > 1e-4


# A perfect instrument


@pytest.mark.parametrize("kind", KINDS)
def test_a_perfect_instrument_has_gains_of_one_and_no_other_error(kind):
    instrument = KINDS[kind][0]
    for term in instrument.terms(M):
        assert term.mean.shape == (term.size,)
        if term.key == "presliding":
            continue  # A roller that takes nothing may take it over any travel.
        factor = term.key.endswith("gain") or term.key == "stretch"
        assert (term.mean == (1.0 if factor else 0.0)).all()


# Default 1-sigma by the table of the contract; None: taken from the data.
DEFAULTS = {
    "tension": {
        "offset": None,
        "gain": 0.01,
        "common_gain": 0.005,
        "time_constant": 0.0,
        "crosstalk": 0.0,
    },
    "tension at the winch of straight cables": {
        "offset": None,
        "gain": 0.01,
        "common_gain": 0.005,
        "time_constant": 0.0,
        "friction": 0.02,
        "presliding": 0.003,
        "presliding_start": 0.6,
        "viscous": 0.0,
        "crosstalk": 0.0,
    },
    "wrench": {
        "offset.force": None,
        "offset.torque": None,
        "position": 0.0,
        "misalignment": 0.0,
        "time_constant": 0.0,
    },
    "length": {
        "offset": 1.0,
        "gain": 0.0,
        "stretch": 0.0,
        "roller": 0.0,
        "roller_axis": 0.0,
        "damping": 0.0,
    },
    "imu": {
        "gyro_bias": 0.02,
        "accelerometer_bias": 0.5,
        "position": 0.005,
        "misalignment": 0.05,
        "reference": 0.02,
        "gyro_scale": 0.0,
        "accelerometer_scale": 0.0,
    },
    "attitude": {"misalignment": 0.05, "reference": 0.02},
    "position": {"target": 0.005, "frame.position": 0.002, "frame.rotation": 0.0005},
    "pose": {
        "misalignment": 0.05,
        "target": 0.005,
        "frame.position": 0.002,
        "frame.rotation": 0.0005,
    },
    "command": {},
}


@pytest.mark.parametrize("kind", DEFAULTS)
def test_default_calibration_is_that_of_the_contract(kind):
    instrument = KINDS[kind][0]
    found = {
        term.key: None if term.deviation is None else set(term.deviation)
        for term in instrument.terms(M)
    }
    assert found == {
        key: None if value is None else {value} for key, value in DEFAULTS[kind].items()
    }
    # How friction has built up is another thing in every run.
    per = {term.key: term.prior.per for term in instrument.terms(M)}
    assert per.pop("presliding_start", "run") == "run"
    assert set(per.values()) <= {"experiment"}
    assert instrument.calibration.delay is None


QUATERNION, ANGLES = ("qw", "qx", "qy", "qz"), ("roll", "pitch", "yaw")
MATRIX = tuple(f"r{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3))
ORIENTATION = (QUATERNION, ANGLES, MATRIX)
XYZ = (("x", "y", "z"),)
COLUMNS = {
    "tension": {"tension": (("f1", "f2", "f3", "f4"),)},
    "wrench": {"force": (("fx", "fy", "fz"),), "torque": (("tx", "ty", "tz"),)},
    "imu": {
        "angular_velocity": (("wx", "wy", "wz"),),
        "specific_force": (("ax", "ay", "az"),),
        "orientation": ORIENTATION,
    },
    "attitude": {"orientation": ORIENTATION},
    "position": {"position": XYZ},
    "pose": {"position": XYZ, "orientation": ORIENTATION},
    "length": {"length": (("l1", "l2", "l3", "l4"),)},
    "command": {"position": XYZ, "orientation": (ANGLES,)},
}


@pytest.mark.parametrize("kind", COLUMNS)
def test_columns_are_those_of_the_contract(kind):
    instrument = KINDS[kind][0]
    assert {q.name: q.forms for q in instrument.quantities(M)} == COLUMNS[kind]


# Backwards


def known_to_be(instrument, values):
    """The same instrument with errors that are known beforehand."""
    text = instrument.model_dump(mode="python", exclude_unset=True)
    text["calibration"] = {}
    for key, value in values.items():
        entry = text["calibration"]
        *path, last = key.split(".")
        for part in path:
            entry = entry.setdefault(part, {})
        entry[last] = {"value": tuple(float(v) for v in value), "sigma": 0.0}
    return type(instrument).model_validate(text)


BACKWARDS = {
    "tension": ("tension", "tension", ["tension"], []),
    "tension at the winch": (
        "tension at the winch of straight cables",
        "tension",
        ["tension"],
        ["position", "rotation", "velocity", "omega"],
    ),
    "wrench": ("wrench", "wrench", ["force", "torque"], []),
    "wrench on the sensor": ("wrench on the sensor", "wrench", ["force", "torque"], []),
    "gyro": ("imu", "omega", ["angular_velocity"], []),
    "accelerometer": ("imu", "specific_force", ["specific_force"], ["omega", "alpha"]),
    "accelerometer without gravity": (
        "imu without gravity",
        "specific_force",
        ["specific_force"],
        ["omega", "alpha", "rotation", "gravity"],
    ),
    "orientation of an imu": ("imu", "rotation", ["orientation"], []),
    "attitude": ("attitude", "rotation", ["orientation"], []),
    "position": ("position", "position", ["position"], ["rotation"]),
    "position of a pose": ("pose", "position", ["position"], ["rotation"]),
    "orientation of a pose": ("pose", "rotation", ["orientation"], []),
    "position of a command": ("command", "position", ["position"], []),
    "orientation of a command": ("command", "rotation", ["orientation"], []),
}


@pytest.mark.parametrize("case", BACKWARDS)
def test_the_state_follows_from_the_readings(case, state):
    kind, unknown, quantities, given = BACKWARDS[case]
    instrument, stated, robot = KINDS[kind]
    calibration = draw(instrument, seed=2)
    instrument = known_to_be(instrument, calibration)
    for key, value in means(instrument, M).items():
        np.testing.assert_array_equal(value, calibration[key])
    # The readings are those of the table above, not of the code under test.
    readings = {
        key: np.array(value) for key, value in stated(instrument, calibration, robot, state).items()
    }
    found = solve_for(
        unknown,
        instrument,
        robot,
        {q: readings[q] for q in quantities},
        {g: getattr(state, g) for g in given},
    )
    np.testing.assert_allclose(found, getattr(state, unknown), rtol=1e-8, atol=1e-8)


def test_only_what_the_known_part_of_the_state_tells_is_predicted(state):
    instrument = Imu(kind="imu", position=(0.1, 0.0, 0.0))
    without = replace(state, alpha=None, wrench=None, tension=None)
    assert set(predict(instrument, STRAIGHT, without, means(instrument, M))) == {
        "angular_velocity",
        "orientation",
    }
    still_there = predict(
        Position(kind="position"), STRAIGHT, without, means(Position(kind="position"), M)
    )
    assert set(still_there) == {"position"}


def test_inputs_stay_as_they_are(state):
    instrument = KINDS["imu"][0]
    before = {name: np.array(value, copy=True) for name, value in vars(state).items()}
    predict(instrument, STRAIGHT, state, draw(instrument))
    for name, value in before.items():
        np.testing.assert_array_equal(getattr(state, name), value)


# Against the motion itself

STEP = 1e-3  # [s]
FIRST = np.array([1, -8, 0, 8, -1]) / (12 * STEP)
SECOND = np.array([-1, 16, -30, 16, -1]) / (12 * STEP**2)
STENCIL = STEP * np.arange(-2, 3)


def path(t):
    """Platform origin and orientation at a time."""
    p = np.array([0.4 * np.sin(1.1 * t), 0.3 * np.cos(1.7 * t), 2 + 0.2 * np.sin(2.3 * t)])
    R = Rotation.from_rotvec(
        [0.5 * np.sin(1.3 * t), 0.4 * np.cos(0.9 * t), 0.7 * np.sin(1.9 * t + 0.4)]
    ).as_matrix()
    return p, R


def derivative(function, t, weights):
    """By a five-point stencil, whose error is of fourth order."""
    return sum(w * function(t + h) for w, h in zip(weights, STENCIL, strict=True))


def omega_at(t):
    R = path(t)[1]
    W = R.T @ derivative(lambda s: path(s)[1], t, FIRST)
    return np.array([W[2, 1] - W[1, 2], W[0, 2] - W[2, 0], W[1, 0] - W[0, 1]]) / 2


@pytest.mark.parametrize("gravity", ["included", "removed"])
def test_an_imu_off_the_origin_feels_what_its_own_path_tells(gravity):
    place, turned = np.array([0.31, -0.22, 0.47]), (20.0, -35.0, 110.0)
    instrument = Imu(kind="imu", position=tuple(place), rpy_deg=turned, gravity=gravity)
    for t in (0.0, 0.7, 1.9):
        p, R = path(t)
        acceleration = derivative(lambda s: path(s)[0], t, SECOND)
        now = State(
            position=p,
            rotation=R,
            velocity=derivative(lambda s: path(s)[0], t, FIRST),
            omega=omega_at(t),
            specific_force=R.T @ (acceleration - TILTED_GRAVITY),
            alpha=derivative(omega_at, t, FIRST),
            tension=None,
            wrench=None,
            gravity=TILTED_GRAVITY,
        )
        readings = predict(instrument, STRAIGHT, now, means(instrument, M))
        of_the_point = derivative(lambda s: path(s)[0] + path(s)[1] @ place, t, SECOND)
        force_samples = of_the_point - (TILTED_GRAVITY if gravity == "included" else 0.0)
        expected = (R @ rpy(turned)).T @ force_samples
        # Differences of second order by steps of a millisecond leave 1e-9; alpha is one of
        # differences.
        np.testing.assert_allclose(readings["specific_force"][0], expected, atol=1e-6)
        np.testing.assert_allclose(readings["orientation"][0], R @ rpy(turned), atol=TOLERANCE)


@pytest.mark.parametrize("case", BACKWARDS)
def test_the_state_follows_from_the_readings_with_errors_that_are_given(case, state):
    kind, unknown, quantities, given = BACKWARDS[case]
    instrument, stated, robot = KINDS[kind]
    calibration = draw(instrument, seed=3)
    readings = {
        key: np.array(value) for key, value in stated(instrument, calibration, robot, state).items()
    }
    found = solve_for(
        unknown,
        instrument,
        robot,
        {q: readings[q] for q in quantities},
        {g: getattr(state, g) for g in given},
        calibration,
    )
    np.testing.assert_allclose(found, getattr(state, unknown), rtol=1e-8, atol=1e-8)


# About a motion

DIFFERENCE = 1e-6  # step of central differences
DIFFERENCED = 1e-7  # relative to the largest number compared: what such differences are right to


def dot(a, b):
    """Scalar product of vectors over time, shape (n, 1)."""
    return np.sum(a * b, axis=1, keepdims=True)


def hamilton(a, b):
    """Product of quaternions (w, x, y, z) over time, shape (n, 4)."""
    scalar = a[:, :1] * b[:, :1] - dot(a[:, 1:], b[:, 1:])
    vector = a[:, :1] * b[:, 1:] + b[:, :1] * a[:, 1:] + np.cross(a[:, 1:], b[:, 1:])
    return np.hstack([scalar, vector])


def unit(q, dq, ddq):
    """Quaternions of length one and their two time derivatives."""
    s = np.linalg.norm(q, axis=1, keepdims=True)
    ds = dot(q, dq) / s
    dds = (dot(dq, dq) + dot(q, ddq) - ds**2) / s
    return (
        q / s,
        dq / s - q * ds / s**2,
        ddq / s - 2 * dq * ds / s**2 - q * dds / s**2 + 2 * q * ds**2 / s**3,
    )


def turning(q, dq, ddq):
    """R, omega and alpha in platform axes: omega = 2 u* du; in its derivative du* du is a number
    without direction."""
    u, du, ddu = unit(q, dq, ddq)
    back = u * [1, -1, -1, -1]
    return (
        Rotation.from_quat(u, scalar_first=True).as_matrix(),
        2 * hamilton(back, du)[:, 1:],
        2 * hamilton(back, ddu)[:, 1:],
    )


def state_along(pose, rate, acceleration, gravity):
    """The platform's state over time."""
    R, omega, alpha = turning(pose[:, 3:], rate[:, 3:], acceleration[:, 3:])
    force_samples = np.einsum("nji,nj->ni", R, acceleration[:, :3] - gravity)
    return State(
        pose[:, :3],
        R,
        rate[:, :3],
        omega,
        force_samples,
        alpha,
        np.zeros((N, M)),
        np.zeros((N, 6)),
        gravity,
    )


@pytest.fixture
def motion():
    """Pose, rate and acceleration; quaternions of any length that also changes."""
    rng = np.random.default_rng(8)
    return (
        np.hstack([rng.normal(0, 2, (N, 3)), rng.normal(0, 1, (N, 4))]),
        rng.normal(0, 1, (N, 7)),
        rng.normal(0, 3, (N, 7)),
    )


def beyond(kind, quantity, measured, motion, errors, gravity, anchors=None, attachments=None):
    """What is measured beyond what the table says, shape (n, 3)."""
    instrument, stated, robot = KINDS[kind]
    if anchors is not None:
        fixed = {"anchors": anchors.reshape(-1, 3), "attachments": attachments.reshape(-1, 3)}
        robot = replace(robot, **fixed)
    ends = np.cumsum([term.size for term in instrument.terms(M)])
    calibration = {
        term.key: errors[end - term.size : end]
        for term, end in zip(instrument.terms(M), ends, strict=True)
    }
    expected = np.array(
        stated(instrument, calibration, robot, state_along(*motion, gravity))[quantity]
    )
    if measured.ndim == 3:
        return Rotation.from_matrix(np.swapaxes(expected, 1, 2) @ measured).as_rotvec()
    return measured - expected


def reading_near(kind, quantity, motion, errors, gravity):
    """Readings that differ from what is expected, of rotations by next to nothing up to two
    radians."""
    expected = (
        beyond(kind, quantity, np.zeros((N, 3)), motion, errors, gravity)
        if quantity != "orientation"
        else None
    )
    rng = np.random.default_rng(4)
    if expected is not None:
        return -expected + rng.normal(0, 1, (N, 3))
    plain = -beyond(kind, quantity, np.tile(np.eye(3), (N, 1, 1)), motion, errors, gravity)
    axes = rng.normal(0, 1, (N, 3))
    angles = np.array([0.0, 1e-5, 1e-3, 0.1, 0.5, 1.0, 2.0])[:, None]
    off = Rotation.from_rotvec(angles * axes / np.linalg.norm(axes, axis=1, keepdims=True))
    return Rotation.from_rotvec(plain).as_matrix() @ off.as_matrix()


LOOKED_AT = [
    (kind, quantity)
    for kind, quantities in {
        "imu": ("angular_velocity", "specific_force", "orientation"),
        "imu without gravity": ("angular_velocity", "specific_force", "orientation"),
        "attitude": ("orientation",),
        "position": ("position",),
        "pose": ("position", "orientation"),
        "command": ("position", "orientation"),
    }.items()
    for quantity in quantities
]


def errors_of(kind):
    """All terms in their order; an instrument without any has one number that does nothing."""
    drawn = list(draw(KINDS[kind][0], seed=6).values())
    return np.concatenate(drawn) if drawn else np.zeros(1)


def differences_by(function, at):
    """Central differences by every number of an array's last axis, on the last axis of the
    result."""
    columns = []
    for j in range(at.shape[-1]):
        step = np.zeros(at.shape[-1])
        step[j] = DIFFERENCE
        columns.append((function(at + step) - function(at - step)) / (2 * DIFFERENCE))
    return np.stack(columns, axis=-1)


@pytest.mark.parametrize(("kind", "quantity"), LOOKED_AT)
def test_what_is_measured_beyond_what_a_motion_tells_and_its_derivatives(kind, quantity, motion):
    instrument, _, robot = KINDS[kind]
    errors = errors_of(kind)
    measured = reading_near(kind, quantity, motion, errors, TILTED_GRAVITY)
    found = linearised(instrument, quantity, robot, measured, motion, errors, TILTED_GRAVITY)
    now = [*motion, errors, TILTED_GRAVITY, robot.anchors.ravel(), robot.attachments.ravel()]
    expected = {"residual": beyond(kind, quantity, measured, motion, errors, TILTED_GRAVITY)}
    names = ("pose", "rate", "acceleration", "errors", "gravity", "anchors", "attachments")
    for place, name in enumerate(names):

        def residual(value, place=place):
            changed = [*now[:place], value, *now[place + 1 :]]
            return beyond(kind, quantity, measured, tuple(changed[:3]), *changed[3:])

        expected[f"by_{name}"] = differences_by(residual, now[place])
    # Tensions are no part of a motion: what follows them is asked elsewhere.
    assert found.keys() - {"by_tension"} == expected.keys()
    np.testing.assert_allclose(found["residual"], expected["residual"], atol=TOLERANCE)
    for name, value in expected.items():
        # Of no error at all there is one column, which is nothing.
        assert found[name].shape == value.shape
        np.testing.assert_allclose(
            found[name], value, atol=DIFFERENCED * max(1, np.abs(value).max()), err_msg=name
        )


@pytest.mark.parametrize(("kind", "quantity"), LOOKED_AT)
def test_the_length_of_the_quaternion_does_not_matter(kind, quantity, motion):
    # c(t) q(t) for any c(t) is the same motion.
    instrument, _, robot = KINDS[kind]
    errors = errors_of(kind)
    measured = reading_near(kind, quantity, motion, errors, TILTED_GRAVITY)
    rng = np.random.default_rng(12)
    c, dc, ddc = rng.uniform(0.3, 3, (N, 1)), rng.normal(0, 1, (N, 1)), rng.normal(0, 1, (N, 1))
    pose, rate, acceleration = (x.copy() for x in motion)
    q, dq, ddq = (x[:, 3:] for x in motion)
    pose[:, 3:] = c * q
    rate[:, 3:] = c * dq + dc * q
    acceleration[:, 3:] = c * ddq + 2 * dc * dq + ddc * q
    one, other = (
        linearised(instrument, quantity, robot, measured, m, errors, TILTED_GRAVITY)
        for m in (motion, (pose, rate, acceleration))
    )
    for name in ("residual", "by_errors", "by_gravity"):
        np.testing.assert_allclose(other[name], one[name], atol=1e-9, err_msg=name)
    # Nothing changes along c, dc, ddc.
    by_pose, by_rate, by_acceleration = (
        one[f"by_{name}"][:, :, 3:] for name in ("pose", "rate", "acceleration")
    )
    for along in (
        by_pose @ q[:, :, None] + by_rate @ dq[:, :, None] + by_acceleration @ ddq[:, :, None],
        by_rate @ q[:, :, None] + 2 * by_acceleration @ dq[:, :, None],
        by_acceleration @ q[:, :, None],
    ):
        np.testing.assert_allclose(along, 0, atol=1e-9)


# How what is found follows readings and errors

SENSITIVE = {
    "tension": ("tension", "tension"),
    "tension at the winch": ("tension at the winch of straight cables", "tension"),
    "wrench": ("wrench", "wrench"),
    "wrench on the sensor": ("wrench on the sensor", "wrench"),
}


@pytest.mark.parametrize("case", SENSITIVE)
def test_what_is_found_follows_readings_and_errors_as_differences_say(case, state):
    kind, unknown = SENSITIVE[case]
    instrument, stated, robot = KINDS[kind]
    calibration = draw(instrument, seed=7)
    quantities = tuple(q.name for q in instrument.quantities(M))
    readings = np.hstack([stated(instrument, calibration, robot, state)[q] for q in quantities])
    terms = instrument.terms(M)
    ends = np.cumsum([term.size for term in terms])[:-1]

    def found(values, errors):
        split = dict(zip(quantities, np.split(values, len(quantities), axis=1), strict=True))
        given = {key: getattr(state, key) for key in ("position", "rotation", "velocity", "omega")}
        known = dict(zip((term.key for term in terms), np.split(errors, ends), strict=True))
        return solve_for(unknown, instrument, robot, split, given, known)

    errors = np.concatenate(list(calibration.values()))
    told = {
        key: getattr(state, key)
        for key in ("tension", "wrench", "position", "rotation", "velocity", "omega")
    }
    given = (unknown, instrument, robot, quantities, told, calibration)
    by_reading, by_errors, _ = sensitivity(*given)
    alone = follows_readings(*given)
    for derivative, expected in (
        (by_reading, differences_by(lambda values: found(values, errors), readings)),
        (alone, differences_by(lambda values: found(values, errors), readings)),
        (by_errors, differences_by(lambda e: found(readings, e), errors)),
    ):
        whole = np.broadcast_to(derivative, (N, *derivative.shape[1:]))
        np.testing.assert_allclose(
            whole, expected, atol=DIFFERENCED * max(1, np.abs(expected).max())
        )


def test_a_tension_follows_its_own_reading_gain_and_offset(state):
    # tension = (reading - offset) / (common gain x gain), differentiated by hand.
    instrument = Tension(kind="tension")
    calibration = draw(instrument, seed=9)
    calibration["crosstalk"] *= 0.0
    gain, common = calibration["gain"], calibration["common_gain"]
    by_reading, by_errors, _ = sensitivity(
        "tension", instrument, STRAIGHT, ("tension",), {"tension": state.tension}, calibration
    )
    eye, t = np.eye(M), state.tension
    np.testing.assert_allclose(
        by_reading, np.broadcast_to(eye / (common * gain), by_reading.shape), rtol=1e-12
    )
    whole = np.broadcast_to(by_errors, (N, M, 2 * M + 2 + M * (M - 1)))
    np.testing.assert_allclose(
        whole[:, :, :M], np.broadcast_to(-eye / (common * gain), (N, M, M)), rtol=1e-12
    )
    np.testing.assert_allclose(whole[:, :, M : 2 * M], -eye * (t / gain)[:, None, :], rtol=1e-12)
    np.testing.assert_allclose(whole[:, :, 2 * M], -t / common, rtol=1e-12)
    # A filter acts on the time of a reading.
    np.testing.assert_array_equal(whole[:, :, 2 * M + 1], 0.0)
    # A part of another cable's tension takes as much from one's own.
    pairs = [(i, j) for i in range(M) for j in range(M) if i != j]
    for k, (i, j) in enumerate(pairs):
        np.testing.assert_allclose(whole[:, i, 2 * M + 2 + k], -t[:, j], rtol=1e-12)
        np.testing.assert_array_equal(np.delete(whole[:, :, 2 * M + 2 + k], i, axis=1), 0.0)


# What an instrument says of itself

DECLARED = {
    # kind: force that it reads, reading for every cable, commanded, motion, motion by cables
    "tension": ("tension", True, False, False, False),
    "wrench": ("wrench", False, False, False, False),
    "imu": (None, False, False, True, False),
    "attitude": (None, False, False, True, False),
    "position": (None, False, False, True, False),
    "pose": (None, False, False, True, False),
    "length": (None, True, False, False, True),
    "command": (None, False, True, False, False),
}


@pytest.mark.parametrize("kind", DECLARED)
def test_what_a_kind_is(kind):
    i = KINDS[kind][0]
    declared = (i.measured_force, i.per_cable, i.commanded, i.is_motion, i.is_cable_motion)
    assert declared == DECLARED[kind]
    assert i.is_force == (DECLARED[kind][0] is not None)


def test_a_command_with_a_noise_is_a_measurement():
    assert not Command(kind="command").is_motion
    assert Command.model_validate({"kind": "command", "noise": {"position": 0.01}}).is_motion


MOUNTINGS = {
    # kind: keys of rotation, point and frame
    "wrench": ("rpy_deg", "position", None),
    "imu": ("rpy_deg", "position", None),
    "attitude": ("rpy_deg", None, None),
    "position": (None, "target", "frame"),
    "pose": ("rpy_deg", "position", "frame"),
    "length": (None, None, None),
    "tension": (None, None, None),
    "command": (None, None, None),
}


@pytest.mark.parametrize("kind", MOUNTINGS)
def test_a_mounting_is_that_of_the_keys(kind):
    instrument = KINDS[kind][0]
    mounting, keys = instrument.mounting, dict(instrument)
    rotation, point, frame = MOUNTINGS[kind]
    assert mounting.rpy_deg == (keys[rotation] if rotation else None)
    assert mounting.point == (keys[point] if point else None)
    assert mounting.frame == (keys[frame] if frame else None)
    if point:
        assert mounting.point_key == point


@pytest.mark.parametrize("kind", ["imu", "imu without gravity", "wrench", "wrench on the sensor"])
def test_the_other_choice_is_another_instrument_whose_other_choice_is_this_one(kind):
    instrument = KINDS[kind][0]
    (choice,) = instrument.choices
    other = instrument.model_copy(update={choice.key: choice.other})
    assert other != instrument
    (back,) = other.choices
    assert other.model_copy(update={back.key: back.other}) == instrument
    assert back.what != choice.what


ORDERS = {
    ("imu", "angular_velocity"): 1,
    ("imu", "specific_force"): 2,
    ("imu", "orientation"): 0,
    ("imu without gravity", "specific_force"): 2,
    ("attitude", "orientation"): 0,
    ("position", "position"): 0,
    ("pose", "orientation"): 0,
    ("length", "length"): 0,
    ("length of elastic cables", "length"): 0,
}


@pytest.mark.parametrize(("kind", "quantity"), ORDERS)
def test_the_derivative_of_the_motion_that_a_quantity_reads(kind, quantity):
    instrument, _, robot = KINDS[kind]
    assert order_of(instrument, quantity, robot) == ORDERS[kind, quantity]


@pytest.mark.parametrize(
    ("kind", "quantity"),
    [
        ("imu", "angular_velocity"),
        ("imu", "specific_force"),
        ("position", "position"),
        ("pose", "position"),
        ("length", "length"),
        ("wrench", "torque"),
        ("tension", "tension"),
    ],
)
def test_columns_of_the_errors_are_those_of_differences(kind, quantity, state):
    instrument, stated, robot = KINDS[kind]
    known = means(instrument, M)
    found = term_columns(instrument, quantity, robot, state)
    assert found.keys() == known.keys()
    for key, columns in found.items():

        def reading(value, key=key):
            return np.array(stated(instrument, {**known, key: value}, robot, state)[quantity])

        expected = differences_by(reading, known[key])
        np.testing.assert_allclose(
            columns, expected, atol=DIFFERENCED * max(1, np.abs(expected).max()), err_msg=key
        )


def test_what_one_cable_reads_is_followed_by_a_matrix(state):
    instrument, _, robot = KINDS["tension"]
    one = replace(
        robot,
        anchors=robot.anchors[:1],
        attachments=robot.attachments[:1],
        pulley_radius=robot.pulley_radius[:1],
        pulley_axis=robot.pulley_axis[:1],
    )
    told = {key: getattr(state, key) for key in ("position", "rotation", "velocity", "omega")}
    told["tension"] = state.tension[:, :1]
    calibration = {term.key: np.full(term.size, term.nominal) for term in instrument.terms(1)}
    found = follows_readings("tension", instrument, one, ("tension",), told, calibration)
    np.testing.assert_allclose(np.broadcast_to(found, (N, 1, 1)), np.ones((N, 1, 1)))
