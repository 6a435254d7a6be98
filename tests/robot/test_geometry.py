"""Derivatives of the wrench of the cables against differences of the cables themselves."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from steelyard import rotations
from steelyard.robot.kinematics import cable_wrench, cables_at
from steelyard.robot.model import CableProperties, Robot

N, M = 6, 4
STEP = 1e-5  # [m], [rad]; of central differences
TOLERANCE = (
    2e-7  # relative to the largest derivative: cables of metres turn smoothly within the step
)

PLAIN = Robot(
    name="plain",
    anchors=[[-4, -3, 5], [4, -3, 5.5], [4, 3, 5], [-4, 3, 6]],
    attachments=[[-0.3, -0.2, 0.1], [0.3, -0.2, 0], [0.3, 0.25, 0], [-0.3, 0.2, 0.1]],
)
ROBOTS = {
    "from points": PLAIN,
    "over pulleys": replace(
        PLAIN,
        pulley_radius=np.array([0.05, 0.12, 0.0, 0.08]),
        pulley_axis=np.array([[0, 0, 1.0], [0.1, -0.2, 1.0], [0, 0, 1.0], [0.3, 0, -1.0]]),
    ),
    "that stretch": replace(PLAIN, cable=CableProperties(axial_stiffness=4e4)),
}


@pytest.fixture
def poses():
    rng = np.random.default_rng(11)
    return (
        rng.normal([0, 0, 2], 0.5, (N, 3)),
        Rotation.from_rotvec(rng.normal(0, 0.5, (N, 3))).as_matrix(),
        rng.uniform(80, 900, (N, M)),
    )


def derivatives(robot, position, rotation, tension):
    """Of the wrench of straight cables over n samples: by anchors and attachments, shape (n, 6,
    3 m), and by position and a rotation vector on the right of the rotation, shape (n, 6, 6)."""
    ends = [ca.SX.sym(name, 3, M) for name in ("anchors", "attachments")]
    at, R = ca.SX.sym("position", 3), ca.SX.sym("rotation", 3, 3)
    t, turn = ca.SX.sym("tension", M), ca.SX.sym("turn", 3)
    wrench = cable_wrench(robot.with_straight_cables(), at, R @ rotations.exp(turn), t, *ends)
    by = [ca.jacobian(wrench, ca.vec(each)) for each in (*ends, ca.vertcat(at, turn))]
    function = ca.Function("derivatives", [at, R, t, *ends, turn], by)
    fixed = (np.transpose(robot.anchors), np.transpose(robot.attachments), np.zeros(3))
    samples = [function(*each, *fixed) for each in zip(position, rotation, tension, strict=True)]
    return tuple(np.array([np.array(one) for one in each]) for each in zip(*samples, strict=True))


def pulls(robot, position, rotation, tension):
    """Wrench of every cable alone, shape (n, 6, m)."""
    return cables_at(robot, position, rotation, tension).structure * tension[:, None, :]


def differences(function):
    """Central differences by three coordinates, on the last axis."""
    return np.stack(
        [(function(STEP * e) - function(-STEP * e)) / (2 * STEP) for e in np.eye(3)], axis=-1
    )


def assert_derivative(found, expected):
    np.testing.assert_allclose(found, expected, atol=TOLERANCE * np.abs(expected).max())


@pytest.mark.parametrize("end", ["anchors", "attachments"])
@pytest.mark.parametrize("cables", ROBOTS)
def test_the_wrench_follows_where_the_cables_are_fixed(cables, end, poses):
    robot = ROBOTS[cables]
    found = derivatives(robot, *poses)[["anchors", "attachments"].index(end)]
    # All cables move at once: each pulls by its own ends alone.
    expected = differences(
        lambda step: pulls(replace(robot, **{end: getattr(robot, end) + step}), *poses)
    )
    assert found.shape == (N, 6, 3 * M)
    assert_derivative(found.reshape(N, 6, M, 3), expected)


def test_a_cable_whose_end_is_moved_alone_changes_nothing_in_the_others(poses):
    attachments = np.array(PLAIN.attachments)
    attachments[2, 1] += STEP
    moved = replace(PLAIN, attachments=attachments)
    change = (pulls(moved, *poses) - pulls(PLAIN, *poses)).sum(axis=2) / STEP
    found = derivatives(PLAIN, *poses)[1][:, :, 2 * 3 + 1]
    # One-sided: wrong by the step itself.
    np.testing.assert_allclose(found, change, atol=10 * STEP * np.abs(change).max())


@pytest.mark.parametrize("cables", ROBOTS)
def test_the_wrench_follows_the_pose(cables, poses):
    robot, (position, rotation, tension) = ROBOTS[cables], poses
    found = derivatives(robot, *poses)[2]
    moved = differences(lambda step: pulls(robot, position + step, rotation, tension).sum(axis=2))
    turned = differences(
        lambda step: pulls(
            robot, position, rotation @ Rotation.from_rotvec(step).as_matrix(), tension
        ).sum(axis=2)
    )
    assert_derivative(found[:, :, :3], moved)
    assert_derivative(found[:, :, 3:], turned)


def test_straight_cables_from_points_have_a_derivative_in_closed_form(poses):
    # A unit vector d along a chord of length l turns by (I - d d^T) / l times the step of its end.
    position, rotation, tension = poses
    by_anchor, _, _ = derivatives(PLAIN, *poses)
    for n in range(N):
        R = rotation[n]
        for i, (a, b) in enumerate(zip(PLAIN.anchors, PLAIN.attachments, strict=True)):
            chord = a - position[n] - R @ b
            length = np.linalg.norm(chord)
            d = chord / length
            force = tension[n, i] * R.T @ (np.eye(3) - np.outer(d, d)) / length
            expected = np.vstack([force, np.cross(b, force, axis=0)])
            np.testing.assert_allclose(by_anchor[n, :, 3 * i : 3 * i + 3], expected, atol=1e-9)


def test_moving_everything_alike_changes_nothing(poses):
    # Anchors and platform by the same step in the world: the sum over all anchors is minus the
    # derivative by the position.
    by_anchor, _, by_pose = derivatives(ROBOTS["over pulleys"], *poses)
    together = by_anchor.reshape(N, 6, M, 3).sum(axis=2)
    np.testing.assert_allclose(together, -by_pose[:, :, :3], atol=1e-9)


def test_sag_hardly_changes_how_the_wrench_follows_the_attachments(poses):
    position, rotation, tension = poses
    tight = (position, rotation, 20 * tension)
    heavy = replace(PLAIN, cable=CableProperties(linear_density=0.06))
    expected = differences(
        lambda step: pulls(replace(heavy, attachments=heavy.attachments + step), *tight)
    )
    found = derivatives(heavy, *tight)[1].reshape(N, 6, M, 3)
    # Cables of 4 N that pull with 2 kN and more sag by a thousandth.
    np.testing.assert_allclose(found, expected, atol=2e-3 * np.abs(expected).max())
