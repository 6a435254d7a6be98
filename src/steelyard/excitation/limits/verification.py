"""Whether the robot can do a motion: checked densely, by other means than those of the search.

Poses, speeds and tensions are those of the trajectory itself, of whole bodies within the margin,
and of the platform on its elastic cables where their stiffness is known.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from steelyard.arrays import Array
from steelyard.errors import InfeasibleError
from steelyard.excitation.information.noise_free_recording import tensions_near_level
from steelyard.excitation.limits.motion_constraints import Margin
from steelyard.excitation.settings import DEFAULT, DesignSettings
from steelyard.inertia import Inertia
from steelyard.instruments import Instrument
from steelyard.motion.limits import Use, below, commanded_tensions, extremes_of
from steelyard.motion.state import State
from steelyard.motion.trajectory import Trajectory
from steelyard.robot.kinematics import cables_at
from steelyard.robot.model import Robot
from steelyard.simulation.forward_dynamics import CablePlatform
from steelyard.simulation.response import ExactMotion

_ROUNDING = 1e-9
"""Of tensions, in parts of the range between their limits."""


@dataclass(frozen=True, eq=False)
class Verified:
    """How much of the limits a motion uses."""

    commanded: tuple[Use, ...]
    """Followed exactly by the nominal platform."""
    bodies: Use | None
    """Lowest and highest tension over the bodies within the margin, moving and at rest; None
    without cables."""
    elastic: tuple[Use, ...]
    """On elastic cables of the stated stiffness (where a softer or stiffer one violates a limit, on
    these); empty where it is not known."""
    violations: tuple[str, ...]
    """In words; empty where the robot can do it."""

    @property
    def fraction(self) -> float:
        """Largest use of a limit."""
        uses = [*self.commanded, *self.elastic, *([self.bodies] if self.bodies else [])]
        return max((use.fraction for use in uses), default=0.0)


def times_of(trajectory: Trajectory, per_second: float = DEFAULT.checks_per_second) -> Array:
    """Instants at which a motion is checked [s]."""
    return np.linspace(0.0, trajectory.duration, int(np.ceil(trajectory.duration * per_second)) + 1)


def verify(
    robot: Robot,
    instruments: Mapping[str, Instrument],
    trajectory: Trajectory,
    margin: Margin,
    level: float,
    *,
    elastic: bool = True,
    settings: DesignSettings = DEFAULT,
) -> Verified:
    """Check a motion.

    Args:
        robot: With a nominal platform.
        instruments: Those that may lose their target.
        trajectory: The command.
        margin: How far the body may be from the nominal one.
        level: Tension near which the cables are held [N].
        elastic: Whether to check it on elastic cables too, which takes some seconds.
        settings: Of the design.
    """
    motion = _CheckedMotion(robot, instruments, trajectory, level, settings)
    commanded = motion.commanded()
    violations = [str(use) for use in commanded if use.fraction > 1]
    bodies = None
    if robot.m:
        try:
            bodies = motion.over_bodies(margin)
        except InfeasibleError as error:
            violations.append(f"with a body that differs by {margin.share:.0%}: {error}")
    on_cables: tuple[Use, ...] = ()
    if elastic and not violations and robot.m and robot.cable.axial_stiffness:
        on_cables, violations = motion.over_stiffnesses(robot.cable.axial_stiffness)
    return Verified(commanded, bodies, on_cables, tuple(violations))


@dataclass(frozen=True, eq=False)
class _CheckedMotion:
    """A motion of a robot with a nominal platform; see :func:`verify`."""

    robot: Robot
    instruments: Mapping[str, Instrument]
    trajectory: Trajectory
    level: float
    settings: DesignSettings

    @cached_property
    def times(self) -> Array:
        """Instants at which it is checked [s], shape (n,)."""
        return times_of(self.trajectory, self.settings.checks_per_second)

    @property
    def platform(self) -> Inertia:
        """The nominal one."""
        assert self.robot.platform is not None
        return self.robot.platform

    def commanded(self) -> tuple[Use, ...]:
        """What the motion uses of the limits where it is followed exactly."""
        state = ExactMotion(self.robot, self.platform, self.trajectory).at(self.times)
        pose, rate, acceleration = (
            self.trajectory.derivative(self.times, order) for order in range(3)
        )
        if self.robot.m:
            state = replace(state, tension=self._tensions(state))
        return tuple(self._uses(pose, rate[:, :3], acceleration[:, :3], state))

    def _tensions(self, state: State) -> Array:
        """Tensions within the limits that move the nominal platform; where there are none, those
        that would, whatever the limits [N], shape (n, m).
        """
        try:
            return commanded_tensions(self.robot, self.trajectory, self.times, level=self.level)
        except InfeasibleError:
            return tensions_near_level(self.robot, state, self.level, self.settings)

    def over_bodies(self, margin: Margin) -> Use:
        """Tensions within the limits that move every one of the bodies, and hold it where it stops.

        Raises:
            InfeasibleError: There are none somewhere.
        """
        times = times_of(self.trajectory, self.settings.body_checks_per_second)
        found = []
        for body in bodies_within(self.platform, margin):
            other = replace(self.robot, platform=body)
            found += [
                commanded_tensions(other, self.trajectory, times, still=still, level=self.level)
                for still in (False, True)
            ]
        return _tension(self.robot, np.concatenate(found))

    def over_stiffnesses(self, stated: float) -> tuple[tuple[Use, ...], list[str]]:
        """What the platform uses of the limits on elastic cables, and the violations at the first
        stiffness that has any.

        Args:
            stated: Axial stiffness of the cables [N].
        """
        uses: tuple[Use, ...] = ()
        violations: list[str] = []
        for factor in self.settings.stiffness_factors:
            cable = replace(self.robot.cable, axial_stiffness=factor * stated)
            other = replace(self, robot=replace(self.robot, cable=cable))
            where = f"on cables of {factor:g} times the stated stiffness"
            try:
                uses = other.on_elastic_cables()
                violations += [f"{where}: {use}" for use in uses if use.fraction > 1]
            except InfeasibleError as error:
                violations.append(f"{where}: {error}")
            if violations:
                break
        return uses, violations

    def on_elastic_cables(self) -> tuple[Use, ...]:
        """What the platform uses of the limits as it really moves on its cables, swinging about
        the command.

        Raises:
            InfeasibleError: A cable goes slack.
        """
        moved = CablePlatform(self.robot, self.platform).move(
            self.trajectory, tolerance=self.settings.elastic_tolerance, level=self.level
        )
        state = moved.at(self.times)
        rpy = Rotation.from_matrix(state.rotation).as_euler("ZYX")[:, ::-1]
        pose = np.hstack([state.position, np.unwrap(rpy, axis=0)])
        velocity = moved.solution(self.times)[7:10].T
        gravity = self.robot.gravity
        acceleration = np.einsum("nij,nj->ni", state.rotation, state.specific_force) + gravity
        return tuple(self._uses(pose, velocity, acceleration, state))

    def _uses(
        self, pose: Array, velocity: Array, acceleration: Array, state: State
    ) -> Iterator[Use]:
        """What a motion uses of every limit of the robot and of its trackers.

        Args:
            pose: x, y, z [m], roll, pitch, yaw [rad], shape (n, 6).
            velocity: Of the platform origin, world frame [m/s], shape (n, 3).
            acceleration: Its derivative [m/s^2], shape (n, 3).
            state: With tensions, where there are cables.
        """
        robot, times = self.robot, self.times
        extremes = extremes_of(robot.limits, pose, velocity, acceleration, state.omega, state.alpha)
        yield from extremes.uses
        for name, instrument in self.instruments.items():
            limits, place = instrument.target_limits, instrument.mounting.point
            if limits is not None and place is not None:
                point = state.position + state.rotation @ np.array(place)
                target = f"the target of '{name}'"
                rate = np.gradient(point, times, axis=0, edge_order=2)
                yield below(f"speed of {target}", "m/s", rate, limits.speed)
                second = np.gradient(rate, times, axis=0, edge_order=2)
                yield below(f"acceleration of {target}", "m/s^2", second, limits.acceleration)
        if robot.m:
            length = cables_at(
                robot.with_straight_cables(), state.position, state.rotation, np.ones(robot.m)
            ).length
            fed = np.abs(np.gradient(length, times, axis=0, edge_order=2)).max(
                axis=1, keepdims=True
            )
            yield below("cable speed", "m/s", fed, robot.limits.cable_speed)
            yield _tension(robot, state.tension)


def bodies_within(body: Inertia, margin: Margin) -> Iterator[Inertia]:
    """The nominal body, and those at the edges of the margin: lighter and heavier, mass shifted
    along the axes.
    """
    yield body
    for share in (-margin.share, margin.share):
        for shift in np.vstack([np.zeros((1, 3)), np.eye(3), -np.eye(3)]) * margin.cog_offset:
            yield Inertia(
                (1 + share) * body.mass, body.center_of_gravity + shift, (1 + share) * body.inertia
            )


def _tension(robot: Robot, values: Array) -> Use:
    """Lowest and highest tension against the limits, both of which may be used to the full."""
    low, high = robot.tension_limits
    least, most = float(values.min()), float(values.max())
    # By how much of the range between them it leaves the limits.
    width = high - low if np.isfinite(high) else max(most - low, 1.0)
    outside = max(low - least, most - high, 0.0) / width
    if outside > _ROUNDING:
        fraction = 1 + outside
    else:
        of_high = most / high if high else 0.0
        of_low = low / max(least, 1e-9)
        fraction = min(1.0, max(of_high, of_low))
    return Use("tension", "N", (least, most), (low, high), fraction)
