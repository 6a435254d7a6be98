import casadi as ca
import numpy as np
import pinocchio as pin
import pytest
from leaning import leaning
from scipy.interpolate import make_interp_spline
from scipy.spatial.transform import Rotation

from steelyard.batch import Batched
from steelyard.dynamics import (
    FLEXIBILITY,
    bending_regressor,
    platform_regressor,
    platform_wrench,
    point_specific_force,
    specific_force_at,
    wrench_about,
)
from steelyard.inertia import LINEAR_PARAMETERS, Inertia, PinocchioParameters

TOLERANCE = 1e-12  # of the largest entry: both sides are the same sums in another order

N = 30
rng = np.random.default_rng(12)
S, OMEGA, ALPHA = rng.normal(0, [[8.0], [2.0], [5.0]], (N, 3, 3)).transpose(1, 0, 2)
MASSES, POSITIONS = rng.uniform(0.5, 20.0, 15), rng.normal(0.1, 0.6, (15, 3))
BODY = Inertia.from_points(MASSES, POSITIONS)
GRAVITY = np.array([0.3, -0.2, -9.7])
PINOCCHIO_NAMES = [
    name.replace("I", "J").replace("m", "h") if len(name) > 1 else name
    for name in PinocchioParameters._fields
]


def close(found, expected):
    np.testing.assert_allclose(found, expected, rtol=0, atol=TOLERANCE * np.abs(expected).max())


def free_flyer(body=BODY):
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "platform")
    inertia = pin.Inertia(body.mass, body.center_of_gravity.copy(), body.inertia.copy())
    model.appendBodyToJoint(joint, inertia, pin.SE3.Identity())
    model.gravity.linear = GRAVITY
    return model, model.createData()


def pinocchio_state(k):
    """Configuration, twist and spatial acceleration of a free flyer that feels specific force
    S[k]."""
    turn = Rotation.random(random_state=k)
    v_in_platform = np.random.default_rng(k).normal(size=3)
    a_in_platform = S[k] + turn.inv().apply(GRAVITY)
    # The derivative of the body coordinates of v lacks omega x v of the acceleration of the origin.
    spatial = a_in_platform - np.cross(OMEGA[k], v_in_platform)
    return (
        np.r_[0.4, -0.7, 1.1, turn.as_quat()],
        np.r_[v_in_platform, OMEGA[k]],
        np.r_[spatial, ALPHA[k]],
    )


def test_wrench_is_that_of_pinocchios_spatial_algebra():
    found = platform_wrench(BODY.parameters, S, OMEGA, ALPHA)
    inertia = pin.Inertia(BODY.mass, BODY.center_of_gravity.copy(), BODY.inertia.copy())
    for k in range(N):
        v = pin.Motion(np.array([0.3, -0.1, 0.7]), OMEGA[k])
        a = pin.Motion(S[k] - np.cross(OMEGA[k], v.linear), ALPHA[k])
        close(found[k], (inertia * a + v.cross(inertia * v)).vector)


def test_wrench_is_that_of_pinocchios_free_flyer_under_gravity():
    model, data = free_flyer()
    expected = [pin.rnea(model, data, *pinocchio_state(k)).copy() for k in range(N)]
    close(platform_wrench(BODY.parameters, S, OMEGA, ALPHA), np.array(expected))


def test_regressor_is_pinocchios_with_its_columns_in_our_order():
    model, data = free_flyer()
    expected = np.array(
        [pin.computeJointTorqueRegressor(model, data, *pinocchio_state(k)).copy() for k in range(N)]
    )
    order = [PINOCCHIO_NAMES.index(name) for name in LINEAR_PARAMETERS]
    found = platform_regressor(S, OMEGA, ALPHA)
    assert found.shape == (N, 6, 10)
    close(found, expected[:, :, order])


def test_regressor_times_pinocchios_parameters_through_the_adapters_is_the_wrench():
    model, data = free_flyer()
    for k in range(N):
        Y = pin.computeJointTorqueRegressor(model, data, *pinocchio_state(k))
        close(
            Y @ np.array(BODY.to_pinocchio()),
            platform_wrench(BODY.parameters, S[[k]], OMEGA[[k]], ALPHA[[k]])[0],
        )


def test_regressor_times_parameters_is_the_wrench_for_any_ten_numbers():
    parameters = np.random.default_rng(1).normal(0, 50, (N, 10))
    found = np.einsum("nkp,np->nk", platform_regressor(S, OMEGA, ALPHA), parameters)
    close(found, platform_wrench(parameters, S, OMEGA, ALPHA))


def test_wrench_is_newtons_law_for_every_point_of_a_cloud():
    found = platform_wrench(BODY.parameters, S, OMEGA, ALPHA)
    for k in range(N):
        s_of_points = (
            S[k] + np.cross(ALPHA[k], POSITIONS) + np.cross(OMEGA[k], np.cross(OMEGA[k], POSITIONS))
        )
        forces = MASSES[:, None] * s_of_points
        close(found[k], np.r_[forces.sum(axis=0), np.cross(POSITIONS, forces).sum(axis=0)])


def test_point_specific_force_is_that_of_the_point():
    s, w, a, p = (ca.SX.sym(name, 3) for name in "swap")
    batched = Batched(
        "point", {"s": s, "w": w, "a": a, "p": p}, {"f": point_specific_force(s, w, a, p)}
    )
    point = np.array([0.3, -0.8, 1.2])
    expected = S + np.cross(ALPHA, point) + np.cross(OMEGA, np.cross(OMEGA, point))
    close(batched(s=S, w=OMEGA, a=ALPHA, p=point)["f"], expected)


@pytest.mark.parametrize("k", range(5))
def test_equation_8_as_printed_is_the_inertia_columns(k):
    (p, q, r), (dp, dq, dr) = OMEGA[k], ALPHA[k]
    printed = [
        [dp, -q * r, q * r, q**2 - r**2, dr + p * q, dq - p * r],
        [p * r, dq, -p * r, dr - p * q, r**2 - p**2, dp + q * r],
        [-p * q, p * q, dr, dq + p * r, dp - q * r, p**2 - q**2],
    ]
    found = platform_regressor(S[[k]], OMEGA[[k]], ALPHA[[k]])[0]
    close(found[3:, 4:], np.array(printed))
    np.testing.assert_array_equal(found[:3, 4:], 0)


@pytest.mark.parametrize("k", range(5))
def test_equation_6_holds_with_the_specific_force_on_the_right(k):
    force = platform_wrench(BODY.parameters, S[[k]], OMEGA[[k]], ALPHA[[k]])[0, :3]

    def cross(v):
        return np.cross(v, np.eye(3)).T

    Phi = np.column_stack([-force, cross(ALPHA[k]) + cross(OMEGA[k]) @ cross(OMEGA[k])])
    close(Phi @ np.r_[1 / BODY.mass, BODY.center_of_gravity], -S[k])


def test_equation_1_needs_the_corrected_sign():
    m, c, J = BODY.mass, BODY.center_of_gravity, BODY.inertia
    rho = np.cross(c, np.eye(3)).T
    found = platform_wrench(BODY.parameters, S, OMEGA, ALPHA)
    for k in range(N):
        gyroscopic = np.cross(OMEGA[k], (J - m * rho @ rho) @ OMEGA[k])
        close(found[k, 3:], m * rho @ S[k] + (J - m * rho @ rho) @ ALPHA[k] + gyroscopic)
        printed = (
            m * rho @ S[k]
            + (J + m * rho @ rho) @ ALPHA[k]
            + np.cross(OMEGA[k], (J + m * rho @ rho) @ OMEGA[k])
        )
        assert np.abs(found[k, 3:] - printed).max() > 1


def test_a_body_at_rest_is_carried_at_its_centre_of_gravity():
    still = np.zeros((1, 3))
    force, torque = platform_wrench(BODY.parameters, -GRAVITY[None], still, still)[0].reshape(2, 3)
    close(force, -BODY.mass * GRAVITY)
    close(torque, np.cross(BODY.center_of_gravity, force))


def test_specific_force_of_a_point_and_how_it_follows_the_point():
    rng = np.random.default_rng(5)
    force, omega, alpha = (rng.normal(0, 3, (7, 3)) for _ in range(3))
    point, step = np.array([0.3, -0.2, 0.5]), 1e-3
    found, by_point = specific_force_at(force, omega, alpha, point)
    np.testing.assert_allclose(
        found,
        force + np.cross(alpha, point) + np.cross(omega, np.cross(omega, point)),
        atol=1e-12,
    )
    for j in range(3):
        # It is linear in the point: any step does.
        moved, _ = specific_force_at(force, omega, alpha, point + step * np.eye(3)[j])
        np.testing.assert_allclose(by_point[:, :, j], (moved - found) / step, atol=1e-9)


def test_a_wrench_about_another_point_is_that_of_pinocchio():
    rng = np.random.default_rng(5)
    wrenches, point = rng.normal(size=(4, 6)), rng.normal(size=3)
    there = pin.SE3(np.eye(3), point)
    expected = np.array([there.actInv(pin.Force(w[:3], w[3:])).vector for w in wrenches])
    close(wrench_about(wrenches, point), expected)
    close(wrench_about(wrenches[0], point), expected[0])
    close(wrench_about(wrenches.T[None], point), expected.T[None])


def tilting(t):
    """Specific force, angular velocity and acceleration of a platform that moves and tilts at .3 and
    .4 Hz."""
    fast, slow = 2 * np.pi * np.array([0.4, 0.3])
    turn = lambda t: Rotation.from_rotvec([0.2 * np.sin(fast * t), 0.15 * np.cos(slow * t), 0.0])  # noqa: E731
    moved = np.array([0.3 * np.sin(slow * t), 0.2 * np.cos(fast * t), 0.1 * np.sin(fast * t)])
    acceleration = -np.array([slow**2, fast**2, fast**2]) * moved
    step = 1e-3
    omega = lambda t: (  # noqa: E731
        (turn(t - step).inv() * turn(t + step)).as_rotvec() / (2 * step)
    )
    alpha = (omega(t + step) - omega(t - step)) / (2 * step)
    return turn(t).inv().apply(acceleration - GRAVITY), omega(t), alpha


@pytest.mark.integration
@pytest.mark.parametrize(
    ("place", "left_out"), [(np.zeros(3), 0.02), (np.array([0.3, -0.2, 0.8]), 0.06)]
)
def test_a_part_on_springs_exerts_what_residual_flexibility_says(place, left_out):
    own, mass, step = 2 * np.pi * 8.0, 3.0, 5e-3
    times = np.arange(0.0, 3.5, step)
    part = Inertia.from_body_parameters(np.r_[mass, place, np.zeros(6)])
    specific_force, omega, alpha = motion = np.array([tilting(t) for t in times]).swapaxes(0, 1)
    felt = np.hstack([specific_force, alpha])
    rate = (felt[2:] - felt[:-2]) / (2 * step)
    change = (felt[:-2] - 2 * felt[1:-1] + felt[2:]) / step**2
    inner = slice(1, -1)
    directions = np.array([np.r_[axis, np.cross(place, axis)] for axis in np.eye(3)[:2]])
    matrix = mass / own**2 * directions.T @ directions
    flexibility = [matrix[i, j] for i, j in FLEXIBILITY]
    stiff = platform_wrench(part.parameters, specific_force, omega, alpha)[inner]
    bent = bending_regressor(np.stack([felt[inner], rate, change]), omega[inner]) @ flexibility
    along = make_interp_spline(times, motion.swapaxes(0, 1))
    exerted = leaning(own, place, mass, along, times)[inner] - stiff
    # It begins with a swing, which has died away by then.
    settled = times[inner] > 2.0
    off, size = (np.linalg.norm(each[settled]) for each in (exerted - bent, exerted))
    # What is left out: squares of the part's own way, and how its moment of inertia changes.
    assert off < left_out * size
