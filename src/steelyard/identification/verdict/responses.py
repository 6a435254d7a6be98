"""How what moves against the platform pulls at it: an oscillator, or a load on a string."""

from __future__ import annotations

import numpy as np
from scipy.linalg.lapack import dtbtrs

from steelyard.arrays import Array


def oscillator(driven: Array, omega: float, damping: float, step: float) -> Array:
    """Pull of a kilogramme on a spring, ``omega^2 x`` of ``x'' + 2 damping omega x' + omega^2 x = -driven`` from
    rest, by the trapezoidal rule, shape (t, 3).

    Args:
        driven: Acceleration at equal steps [m/s^2], shape (t, 3).
        omega: Of the spring [rad/s].
        damping: Ratio.
        step: [s]
    """
    half = omega * step / 2
    first, middle, last = (
        1 + 2 * damping * half + half**2,
        2 * (half**2 - 1),
        1 - 2 * damping * half + half**2,
    )
    band = np.empty((3, len(driven)))
    band[0], band[1], band[2] = first, middle, last
    right = driven.copy()
    right[1:] += 2 * driven[:-1]
    right[2:] += driven[:-2]
    found, _ = dtbtrs(band, -(half**2) * right, uplo="L")
    return np.asarray(found)


def pendulums(
    acceleration: Array, gravity: Array, omega: Array, damping: float, step: float
) -> Array:
    """Pull of a kilogramme on a string, beyond that of one that is fixed, world frame [N], shape (f, t,
    3): of a spherical pendulum at any angle, from where it hangs at first, by the method of Runge and
    Kutta.

    A string tells nothing but its direction: ``r'' = g - a + T r - 2 damping omega r'``, where T keeps its
    length ``|g| / omega^2`` [Goldstein2002]_ (chapter 2.4, a constraint with its multiplier).

    Args:
        acceleration: Of the point where it hangs, world frame, at equal steps [m/s^2], shape (t, 3).
        gravity: World frame [m/s^2], shape (3,).
        omega: Of small swings, one for each length [rad/s], shape (f,).
        damping: Ratio of small swings.
        step: [s]
    """
    felt = gravity - acceleration
    square = (np.linalg.norm(gravity) / omega**2) ** 2
    drag = (2 * damping * omega)[:, None]

    def tension(place: Array, speed: Array, at: Array) -> Array:
        return np.asarray(-(np.sum(speed**2, axis=1) + place @ at) / square)[:, None]

    def rate(place: Array, speed: Array, at: Array) -> Array:
        return np.asarray(at + tension(place, speed, at) * place - drag * speed)

    place = np.sqrt(square)[:, None] * felt[0] / np.linalg.norm(felt[0])
    speed = np.zeros_like(place)
    found = np.empty((len(omega), *felt.shape))
    for i, here in enumerate(felt):
        found[:, i] = -tension(place, speed, here) * place - here
        if i + 1 == len(felt):
            break
        there = felt[i + 1]
        middle = (here + there) / 2
        first = rate(place, speed, here)
        half = place + step / 2 * speed, speed + step / 2 * first
        second = rate(*half, middle)
        other = place + step / 2 * half[1], speed + step / 2 * second
        third = rate(*other, middle)
        last = rate(place + step * other[1], speed + step * third, there)
        place = place + step * speed + step**2 / 6 * (first + second + third)
        speed = speed + step / 6 * (first + 2 * second + 2 * third + last)
        # It neither grows nor turns along itself by the errors of the steps.
        place *= np.sqrt(square / np.sum(place**2, axis=1))[:, None]
        speed -= place * (np.sum(place * speed, axis=1) / square)[:, None]
    return found
