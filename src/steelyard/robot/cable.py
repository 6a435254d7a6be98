"""One cable from its winch over the roller to the platform: direction, length and tension.

Two questions are asked of the same equations: which way does it pull if its tension at the platform is known (identification),
and how hard does it pull if the length fed out is known (simulation). Straight cables have closed forms; for cables with
weight a fixed number of Newton steps from a shallow-sag start reaches rounding error, and the remaining ``residual`` is handed
out so that the caller can check it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import casadi as ca
import numpy as np

from steelyard.arrays import Array
from steelyard.batch import Symbol
from steelyard.robot import catenary, pulley
from steelyard.robot.model import Robot

RESIDUAL_TOLERANCE = 1e-8
"""What :attr:`CableShape.residual` must not exceed where the equations have been solved."""


class CableSpec(NamedTuple):
    """Constants of one cable; geometry may be symbolic."""

    anchor: Symbol
    """World frame [m], shape (3,)."""
    axis: Array
    radius: float
    up: Array
    """Unit vector against gravity, world frame."""
    weight: float
    """[N/m]; 0: straight."""
    compliance: float
    """1 / EA [1/N]; 0: does not stretch."""


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
    """Error of the equations, in metres of span and relative tension; 0 for closed forms."""


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


def by_tension(cable: CableSpec, point: Symbol, tension: Symbol) -> CableShape:
    """Shape of a cable whose tension at the platform end is known.

    Args:
        cable: Its constants.
        point: Attachment in the world frame [m], shape (3,).
        tension: [N], positive where the cable has weight.
    """
    if not cable.weight:
        _, wrap, leave, chord = _straight(cable, point)
        strained = chord + cable.radius * wrap
        direction = (leave - point) / chord
        length = strained / (1 + tension * cable.compliance)
        return CableShape(direction, tension, length, leave, wrap, tension, ca.SX(0))

    def closing(H: Symbol, V: Symbol, fed: Symbol) -> Symbol:
        return ca.sqrt(H**2 + V**2) / tension - 1

    return _hanging(cable, point, tension, closing, _STEPS_BY_TENSION)


def by_length(cable: CableSpec, point: Symbol, fed: Symbol) -> CableShape:
    """Shape of a cable of which a known unstrained length has been fed out.

    Args:
        cable: Its constants; it must stretch.
        point: Attachment in the world frame [m], shape (3,).
        fed: Unstrained length from the anchor over the roller to the attachment [m].
    """
    _, wrap, leave, chord = _straight(cable, point)
    if not cable.weight:
        tension = ((chord + cable.radius * wrap) / fed - 1) / cable.compliance
        return CableShape((leave - point) / chord, tension, fed, leave, wrap, tension, ca.SX(0))

    def closing(H: Symbol, V: Symbol, length: Symbol) -> Symbol:
        return length - fed

    # Only the weight across the chord makes it sag; along the chord it makes the tension grow towards the upper end.
    rise = ca.dot(leave - point, ca.DM(cable.up))
    across = cable.weight * ca.sqrt(ca.fmax(1 - (rise / chord) ** 2, 1e-12))
    mean = catenary.taut_tension(chord, fed - cable.radius * wrap, across, 1 / cable.compliance)
    start = ca.fmax(mean - cable.weight * rise / 2, 0.3 * mean)
    return _hanging(cable, point, start, closing, _STEPS_BY_LENGTH)


def _straight(cable: CableSpec, point: Symbol) -> tuple[pulley.Roller, Symbol, Symbol, Symbol]:
    """Roller, wrap angle, leave point and free length of a straight cable."""
    roller = pulley.swivel(cable.anchor, ca.DM(cable.axis), cable.radius, point)
    wrap = pulley.straight_wrap(roller, point) if cable.radius else ca.SX(0)
    leave = pulley.leave_point(roller, wrap) if cable.radius else cable.anchor
    return roller, wrap, leave, ca.norm_2(leave - point)


_STEPS_BY_TENSION = 4
_STEPS_BY_LENGTH = 4
"""Newton steps that reach rounding error from 10 N upwards on cables of ten metres; the residual tells where they do not."""


def _hanging(
    cable: CableSpec,
    point: Symbol,
    tension: Symbol,
    closing: Callable[[Symbol, Symbol, Symbol], Symbol],
    steps: int,
) -> CableShape:
    """Solve the catenary and the tangent condition at the roller together.

    Args:
        cable: Its constants.
        point: Attachment in the world frame [m], shape (3,).
        tension: A first guess at the platform end [N].
        closing: The equation that closes the system, of H, V and the unstrained length up to the anchor.
        steps: Of Newton's method.
    """
    up = ca.DM(cable.up)
    roller, wrap0, _, _ = _straight(cable, point)
    x = ca.SX.sym("x", 4 if cable.radius else 3)
    H, V, free = x[0], x[1], x[2]
    wrap = x[3] if cable.radius else ca.SX(0)

    def chord_in_plane(wrap: Symbol) -> tuple[Symbol, Symbol, Symbol, Symbol]:
        leave = pulley.leave_point(roller, wrap) if cable.radius else cable.anchor
        d = leave - point
        rise = ca.dot(d, up)
        level = d - rise * up
        # A micrometre keeps a cable that hangs exactly plumb from dividing by zero.
        run = ca.sqrt(ca.dot(level, level) + 1e-12)
        return leave, level / run, run, rise

    leave, level, run, rise = chord_in_plane(wrap)
    horizontal, vertical = catenary.span(H, V, free, cable.weight, cable.compliance)
    winch_tension = ca.sqrt(H**2 + (V + cable.weight * free) ** 2)
    fed = free + cable.radius * wrap / (1 + winch_tension * cable.compliance)
    equations = [horizontal - run, vertical - rise, closing(H, V, fed)]
    if cable.radius:
        pull = (H * level + (V + cable.weight * free) * up) / winch_tension
        equations.append(ca.dot(pull, pulley.radial(roller, wrap)))
    g = ca.vertcat(*equations)

    # Shallow sag: at the platform end the cable hangs lower than its chord by half its weight.
    _, _, run0, rise0 = chord_in_plane(wrap0)
    chord0 = ca.sqrt(run0**2 + rise0**2)
    slope = rise0 / run0 - cable.weight * chord0**2 / (2 * tension * run0)
    H0 = tension / ca.sqrt(1 + slope**2)
    start = [H0, slope * H0, chord0 / (1 + tension * cable.compliance)]
    guess = ca.vertcat(*start, wrap0) if cable.radius else ca.vertcat(*start)

    others = ca.symvar(ca.veccat(g, guess))
    parameters = [s for s in others if not ca.depends_on(x, s)]
    step = ca.Function("step", [x, *parameters], [x - ca.solve(ca.jacobian(g, x), g)])
    solved = guess
    for _ in range(steps):
        solved = step.call([solved, *parameters], True, False)[0]

    direction = (H * level + V * up) / ca.sqrt(H**2 + V**2)
    outputs = [direction, ca.sqrt(H**2 + V**2), fed, leave, wrap, winch_tension, ca.norm_1(g)]
    finish = ca.Function("finish", [x, *parameters], [ca.SX(o) for o in outputs])
    return CableShape(*finish.call([solved, *parameters], True, False))
