"""A cable over a swivelling roller, Fig. 3 of [Tempel2017]_.

The cable enters the roller at the anchor along ``axis``; the roller swivels about that line, which
is tangent to it, and lies in the plane of ``axis`` and the attachment. In that plane, with
coordinates (outward, axis) from the anchor, the centre is at (r, 0), the cable touches the circle
at ``(r, 0) + r (-cos b, sin b)`` after the wrap angle b and travels there in the direction (sin b,
cos b).
"""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca
import numpy as np

from steelyard.arrays import Array
from steelyard.batch import Symbol


class Roller(NamedTuple):
    """A roller turned towards a point, in world axes."""

    anchor: Symbol
    """Where the cable enters [m], shape (3,)."""
    axis: Symbol
    """Its direction of travel there, unit vector, shape (3,)."""
    outward: Symbol
    """Unit vector from the anchor to the centre of the roller, shape (3,)."""
    radius: float
    """[m]"""


def swivel(anchor: Symbol, axis: Symbol, radius: float, point: Symbol) -> Roller:
    """Turn the roller into the plane of its axis and a point."""
    d = point - anchor
    square = d - ca.dot(d, axis) * axis
    # A micrometre keeps the direction defined for a point on the axis itself.
    return Roller(anchor, axis, square / ca.sqrt(ca.dot(square, square) + 1e-12), radius)


def leaned(axis: Array, first: Symbol, second: Symbol) -> Symbol:
    """An axis that leans along two directions square to it by small angles [rad], unit vector,
    shape (3,).

    Args:
        axis: Unit vector, shape (3,).
        first: Along the direction square to it that is nearest to the world's first axis, or its
            second where that is farther from it [rad].
        second: Along what is square to both [rad].
    """
    along = np.eye(3)[0 if abs(axis[0]) <= abs(axis[1]) else 1]
    way = along - (along @ axis) * axis
    way = way / np.linalg.norm(way)
    found = ca.DM(axis) + first * ca.DM(way) + second * ca.DM(np.cross(axis, way))
    return found / ca.norm_2(found)


def leave_point(roller: Roller, wrap: Symbol) -> Symbol:
    """a_corr of Eq. (10): where the cable leaves the roller after a wrap angle [rad], world frame
    [m], shape (3,).
    """
    a, r = roller, roller.radius
    return a.anchor + r * (1 - ca.cos(wrap)) * a.outward + r * ca.sin(wrap) * a.axis


def radial(roller: Roller, wrap: Symbol) -> Symbol:
    """Unit vector from the centre to the leave point; a cable that leaves tangentially is square to
    it, shape (3,).
    """
    return -ca.cos(wrap) * roller.outward + ca.sin(wrap) * roller.axis


def straight_wrap(roller: Roller, point: Symbol) -> Symbol:
    """Wrap angle of a straight cable to a point in the plane of the roller [rad], in [0, 2 pi).

    With D from the centre to the point and l the free length, D = r (-cos b, sin b) + l (sin b, cos
    b).
    """
    d = point - roller.anchor
    x = ca.dot(d, roller.outward) - roller.radius
    y = ca.dot(d, roller.axis)
    r = roller.radius
    free = ca.sqrt(x * x + y * y - r * r)
    angle = ca.atan2(free * x + r * y, free * y - r * x)
    return ca.if_else(angle < 0, angle + 2 * ca.pi, angle)
