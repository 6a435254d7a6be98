"""Hands that still touch a platform that swings without force sensors.

No reading says that something pushes: it shows in what the cables cannot carry, and a body would
follow it. So it is looked for before a body is fitted closely, about the first one: noise of the
motion comes and goes from sample to sample, a push goes on for some tenths of a second.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array, stretches
from steelyard.identification.model.balance import Balance, Forces
from steelyard.identification.solve.settings import FIT, FitSettings


def touching(
    at: Balance, forces: Forces, settings: FitSettings = FIT
) -> tuple[tuple[float, float], ...]:
    """Stretches in which something pushes beside the cables [s]; none where forces are read.

    Args:
        at: The balance about a first body.
        forces: Its forces; what is left out of them already is not looked at.
        settings: With what stands out.
    """
    if not forces.guessed.all() or len(at.time) < 2:
        return ()
    step = float(np.median(np.diff(at.time)))
    many = max(1, round(settings.hand_window / step))
    free = ~forces.touched
    if len(at.time) < 4 * many or not free.any():
        return ()
    size = _smooth_size(at.residual, free, many)
    size = size / max(float(np.median(size[free])), 1e-300)
    size[~free] = 0.0
    # The ends of a spline are not as sure as it is elsewhere.
    inside = np.zeros(len(size), dtype=bool)
    inside[many:-many] = True
    found = []
    for first, last in stretches(size > settings.hand_around):
        if np.any((size > settings.hand)[first:last] & inside[first:last]):
            margin = settings.hand_window / 2
            found.append((float(at.time[first]) - margin, float(at.time[last - 1]) + margin))
    return tuple(found)


def _smooth_size(residual: Array, free: NDArray[np.bool_], many: int) -> Array:
    """Size of the mean of so many residuals about each, of those that are free, shape (n,).

    Of cables that nobody reads, whitened residuals are in the same axes all along a run.
    """
    window = np.ones(many)
    count = np.convolve(free, window, mode="same")
    mean = [np.convolve(column * free, window, mode="same") for column in residual.T]
    return np.asarray(np.linalg.norm(mean, axis=0) / np.maximum(count, 1.0))


def without(forces: Forces, at: Balance, touched: tuple[tuple[float, float], ...]) -> Forces:
    """Forces without those of some stretches [s]."""
    left_out = forces.left_out.copy()
    for start, end in touched:
        left_out[(at.time >= start) & (at.time <= end)] = True
    return replace(forces, left_out=left_out)
