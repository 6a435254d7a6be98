"""Poses at rest among which a calibration may choose, and the regular grid that it is compared
with.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from steelyard.arrays import Array
from steelyard.excitation.limits.motion_constraints import MotionConstraints
from steelyard.excitation.limits.rest_poses import rest_constraint
from steelyard.excitation.settings import DEFAULT, DesignSettings
from steelyard.simulation.trajectories import workspace_of


def candidate_poses(
    constraints: MotionConstraints, seed: int, settings: DesignSettings = DEFAULT
) -> Array:
    """Poses that the cables can hold, drawn over the whole workspace and more densely at its ends,
    where geometry is told best; shape (n, 6).

    Args:
        constraints: Of a robot with limits on its pose.
        seed: The same seed gives the same poses.
        settings: How many are drawn.
    """
    rng = np.random.default_rng(seed)
    drawn = np.sin(np.pi * (rng.random((settings.candidate_poses, 6)) - 0.5))
    return _held(constraints, drawn, settings)


def regular_grid(
    constraints: MotionConstraints, count: int, settings: DesignSettings = DEFAULT
) -> Array:
    """As many poses on a regular grid, the corners of the workspace first, turned about one axis
    after the other; shape (n, 6), n at most ``count``.

    Args:
        constraints: Of a robot with limits on its pose.
        count: Poses wanted.
        settings: How far they are turned.
    """
    steps = 2
    while steps**3 < 2 * count:
        steps += 1
    line = np.linspace(-1.0, 1.0, steps)
    places = np.array(list(product(line, line, line)))
    places = places[np.argsort(-np.linalg.norm(places, axis=1), kind="stable")]
    turns = np.vstack([np.eye(3), -np.eye(3), np.zeros((1, 3))])
    wanted = np.hstack([places, settings.grid_turn * turns[np.arange(len(places)) % len(turns)]])
    return _held(constraints, wanted, settings)[:count]


def in_sequence(poses: Array, reach: Array) -> Array:
    """The same poses, each followed by the nearest that is left: short ways between them; shape (n,
    6).

    Args:
        poses: Shape (n, 6).
        reach: Half widths of the workspace, by which distances are told, shape (6,).
    """
    scaled = poses / np.maximum(reach, 1e-9)
    left = list(range(1, len(poses)))
    order = [0]
    while left:
        away = np.linalg.norm(scaled[left] - scaled[order[-1]], axis=1)
        order.append(left.pop(int(away.argmin())))
    return np.asarray(poses[order])


def _held(constraints: MotionConstraints, relative: Array, settings: DesignSettings) -> Array:
    """Those poses that the cables can hold, turned less where they cannot otherwise, shape (n, 6).

    Args:
        constraints: Of the robot.
        relative: In half widths of the workspace about its middle, shape (k, 6).
        settings: How much less they are turned.
    """
    middle, reach = workspace_of(constraints.robot)
    poses = middle + relative * reach
    holds = rest_constraint(constraints, poses) <= 1
    for share in settings.smaller_turns:
        turned_less = poses.copy()
        turned_less[:, 3:] = middle[3:] + share * relative[:, 3:] * reach[3:]
        also = ~holds & (rest_constraint(constraints, turned_less) <= 1)
        poses[also] = turned_less[also]
        holds |= also
    return np.asarray(poses[holds])
