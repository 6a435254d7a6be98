"""The elastic catenary [Irvine1981]_.

A cable of weight w per unstrained length hangs between two points. Seen from its end at the platform, in the vertical plane
through both points, the force that it exerts there has a horizontal part H towards the other end and a vertical part V upwards;
at the unstrained distance s the vertical part has grown to V + w s.
"""

from __future__ import annotations

import casadi as ca

from steelyard.batch import Symbol


def span(H: Symbol, V: Symbol, length: Symbol, weight: Symbol, compliance: Symbol) -> tuple[Symbol, Symbol]:
    """Where the far end is, seen from the platform end, Eq. (1.19) and (1.20) of [Irvine1981]_.

    Args:
        H: Horizontal part of the tension, positive [N].
        V: Vertical part of the tension at the platform end, upwards [N].
        length: Unstrained length [m].
        weight: Of unstrained cable, positive [N/m].
        compliance: 1 / EA [1/N]; 0 for a cable that does not stretch.

    Returns:
        Horizontal and vertical distance [m].
    """
    end = V + weight * length
    far, near = ca.sqrt(H**2 + end**2), ca.sqrt(H**2 + V**2)
    # (far - near) / weight and the difference of the inverse hyperbolic sines without cancellation, however light the cable.
    growth = length * (end + V) / (far + near)
    horizontal = H * length * compliance + H / weight * ca.log1p(weight * (length + growth) / (V + near))
    vertical = (V + weight * length / 2) * length * compliance + growth
    return horizontal, vertical


def taut_tension(chord: Symbol, length: Symbol, weight: Symbol, stiffness: Symbol) -> Symbol:
    """Mean tension of a shallow cable of a given unstrained length: stretch less sag, to start Newton's method from.

    Solves T^3 - EA (chord / length - 1) T^2 - EA (weight chord)^2 / 24 = 0 from above, where Newton's method cannot fail.

    Args:
        chord: Distance of its ends [m].
        length: Unstrained length [m].
        weight: [N/m].
        stiffness: EA [N].

    Returns:
        Tension [N], positive.
    """
    stretch = stiffness * (chord / length - 1)
    sag = stiffness * (weight * chord) ** 2 / 24
    T = ca.fmax(stretch, 0) + sag ** (1 / 3)
    for _ in range(8):
        T = T - (T**3 - stretch * T**2 - sag) / (3 * T**2 - 2 * stretch * T)
    return T
