"""Tensions of noise-free recordings, against the wrench that they must exert and SciPy's constrained minimum."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize

from steelyard.excitation.information.noise_free_recording import tensions_near_level
from steelyard.excitation.limits.rest_poses import with_pose_limits, workspace_grid
from steelyard.motion.trajectory import multisine
from steelyard.robot.file import read_robot
from steelyard.robot.kinematics import cables_at
from steelyard.robot.model import Limits
from steelyard.simulation.response import ExactMotion
from steelyard.simulation.trajectories import workspace_of

ROBOT = read_robot("cogiro")
STRAIGHT = ROBOT.with_straight_cables()
LEVEL = 900.0
MOTION = multisine([0, 0, 2, 0, 0, 0], np.array([0.5, 0.4, 0.3, 0.2, 0.2, 0.3]), 10, harmonics=4)


def state_of(robot):
    return ExactMotion(robot, robot.platform, MOTION).at(np.linspace(1, 9, 5))


@pytest.mark.parametrize(("robot", "relative"), [(STRAIGHT, 1e-12), (ROBOT, 1e-4)])
def test_they_exert_the_wrench(robot, relative):
    """Sag and tension follow each other, three times: what is left is small."""
    state = state_of(robot)
    tension = tensions_near_level(robot, state, LEVEL)
    W = cables_at(robot, state.position, state.rotation, tension).structure
    exerted = np.einsum("nkm,nm->nk", W, tension)
    assert np.abs(exerted - state.wrench).max() < relative * np.abs(state.wrench).max()


def test_those_of_straight_cables_are_nearest_to_the_level():
    state = state_of(STRAIGHT)
    tension = tensions_near_level(STRAIGHT, state, LEVEL)
    W = cables_at(STRAIGHT, state.position, state.rotation, tension).structure
    for i in range(len(tension)):
        nearest = minimize(
            lambda t: np.sum((t - LEVEL) ** 2) / LEVEL**2,
            np.full(STRAIGHT.m, LEVEL),
            jac=lambda t: 2 * (t - LEVEL) / LEVEL**2,
            constraints={
                "type": "eq",
                "fun": lambda t, i=i: (W[i] @ t - state.wrench[i]) / LEVEL,
                "jac": lambda t, i=i: W[i] / LEVEL,
            },
            method="SLSQP",
            options={"ftol": 1e-14},
        )
        np.testing.assert_allclose(tension[i], nearest.x, atol=1e-3)


def test_the_grid_begins_in_the_middle_and_stay_in_the_workspace():
    poses = workspace_grid(ROBOT)
    middle, reach = workspace_of(ROBOT)
    np.testing.assert_array_equal(poses[0], middle)
    np.testing.assert_array_equal(poses[:, 3:], np.tile(middle[3:], (len(poses), 1)))
    assert np.all(np.abs(poses - middle) <= reach)
    distances = np.linalg.norm((poses - middle)[:, :3] / reach[:3], axis=1)
    assert np.all(np.diff(distances) > -1e-12)
    assert len(np.unique(poses, axis=0)) == len(poses)


def test_a_robot_without_limits_gets_those_of_its_workspace():
    free = replace(ROBOT, limits=Limits())
    middle, reach = workspace_of(free)
    limits = with_pose_limits(free).limits
    np.testing.assert_allclose(limits.position, [(middle - reach)[:3], (middle + reach)[:3]])
    np.testing.assert_allclose(limits.rpy, [(middle - reach)[3:], (middle + reach)[3:]])
    assert with_pose_limits(ROBOT).limits.position == ROBOT.limits.position
