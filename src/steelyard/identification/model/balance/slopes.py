"""How fast sampled quantities change, by lines through what was read about each time."""

import numpy as np

from steelyard.arrays import Array

AROUND = 0.1
"""Half the time over which the change of a tension is looked at [s]: noise of readings at 25 Hz leaves
some newtons a second of it, and a platform that swings with 1.5 Hz on its ropes all but a tenth."""
_INSTANT = 1e-4
"""Samples closer than this are of one instant [s]: means of dense streams are a millisecond apart."""


def slopes(time: Array, values: Array) -> Array:
    """How fast something changes, by lines through what was read about each time, shape (n, m).

    Args:
        time: Ascending [s], shape (n,).
        values: Shape (n, m).
    """
    n = len(time)
    if n < 2:
        return np.zeros_like(values)
    own = np.arange(n)
    first = np.minimum(np.searchsorted(time, time - AROUND), np.maximum(own - 1, 0))
    last = np.maximum(np.searchsorted(time, time + AROUND, side="right"), np.minimum(own + 2, n))
    t, x = time - time.mean(), values - values.mean(axis=0)
    sums = np.cumsum(np.column_stack([np.ones(n), t, t**2, x, t[:, None] * x]), axis=0)
    sums = np.vstack([np.zeros(sums.shape[1]), sums])
    count, by_t, by_square, rest = np.split(sums[last] - sums[first], [1, 2, 3], axis=1)
    by_x, by_both = np.split(rest, 2, axis=1)
    width = by_square - by_t**2 / count
    # Samples of one instant tell no rate.
    apart = width > _INSTANT**2
    slopes = (by_both - by_t * by_x / count) / np.where(apart, width, 1.0)
    return np.asarray(np.where(apart, slopes, 0.0))
