"""What a command demands of the robot at one instant, against what it can do; as expressions with
derivatives.

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
from steelyard.dynamics import newton_euler, point_specific_force
from steelyard.excitation.course import SIX
from steelyard.excitation.ringing import softness_of
from steelyard.excitation.sight import AT, commanded_state, hanging_wrench, structure_at, tension_of
from steelyard.instruments import Instrument
from steelyard.motion.state import State
from steelyard.robot.model import Robot

_OFF = 2.5
"""The centre of gravity may be off by the margin times the radius of the platform over this."""
_SMOOTH = 1e-6


@dataclass(frozen=True)
class Margin:
    """How far the body may be from the nominal one."""

    share: float
    """Of mass and inertia, which change together: another load of the same shape."""
    radius: float
    """Of the platform [m]."""

    @property
    def off(self) -> float:
        """Of the centre of gravity, in any direction [m]."""
        return self.share * self.radius / _OFF


@dataclass(frozen=True, eq=False)
class Demands:
    """Everything that must be at most 1 at every instant."""

    robot: Robot
    instruments: Mapping[str, Instrument]
    margin: Margin
    level: float
    """Tension that the cables are held near to [N]."""
    share: float
    """Part of the limits on speed and acceleration that a command may use: elastic cables add to
    it."""
    softest: float | None = None
    """How easily the platform may swing on its cables, see :func:`.softness_of` [s^2]; None: that
    does not matter."""

    @property
    def names(self) -> tuple[str, ...]:
        """What each is about, shape (g,)."""
        return self._expressed.names

    def values(self, commands: Array) -> Array:
        """All of them, shape (n, g).

        Args:
            commands: Pose, rate and acceleration, shape (n, 18).
        """
        return self._expressed.plain(command=commands, level=self.level, softest=self._softest)[
            "value"
        ]

    def linearised(self, commands: Array) -> tuple[Array, Array]:
        """All of them, shape (n, g), and their derivatives by the commands, shape (n, g, 18)."""
        found = self._expressed.sloped(command=commands, level=self.level, softest=self._softest)
        return found["value"], found["slope"]

    @property
    def _softest(self) -> float:
        return 1.0 if self.softest is None else self.softest

    @property
    def _expressed(self) -> _Expressed:
        return _expressed(
            self.robot,
            tuple(self.instruments.items()),
            self.margin,
            self.share,
            self.softest is not None,
        )


@lru_cache(maxsize=8)
def _expressed(
    robot: Robot,
    instruments: tuple[tuple[str, Instrument], ...],
    margin: Margin,
    share: float,
    swings: bool,
) -> _Expressed:
    return _Expressed(robot, dict(instruments), margin, share, swings)


@dataclass(frozen=True, eq=False)
class _Expressed:
    """The demands as expressions."""

    robot: Robot
    instruments: Mapping[str, Instrument]
    margin: Margin
    share: float
    swings: bool

    @cached_property
    def names(self) -> tuple[str, ...]:
        """What each is about, shape (g,)."""
        return tuple(name for name, each in self._found[1] for _ in range(each.numel()))

    @cached_property
    def plain(self) -> Batched:
        """Values alone."""
        inputs, found = self._found
        value = ca.densify(ca.cse(ca.vertcat(*[each for _, each in found])))
        return Batched("demands", inputs, {"value": value})

    @cached_property
    def sloped(self) -> Batched:
        """With derivatives."""
        inputs, found = self._found
        value = ca.vertcat(*[each for _, each in found])
        value, slope = ca.cse(
            [ca.densify(value), ca.densify(ca.jacobian(value, inputs["command"]))]
        )
        return Batched("slopes", inputs, {"value": value, "slope": slope})

    @cached_property
    def _found(self) -> tuple[dict[str, Symbol], list[tuple[str, Symbol]]]:
        inputs = {
            "command": ca.SX.sym("command", AT),
            "level": ca.SX.sym("level"),
            "softest": ca.SX.sym("softest"),
        }
        command, level, softest = inputs.values()
        state = commanded_state(command, self.robot.gravity)
        found = [
            *self._box(command),
            *self._motion(command, state),
            *self._cables(command, state, level),
        ]
        if self.swings:
            found.append(("softness", softness_of(self.robot, state) / softest))
        return inputs, found

    def _box(self, command: Symbol) -> Iterator[tuple[str, Symbol]]:
        limits = self.robot.limits
        for name, box, first in (("position", limits.position, 0), ("orientation", limits.rpy, 3)):
            if box is not None:
                low, high = np.array(box)
                off = (command[first : first + 3] - ca.DM(low + high) / 2) / ca.DM((high - low) / 2)
                yield name, ca.vertcat(off, -off)

    def _motion(self, command: Symbol, state: State) -> Iterator[tuple[str, Symbol]]:
        limits = self.robot.limits
        speed, acceleration = command[SIX : SIX + 3], command[2 * SIX : 2 * SIX + 3]
        yield from self._below("speed", speed, limits.speed)
        yield from self._below("acceleration", acceleration, limits.acceleration)
        yield from self._below("angular speed", state.omega, limits.angular_speed)
        yield from self._below("angular acceleration", state.alpha, limits.angular_acceleration)
        for name, instrument in self.instruments.items():
            limits_of_target, target = instrument.target_limits, instrument.mounting.point
            if limits_of_target is not None and target is not None:
                point = ca.DM(target)
                moved = speed + state.rotation @ ca.cross(state.omega, point)
                force_samples = point_specific_force(
                    state.specific_force, state.omega, state.alpha, point
                )
                bent = state.rotation @ force_samples + ca.DM(self.robot.gravity)
                yield from self._below(
                    f"speed of the target of '{name}'", moved, limits_of_target.speed
                )
                yield from self._below(
                    f"acceleration of the target of '{name}'", bent, limits_of_target.acceleration
                )

    def _below(
        self, name: str, vector: Symbol, limit: float | None
    ) -> Iterator[tuple[str, Symbol]]:
        if limit is not None:
            yield name, ca.dot(vector, vector) / (self.share * limit) ** 2

    def _cables(self, command: Symbol, state: State, level: Symbol) -> Iterator[tuple[str, Symbol]]:
        robot = self.robot
        if not robot.m:
            return
        assert robot.platform is not None
        structure = structure_at(robot, state)
        if robot.limits.cable_speed is not None:
            # A tension does no more work than the wrench that it makes.
            twist = ca.vertcat(state.rotation.T @ command[SIX : SIX + 3], state.omega)
            fed = structure.T @ twist / (self.share * robot.limits.cable_speed)
            yield "cable speed", ca.vertcat(fed, -fed)
        ten = ca.SX.sym("ten", 10)
        moving = newton_euler(ten, state.specific_force, state.omega, state.alpha)
        hanging = hanging_wrench(ten, state, robot.gravity)
        low, high = robot.tension_limits
        unit = robot.platform.mass * float(np.linalg.norm(robot.gravity)) / 2
        for name, wrench in (("tension", moving), ("tension at rest", hanging)):
            least, most = self._tensions(structure, wrench, ten, level)
            yield name, 1 - (least - low) / unit
            if np.isfinite(high):
                yield name, 1 + (most - high) / unit

    def _tensions(
        self, structure: Symbol, wrench: Symbol, ten: Symbol, level: Symbol
    ) -> tuple[Symbol, Symbol]:
        """Least and largest tension of each cable over the bodies within the margin."""
        body = self.robot.platform
        assert body is not None
        tension = tension_of(self.robot, structure, wrench, level)
        # It is linear in the body: what is there without one, what the nominal one adds, what a
        # shift of its mass adds.
        slope = ca.jacobian(tension, ten)
        none = ca.substitute(tension, ten, ca.DM.zeros(10))
        nominal = slope @ ca.DM(body.parameters)
        shifted = (1 + self.margin.share) * body.mass * self.margin.off * slope[:, 1:4]
        spread = ca.sqrt(ca.sum2(shifted**2) + _SMOOTH)
        ends = [none + (1 + sign * self.margin.share) * nominal for sign in (-1, 1)]
        return ca.fmin(*ends) - spread, ca.fmax(*ends) + spread
