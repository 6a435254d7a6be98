"""Poses that the cables can hold at rest: where a motion may begin and end, near which tension the
cables are held, and why there may be no motion at all.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from steelyard.arrays import Array, readonly
from steelyard.errors import InputError
from steelyard.excitation.command.commanded_state import COMMAND
from steelyard.excitation.command.motion_spline import COORDINATES
from steelyard.excitation.limits.motion_constraints import Margin, MotionConstraints
from steelyard.excitation.settings import DEFAULT, DesignSettings
from steelyard.robot.model import Robot
from steelyard.simulation.trajectories import workspace_of


def rest_constraint(constraints: MotionConstraints, poses: Array) -> Array:
    """Largest constraint of each pose at rest; above 1 it cannot be held, shape (n,).

    Args:
        constraints: Of the robot.
        poses: Shape (n, 6).
    """
    commands = np.hstack([poses, np.zeros((len(poses), COMMAND - COORDINATES))])
    return np.asarray(constraints.values(commands).max(axis=1))


def workspace_grid(robot: Robot, settings: DesignSettings = DEFAULT) -> Array:
    """Level poses over the workspace, its middle first, shape (n, 6)."""
    middle, reach = workspace_of(robot)
    steps = settings.start_grid
    offsets = np.array([[x, y, z] for x in steps for y in steps for z in steps])
    poses = np.tile(middle, (len(offsets), 1))
    poses[:, :3] += offsets * reach[:3]
    return poses[np.argsort(np.linalg.norm(offsets, axis=1), kind="stable")]


def with_tension_level(
    constraints: MotionConstraints, settings: DesignSettings = DEFAULT
) -> MotionConstraints:
    """The same constraints with the cables held near the lowest tension that lets the platform
    hang almost wherever it can.

    Raises:
        InputError: It can hang nowhere.
    """
    robot = constraints.robot
    if not robot.m:
        return constraints
    if robot.m < COORDINATES:
        raise InputError(
            f"robot '{robot.name}': expected at least 6 cables, found {robot.m}; with fewer the"
            " platform cannot be held in all directions"
        )
    poses = workspace_grid(robot, settings)
    tried = [replace(constraints, level=level) for level in _tension_levels(robot, settings)]
    counts = []
    for each in tried:
        counts.append(int(np.sum(rest_constraint(each, poses) <= 1)))
        if counts[-1] == len(poses):
            break
    if not max(counts):
        raise InputError(_why_nowhere(constraints, poses, settings))
    enough = settings.grid_share * max(counts)
    return next(each for each, count in zip(tried, counts, strict=False) if count >= enough)


def _tension_levels(robot: Robot, settings: DesignSettings) -> list[float]:
    """Tensions near which the cables may be held [N]; without a highest allowed one the
    smallest.
    """
    high = robot.tension_limits[1]
    return [share * high for share in settings.tension_levels] if np.isfinite(high) else [0.0]


def with_pose_limits(robot: Robot) -> Robot:
    """The robot with limits on the pose where its file has none: about the middle of its
    workspace.
    """
    middle, reach = workspace_of(robot)
    low, high = middle - reach, middle + reach
    limits = robot.limits
    position = limits.position or (tuple(low[:3].tolist()), tuple(high[:3].tolist()))
    rpy = limits.rpy or (tuple(low[3:].tolist()), tuple(high[3:].tolist()))
    return replace(robot, limits=replace(limits, position=position, rpy=rpy))


def _why_nowhere(constraints: MotionConstraints, poses: Array, settings: DesignSettings) -> str:
    """Whether the margin or the robot is the reason why no pose can be held."""
    robot = constraints.robot
    low, high = robot.tension_limits
    exact = replace(constraints, margin=Margin(0.0, robot.size))
    tried = [replace(exact, level=level) for level in _tension_levels(robot, settings)]
    if any((rest_constraint(each, poses) <= 1).any() for each in tried):
        return (
            f"robot '{robot.name}': expected a pose within its limits that the cables can hold if"
            f" the body differs by {constraints.margin.share:.0%}, found none; choose a smaller"
            " --margin"
        )
    return (
        f"robot '{robot.name}': expected a pose within its limits that {robot.m} cables can hold"
        f" with {low:g} to {high:g} N, found none; check that all cables are listed, and 'limits',"
        " 'tension' and 'platform' in the robot file"
    )


def default_start_pose(constraints: MotionConstraints, settings: DesignSettings = DEFAULT) -> Array:
    """A pose to begin with: the middle of the workspace or, where it is near to a constraint, the
    pose that is farthest from all, shape (6,).

    Raises:
        InputError: The middle of the workspace cannot be held: something is missing, and where to
            go is not for us to guess.
    """
    robot, poses = constraints.robot, workspace_grid(constraints.robot, settings)
    distance = 1 - rest_constraint(constraints, poses)
    best = np.asarray(poses[int(distance.argmax())])
    if distance[0] <= 0:
        raise InputError(
            f"robot '{robot.name}': expected that {robot.m} cables can hold the platform in the"
            f" middle of its limits, {listed_numbers(poses[0, :3])} m, even if it differs by"
            f" {constraints.margin.share:.0%}, found that they can in {int(np.sum(distance > 0))}"
            f" of {len(poses)} places; check that all cables are listed, or give a pose with"
            f" --start, such as {' '.join(f'{value:.3g}' for value in best[:3])} 0 0 0, or a"
            " smaller --margin"
        )
    if distance[0] >= settings.central_share * distance.max():
        return np.asarray(poses[0])
    return best


def checked_pose(constraints: MotionConstraints, pose: Array, which: str) -> Array:
    """A pose that a user has chosen.

    Raises:
        InputError: It is outside the limits, or the cables cannot hold the platform there.
    """
    robot, pose = constraints.robot, readonly(pose, (COORDINATES,), f"--{which}")
    commands = np.concatenate([pose, np.zeros(COMMAND - COORDINATES)])[None]
    values = constraints.values(commands)[0]
    worst = int(values.argmax())
    if values[worst] <= 1:
        return pose
    name = constraints.names[worst]
    if name == "position":
        raise _outside(robot, which, "x, y, z", "m", pose[:3], robot.limits.position)
    if name == "orientation":
        limits = np.degrees(np.array(robot.limits.rpy))
        raise _outside(robot, which, "roll, pitch, yaw", "deg", np.degrees(pose[3:]), limits)
    raise InputError(
        f"--{which}: expected a pose in which the cables can hold the platform, even if it"
        f" differs by {constraints.margin.share:.0%}, with tensions within"
        f" {robot.tension_limits[0]:g} to {robot.tension_limits[1]:g} N, found one where they"
        " cannot; choose another, or a smaller --margin"
    )


def _outside(
    robot: Robot, which: str, what: str, unit: str, found: Array, limits: object
) -> InputError:
    """That a chosen pose is not within the limits."""
    low, high = np.array(limits)
    return InputError(
        f"--{which}: expected {what} within {listed_numbers(low)} to {listed_numbers(high)}"
        f" {unit}, found {listed_numbers(found)}; choose a pose within 'limits' of robot"
        f" '{robot.name}'"
    )


def listed_numbers(values: Array) -> str:
    """Coordinates in brackets, for messages."""
    return "(" + ", ".join(f"{value:g}" for value in np.asarray(values)) + ")"
