"""Noise that readings of a motion show: how they scatter about a spline of their own."""

from __future__ import annotations

import numpy as np

from steelyard.arrays import Array
from steelyard.identification.model.settings import MOTION, MotionSettings
from steelyard.identification.samples.motion_streams import unbroken
from steelyard.smoothing import NORMAL_MEDIAN, Samples1D, fit

_THIRD = float(np.sqrt(20.0))
"""1-sigma of third differences of white noise of 1-sigma one."""
LEAST_RAPID = 4
"""Readings that have a third difference."""
_FLICKER = 3
"""Values that an encoder at rest may read: its count and those beside it."""


def scatter(
    time: Array,
    values: Array,
    start: float,
    end: float,
    spacing: float,
    settings: MotionSettings = MOTION,
) -> float | None:
    """1-sigma of samples about their own spline; None where they do not determine one, not even
    between their gaps.
    """
    flat = values.reshape(len(values), -1)
    whole = fit(Samples1D(time, flat), start, end, spacing, robust=True) if len(time) else None
    sigma = whole.sigma if whole is not None else _between_gaps(time, flat, spacing)
    if sigma is None:
        return None
    # Nine elements of a rotation matrix scatter by sqrt(6 / 9) of the rotation vector.
    scale = np.sqrt(1.5) if values.ndim == 3 else 1.0
    return max(sigma * scale, least_noise(values, settings))


def _between_gaps(time: Array, values: Array, spacing: float) -> float | None:
    """1-sigma of samples about splines of their own between gaps that a spline of this spacing does
    not bridge; None where they do not determine any.
    """
    square, count = 0.0, 0
    for start, end in unbroken(time, spacing) if len(time) else ():
        own = (time >= start) & (time <= end)
        if end - start <= spacing:
            continue
        fitted = fit(Samples1D(time[own], values[own]), start, end, spacing, robust=True)
        if fitted is not None:
            square += int(own.sum()) * fitted.sigma**2
            count += int(own.sum())
    return float(np.sqrt(square / count)) if count else None


def least_noise(values: Array, settings: MotionSettings = MOTION) -> float:
    """Least 1-sigma of a quantity, from how much it varies."""
    flat = values.reshape(len(values), -1)
    return float(
        settings.least_noise * np.nanstd(flat, axis=0).max()
        + 1e-9 * np.nanmax(np.abs(flat))
        + 1e-12
    )


def rapid_scatter(values: Array) -> float:
    """1-sigma of white noise that changes from sample to sample as much as the readings do,
    robustly; what changes slowly does not count.

    Args:
        values: Shape (n, k), n at least :data:`LEAST_RAPID`.
    """
    return float(np.nanmax(by_differences(np.diff(values, 3, axis=0))))


def by_differences(third: Array) -> Array:
    """1-sigma of white noise by third differences of its samples, robustly: of each column, shape
    (k,).

    Args:
        third: Shape (n, k); NaN where there is none.
    """
    return np.asarray(np.nanmedian(np.abs(third), axis=0) / NORMAL_MEDIAN / _THIRD)


def stands_still(values: Array) -> bool:
    """Whether a quantity does nothing but flicker by its last digit, as the encoders of locked
    winches do: it tells nothing of its noise.

    Args:
        values: Readings, shape (n, ...).
    """
    flat = values.reshape(len(values), -1)
    return all(len(np.unique(own[np.isfinite(own)])) <= _FLICKER for own in flat.T)
