import re
from dataclasses import replace

import numpy as np
import pytest
from few_cables import ABOVE, HEIGHT, NARROW, WIDE, few_cables
from scipy.spatial.transform import Rotation

from steelyard.dynamics import platform_wrench
from steelyard.errors import InfeasibleError
from steelyard.inertia import Inertia
from steelyard.motion.limits import commanded_tensions, motion_extremes, nearest_tensions
from steelyard.motion.state import motion_of_poses, motion_of_quaternions, specific_force_of
from steelyard.motion.trajectory import RestToRest, Sampled, multisine
from steelyard.robot.file import read_robot
from steelyard.robot.kinematics import cables_at
from steelyard.robot.model import Limits

TOLERANCE = 1e-8  # of SI values near one: the sixth-order differences below are good to 1e-10 for slow motions

GRAVITY = np.array([0.2, -0.1, -9.8])
START, END = (
    np.array([0.01, -0.01, 1.55, -0.33, 0.43, -0.54]),
    np.array([1.01, 1.49, 2.55, 0.37, -0.18, 0.51]),
)
MOVE = RestToRest(START, END, move=3.0, pause=0.5)
SINE = multisine([0, 0, 1.5, 0, 0, 0.2], [1.0, 0.8, 0.5, 0.3, 0.25, 0.2], 20.0, 8, seed=3)
TIMES = np.linspace(0.7, 3.3, 27)


def difference(function, t, step=0.02):
    return sum(
        c * (function(t + k * step) - function(t - k * step)) for k, c in ((1, 45), (2, -9), (3, 1))
    ) / (60 * step)


def scipy_rotation(pose):
    return Rotation.from_euler("ZYX", pose[:, [5, 4, 3]])


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_derivatives_of_rest_to_rest_follow_each_other(order):
    found = MOVE.derivative(TIMES, order)
    np.testing.assert_allclose(
        found, difference(lambda t: MOVE.derivative(t, order - 1), TIMES), atol=TOLERANCE
    )


def test_rest_to_rest_goes_straight_from_start_to_end():
    poses = MOVE.derivative(np.array([-1.0, 0.0, 0.5, 2.0, 3.5, 4.0, 9.0]), 0)
    np.testing.assert_allclose(poses[:3], np.tile(START, (3, 1)), atol=TOLERANCE)
    np.testing.assert_allclose(poses[3], (START + END) / 2, atol=TOLERANCE)
    np.testing.assert_allclose(poses[4:], np.tile(END, (3, 1)), atol=TOLERANCE)
    share = (MOVE.derivative(TIMES, 0) - START) / (END - START)
    np.testing.assert_allclose(share, np.tile(share[:, :1], 6), atol=TOLERANCE)
    assert (np.diff(share[:, 0]) > 0).all()


@pytest.mark.parametrize("order", [1, 2, 3])
def test_rest_to_rest_is_at_rest_at_both_ends_up_to_jerk(order):
    just_inside = np.array([0.5 + 1e-9, 3.5 - 1e-9])
    np.testing.assert_allclose(
        MOVE.derivative(just_inside, order), 0, atol=1e2 * TOLERANCE
    )  # snap times 1e-9 s
    np.testing.assert_array_equal(
        MOVE.derivative(np.array([-1.0, 0.2, 0.5, 3.5, 3.9, 7.0]), order), 0
    )


def test_rest_to_rest_reversed_is_the_film_run_backwards():
    assert MOVE.duration == MOVE.reversed().duration == 4.0
    np.testing.assert_allclose(
        MOVE.reversed().derivative(4.0 - TIMES, 0), MOVE.derivative(TIMES, 0), atol=TOLERANCE
    )
    np.testing.assert_allclose(
        MOVE.reversed().derivative(4.0 - TIMES, 1), -MOVE.derivative(TIMES, 1), atol=TOLERANCE
    )


@pytest.mark.parametrize("n", [2, 3, 4, 5, 6, 40])
def test_sampled_goes_through_its_poses_and_rests_outside(n):
    rng = np.random.default_rng(n)
    time, poses = np.r_[0.0, np.cumsum(rng.uniform(0.1, 0.4, n - 1))], rng.normal(size=(n, 6))
    found = Sampled.through(time, poses)
    assert found.duration == time[-1]
    np.testing.assert_allclose(found.derivative(time, 0), poses, atol=TOLERANCE)
    outside = np.array([-2.0, -1e-9, time[-1] + 1e-9, time[-1] + 5])
    np.testing.assert_allclose(found.derivative(outside, 0), poses[[0, 0, -1, -1]], atol=TOLERANCE)
    for order in (1, 2, 3):
        np.testing.assert_array_equal(found.derivative(outside, order), 0)


def test_sampled_reproduces_a_quintic_and_its_derivatives():
    quintics = [np.polynomial.Polynomial(c) for c in np.random.default_rng(5).normal(size=(6, 6))]
    time = np.linspace(0, 2.0, 15)
    found = Sampled.through(time, np.column_stack([q(time) for q in quintics]))
    t = np.linspace(0.05, 1.95, 33)
    for order in range(5):
        expected = np.column_stack([q.deriv(order)(t) if order else q(t) for q in quintics])
        np.testing.assert_allclose(
            found.derivative(t, order), expected, atol=TOLERANCE, rtol=TOLERANCE
        )


@pytest.mark.parametrize("harmonics", [1, 8, 40])
@pytest.mark.parametrize("order", [0, 1, 2])
def test_multisine_begins_and_ends_at_rest_at_its_centre(order, harmonics):
    center, amplitude, duration = (
        [0.1, -0.2, 1.5, 0.0, 0.1, 0.2],
        [1.0, 0.8, 0.5, 0.3, 0.25, 0.2],
        20.0,
    )
    ends = multisine(center, amplitude, duration, harmonics).derivative(
        np.array([0.0, duration]), order
    )
    expected = center if order == 0 else np.zeros(6)
    np.testing.assert_allclose(ends, np.tile(expected, (2, 1)), atol=TOLERANCE)


def test_multisine_fills_its_amplitude_and_holds_its_frequencies():
    time = np.linspace(0, 20.0, 4001)
    excursion = np.abs(SINE.derivative(time, 0) - [0, 0, 1.5, 0, 0, 0.2]).max(axis=0)
    np.testing.assert_allclose(excursion, [1.0, 0.8, 0.5, 0.3, 0.25, 0.2], rtol=0.01)
    spectrum = np.abs(np.fft.rfft(SINE.derivative(time[:-1], 0) - [0, 0, 1.5, 0, 0, 0.2], axis=0))
    assert (
        spectrum[13:].max(axis=0) < 0.1 * spectrum[1:9].max(axis=0)
    ).all()  # the fading widens the lines a little


def test_multisine_is_drawn_by_its_seed():
    def drawn(seed):
        return multisine([0] * 6, [1] * 6, 10.0, 4, seed=seed).derivative(np.array([4.0]), 0)

    np.testing.assert_array_equal(drawn(1), drawn(1))
    assert np.abs(drawn(1) - drawn(2)).max() > 0.01


class Swing:
    """All six axes at their own frequencies, without knots or ends."""

    amplitude = np.array([1.0, 0.8, 0.5, 0.6, 0.5, 2.0])
    rate = np.array([0.7, 0.9, 1.1, 0.8, 1.2, 0.6])

    def derivative(self, t, order):
        angle = np.multiply.outer(t, self.rate) + np.arange(6) + order * np.pi / 2
        return self.amplitude * self.rate**order * np.sin(angle)


@pytest.mark.parametrize("trajectory", [MOVE, Swing()], ids=["rest-to-rest", "swing"])
def test_motion_of_poses_is_what_scipy_rotations_do(trajectory):
    motion = motion_of_poses(*(trajectory.derivative(TIMES, k) for k in range(3)), GRAVITY)
    here = scipy_rotation(trajectory.derivative(TIMES, 0))

    def turned(t):
        return (here.inv() * scipy_rotation(trajectory.derivative(t, 0))).as_rotvec()

    def omega(t):
        now = scipy_rotation(trajectory.derivative(t, 0))
        return difference(
            lambda u: (now.inv() * scipy_rotation(trajectory.derivative(u, 0))).as_rotvec(), t
        )

    acceleration = difference(
        lambda t: difference(lambda u: trajectory.derivative(u, 0)[:, :3], t), TIMES
    )
    np.testing.assert_allclose(motion["rotation"], here.as_matrix(), atol=TOLERANCE)
    np.testing.assert_allclose(
        motion["position"], trajectory.derivative(TIMES, 0)[:, :3], atol=TOLERANCE
    )
    np.testing.assert_allclose(motion["omega"], difference(turned, TIMES), atol=TOLERANCE)
    np.testing.assert_allclose(motion["alpha"], difference(omega, TIMES), atol=TOLERANCE)
    np.testing.assert_allclose(
        motion["specific_force"], here.inv().apply(acceleration - GRAVITY), atol=TOLERANCE
    )
    force_samples = specific_force_of(motion["rotation"], acceleration, GRAVITY)
    np.testing.assert_allclose(force_samples, motion["specific_force"], atol=TOLERANCE)


@pytest.mark.parametrize("length", [1.0, 0.3])
def test_motion_of_quaternions_is_that_of_their_rotations_whatever_their_length(length):
    def quaternion(t):
        q = Rotation.from_euler("ZYX", MOVE.derivative(t, 0)[:, [5, 4, 3]]).as_quat(
            scalar_first=True
        )
        return q * np.sign(q[:, :1]) * (1 if length == 1 else length + 0.05 * t[:, None])

    rates = [quaternion(TIMES), difference(quaternion, TIMES)]
    rates.append(difference(lambda t: difference(quaternion, t), TIMES))
    expected = motion_of_poses(*(MOVE.derivative(TIMES, k) for k in range(3)), GRAVITY)
    found = motion_of_quaternions(*rates)
    np.testing.assert_allclose(found["omega"], expected["omega"], atol=TOLERANCE)
    np.testing.assert_allclose(found["alpha"], expected["alpha"], atol=TOLERANCE)


def test_wrench_along_a_trajectory_moves_every_point_of_a_cloud():
    masses, points = (
        np.random.default_rng(2).uniform(1, 9, 6),
        np.random.default_rng(3).normal(size=(6, 3)),
    )

    def places(t):  # (n, 6 points, 3)
        pose = MOVE.derivative(t, 0)
        return pose[:, None, :3] + np.einsum(
            "nij,kj->nki", scipy_rotation(pose).as_matrix(), points
        )

    accelerations = difference(lambda t: difference(places, t), TIMES)
    forces = masses[:, None] * (accelerations - GRAVITY)
    arms = places(TIMES) - MOVE.derivative(TIMES, 0)[:, None, :3]
    turn = scipy_rotation(MOVE.derivative(TIMES, 0))
    force, torque = (turn.inv().apply(v.sum(axis=1)) for v in (forces, np.cross(arms, forces)))
    motion = motion_of_poses(*(MOVE.derivative(TIMES, k) for k in range(3)), GRAVITY)
    found = platform_wrench(
        Inertia.from_points(masses, points).parameters,
        motion["specific_force"],
        motion["omega"],
        motion["alpha"],
    )
    np.testing.assert_allclose(found, np.hstack([force, torque]), atol=masses.sum() * TOLERANCE)


# The polynomial of a move is 35/16 times as fast halfway as on average.
@pytest.mark.parametrize(
    ("limits", "end", "fraction", "worst"),
    [
        (Limits(), [1, 0, 0, 0, 0, 0], 0.0, "no limits given"),
        (Limits(speed=2.0), [0.6, 0.8, 0, 0, 0, 0], 35 / 16 / 4 / 2.0, "speed 0.547 of 2 m/s"),
        (
            Limits(speed=2.0, angular_speed=0.5),
            [0.1, 0, 0, 0, 0, 1],
            35 / 16 / 4 / 0.5,
            "angular speed 0.547 of 0.5 rad/s",
        ),
        (
            Limits(position=((-1, -1, -1), (3, 3, 3)), speed=9),
            [0, 4, 0, 0, 0, 0],
            1.5,
            r"position\[1\] 0 to 4 of -1 to 3 m",
        ),
        (
            Limits(rpy=((-0.5,) * 3, (0.5,) * 3)),
            [0, 0, 0, 0.4, -0.6, 0],
            1.2,
            r"roll, pitch, yaw\[1\] -34\.4 to -?0 of -28\.6 to 28\.6 deg",
        ),
    ],
)
def test_extremes_name_the_limit_that_is_used_most(limits, end, fraction, worst):
    robot = replace(read_robot("cogiro"), limits=limits)
    found = motion_extremes(robot, RestToRest(np.zeros(6), end, move=4.0))
    assert found.fraction == pytest.approx(fraction, rel=TOLERANCE)
    assert re.search(worst, found.worst)


def test_commanded_tensions_carry_the_platform():
    robot = read_robot("cogiro").with_straight_cables()
    tension = commanded_tensions(robot, MOVE, TIMES)
    motion = motion_of_poses(*(MOVE.derivative(TIMES, k) for k in range(3)), robot.gravity)
    W = cables_at(robot, motion["position"], motion["rotation"], tension).structure
    wrench = platform_wrench(
        robot.platform.parameters, motion["specific_force"], motion["omega"], motion["alpha"]
    )
    np.testing.assert_allclose(
        np.einsum("nkm,nm->nk", W, tension), wrench, atol=100 * TOLERANCE * np.abs(wrench).max()
    )
    assert (tension >= 50).all()


def test_four_cables_carry_a_quarter_of_the_weight_each():
    middle = replace(few_cables(4), platform=Inertia(5.0, np.zeros(3), 0.1 * np.eye(3)))
    still = RestToRest(np.zeros(6), np.zeros(6), move=1.0)
    tension = nearest_tensions(middle, still, np.zeros(1))
    depth = HEIGHT - ABOVE
    upward = depth / np.hypot(depth, WIDE - NARROW)
    np.testing.assert_allclose(tension, 5.0 * 9.81 / 4 / upward, rtol=1e-3)


@pytest.mark.parametrize("count", [3, 4])
def test_what_few_cables_cannot_exert_is_at_right_angles_to_what_they_can(count):
    robot = few_cables(count)
    pose = np.array([[*robot.anchors[:, :2].mean(axis=0), 0.2, 0.02, -0.01, 0.0]])
    still = RestToRest(pose[0], pose[0], move=1.0)
    tension = nearest_tensions(robot, still, np.zeros(1))
    motion = motion_of_poses(pose, np.zeros((1, 6)), np.zeros((1, 6)), robot.gravity)
    W = cables_at(robot, motion["position"], motion["rotation"], tension).structure[0]
    wrench = platform_wrench(
        robot.platform.parameters, motion["specific_force"], motion["omega"], motion["alpha"]
    )[0]
    units = np.repeat([1.0, robot.size], 3)
    left = (wrench - W @ tension[0]) / units
    # Along what they pull together with any strength.
    along = np.linalg.svd(W / units[:, None])[0][:, :3]
    assert np.abs(along.T @ left).max() < 1e-9 * np.abs(wrench).max()
    assert np.abs(left).max() > 1e-3
    away = RestToRest(pose[0], pose[0] + np.array([9, 0, 0, 0, 0, 0]), move=4.0)
    with pytest.raises(
        InfeasibleError, match=r"expected tensions within 1 to 500 N that carry .*c"
    ):
        nearest_tensions(robot, away, TIMES)


def test_a_pose_outside_the_frame_cannot_be_commanded_and_its_time_is_named():
    away = RestToRest([0, 0, 1.5, 0, 0, 0], [12.0, 0, 1.5, 0, 0, 0], move=10.0)
    with pytest.raises(
        InfeasibleError, match=r"^at \d+\.\d\d s of the trajectory: expected tensions within 50"
    ):
        commanded_tensions(read_robot("cogiro"), away, np.linspace(0, 10, 51))
