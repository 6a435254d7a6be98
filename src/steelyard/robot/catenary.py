r"""The elastic catenary [Irvine1981]_ between two points, in terms of the mean of its two end
tensions.

A cable of weight w per unstrained length L hangs between two points. Seen from its end at the
platform, in the vertical plane through both points, the force that it exerts there has a horizontal
part H towards the other end and a vertical part V upwards; at the unstrained distance s the
vertical part has grown to V + w s. With T and T' the tensions at the two ends, M their mean and u =
w L / 2 M, the difference of inverse hyperbolic sines in Eq. (1.19) is 2 artanh u, and Eq. (1.19),
(1.20) read

.. math:: x = H L (c + \frac{\operatorname{artanh} u}{u M}), \qquad z = (V + w L / 2) L (c +
\frac{1}{M}),

with c = 1 / EA. Nothing cancels in them, however light the cable. That M is the mean of the
tensions of these forces is the one condition left between M and L, so a cable of which either is
known is one equation in one unknown.
"""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca

from steelyard.batch import Symbol


class Catenary(NamedTuple):
    """A cable between two points; its forces belong to a hanging cable where
    :func:`required_length` is ``length``.
    """

    mean: Symbol
    """Mean M of the tensions at both ends [N]."""
    length: Symbol
    """Unstrained length L, positive [m]."""
    weight: Symbol
    """Of unstrained cable, positive [N/m]."""
    compliance: Symbol
    """1 / EA [1/N]; 0 for a cable that does not stretch."""

    @property
    def fullness(self) -> Symbol:
        """u, half its weight over its mean tension: 0 for a taut cable, below 1 for every one."""
        return self.weight * self.length / (2 * self.mean)


def _lengthening(cable: Catenary) -> tuple[Symbol, Symbol]:
    """Horizontal and vertical distance over the straight unstretched ones of the same mean
    forces.
    """
    u, stretch = cable.fullness, cable.compliance * cable.mean
    return ca.atanh(u) / u + stretch, 1 + stretch


def forces(cable: Catenary, level: Symbol, rise: Symbol) -> tuple[Symbol, Symbol]:
    """Horizontal force and mean vertical force with which a cable spans given distances.

    Args:
        cable: Its mean tension and length.
        level: Horizontal distance, or vector, of the far end from the platform end [m].
        rise: Vertical distance [m].

    Returns:
        H [N], of the shape of ``level``, and V + w L / 2 [N].
    """
    across, upward = _lengthening(cable)
    mean_over_length = cable.mean / cable.length
    return level * (mean_over_length / across), rise * (mean_over_length / upward)


class RequiredLength(NamedTuple):
    """Unstrained length at which the mean of the end tensions is what a cable says, and its
    derivatives.
    """

    value: Symbol
    """[m]"""
    by_mean: Symbol
    """By the mean tension of the cable [m/N]."""
    by_length: Symbol
    """By its length, of second order in u."""


def required_length(cable: Catenary, run_squared: Symbol, rise: Symbol) -> RequiredLength:
    """The one equation of a hanging cable: its length is the one that its mean tension requires.

    From H^2 = (M^2 - (V + w L / 2)^2) (1 - u^2), which is T + T' = 2 M squared.

    Args:
        cable: Its mean tension and length.
        run_squared: Square of the horizontal distance of its ends [m^2].
        rise: Vertical distance [m].

    Returns:
        Required length, with derivatives for Newton's method.
    """
    across, upward = _lengthening(cable)
    u_squared, stretch = cable.fullness**2, cable.compliance * cable.mean
    steep = 1 / (1 - u_squared)
    level_part, rise_part = run_squared * steep / across**2, (rise / upward) ** 2
    value = ca.sqrt(level_part + rise_part)
    # u times the derivative of artanh(u) / u by u is steep less that quotient, which is across less
    # stretch.
    by_log_u = level_part * (u_squared * steep - (steep + stretch - across) / across)
    by_log_stretch = -stretch * (level_part / across + rise_part / upward)
    return RequiredLength(
        value, (by_log_stretch - by_log_u) / (value * cable.mean), by_log_u / (value * cable.length)
    )


def mean_of_near_end(tension: Symbol, rise: Symbol, weight: Symbol, compliance: Symbol) -> Symbol:
    """Mean of the end tensions of a cable whose tension at the platform end is known; its length
    does not matter.

    The positive root of (M - T) (1 + c M) = w z / 2, without cancellation.

    Args:
        tension: T at the platform end [N].
        rise: Height z of the far end above it [m].
        weight: [N/m].
        compliance: 1 / EA [1/N].

    Returns:
        M [N].
    """
    stretched = 1 + compliance * tension
    return tension + weight * rise / (
        stretched + ca.sqrt(stretched**2 + 2 * compliance * weight * rise)
    )


def near_end_of_mean(mean: Symbol, rise: Symbol, weight: Symbol, compliance: Symbol) -> Symbol:
    """Tension at the platform end for a given mean, the inverse of :func:`mean_of_near_end`; units
    as there.
    """
    return mean - weight * rise / (2 * (1 + compliance * mean))


def shallow_length(
    mean: Symbol, run_squared: Symbol, rise: Symbol, weight: Symbol, compliance: Symbol
) -> Symbol:
    """Unstrained length of a shallow cable of a given mean tension: its parabola, to start Newton's
    method from; units as above.
    """
    chord = ca.sqrt(run_squared + rise**2)
    return chord * (1 + run_squared * (weight / mean) ** 2 / 24) / (1 + compliance * mean)


def taut_tension(chord: Symbol, length: Symbol, weight: Symbol, stiffness: Symbol) -> Symbol:
    """Mean tension of a shallow cable of a given unstrained length: stretch less sag, to start
    Newton's method from.

    Solves T^3 - EA (chord / length - 1) T^2 - EA (weight chord)^2 / 24 = 0 from above, where
    Newton's method cannot fail.

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
