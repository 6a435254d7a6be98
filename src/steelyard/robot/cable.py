"""One cable from its winch over the roller to the platform: direction, length and tension.

Two questions are asked of the same equations: which way does it pull if its tension at the platform
is known (identification), and how hard does it pull if the length fed out is known (simulation).
Straight cables have closed forms; for cables with weight a fixed number of steps from a shallow-sag
start reaches rounding error, and the remaining ``residual`` is handed out so that the caller can
check it. One step does for taut cables.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Literal, NamedTuple

import casadi as ca
import numpy as np

from steelyard.arrays import Array
from steelyard.batch import Symbol
from steelyard.robot import catenary, pulley
from steelyard.robot.model import Robot

RESIDUAL_TOLERANCE = 1e-8
"""What :attr:`CableShape.residual` must not exceed where the equations have been solved."""

STEPS = 4
"""Steps for a known tension that reach rounding error from 10 N upwards on cables of ten metres and
60 g/m; the residual shows where they do not."""
_STEPS_BY_LENGTH = 5
"""Those for a known length, up to some hundredths longer than the chord unless the cable hangs
nearly plumb."""


class CableSpec(NamedTuple):
    """Constants of one cable; all may be symbolic."""

    anchor: Symbol
    """World frame [m], shape (3,)."""
    axis: Array | Symbol
    """Its direction of travel there, unit vector, world frame, shape (3,)."""
    radius: float | Symbol
    """Of the roller [m]; the number 0: none."""
    up: Array | Symbol
    """Unit vector against gravity, world frame, shape (3,)."""
    weight: float | Symbol
    """[N/m]; the number 0: straight."""
    compliance: float | Symbol
    """1 / EA [1/N]; 0: does not stretch."""

    @property
    def hangs(self) -> bool:
        """Whether it has weight."""
        return isinstance(self.weight, ca.SX) or self.weight != 0

    @property
    def rolls(self) -> bool:
        """Whether it runs over a roller."""
        return isinstance(self.radius, ca.SX) or self.radius != 0


class CableShape(NamedTuple):
    """How a cable hangs."""

    direction: Symbol
    """Unit vector in which it pulls the platform, world frame, shape (3,)."""
    tension: Symbol
    """At the platform end [N]."""
    length: Symbol
    """Unstrained length from the anchor over the roller to the attachment [m]."""
    leave_point: Symbol
    """World frame [m], shape (3,)."""
    wrap: Symbol
    """Wrap angle on the roller [rad]."""
    winch_tension: Symbol
    """At the roller, where the cable's weight has been added [N]."""
    residual: Symbol
    """Error of the equations, in metres of length and radians at the roller; 0 for closed forms."""


def spec(robot: Robot, i: int) -> CableSpec:
    """Constants of cable i of a robot."""
    density, stiffness = robot.cable.linear_density, robot.cable.axial_stiffness
    return CableSpec(
        anchor=ca.DM(robot.anchors[i]),
        axis=robot.pulley_axis[i],
        radius=float(robot.pulley_radius[i]),
        up=robot.up,
        weight=(density or 0.0) * float(np.linalg.norm(robot.gravity)),
        compliance=1 / stiffness if stiffness else 0.0,
    )


def by_tension(
    cable: CableSpec, point: Symbol, tension: Symbol, *, steps: int = STEPS
) -> CableShape:
    """Shape of a cable whose tension at the platform end is known.

    Args:
        cable: Its constants.
        point: Attachment in the world frame [m], shape (3,).
        tension: [N], positive where the cable has weight.
        steps: Towards the shape of a cable with weight; fewer are faster and leave a larger
            residual where it is slack.
    """
    if cable.hangs:
        return _hanging("tension", cable, point, tension, steps)
    wrap, leave, chord = _straight(cable, point)
    length = (chord + cable.radius * wrap) / (1 + tension * cable.compliance)
    return CableShape((leave - point) / chord, tension, length, leave, wrap, tension, ca.SX(0))


def by_length(cable: CableSpec, point: Symbol, fed: Symbol) -> CableShape:
    """Shape of a cable of which a known unstrained length has been fed out.

    Args:
        cable: Its constants; it must stretch.
        point: Attachment in the world frame [m], shape (3,).
        fed: Unstrained length from the anchor over the roller to the attachment [m].
    """
    if cable.hangs:
        return _hanging("length", cable, point, fed, _STEPS_BY_LENGTH)
    wrap, leave, chord = _straight(cable, point)
    tension = ((chord + cable.radius * wrap) / fed - 1) / cable.compliance
    return CableShape((leave - point) / chord, tension, fed, leave, wrap, tension, ca.SX(0))


def _straight(cable: CableSpec, point: Symbol) -> tuple[Symbol, Symbol, Symbol]:
    """Wrap angle, leave point and free length of a straight cable."""
    if not cable.rolls:
        return ca.SX(0), cable.anchor, ca.norm_2(cable.anchor - point)
    arguments = [ca.SX(a) for a in (cable.anchor, cable.axis, cable.radius, point)]
    wrap, leave, chord = _rolled().call(arguments, True, False)
    return wrap, leave, chord


@lru_cache(maxsize=1)
def _rolled() -> Symbol:
    """Function of a roller and an attachment: :func:`_straight`; see :func:`_solution`."""
    anchor, axis, point = (ca.SX.sym(name, 3) for name in ("anchor", "axis", "point"))
    radius: Symbol = ca.SX.sym("radius")
    roller = pulley.swivel(anchor, axis, radius, point)
    wrap = pulley.straight_wrap(roller, point)
    leave = pulley.leave_point(roller, wrap)
    return ca.Function(
        "rolled", [anchor, axis, radius, point], [wrap, leave, ca.norm_2(leave - point)]
    )


_Given = Literal["tension", "length"]
_FULLEST_START = 0.9
"""Half the weight over the mean tension from which the fullest cable is approached; 1 is out of
reach."""


def _hanging(
    known: _Given, cable: CableSpec, point: Symbol, value: Symbol, steps: int
) -> CableShape:
    constants = [cable.anchor, cable.axis, cable.radius, cable.up, cable.weight, cable.compliance]
    arguments = [ca.SX(a) for a in (*constants, point, value)]
    return CableShape(*_solution(known, cable.rolls, steps).call(arguments, True, False))


@lru_cache(maxsize=16)
def _solution(known: _Given, rolls: bool, steps: int) -> Symbol:
    """Function of a cable's constants, its attachment and what is known of it: the fields of its
    shape.

    Expressions made by one call of it cost a hundredth of those made in Python, cable by cable.
    """
    anchor, axis, up, point = (ca.SX.sym(name, 3) for name in ("anchor", "axis", "up", "point"))
    radius, weight, compliance, value = (
        ca.SX.sym(name) for name in ("radius", "weight", "compliance", "value")
    )
    cable = CableSpec(anchor, axis, radius if rolls else 0.0, up, weight, compliance)
    equations = _HangingEquations(
        known, cable, pulley.swivel(anchor, axis, cable.radius, point), point, value
    )
    inputs = [anchor, axis, radius, up, weight, compliance, point, value]
    state = equations.start()
    for _ in range(steps):
        state = equations.improved(state)
    return ca.Function(
        "hanging", inputs, ca.cse([ca.SX(field) for field in equations.shape(state)])
    )


class _HangingUnknowns(NamedTuple):
    """What is sought of a hanging cable; its tension or its length follows from what is known."""

    mean: Symbol
    """Mean tension between platform and roller [N]."""
    free: Symbol
    """Unstrained length between them [m]."""
    wrap: Symbol
    """[rad]"""


class _Line(NamedTuple):
    """The straight line from the attachment to the leave point."""

    leave: Symbol
    level: Symbol
    """Its horizontal part [m], shape (3,)."""
    run_squared: Symbol
    rise: Symbol


class _HangingEquations(NamedTuple):
    """Those of a hanging cable over its roller, for either question."""

    known: _Given
    cable: CableSpec
    roller: pulley.Roller
    point: Symbol
    value: Symbol
    """Tension at the platform end [N], or unstrained length up to the anchor [m]."""

    def start(self) -> _HangingUnknowns:
        """A shallow cable over the straight one's wrap angle."""
        cable = self.cable
        wrap = pulley.straight_wrap(self.roller, self.point) if cable.rolls else ca.SX(0)
        line = self.line(wrap)
        if self.known == "tension":
            mean = catenary.mean_of_near_end(self.value, line.rise, cable.weight, cable.compliance)
            shallow = catenary.shallow_length(
                mean, line.run_squared, line.rise, cable.weight, cable.compliance
            )
            free = ca.fmin(shallow, 2 * _FULLEST_START * mean / cable.weight)
        else:
            # Only the weight across the chord makes it sag; a micrometre keeps a cable that hangs
            # plumb from having none.
            run = ca.sqrt(line.run_squared + 1e-12)
            chord = ca.sqrt(run**2 + line.rise**2)
            free = self.value - cable.radius * wrap
            taut = catenary.taut_tension(
                chord, free, cable.weight * run / chord, 1 / cable.compliance
            )
            mean = ca.fmax(taut, free * cable.weight / (2 * _FULLEST_START))
        return self.rolled(line, _HangingUnknowns(mean, free, wrap))

    def improved(self, state: _HangingUnknowns) -> _HangingUnknowns:
        """One step of Newton's method for the mean tension or the length, then one for the wrap
        angle.
        """
        line = self.line(state.wrap)
        state = self.consistent(line, state)
        required = catenary.required_length(self.catenary(state), line.run_squared, line.rise)
        miss = required.value - state.free
        # At most halfway to a cable that is all weight: beyond there is none.
        if self.known == "tension":
            free = state.free + miss / (1 - required.by_length)
            state = state._replace(
                free=ca.fmin(free, state.free / 2 + state.mean / self.cable.weight)
            )
        else:
            # What lies on the roller stretches as well. The equation times the mean squared is
            # nearly a cubic one.
            on_roller = (
                self.cable.compliance * self.on_roller(line, state) / self.strained(line, state)
            )
            slope = required.by_mean - on_roller * (1 - required.by_length)
            mean = state.mean - miss / (slope + 2 * miss / state.mean)
            state = state._replace(
                mean=ca.fmax(mean, state.mean / 2 + state.free * (self.cable.weight / 4))
            )
        return self.rolled(line, state)

    def consistent(self, line: _Line, state: _HangingUnknowns) -> _HangingUnknowns:
        """With what follows from the known value at a wrap angle."""
        cable = self.cable
        if self.known == "tension":
            mean = catenary.mean_of_near_end(self.value, line.rise, cable.weight, cable.compliance)
            return state._replace(mean=mean)
        return state._replace(free=self.value - self.on_roller(line, state))

    def on_roller(self, line: _Line, state: _HangingUnknowns) -> Symbol:
        """Unstrained length there [m]."""
        if not self.cable.rolls:
            return ca.SX(0)
        return self.cable.radius * state.wrap / self.strained(line, state)

    def strained(self, line: _Line, state: _HangingUnknowns) -> Symbol:
        """Length over unstrained length on the roller."""
        return 1 + self.cable.compliance * self.tensions(line, state)[1]

    def line(self, wrap: Symbol) -> _Line:
        """Where the cable leaves the roller, seen from the attachment."""
        leave = pulley.leave_point(self.roller, wrap) if self.cable.rolls else self.cable.anchor
        d = leave - self.point
        rise = ca.dot(d, self.cable.up)
        level = d - rise * self.cable.up
        return _Line(leave, level, ca.dot(level, level), rise)

    def catenary(self, state: _HangingUnknowns) -> catenary.Catenary:
        """The part that hangs freely."""
        return catenary.Catenary(state.mean, state.free, self.cable.weight, self.cable.compliance)

    def tensions(self, line: _Line, state: _HangingUnknowns) -> tuple[Symbol, Symbol]:
        """At the platform and at the roller [N]."""
        if self.known == "tension":
            near = self.value
        else:
            near = catenary.near_end_of_mean(
                state.mean, line.rise, self.cable.weight, self.cable.compliance
            )
        return near, 2 * state.mean - near

    def pulls(self, line: _Line, state: _HangingUnknowns) -> tuple[Symbol, Symbol]:
        """Forces along the cable towards the anchor, at the platform and at the roller [N], shape
        (3,).
        """
        level, rise = catenary.forces(self.catenary(state), line.level, line.rise)
        half_weight = self.cable.weight * state.free / 2
        return (
            level + (rise - half_weight) * self.cable.up,
            level + (rise + half_weight) * self.cable.up,
        )

    def kink(self, line: _Line, state: _HangingUnknowns) -> Symbol:
        """By what the wrap angle falls short of a cable that leaves the roller tangentially, in
        first order [rad].
        """
        angle = ca.SX.sym("angle")
        radial = pulley.radial(self.roller, angle)
        radial, along = ca.substitute(
            [radial, ca.jacobian(radial, angle)], [angle], [ca.SX(state.wrap)]
        )
        _, pull = self.pulls(line, state)
        # With the angle, the weight that hangs from the leave point changes too.
        curved = self.cable.weight * self.cable.radius * ca.dot(self.cable.up, radial)
        return ca.dot(pull, radial) / (curved - ca.dot(pull, along))

    def rolled(self, line: _Line, state: _HangingUnknowns) -> _HangingUnknowns:
        """With the wrap angle at which the end of the cable is tangential; a cable laid on the
        roller keeps its length.
        """
        if not self.cable.rolls:
            return state
        kink = self.kink(line, state)
        laid = self.cable.radius * kink / self.strained(line, state)
        return state._replace(wrap=state.wrap + kink, free=state.free - laid)

    def shape(self, state: _HangingUnknowns) -> CableShape:
        """The cable and by how much it misses its equations."""
        line = self.line(state.wrap)
        state = self.consistent(line, state)
        tension, winch_tension = self.tensions(line, state)
        pull, _ = self.pulls(line, state)
        miss = (
            catenary.required_length(self.catenary(state), line.run_squared, line.rise).value
            - state.free
        )
        kink = self.kink(line, state) if self.cable.rolls else ca.SX(0)
        return CableShape(
            direction=pull / ca.norm_2(pull),
            tension=tension,
            length=(
                state.free + self.on_roller(line, state) if self.known == "tension" else self.value
            ),
            leave_point=line.leave,
            wrap=state.wrap,
            winch_tension=winch_tension,
            residual=ca.fabs(miss) + ca.fabs(kink),
        )
