"""Whether a trajectory keeps to what the robot can do."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array
from steelyard.dynamics import platform_wrench
from steelyard.errors import InfeasibleError
from steelyard.motion.state import motion_of_poses
from steelyard.motion.trajectory import Trajectory
from steelyard.robot.kinematics import cables_at
from steelyard.robot.model import Robot
from steelyard.robot.tension import distribute

_CHECKS_PER_SECOND = 50.0
_MOST_CHECKS = 20_000


@dataclass(frozen=True)
class Extremes:
    """How hard a trajectory is on its robot."""

    fraction: float
    """Largest use of a limit on pose, speed or acceleration; above 1 it is violated."""
    worst: str
    """Which one that is, in words and numbers."""


def check_times(trajectory: Trajectory) -> Array:
    """Times at which a trajectory is checked [s], shape (n,)."""
    count = min(int(np.ceil(trajectory.duration * _CHECKS_PER_SECOND)), _MOST_CHECKS)
    return np.linspace(0.0, trajectory.duration, count + 1)


def motion_extremes(robot: Robot, trajectory: Trajectory) -> Extremes:
    """Hold a trajectory against the robot's limits on pose, speed and acceleration."""
    t = check_times(trajectory)
    pose, rate, acceleration = (trajectory.derivative(t, order) for order in range(3))
    motion = motion_of_poses(pose, rate, acceleration, robot.gravity)
    limits = robot.limits
    uses: list[tuple[float, str]] = [(0.0, "no limits given")]

    def bounded(value: Array, limit: float | None, what: str, unit: str) -> None:
        if limit is not None:
            largest = float(np.linalg.norm(value, axis=1).max())
            uses.append((largest / limit, f"{what} {largest:.3g} of {limit:g} {unit}"))

    def boxed(value: Array, box: object, what: str, unit: str) -> None:
        if box is not None:
            low, high = np.array(box)
            middle, half = (low + high) / 2, (high - low) / 2
            use = np.abs((value - middle) / half).max(axis=0)
            axis = int(use.argmax())
            found = f"{value[:, axis].min():.3g} to {value[:, axis].max():.3g} of {low[axis]:.3g} to {high[axis]:.3g} {unit}"
            uses.append((float(use[axis]), f"{what}[{axis}] {found}"))

    boxed(pose[:, :3], limits.position, "position", "m")
    boxed(np.degrees(pose[:, 3:]), np.degrees(limits.rpy) if limits.rpy else None, "roll, pitch, yaw", "deg")
    bounded(rate[:, :3], limits.speed, "speed", "m/s")
    bounded(acceleration[:, :3], limits.acceleration, "acceleration", "m/s^2")
    bounded(motion["omega"], limits.angular_speed, "angular speed", "rad/s")
    bounded(motion["alpha"], limits.angular_acceleration, "angular acceleration", "rad/s^2")
    return Extremes(*max(uses))


def commanded_tensions(robot: Robot, trajectory: Trajectory, times: Array, *, still: bool = False) -> Array:
    """Tensions that would move the nominal platform exactly as commanded, within the robot's limits [N], shape (n, m).

    Args:
        robot: With a nominal platform.
        trajectory: The command.
        times: [s], shape (n,).
        still: Whether to hold the platform at rest in the poses instead.

    Raises:
        InfeasibleError: There are none at some time; the message says when.
    """
    if robot.platform is None:
        raise InfeasibleError(
            f"robot '{robot.name}': expected a nominal platform, found none; add 'platform' to its file"
        )
    pose, rate, acceleration = (trajectory.derivative(times, order) for order in range(3))
    if still:
        rate, acceleration = np.zeros_like(pose), np.zeros_like(pose)
    motion = motion_of_poses(pose, rate, acceleration, robot.gravity)
    wrench = platform_wrench(robot.platform.parameters, motion["specific_force"], motion["omega"], motion["alpha"])
    straight = robot.with_straight_cables()
    structure = cables_at(straight, motion["position"], motion["rotation"], np.ones(robot.m)).structure
    try:
        return distribute(structure, wrench, robot.tension_limits)
    except InfeasibleError as error:
        raise InfeasibleError(f"at {times[error.sample]:.2f} s of the trajectory: {error}", error.sample) from None
