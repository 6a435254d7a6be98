"""Where a motion may begin and end, how tight its cables are held, and why there may be no motion
at all.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import InputError
from steelyard.excitation.course import SIX
from steelyard.excitation.demands import Demands, Margin
from steelyard.excitation.sight import AT
from steelyard.robot.model import Robot
from steelyard.simulation.trajectories import workspace_of

_GRID = (0.0, -0.3, 0.3, -0.6, 0.6)
"""Places that are tried, in units of the reach from the middle."""
_LEVELS = (0.0, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5)
"""Tensions that cables may be held near to, in units of the highest allowed: the lowest that lets
the platform hang almost everywhere."""
_ALMOST = 0.9
_CENTRAL = 0.5
"""A start in the middle of the workspace is taken where it leaves this part of the room that the
best pose has."""


def hanging(demands: Demands, poses: Array) -> Array:
    """Worst demand of each pose at rest; above 1 it cannot be held, shape (n,).

    Args:
        demands: Of the robot.
        poses: Shape (n, 6).
    """
    commands = np.hstack([poses, np.zeros((len(poses), AT - SIX))])
    return np.asarray(demands.values(commands).max(axis=1))


def places(robot: Robot) -> Array:
    """Level poses over the workspace, its middle first, shape (n, 6)."""
    middle, reach = workspace_of(robot)
    offsets = np.array([[a, b, c] for a in _GRID for b in _GRID for c in _GRID])
    poses = np.tile(middle, (len(offsets), 1))
    poses[:, :3] += offsets * reach[:3]
    return poses[np.argsort(np.linalg.norm(offsets, axis=1), kind="stable")]


def held(demands: Demands) -> Demands:
    """The same demands with the cables held near to the lowest tension that lets the platform hang
    almost wherever it can.

    Raises:
        InputError: It can hang nowhere.
    """
    robot = demands.robot
    if not robot.m:
        return demands
    if robot.m < SIX:
        raise InputError(
            f"robot '{robot.name}': expected at least 6 cables, found {robot.m}; with fewer the"
            " platform cannot be held in all directions"
        )
    poses = places(robot)
    tried = [replace(demands, level=level) for level in _levels(robot)]
    counts = []
    for each in tried:
        counts.append(int(np.sum(hanging(each, poses) <= 1)))
        if counts[-1] == len(poses):
            break
    if not max(counts):
        raise InputError(_why_nowhere(demands, poses))
    return next(
        each for each, count in zip(tried, counts, strict=False) if count >= _ALMOST * max(counts)
    )


def _levels(robot: Robot) -> list[float]:
    """Tensions that the cables may be held near to [N]; without a highest allowed one the
    smallest.
    """
    high = robot.tension_limits[1]
    return [share * high for share in _LEVELS] if np.isfinite(high) else [0.0]


def within_bounds(robot: Robot) -> Robot:
    """The robot with limits on the pose where its file has none: about the middle of its
    workspace.
    """
    middle, reach = workspace_of(robot)
    low, high = middle - reach, middle + reach
    limits = robot.limits
    position = limits.position or (tuple(low[:3].tolist()), tuple(high[:3].tolist()))
    rpy = limits.rpy or (tuple(low[3:].tolist()), tuple(high[3:].tolist()))
    return replace(robot, limits=replace(limits, position=position, rpy=rpy))


def _why_nowhere(demands: Demands, poses: Array) -> str:
    robot = demands.robot
    low, high = robot.tension_limits
    exact = [
        replace(demands, margin=Margin(0.0, robot.size), level=level) for level in _levels(robot)
    ]
    if any((hanging(each, poses) <= 1).any() for each in exact):
        return (
            f"robot '{robot.name}': expected a pose within its limits that the cables can hold if"
            f" the body differs by {demands.margin.share:.0%}, found none; choose a smaller"
            " --margin"
        )
    return (
        f"robot '{robot.name}': expected a pose within its limits that {robot.m} cables can hold"
        f" with {low:g} to {high:g} N, found none; check that all cables are listed, and 'limits',"
        " 'tension' and 'platform' in the robot file"
    )


def good_pose(demands: Demands) -> Array:
    """A pose to begin with: the middle of the workspace or, where little room is left there, the
    place that leaves most, shape (6,).

    Raises:
        InputError: The middle of the workspace cannot be held: something is missing, and where to
            go is not for us to guess.
    """
    robot, poses = demands.robot, places(demands.robot)
    room = 1 - hanging(demands, poses)
    best = np.asarray(poses[int(room.argmax())])
    if room[0] <= 0:
        raise InputError(
            f"robot '{robot.name}': expected that {robot.m} cables can hold the platform in the"
            f" middle of its limits, {_listed(poses[0, :3])} m, even if it differs by"
            f" {demands.margin.share:.0%}, found that they can in {int(np.sum(room > 0))} of"
            f" {len(poses)} places; check that all cables are listed, or give a pose with --start,"
            f" such as {' '.join(f'{value:.3g}' for value in best[:3])} 0 0 0, or a smaller"
            " --margin"
        )
    return np.asarray(poses[0]) if room[0] >= _CENTRAL * room.max() else best


def checked_pose(demands: Demands, pose: Array, which: str) -> Array:
    """A pose that a user has chosen.

    Raises:
        InputError: It is outside the limits, or the cables cannot hold the platform there.
    """
    robot = demands.robot
    commands = np.concatenate([pose, np.zeros(AT - SIX)])[None]
    values = demands.values(commands)[0]
    worst = int(values.argmax())
    if values[worst] > 1:
        name = demands.names[worst]
        if name in {"position", "orientation"}:
            what, unit, found = (
                ("x, y, z", "m", pose[:3])
                if name == "position"
                else ("roll, pitch, yaw", "deg", np.degrees(pose[3:]))
            )
            low, high = (
                np.array(robot.limits.position)
                if name == "position"
                else np.degrees(np.array(robot.limits.rpy))
            )
            raise InputError(
                f"--{which}: expected {what} within {_listed(low)} to {_listed(high)} {unit}, found"
                f" {_listed(found)}; choose a pose within 'limits' of robot '{robot.name}'"
            )
        raise InputError(
            f"--{which}: expected a pose in which the cables can hold the platform, even if it"
            f" differs by {demands.margin.share:.0%}, with tensions within"
            f" {robot.tension_limits[0]:g} to {robot.tension_limits[1]:g} N, found one where they"
            " cannot; choose another, or a smaller --margin"
        )
    return pose


def _listed(values: Array) -> str:
    return "(" + ", ".join(f"{value:g}" for value in np.asarray(values)) + ")"
