"""Constraints on a command at one instant: each is a number that must be at most 1, as an
expression with derivatives.

The tensions are those nearest to a level. They are asked for a body that is not quite the nominal
one, in motion and at rest: where the platform stops, it must be able to hang.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache

import casadi as ca
import numpy as np

from steelyard.arrays import Array
from steelyard.batch import Batched, Symbol
from steelyard.dynamics import newton_euler, point_specific_force, point_velocity
from steelyard.excitation.command.commanded_state import (
    COMMAND,
    commanded_state,
    static_wrench,
    structure_at,
    tension_of,
)
from steelyard.excitation.command.motion_spline import COORDINATES
from steelyard.excitation.limits.cable_vibration import dunkerley_sum
from steelyard.instruments import Instrument
from steelyard.motion.state import State
from steelyard.robot.model import Robot

_ROUNDING = 1e-6
"""Added to the square of a tension [N^2], so that its root has a derivative at zero."""

Constraints = Iterator[tuple[str, Symbol]]
"""What each is about, and numbers that must be at most 1."""


@dataclass(frozen=True)
class Margin:
    """How far the body may be from the nominal one."""

    share: float
    """Of mass and inertia, which change together: another load of the same shape."""
    radius: float
    """Of the platform [m]."""
    radius_ratio: float = 2.5
    """Radius of the platform times the share, over the offset of the centre of gravity: a fifth
    more mass moves it by 8 % of the radius."""

    @property
    def cog_offset(self) -> float:
        """Of the centre of gravity, in any direction [m]."""
        return self.share * self.radius / self.radius_ratio


@dataclass(frozen=True, eq=False)
class MotionConstraints:
    """The g constraints on a command at one instant."""

    robot: Robot
    instruments: Mapping[str, Instrument]
    margin: Margin
    level: float
    """Tension near which the cables are held [N]."""
    limit_fraction: float
    """Part of the limits on speed and acceleration that a command may use: elastic cables add to
    it."""
    largest_dunkerley_sum: float | None = None
    """Of the natural frequencies, see :func:`.dunkerley_sum` [s^2]; None: not constrained."""

    @property
    def names(self) -> tuple[str, ...]:
        """What each is about, shape (g,)."""
        return self._expressions.names

    def values(self, commands: Array) -> Array:
        """All of them, shape (n, g).

        Args:
            commands: Pose, rate and acceleration, shape (n, 18).
        """
        return self._expressions.value(command=commands, **self._numbers)["value"]

    def linearised(self, commands: Array) -> tuple[Array, Array]:
        """All of them, shape (n, g), and their derivatives by the commands, shape (n, g, 18)."""
        found = self._expressions.linearised(command=commands, **self._numbers)
        return found["value"], found["jacobian"]

    @property
    def _numbers(self) -> dict[str, float]:
        """What the expressions take beside the command."""
        largest = self.largest_dunkerley_sum
        return {"level": self.level, "largest": 1.0 if largest is None else largest}

    @property
    def _expressions(self) -> _ConstraintExpressions:
        return _expressions(
            self.robot,
            tuple(self.instruments.items()),
            self.margin,
            self.limit_fraction,
            self.largest_dunkerley_sum is not None,
        )


@dataclass(frozen=True, eq=False)
class _ConstraintExpressions:
    """The constraints as expressions."""

    robot: Robot
    instruments: tuple[tuple[str, Instrument], ...]
    margin: Margin
    limit_fraction: float
    limits_frequencies: bool

    @cached_property
    def names(self) -> tuple[str, ...]:
        """What each is about, shape (g,)."""
        return tuple(name for name, each in self._built[1] for _ in range(each.numel()))

    @cached_property
    def value(self) -> Batched:
        """Values alone."""
        inputs, found = self._built
        value = ca.densify(ca.cse(ca.vertcat(*[each for _, each in found])))
        return Batched("constraints", inputs, {"value": value})

    @cached_property
    def linearised(self) -> Batched:
        """With derivatives."""
        inputs, found = self._built
        value = ca.vertcat(*[each for _, each in found])
        jacobian = ca.densify(ca.jacobian(value, inputs["command"]))
        value, jacobian = ca.cse([ca.densify(value), jacobian])
        return Batched("linearised", inputs, {"value": value, "jacobian": jacobian})

    @cached_property
    def _built(self) -> tuple[dict[str, Symbol], list[tuple[str, Symbol]]]:
        """Inputs, and the constraints in the order of their names."""
        command = ca.SX.sym("command", COMMAND)
        level, largest = ca.SX.sym("level"), ca.SX.sym("largest")
        inputs = {"command": command, "level": level, "largest": largest}
        state = commanded_state(command, self.robot.gravity)
        found = [
            *self._box(command),
            *self._motion(command, state),
            *self._cables(command, state, level),
        ]
        if self.limits_frequencies:
            found.append(("natural frequencies", dunkerley_sum(self.robot, state) / largest))
        return inputs, found

    def _box(self, command: Symbol) -> Constraints:
        """Position and orientation within their ranges."""
        limits = self.robot.limits
        for name, box, first in (("position", limits.position, 0), ("orientation", limits.rpy, 3)):
            if box is not None:
                low, high = np.array(box)
                off = (command[first : first + 3] - ca.DM(low + high) / 2) / ca.DM((high - low) / 2)
                yield name, ca.vertcat(off, -off)

    def _motion(self, command: Symbol, state: State) -> Constraints:
        """Speeds and accelerations of the platform, and of the targets of trackers."""
        limits = self.robot.limits
        speed = command[COORDINATES : COORDINATES + 3]
        acceleration = command[2 * COORDINATES : 2 * COORDINATES + 3]
        yield from self._below("speed", speed, limits.speed)
        yield from self._below("acceleration", acceleration, limits.acceleration)
        yield from self._below("angular speed", state.omega, limits.angular_speed)
        yield from self._below("angular acceleration", state.alpha, limits.angular_acceleration)
        for name, instrument in self.instruments:
            own, place = instrument.target_limits, instrument.mounting.point
            if own is not None and place is not None:
                target = f"the target of '{name}'"
                point = ca.DM(place)
                velocity = point_velocity(state.rotation, speed, state.omega, point)
                specific_force = point_specific_force(
                    state.specific_force, state.omega, state.alpha, point
                )
                accelerated = state.rotation @ specific_force + ca.DM(self.robot.gravity)
                yield from self._below(f"speed of {target}", velocity, own.speed)
                yield from self._below(f"acceleration of {target}", accelerated, own.acceleration)

    def _below(self, name: str, vector: Symbol, limit: float | None) -> Constraints:
        """The length of a vector within its part of a limit, squared."""
        if limit is not None:
            yield name, ca.dot(vector, vector) / (self.limit_fraction * limit) ** 2

    def _cables(self, command: Symbol, state: State, level: Symbol) -> Constraints:
        """Speeds of the cables, and tensions of all bodies within the margin."""
        robot = self.robot
        if not robot.m:
            return
        assert robot.platform is not None
        structure = structure_at(robot, state)
        if robot.limits.cable_speed is not None:
            # A tension does no more work than the wrench that it makes.
            velocity = command[COORDINATES : COORDINATES + 3]
            twist = ca.vertcat(state.rotation.T @ velocity, state.omega)
            fed = structure.T @ twist / (self.limit_fraction * robot.limits.cable_speed)
            yield "cable speed", ca.vertcat(fed, -fed)
        ten = ca.SX.sym("ten", 10)
        moving = newton_euler(ten, state.specific_force, state.omega, state.alpha)
        at_rest = static_wrench(ten, state, robot.gravity)
        low, high = robot.tension_limits
        unit = robot.platform.mass * float(np.linalg.norm(robot.gravity)) / 2
        for name, wrench in (("tension", moving), ("tension at rest", at_rest)):
            least, most = self._tensions(structure, wrench, ten, level)
            yield name, 1 - (least - low) / unit
            if np.isfinite(high):
                yield name, 1 + (most - high) / unit

    def _tensions(
        self, structure: Symbol, wrench: Symbol, ten: Symbol, level: Symbol
    ) -> tuple[Symbol, Symbol]:
        """Least and largest tension of each cable over the bodies within the margin, shape (m,)
        each.
        """
        body = self.robot.platform
        assert body is not None
        tension = tension_of(self.robot, structure, wrench, level)
        # It is linear in the body: what is there without one, what the nominal one adds, what a
        # shift of its mass adds.
        by_body = ca.jacobian(tension, ten)
        none = ca.substitute(tension, ten, ca.DM.zeros(10))
        nominal = by_body @ ca.DM(body.parameters)
        shift = (1 + self.margin.share) * body.mass * self.margin.cog_offset
        shifted = shift * by_body[:, 1:4]
        spread = ca.sqrt(ca.sum2(shifted**2) + _ROUNDING)
        ends = [none + (1 + sign * self.margin.share) * nominal for sign in (-1, 1)]
        return ca.fmin(*ends) - spread, ca.fmax(*ends) + spread


_expressions = lru_cache(maxsize=8)(_ConstraintExpressions)
"""One and the same value for the same robot: what has been built for it is found again."""
