"""Measured and predicted readings, thinned, with what there is to say about their residuals."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.identification.residuals import Residuals
from steelyard.report.evidence.thinning import Thinning, rounded, thinned
from steelyard.report.evidence.values import Number, Spectrum, Trace, numbers
from steelyard.spectra import density

_LEAST_SIGMA = 1e-300
"""Instead of zero, which nothing can be divided by."""
_LEAST_POWER = 1e-12
"""Of a spectrum: logarithmic axes need more than zero."""


def traces(found: Iterable[Residuals], thinning: Thinning) -> list[Trace]:
    """All quantities of all instruments, so thinned that they fit the bound together."""
    every = [each for each in found if len(each.time)]
    width = sum(2 * each.measured.shape[1] + 1 for each in every)
    most = thinning.most_numbers / max(width, 1)
    points = int(np.clip(most, thinning.fewest_points, thinning.most_points))
    return [_trace(each, points, thinning) for each in every]


def _trace(each: Residuals, points: int, thinning: Thinning) -> Trace:
    """One quantity, of about so many points."""
    known = np.isfinite(each.residual)
    used = known & ~each.left_out
    scale = 1.0 if each.sigma is None else np.maximum(each.sigma, _LEAST_SIGMA)
    scaled = np.where(used, each.residual, 0.0) / scale
    few = thinned(np.where(known, np.abs(each.residual) / scale, 0.0), points)
    outliers = each.left_out
    if each.sigma is not None:
        outliers = outliers | (np.abs(scaled) > thinning.outlying)
    columns = zip(each.residual.T, used.T, strict=True)
    return Trace(
        run=each.run,
        instrument=each.instrument,
        quantity=each.quantity,
        unit=each.unit,
        channels=each.channels,
        static=each.static,
        samples=len(each.time),
        time=tuple(rounded(each.time[few], 8)),
        measured=tuple(numbers(column, 6) for column in each.measured[few].T),
        residual=tuple(numbers(column, 4) for column in each.residual[few].T),
        sigma=None if each.sigma is None else tuple(rounded(each.sigma, 5)),
        rms=tuple(_rms(column[rows]) for column, rows in columns),
        worst=None if each.sigma is None else float(f"{np.abs(scaled).max(initial=0.0):.4g}"),
        outliers=int(np.sum(outliers)),
        left_out=tuple((int(k), int(n)) for n, k in np.argwhere(each.left_out[few])),
        spectrum=_spectrum(each, used, scaled, thinning),
    )


def _rms(values: Array) -> Number:
    return float(f"{np.sqrt(np.mean(values**2)):.4g}") if len(values) else None


def _spectrum(
    each: Residuals, used: NDArray[np.bool_], scaled: Array, thinning: Thinning
) -> Spectrum | None:
    """Of residuals that came at about even times; None where they did not, or are few.

    Args:
        each: The quantity, n samples of k channels.
        used: Which residuals the fit looks at, shape (n, k).
        scaled: Residuals in their 1-sigma, shape (n, k).
        thinning: Lengths of the parts that it is the mean of.
    """
    step = np.diff(each.time)
    if each.static or len(step) < thinning.fewest_intervals:
        return None
    if used.mean() < 1 - thinning.most_missing:
        return None
    middle = float(np.median(step))
    if middle <= 0 or np.quantile(np.abs(step - middle), 0.9) > thinning.jitter * middle:
        return None
    level = 1.0 if each.sigma is not None else np.maximum(np.mean(scaled**2, axis=0), _LEAST_SIGMA)
    n = len(scaled)
    length = min(thinning.longest_segment, n // thinning.spectrum_segments)
    length = min(n, max(thinning.shortest_segment, length))
    frequency, found = density(scaled, middle, length)
    # One-sided: white noise of unit variance has the density two over the rate.
    power = np.mean(found / (2 * middle) / level, axis=1)
    power = np.maximum(power[1:], _LEAST_POWER)
    return Spectrum(tuple(rounded(frequency[1:], 5)), tuple(rounded(power, 4)))
