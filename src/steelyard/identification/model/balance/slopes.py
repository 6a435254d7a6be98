"""What sampled quantities are and how fast they change, by lines through what was read about each
time.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array

AROUND = 0.1
"""Half the time over which the change of a tension is looked at [s]: noise of readings at 25 Hz
leaves some newtons a second of it, and a platform that swings with 1.5 Hz on its ropes all but a
tenth."""
_INSTANT = 1e-4
"""Samples closer than this are of one instant [s]: means of dense streams are a millisecond
apart."""


def slopes(time: Array, values: Array) -> Array:
    """How fast something changes, by lines through what was read about each time and at least its
    neighbours, shape (n, m).

    Args:
        time: Ascending [s], shape (n,).
        values: Shape (n, m).
    """
    n = len(time)
    if n < 2:
        return np.zeros_like(values)
    own = np.arange(n)
    first, last = _about(time)
    first, last = (
        np.minimum(first, np.maximum(own - 1, 0)),
        np.maximum(last, np.minimum(own + 2, n)),
    )
    return _lines(time, values, first, last)[1]


def smoothed(time: Array, values: Array) -> Array:
    """What something is without what changes from sample to sample, by lines through what was read
    about each time, shape (n, m); what has no neighbours there is as it is.

    Args:
        time: Ascending [s], shape (n,).
        values: Shape (n, m).
    """
    return _lines(time, values, *_about(time))[0]


def means_of(values: Array, many: int) -> Array:
    """Means of so many samples each, shape (n // many, k); fewer at the end are left.

    Args:
        values: Shape (n, k).
        many: At least one.
    """
    count = len(values) // many
    return np.asarray(values[: count * many].reshape(count, many, -1).mean(axis=1))


def _about(time: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """First sample about each time, and first one after these, shape (n,) each."""
    return np.searchsorted(time, time - AROUND), np.searchsorted(time, time + AROUND, side="right")


def _lines(
    time: Array, values: Array, first: NDArray[np.intp], last: NDArray[np.intp]
) -> tuple[Array, Array]:
    """Value and slope at each time of the line through some samples, shape (n, m) each."""
    origin, middle = time.mean(), values.mean(axis=0)
    t, x = time - origin, values - middle
    sums = np.cumsum(np.column_stack([np.ones(len(t)), t, t**2, x, t[:, None] * x]), axis=0)
    sums = np.vstack([np.zeros(sums.shape[1]), sums])
    count, by_t, by_square, rest = np.split(sums[last] - sums[first], [1, 2, 3], axis=1)
    by_x, by_both = np.split(rest, 2, axis=1)
    width = by_square - by_t**2 / count
    # Samples of one instant tell no rate.
    apart = width > _INSTANT**2
    slope = (by_both - by_t * by_x / count) / np.where(apart, width, 1.0)
    slope = np.where(apart, slope, 0.0)
    return np.asarray(middle + (by_x + slope * (t[:, None] * count - by_t)) / count), slope
