"""Percentiles of the readings around each."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array

_AT_ONCE = 4096
"""Readings whose neighbours are sorted at once, so that memory stays small."""


def running_percentile(
    values: Array, around: int, percentile: float, at: NDArray[np.intp] | None = None
) -> Array:
    """A percentile of the readings around each, the first or last one repeated beyond the ends.

    Args:
        values: Shape (n, ...); each channel by itself.
        around: Readings that are looked at, an odd number.
        percentile: Below 100; of ``around`` values the one that stands there, never between two.
        at: Where it is asked for, shape (c,); None: everywhere.

    Returns:
        Shape (c, ...).
    """
    rank = int(around * percentile / 100)
    beyond = [(around // 2, around // 2)] + [(0, 0)] * (values.ndim - 1)
    windows = np.lib.stride_tricks.sliding_window_view(
        np.pad(values, beyond, mode="edge"), around, axis=0
    )
    asked = np.arange(len(values)) if at is None else at
    found = np.empty((len(asked), *values.shape[1:]))
    for start in range(0, len(asked), _AT_ONCE):
        own = asked[start : start + _AT_ONCE]
        found[start : start + _AT_ONCE] = np.partition(windows[own], rank, axis=-1)[..., rank]
    return found
