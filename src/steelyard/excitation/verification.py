"""Whether the robot can do a motion: looked at densely, by other means than those of the search.

Poses, speeds and tensions are those of the trajectory itself, of whole bodies within the margin,
and of the platform on its elastic cables where their stiffness is known.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from steelyard.arrays import Array
from steelyard.errors import InfeasibleError
from steelyard.excitation.demands import Margin
from steelyard.excitation.rehearsal import held_tensions
from steelyard.inertia import Inertia
from steelyard.instruments import Instrument
from steelyard.motion.limits import Use, below, commanded_tensions, extremes_of
from steelyard.motion.state import State
from steelyard.motion.trajectory import Trajectory
from steelyard.robot.kinematics import cables_at
from steelyard.robot.model import Robot
from steelyard.simulation.forward_dynamics import CablePlatform, ExactMotion

_PER_SECOND = 100.0
_BODIES_PER_SECOND = 20.0
_STIFFNESSES = 0.7, 1.4, 1.0
"""Of the cables, in units of the stated one, which is known to a factor only; the last is what is
shown."""
_TOLERANCE = 1e-6
"""Of the elastic motion, see :meth:`CablePlatform.move`."""


@dataclass(frozen=True, eq=False)
class Verified:
    """What a motion takes of the limits."""

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


def times_of(trajectory: Trajectory, per_second: float = _PER_SECOND) -> Array:
    """Instants at which a motion is looked at [s]."""
    return np.linspace(0.0, trajectory.duration, int(np.ceil(trajectory.duration * per_second)) + 1)


def verify(
    robot: Robot,
    instruments: Mapping[str, Instrument],
    trajectory: Trajectory,
    margin: Margin,
    level: float,
    *,
    elastic: bool = True,
) -> Verified:
    """Look at a motion.

    Args:
        robot: With a nominal platform.
        instruments: Those that may lose their target.
        trajectory: The command.
        margin: How far the body may be from the nominal one.
        level: Tension that the cables are held near to [N].
        elastic: Whether to look at it on elastic cables too, which takes some seconds.
    """
    assert robot.platform is not None
    times = times_of(trajectory)
    state = ExactMotion(robot, robot.platform, trajectory).at(times)
    pose, rate, acceleration = (trajectory.derivative(times, order) for order in range(3))
    if robot.m:
        state = replace(state, tension=_tensions(robot, trajectory, times, state, level))
    commanded = tuple(
        _uses(robot, instruments, times, pose, rate[:, :3], acceleration[:, :3], state)
    )
    violations = [str(use) for use in commanded if use.fraction > 1]
    bodies = None
    if robot.m:
        try:
            bodies = _over_bodies(robot, trajectory, margin, level)
        except InfeasibleError as error:
            violations.append(f"with a body that differs by {margin.share:.0%}: {error}")
    swinging: tuple[Use, ...] = ()
    if elastic and not violations and robot.m and robot.cable.axial_stiffness:
        for factor in _STIFFNESSES:
            cable = replace(robot.cable, axial_stiffness=factor * robot.cable.axial_stiffness)
            where = f"on cables of {factor:g} times the stated stiffness"
            try:
                swinging = _on_elastic_cables(
                    replace(robot, cable=cable), instruments, trajectory, times, level
                )
                violations += [f"{where}: {use}" for use in swinging if use.fraction > 1]
            except InfeasibleError as error:
                violations.append(f"{where}: {error}")
            if violations:
                break
    return Verified(commanded, bodies, swinging, tuple(violations))


def _tensions(
    robot: Robot, trajectory: Trajectory, times: Array, state: State, level: float
) -> Array:
    """Tensions within the limits that move the nominal platform; where there are none, those that
    would, whatever the limits [N], shape (n, m).
    """
    try:
        return commanded_tensions(robot, trajectory, times, level=level)
    except InfeasibleError:
        return held_tensions(robot, state, level)


def bodies_within(body: Inertia, margin: Margin) -> Iterator[Inertia]:
    """The nominal body, and those at the edges of the margin: lighter and heavier, mass shifted
    along the axes.
    """
    yield body
    for share in (-margin.share, margin.share):
        for shift in np.vstack([np.zeros((1, 3)), np.eye(3), -np.eye(3)]) * margin.off:
            yield Inertia(
                (1 + share) * body.mass, body.center_of_gravity + shift, (1 + share) * body.inertia
            )


def _over_bodies(robot: Robot, trajectory: Trajectory, margin: Margin, level: float) -> Use:
    """Tensions within the limits that move every one of the bodies, and hold it where it stops.

    Raises:
        InfeasibleError: There are none somewhere.
    """
    assert robot.platform is not None
    times = times_of(trajectory, _BODIES_PER_SECOND)
    found = []
    for body in bodies_within(robot.platform, margin):
        other = replace(robot, platform=body)
        found += [
            commanded_tensions(other, trajectory, times, still=still, level=level)
            for still in (False, True)
        ]
    return _tension(robot, np.concatenate(found))


def _tension(robot: Robot, values: Array) -> Use:
    """Lowest and highest tension against the limits, both of which may be used to the full."""
    low, high = robot.tension_limits
    least, most = float(values.min()), float(values.max())
    # By how much of the room between them it leaves the limits.
    room = high - low if np.isfinite(high) else max(most - low, 1.0)
    outside = max(low - least, most - high, 0.0) / room
    fraction = (
        1 + outside
        if outside > _ROUNDING
        else min(1.0, max(most / high if high else 0.0, low / max(least, 1e-9)))
    )
    return Use("tension", "N", (least, most), (low, high), fraction)


_ROUNDING = 1e-9


def _uses(
    robot: Robot,
    instruments: Mapping[str, Instrument],
    times: Array,
    pose: Array,
    velocity: Array,
    acceleration: Array,
    state: State,
) -> Iterator[Use]:
    yield from extremes_of(
        robot.limits, pose, velocity, acceleration, state.omega, state.alpha
    ).uses
    for name, instrument in instruments.items():
        limits, target = instrument.target_limits, instrument.mounting.point
        if limits is not None and target is not None:
            point = state.position + state.rotation @ np.array(target)
            moved = np.gradient(point, times, axis=0, edge_order=2)
            yield below(f"speed of the target of '{name}'", "m/s", moved, limits.speed)
            bent = np.gradient(moved, times, axis=0, edge_order=2)
            yield below(
                f"acceleration of the target of '{name}'", "m/s^2", bent, limits.acceleration
            )
    if robot.m:
        length = cables_at(
            robot.with_straight_cables(), state.position, state.rotation, np.ones(robot.m)
        ).length
        fed = np.abs(np.gradient(length, times, axis=0, edge_order=2)).max(axis=1, keepdims=True)
        yield below("cable speed", "m/s", fed, robot.limits.cable_speed)
        yield _tension(robot, state.tension)


def _on_elastic_cables(
    robot: Robot,
    instruments: Mapping[str, Instrument],
    trajectory: Trajectory,
    times: Array,
    level: float,
) -> tuple[Use, ...]:
    """The same of what the platform really does on its cables, which swings about the command.

    Raises:
        InfeasibleError: A cable goes slack.
    """
    assert robot.platform is not None
    moved = CablePlatform(robot, robot.platform).move(trajectory, tolerance=_TOLERANCE, level=level)
    state = moved.at(times)
    rpy = Rotation.from_matrix(state.rotation).as_euler("ZYX")[:, ::-1]
    pose = np.hstack([state.position, np.unwrap(rpy, axis=0)])
    velocity = moved.solution(times)[7:10].T
    acceleration = np.einsum("nij,nj->ni", state.rotation, state.specific_force) + robot.gravity
    return tuple(_uses(robot, instruments, times, pose, velocity, acceleration, state))
