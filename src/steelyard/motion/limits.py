"""Whether a trajectory keeps to what the robot can do."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from steelyard.arrays import Array
from steelyard.dynamics import platform_wrench
from steelyard.errors import InfeasibleError
from steelyard.motion.state import motion_of_poses
from steelyard.motion.trajectory import Trajectory
from steelyard.robot.kinematics import cables_at
from steelyard.robot.model import Limits, Robot
from steelyard.robot.tension import distribute

_WEAK = 0.05
"""Singular value of a structure matrix, over the largest, of tensions that hardly pull together:
what a pose lacks would make them large, and push cables."""


@dataclass(frozen=True)
class CheckSettings:
    """At how many instants a trajectory is checked."""

    per_second: float = 50.0
    """[Hz]: a hundred in each period of half a hertz, the fastest motions of such robots."""
    most: int = 20_000
    """Of a long trajectory: this bounds time and memory."""


DEFAULT = CheckSettings()
"""What is used where nothing is given."""


@dataclass(frozen=True)
class Use:
    """How much of a limit a motion uses."""

    name: str
    """``position``, ``speed``, …"""
    unit: str
    extremes: tuple[Any, ...]
    """Largest size; or lowest and highest value, of each axis where there are several."""
    limit: tuple[Any, ...] | None
    """The same of what is allowed; None: no limit."""
    fraction: float
    """Of the limit that is used; above 1 it is violated; 0 without one."""

    def __str__(self) -> str:
        """In words and numbers; of several axes the one that uses most."""
        axis, values, limit = "", self.extremes, self.limit
        if isinstance(values[0], tuple) and limit is not None:
            low, high = np.array(values)
            least, most = np.array(limit)
            beyond = np.maximum(2 * high - most - least, most + least - 2 * low)
            worst = int((beyond / (most - least)).argmax())
            axis = f"[{worst}]" if len(low) > 1 else ""
            values, limit = (low[worst], high[worst]), (least[worst], most[worst])
        allowed = "" if limit is None else f" of {_shown(limit)}"
        return f"{self.name}{axis} {_shown(values)}{allowed} {self.unit}"


def _shown(values: tuple[Any, ...]) -> str:
    texts = []
    for value in values:
        texts.append(f"{value:g}" if isinstance(value, int) else f"{value:.3g}")
    return " to ".join(texts)


@dataclass(frozen=True)
class Extremes:
    """How much of every limit a motion uses."""

    uses: tuple[Use, ...]

    @property
    def fraction(self) -> float:
        """Largest use of a limit on pose, speed or acceleration; above 1 it is violated."""
        return max((use.fraction for use in self.uses), default=0.0)

    @property
    def worst(self) -> str:
        """Which one that is, in words and numbers."""
        limited = [use for use in self.uses if use.limit is not None]
        return str(max(limited, key=lambda use: use.fraction)) if limited else "no limits given"


def check_times(trajectory: Trajectory, settings: CheckSettings = DEFAULT) -> Array:
    """Times at which a trajectory is checked [s], shape (n,)."""
    count = min(int(np.ceil(trajectory.duration * settings.per_second)), settings.most)
    return np.linspace(0.0, trajectory.duration, count + 1)


def motion_extremes(robot: Robot, trajectory: Trajectory, times: Array | None = None) -> Extremes:
    """Hold a trajectory against the robot's limits on pose, speed and acceleration.

    Args:
        robot: With its limits.
        trajectory: Of a command.
        times: At which to check [s]; None: :func:`check_times`.
    """
    t = check_times(trajectory) if times is None else times
    pose, rate, acceleration = (trajectory.derivative(t, order) for order in range(3))
    motion = motion_of_poses(pose, rate, acceleration, robot.gravity)
    return extremes_of(
        robot.limits, pose, rate[:, :3], acceleration[:, :3], motion["omega"], motion["alpha"]
    )


def extremes_of(
    limits: Limits, pose: Array, velocity: Array, acceleration: Array, omega: Array, alpha: Array
) -> Extremes:
    """Hold a motion against limits on pose, speed and acceleration.

    Args:
        limits: What it must keep to.
        pose: x, y, z [m], roll, pitch, yaw [rad], shape (n, 6).
        velocity: Of the platform origin, world frame [m/s], shape (n, 3).
        acceleration: Its derivative [m/s^2], shape (n, 3).
        omega: Angular velocity [rad/s], shape (n, 3).
        alpha: Angular acceleration [rad/s^2], shape (n, 3).
    """
    rpy = None if limits.rpy is None else np.degrees(limits.rpy)
    return Extremes(
        (
            within("position", "m", pose[:, :3], limits.position),
            within("roll, pitch, yaw", "deg", np.degrees(pose[:, 3:]), rpy),
            below("speed", "m/s", velocity, limits.speed),
            below("acceleration", "m/s^2", acceleration, limits.acceleration),
            below("angular speed", "rad/s", omega, limits.angular_speed),
            below("angular acceleration", "rad/s^2", alpha, limits.angular_acceleration),
        )
    )


def below(name: str, unit: str, vectors: Array, limit: float | None) -> Use:
    """Largest length of vectors, shape (n, k), against a limit."""
    largest = float(np.linalg.norm(vectors, axis=1).max())
    allowed = None if limit is None else (limit,)
    return Use(name, unit, (largest,), allowed, largest / limit if limit else 0.0)


def within(name: str, unit: str, values: Array, box: Any) -> Use:
    """Lowest and highest values, shape (n, k), against those allowed."""
    found = tuple(values.min(axis=0).tolist()), tuple(values.max(axis=0).tolist())
    if box is None:
        return Use(name, unit, found, None, 0.0)
    low, high = np.array(box)
    middle, half = (low + high) / 2, (high - low) / 2
    fraction = float(np.abs((values - middle) / half).max())
    return Use(name, unit, found, (tuple(low.tolist()), tuple(high.tolist())), fraction)


def commanded_tensions(
    robot: Robot,
    trajectory: Trajectory,
    times: Array,
    *,
    still: bool = False,
    level: float | None = None,
) -> Array:
    """Tensions that would move the nominal platform exactly as commanded, within the robot's limits
    [N], shape (n, m).

    Args:
        robot: With a nominal platform.
        trajectory: The command.
        times: [s], shape (n,).
        still: Whether to hold the platform at rest in the poses instead.
        level: Tension to stay near to [N]; None: the smallest that do.

    Raises:
        InfeasibleError: There are none at some time; the message says when.
    """
    structure, wrench = _balance(robot, trajectory, times, still=still)
    try:
        return distribute(structure, wrench, robot.tension_limits, level)
    except InfeasibleError as error:
        raise InfeasibleError(
            f"at {times[error.sample]:.2f} s of the trajectory: {error}", error.sample
        ) from None


def nearest_tensions(
    robot: Robot, trajectory: Trajectory, times: Array, *, still: bool = False
) -> Array:
    """Tensions of fewer than six cables that come nearest to moving the nominal platform as
    commanded [N], shape (n, m): forces and, in units of the platform's size, torques by least
    squares, the most even of those that are about as near.

    Args:
        robot: With a nominal platform.
        trajectory: The command.
        times: [s], shape (n,).
        still: Whether to hold the platform at rest in the poses instead.

    Raises:
        InfeasibleError: One of them is beyond the robot's limits; the message says when.
    """
    structure, wrench = _balance(robot, trajectory, times, still=still)
    units = np.repeat([1.0, robot.size], 3)
    tensions: Array = np.einsum(
        "nmk,nk->nm", np.linalg.pinv(structure / units[:, None], rcond=_WEAK), wrench / units
    )
    low, high = robot.tension_limits
    beyond = ((tensions < low) | (tensions > high)).any(axis=1)
    if beyond.any():
        first = int(np.argmax(beyond))
        off = np.maximum(low - tensions[first], tensions[first] - high)
        which = int(np.argmax(off))
        raise InfeasibleError(
            f"at {times[first]:.2f} s of the trajectory: expected tensions within {low:g} to"
            f" {high:g} N that carry the platform, found {tensions[first, which]:.4g} N of cable"
            f" {which + 1}; move nearer to the middle, more slowly, or tilt less",
            first,
        )
    return tensions


def winch_tensions(
    robot: Robot,
    trajectory: Trajectory,
    times: Array,
    *,
    still: bool = False,
    level: float | None = None,
) -> Array:
    """Tensions at which winches aim for a command [N], shape (n, m): :func:`commanded_tensions`
    where the cables hold any pose, else :func:`nearest_tensions`. Arguments and errors as of these.
    """
    if robot.holds_any_pose:
        return commanded_tensions(robot, trajectory, times, still=still, level=level)
    return nearest_tensions(robot, trajectory, times, still=still)


def _balance(
    robot: Robot, trajectory: Trajectory, times: Array, *, still: bool
) -> tuple[Array, Array]:
    """Structure matrices of straight cables, shape (n, 6, m), and the wrench on the nominal
    platform, shape (n, 6), along a command; arguments as of :func:`commanded_tensions`.

    Raises:
        InfeasibleError: There is no nominal platform.
    """
    if robot.platform is None:
        raise InfeasibleError(
            f"robot '{robot.name}': expected a nominal platform, found none; add 'platform' to its"
            " file"
        )
    pose, rate, acceleration = (trajectory.derivative(times, order) for order in range(3))
    if still:
        rate, acceleration = np.zeros_like(pose), np.zeros_like(pose)
    motion = motion_of_poses(pose, rate, acceleration, robot.gravity)
    wrench = platform_wrench(
        robot.platform.parameters, motion["specific_force"], motion["omega"], motion["alpha"]
    )
    straight = robot.with_straight_cables()
    structure = cables_at(
        straight, motion["position"], motion["rotation"], np.ones(robot.m)
    ).structure
    return structure, wrench
