"""Free swings on cables of constant length: energy, lengths, Newton and Euler, and small ones."""

from dataclasses import replace

import numpy as np
import pytest
from mujoco_swings import BODY, swinging_robot
from scipy.spatial.transform import Rotation

from steelyard.motion.state import motion_of_poses
from steelyard.natural_frequencies.free_swing import free_swing, hung_on
from steelyard.natural_frequencies.modes import natural
from steelyard.robot.kinematics import cables_at
from steelyard.simulation.response import ExactMotion

POSE = [0.3, 0.1, 1.2, 0.0, 0.0, 0.0]
DURATION = 3.0


def swinging(m, amplitude, mode=None):
    """A place of rest, and a swing in one mode or in all."""
    found = natural(swinging_robot(m), BODY, pose=POSE)
    own = range(6 - m) if mode is None else [mode]
    rate = sum(2 * np.pi * found.frequencies[i] * amplitude * found.shapes[i] for i in own)
    return found, free_swing(found, rate, DURATION)


def state_of(found, swing, times):
    return ExactMotion(found.cables, BODY, swing.trajectory).at(times)


@pytest.mark.parametrize("m", [2, 3, 4])
def test_energy_and_lengths_stay(m):
    found, swing = swinging(m, 0.05)
    # The spline knows little of derivatives at its very ends.
    state = state_of(found, swing, np.linspace(0.1, DURATION - 0.1, 200))
    center = state.position + state.rotation @ BODY.center_of_gravity
    moving = state.velocity + np.einsum(
        "nij,nj->ni", state.rotation, np.cross(state.omega, BODY.center_of_gravity)
    )
    turning = np.einsum("ni,ij,nj->n", state.omega, BODY.inertia, state.omega)
    energy = (
        0.5 * (BODY.mass * np.sum(moving**2, axis=1) + turning) + BODY.mass * 9.81 * center[:, 2]
    )
    np.testing.assert_allclose(energy, energy[0], atol=1e-5)
    assert np.ptp(BODY.mass * 9.81 * center[:, 2]) > 0.1
    points = state.position[:, None] + np.einsum(
        "nij,mj->nmi", state.rotation, found.cables.attachments
    )
    lengths = np.linalg.norm(points - found.cables.anchors, axis=2)
    np.testing.assert_allclose(lengths, np.broadcast_to(found.lengths, lengths.shape), atol=1e-7)


@pytest.mark.parametrize("m", [2, 4])
def test_tensions_are_those_that_the_motion_needs(m):
    found, swing = swinging(m, 0.05)
    n = len(swing.tension)
    times = np.linspace(0, DURATION, n)[10:-10]
    state = state_of(found, swing, times)
    structure = cables_at(
        found.cables, state.position, state.rotation, swing.tension[10:-10]
    ).structure
    pulled = np.einsum("nkm,nm->nk", structure, swing.tension[10:-10])
    np.testing.assert_allclose(pulled, state.wrench, atol=1e-3)


@pytest.mark.parametrize("mode", [0, 1, 2])
def test_small_swings_have_the_natural_frequency(mode):
    found, swing = swinging(3, 1e-4, mode)
    times = np.linspace(0, DURATION, 500)
    poses = swing.trajectory.derivative(times, 0)
    rest = found.rest.place
    rpy = Rotation.from_matrix(rest.rotation).as_euler("ZYX")[::-1]
    off = poses - np.concatenate([rest.position, rpy])
    phase = 2 * np.pi * found.frequencies[mode] * times
    left = off - np.outer(
        np.sin(phase), np.linalg.lstsq(np.sin(phase)[:, None], off, rcond=None)[0]
    )
    assert np.abs(left).max() < 2e-3 * np.abs(off).max()


def test_a_robot_with_some_of_its_cables():
    robot = swinging_robot(4)
    three = hung_on(robot, np.array([0, 1, 3]))
    np.testing.assert_array_equal(three.anchors, robot.anchors[[0, 1, 3]])
    np.testing.assert_array_equal(three.attachments, robot.attachments[[0, 1, 3]])
    whole = np.arange(24.0 * 24).reshape(24, 24)
    calibrated = hung_on(replace(robot, covariance=whole + whole.T), np.array([1, 2]))
    assert calibrated.covariance.shape == (12, 12)
    assert calibrated.covariance[0, 6] == (whole + whole.T)[3, 15]


def test_motion_is_that_of_a_rigid_body():
    found, swing = swinging(3, 0.05)
    times = np.linspace(0.1, DURATION - 0.1, 50)
    pose, rate, acceleration = (swing.trajectory.derivative(times, k) for k in range(3))
    motion = motion_of_poses(pose, rate, acceleration, found.cables.gravity)
    step = 1e-4
    before, after = (state_of(found, swing, times + s).velocity for s in (-step, step))
    by_differences = (after - before) / (2 * step)
    acceleration = np.einsum("nij,nj->ni", motion["rotation"], motion["specific_force"])
    np.testing.assert_allclose(acceleration + found.cables.gravity, by_differences, atol=1e-4)
