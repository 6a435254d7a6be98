import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from steelyard import rotations
from steelyard.batch import Batched
from steelyard.motion.state import motion_of_poses

TOLERANCE = (
    1e-10  # the sixth-order differences below are good to 1e-11, closed forms to 1e-15 / sin(angle)
)

SETTINGS = settings(deadline=None, derandomize=True, max_examples=60)
finite_vector = st.tuples(*[st.floats(-3, 3)] * 3)
rng = np.random.default_rng(3)
RPY = rng.uniform([-3, -1.5, -3], [3, 1.5, 3], (50, 3))


def symbolic(function, size=3, columns=1):
    x = ca.SX.sym("x", size, columns)
    batched = Batched("f", {"x": x}, {"y": function(x)})
    return lambda values: batched(x=values)["y"]


from_rpy, rate_matrix, exp = (
    symbolic(f) for f in (rotations.from_rpy, rotations.rate_matrix, rotations.exp)
)
log, from_quaternion = symbolic(rotations.log, 3, 3), symbolic(rotations.from_quaternion, 4)


def difference(function, step=0.01):
    return sum(
        c * (function(k * step) - function(-k * step)) for k, c in ((1, 45), (2, -9), (3, 1))
    ) / (60 * step)


def scipy_rpy(rpy):
    return Rotation.from_euler("ZYX", np.asarray(rpy)[..., ::-1])


def vee(matrix):
    return np.stack([matrix[..., 2, 1], matrix[..., 0, 2], matrix[..., 1, 0]], axis=-1)


def test_from_rpy_is_yaw_after_pitch_after_roll():
    np.testing.assert_allclose(from_rpy(RPY), scipy_rpy(RPY).as_matrix(), atol=TOLERANCE)


def test_skew_is_the_cross_product():
    v, w = rng.normal(size=(2, 20, 3))
    np.testing.assert_allclose(
        np.einsum("nij,nj->ni", symbolic(rotations.skew)(v), w), np.cross(v, w), atol=TOLERANCE
    )


def test_cross_matrices_are_those_of_the_cross_product():
    v, w = rng.normal(size=(2, 20, 3))
    matrices = rotations.cross_matrices(v)
    np.testing.assert_allclose(np.einsum("nij,nj->ni", matrices, w), np.cross(v, w), atol=TOLERANCE)
    np.testing.assert_array_equal(matrices, symbolic(rotations.skew)(v))
    assert rotations.cross_matrices(np.empty((0, 3))).shape == (0, 3, 3)


def test_quaternions_over_time_do_not_jump():
    """A body that turns by several turns: half the angle about a fixed axis is the oracle."""
    t = np.linspace(0, 1, 400)
    axis = np.array([0.6, -0.48, 0.64])
    angle = 0.4 + 9 * np.pi * np.sin(3 * t)
    half = np.column_stack([np.cos(angle / 2), np.sin(angle / 2)[:, None] * axis])
    found = rotations.quaternions_of(Rotation.from_rotvec(angle[:, None] * axis).as_matrix())
    sign = np.sign(found[0] @ half[0])
    np.testing.assert_allclose(sign * found, half, atol=TOLERANCE)
    # Whatever the signs were before; the first stays.
    mixed = half * np.where(rng.uniform(size=len(t)) < 0.5, -1, 1)[:, None]
    expected = half * np.sign(mixed[0] @ half[0])
    np.testing.assert_array_equal(rotations.sign_continuous(mixed), expected)
    assert rotations.sign_continuous(np.empty((0, 4))).shape == (0, 4)


def test_from_quaternion_puts_the_scalar_first():
    given_rotations = Rotation.random(50, random_state=5)
    q = given_rotations.as_quat(scalar_first=True)
    np.testing.assert_allclose(from_quaternion(q), given_rotations.as_matrix(), atol=TOLERANCE)


def test_quaternion_rate_is_the_derivative_of_the_quaternion_of_a_turning_body():
    start, omega = Rotation.random(20, random_state=6), rng.normal(size=(20, 3))
    sym_q, sym_w = ca.SX.sym("q", 4), ca.SX.sym("w", 3)
    rate = Batched(
        "rate", {"q": sym_q, "w": sym_w}, {"rate": rotations.quaternion_rate(sym_q, sym_w)}
    )
    q0 = start.as_quat(scalar_first=True)

    def later(t):
        q = (start * Rotation.from_rotvec(t * omega)).as_quat(scalar_first=True)
        return q * np.sign(np.sum(q * q0, axis=1, keepdims=True))

    np.testing.assert_allclose(rate(q=q0, w=omega)["rate"], difference(later), atol=TOLERANCE)


def test_rate_matrix_takes_angle_rates_to_the_angular_velocity_in_world_axes():
    rates = rng.normal(size=RPY.shape)
    R_dot = difference(lambda t: scipy_rpy(RPY + t * rates).as_matrix())
    omega_in_world = vee(R_dot @ scipy_rpy(RPY).as_matrix().transpose(0, 2, 1))
    np.testing.assert_allclose(
        np.einsum("nij,nj->ni", rate_matrix(RPY), rates), omega_in_world, atol=TOLERANCE
    )


def test_rate_matrix_is_the_printed_one_except_for_its_third_column():
    (_, theta, psi), matrix = RPY[0], rate_matrix(RPY)[0]
    C, S = np.cos, np.sin
    printed = np.array(
        [[C(theta) * C(psi), -S(psi), 1], [C(theta) * S(psi), C(psi), 0], [-S(theta), 0, 0]]
    )
    np.testing.assert_allclose(matrix[:, :2], printed[:, :2], atol=TOLERANCE)
    np.testing.assert_array_equal(matrix[:, 2], [0, 0, 1])


@pytest.mark.parametrize("i", range(10))
def test_equation_4b_as_printed_is_the_angular_acceleration_of_motion_of_poses(i):
    (_, theta, psi), dq, ddq = RPY[i], *np.random.default_rng(i).normal(size=(2, 3))
    C, S, (dphi, dtheta, _) = np.cos, np.sin, dq
    printed = np.array(
        [
            [0, -dphi * S(theta) * C(psi), -dphi * C(theta) * S(psi) - dtheta * C(psi)],
            [0, -dphi * S(theta) * S(psi), dphi * C(theta) * C(psi) - dtheta * S(psi)],
            [0, -dphi * C(theta), 0],
        ]
    )
    corrected_4a = np.array(
        [[C(theta) * C(psi), -S(psi), 0], [C(theta) * S(psi), C(psi), 0], [-S(theta), 0, 1]]
    )
    pose, rate, acceleration = (np.r_[0, 0, 0, v][None] for v in (RPY[i], dq, ddq))
    motion = motion_of_poses(pose, rate, acceleration, np.array([0, 0, -9.81]))
    R = scipy_rpy(RPY[i]).as_matrix()
    np.testing.assert_allclose(
        R @ motion["alpha"][0], printed @ dq + corrected_4a @ ddq, atol=TOLERANCE
    )
    np.testing.assert_allclose(R @ motion["omega"][0], corrected_4a @ dq, atol=TOLERANCE)


@SETTINGS
@given(finite_vector)
def test_exp_equals_scipy(theta):
    np.testing.assert_allclose(
        exp([theta])[0], Rotation.from_rotvec(theta).as_matrix(), atol=TOLERANCE
    )


@SETTINGS
@given(finite_vector)
def test_log_equals_scipy_below_half_a_turn(vector):
    theta = 3.1 * np.array(vector) / max(3.1, np.linalg.norm(vector))
    np.testing.assert_allclose(
        log(Rotation.from_rotvec(theta).as_matrix()[None])[0], theta, atol=TOLERANCE
    )


@pytest.mark.parametrize(
    "angle", [1e-300, 1e-160, 1e-12, 1e-8, 1e-5, 0.99999e-3, 1e-3, 1.00001e-3, 0.01, 0.05, 0.0999]
)
def test_exp_and_log_are_exact_to_rounding_near_zero(angle):
    theta = angle * np.array([0.6, -0.48, 0.64])
    np.testing.assert_allclose(
        exp([theta])[0], Rotation.from_rotvec(theta).as_matrix(), atol=4e-16, rtol=4e-16
    )
    np.testing.assert_allclose(
        log(Rotation.from_rotvec(theta).as_matrix()[None])[0], theta, atol=0, rtol=1e-14
    )


@pytest.mark.parametrize("angle", [0.0, 1e-200, 1e-9, 0.9999e-3, 1.0001e-3, 0.3, 2.0])
def test_first_and_second_derivatives_of_exp_are_those_of_scipy(angle):
    x, direction = ca.SX.sym("x", 3), ca.SX.sym("d", 3)
    column = ca.vec(rotations.exp(x).T)
    first = ca.jtimes(column, x, direction)
    second = ca.jtimes(first, x, direction)
    derivatives = ca.Function("derivatives", [x, direction], [first, second])
    theta, d = angle * np.array([0.6, -0.48, 0.64]), np.array([0.3, -0.7, 0.5])
    values = [np.array(v).reshape(3, 3) for v in derivatives(theta, d)]

    def matrix(t):
        return Rotation.from_rotvec(theta + t * d).as_matrix()

    np.testing.assert_allclose(values[0], difference(matrix), atol=TOLERANCE)
    h = 0.1  # tenth-order second difference
    weights = {0: -5269 / 1800, 1: 5 / 3, 2: -5 / 21, 3: 5 / 126, 4: -5 / 1008, 5: 1 / 3150}
    expected = (
        sum(c * (matrix(k * h) + matrix(-k * h)) / (1 + (k == 0)) for k, c in weights.items())
        / h**2
    )
    np.testing.assert_allclose(values[1], expected, atol=TOLERANCE)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 0.9999e-3, 1.0001e-3, 0.3, 2.0])
def test_log_undoes_exp_with_unit_derivative(angle):
    x = ca.SX.sym("x", 3)
    round_trip = rotations.log(rotations.exp(x))
    jacobian = ca.Function("J", [x], [round_trip, ca.jacobian(round_trip, x)])
    theta = angle * np.array([0.6, -0.48, 0.64])
    value, J = jacobian(theta)
    np.testing.assert_allclose(np.array(value).ravel(), theta, atol=TOLERANCE)
    np.testing.assert_allclose(np.array(J), np.eye(3), atol=TOLERANCE)


def test_quaternions_of_a_turning_body_do_not_jump():
    # More than a full turn about an axis that moves: the sign that SciPy gives jumps on the way.
    angle = np.linspace(0.0, 9.0, 200)[:, None]
    axis = np.array([0.6, 0.0, 0.8]) + 0.01 * angle * np.array([0.0, 1.0, 0.0])
    turns = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis, axis=1, keepdims=True))
    assert np.abs(np.diff(turns.as_quat(canonical=True), axis=0)).max() > 0.5
    found = rotations.quaternions_of(turns.as_matrix())
    assert np.abs(np.diff(found, axis=0)).max() < 0.05
    back = Rotation.from_quat(found, scalar_first=True)
    np.testing.assert_allclose(back.as_matrix(), turns.as_matrix(), atol=1e-12)


@pytest.mark.parametrize("scale", [1 + 1e-4, 0.9, -1.0, 0.0, 1e200])
def test_rotations_are_neither_stretched_nor_mirrored(scale):
    rotation = Rotation.random(random_state=np.random.default_rng(5)).as_matrix()
    assert rotations.is_rotation(rotation, 1e-12)
    assert not rotations.is_rotation(scale * rotation, 1e-6)
    assert not rotations.is_rotation(rotation @ np.diag([1.0, -1.0, 1.0]), 1e-6)
