"""Least-squares splines: one zero-phase low-pass for streams of any rate, uneven, with repeated or
missing samples.

Every stream of a run is fitted with quintic splines on one common grid of knots, so that all are
filtered alike; the spline is then evaluated, with derivatives, at any time. Knots ``spacing`` apart
pass motion up to about ``1 / (2 spacing)``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, make_lsq_spline

from steelyard.arrays import Array

DEGREE = 5
"""Quintic: the acceleration of a position is still a smooth cubic."""
NORMAL_MEDIAN = 0.6745
"""Median of the size of a standard normal number."""
_PROBES = 4
"""Columns of white noise that are fitted along with the data, to see how much noise the spline lets
through."""


@dataclass(frozen=True)
class SplineSettings:
    """How long parts are cut, and which samples are left out of a robust fit."""

    longest_piece: float = 300.0
    """Of a part that is fitted at once [s]: memory does not grow with the recording."""
    overlap: float = 12.0
    """Knot spacings by which pieces overlap: the end of a spline is forgotten to rounding."""
    iterations: int = 5
    """Fits in which samples are left out anew."""
    far: float = 6.0
    """1-sigmas by which a sample stands far from what is expected: a normal one in 5e8 does."""
    most_left_out: float = 0.05
    """Share of a channel up to which what stands far is an exception."""


SPLINE = SplineSettings()


@dataclass(frozen=True, eq=False)
class Samples1D:
    """Samples of one quantity: times [s], shape (n,), never decreasing, and finite values, shape
    (n, k).
    """

    time: Array
    values: Array


@dataclass(frozen=True, eq=False)
class Smoothed:
    """A quantity as a smooth function of time."""

    spline: BSpline
    columns: int
    sigma: float
    """1-sigma of a single sample about the spline, root mean square over the columns."""

    def at(self, times: Array, order: int = 0) -> Array:
        """Value or derivative at times [s]; shape (n, k)."""
        return np.asarray(self.spline(times, nu=order))[:, : self.columns]

    def noise(self, times: Array, order: int) -> float:
        """1-sigma of a derivative that is left in :meth:`at` by white noise of the samples."""
        probes = np.asarray(self.spline(times, nu=order))[:, self.columns :]
        return self.sigma * float(np.sqrt(np.mean(probes**2)))


def knots(start: float, end: float, spacing: float) -> Array:
    """Knot vector over an interval, about ``spacing`` apart [s]."""
    pieces = max(1, round((end - start) / spacing))
    inner = np.linspace(start, end, pieces + 1)
    return np.concatenate([np.full(DEGREE, start), inner, np.full(DEGREE, end)])


def fit(
    samples: Samples1D,
    start: float,
    end: float,
    spacing: float,
    *,
    robust: bool = False,
    settings: SplineSettings = SPLINE,
) -> Smoothed | None:
    """Fit one quantity over an interval; None where its samples do not determine the spline.

    Args:
        samples: Of the quantity.
        start: Of the interval [s].
        end: Of the interval [s].
        spacing: Of the knots [s].
        robust: Whether to leave out numbers that stand far from the others of their channel.
        settings: Which of them stand far.
    """
    inside = (samples.time >= start) & (samples.time <= end)
    time, values = samples.time[inside], samples.values[inside]
    if not robust or len(time) <= _NEIGHBOURS:
        return _fit(time, values, start, end, spacing)[0]
    # A number that stands far is replaced by what the others say of it: a spike in one channel
    # leaves the others as they are. Spikes are seen against their neighbours first, since they
    # would ring through the spline.
    expected: Array | None = _among_neighbours(values)
    fitted = None
    for _ in range(settings.iterations):
        assert expected is not None
        far = _far(values, expected, settings)
        if fitted is not None and not far.any():
            break
        replaced = np.where(far, expected, values) if far.any() else values
        again, expected = _fit(time, replaced, start, end, spacing)
        if again is None:
            break
        fitted = again
    return fitted


_NEIGHBOURS = 4
"""Samples beside one, two on each side, that say what to expect of it."""


def _among_neighbours(values: Array) -> Array:
    """Median of the two samples before and the two after each, shape (n, k)."""
    # At the ends those of the other side stand in.
    around = np.concatenate([values[[4, 3]], values, values[[-4, -5]]])
    before, after = (around[:-4], around[1:-3]), (around[3:-1], around[4:])
    lower, higher = np.minimum(*before), np.maximum(*before)
    low, high = np.minimum(*after), np.maximum(*after)
    # Of two sorted pairs the middle two are the larger of the smaller ones and the smaller of the
    # larger ones.
    return np.asarray((np.maximum(lower, low) + np.minimum(higher, high)) / 2)


def _far(values: Array, expected: Array, settings: SplineSettings) -> NDArray[np.bool_]:
    """Numbers that stand further from what is expected than those of their channel do."""
    residual = np.abs(values - expected)
    # The median is hardly moved by the few that stand far.
    sigma = np.median(residual, axis=0) / NORMAL_MEDIAN
    far = residual > settings.far * sigma + 1e-9 * np.abs(values).max(axis=0)
    # Where many stand far, none is the exception.
    return np.asarray(far & (far.mean(axis=0) <= settings.most_left_out))


def _fit(
    time: Array, values: Array, start: float, end: float, spacing: float
) -> tuple[Smoothed | None, Array | None]:
    """The spline, and its values at the samples."""
    t = knots(start, end, spacing)
    freedom = len(t) - DEGREE - 1
    if len(time) <= freedom:
        return None, None
    columns = values.shape[1]
    probes = np.random.default_rng(0).standard_normal((len(time), _PROBES))
    # About its mean: large constants (a clock's epoch, a load) would cost digits.
    center = values.mean(axis=0)
    spline = _least_squares(time, np.hstack([values - center, probes]), t)
    if spline is None:
        return None, None
    predicted = spline(time)[:, :columns] + center
    residual = values - predicted
    if not np.isfinite(residual).all():
        return None, None  # some knots have no samples near
    spline = BSpline(spline.t, spline.c + np.concatenate([center, np.zeros(_PROBES)]), DEGREE)
    sigma = float(np.sqrt(np.sum(residual**2) / (columns * (len(time) - freedom))))
    return Smoothed(spline, columns, sigma), predicted


def _least_squares(time: Array, values: Array, t: Array) -> BSpline | None:
    """Least-squares spline on knots t; None where the samples do not determine it.

    The normal equations of B-splines are banded, mostly well conditioned and linear in time; where
    they are not, as with samples that only just reach an end, orthogonal reduction takes over.
    """
    for method in ("norm-eq", "qr"):
        try:
            return make_lsq_spline(time, values, t, k=DEGREE, method=method)
        except (ValueError, np.linalg.LinAlgError):
            continue
    return None


def segments(
    streams: Sequence[Array], start: float, end: float, spacing: float
) -> list[tuple[float, float]]:
    """Parts of an interval in which no stream has a gap too wide for the knots.

    Args:
        streams: Times of each [s].
        start: Of the interval [s].
        end: Of the interval [s].
        spacing: Of the knots [s].

    Returns:
        Start and end of every part [s].
    """
    parts = [(start, end)]
    for time in streams:
        inside = time[(time >= start) & (time <= end)]
        steps = np.diff(inside)
        limit = max(2 * spacing, 4 * float(np.median(steps)) if len(steps) else 0.0)
        gaps = np.flatnonzero(steps > limit)
        edges = [start, *(edge for i in gaps for edge in (inside[i], inside[i + 1])), end]
        own = list(zip(edges[::2], edges[1::2], strict=True))
        parts = [
            (max(a, c), min(b, d)) for a, b in parts for c, d in own if min(b, d) - max(a, c) > 0
        ]
    return [(float(a), float(b)) for a, b in parts]


def pieces(start: float, end: float, spacing: float) -> list[tuple[float, float, float, float]]:
    """Cut a long part into pieces, so that memory does not grow with its length.

    Every piece is fitted over some more than it is used for: a spline forgets its ends within a few
    knots.

    Args:
        start: Of the part [s].
        end: Of the part [s].
        spacing: Of the knots [s].

    Returns:
        Start and end of what is fitted, start and end of what is used of it [s]; at the ends of the
        part a knot spacing, where derivatives are poor, is not used.
    """
    count = max(1, round((end - start) / SPLINE.longest_piece))
    cuts = np.linspace(start, end, count + 1)
    overlap = SPLINE.overlap * spacing
    found = []
    for i, (a, b) in enumerate(pairwise(cuts.tolist())):
        first = a if i else start + spacing
        last = b if i + 1 < count else end - spacing
        found.append((max(start, a - overlap), min(end, b + overlap), first, last))
    return found


def choose_spacing(
    streams: Sequence[Samples1D],
    candidates: Sequence[float],
    start: float,
    end: float,
    *,
    robust: bool = False,
) -> float:
    """Knot spacing that predicts the streams best, by generalised cross-validation.

    Args:
        streams: Quantities that will be differentiated, where a wrong choice hurts most.
        candidates: Spacings to choose from [s], ascending.
        start: Of the interval to judge on [s].
        end: Of the interval [s].
        robust: Whether to leave out numbers that stand far from the others of their channel.

    Returns:
        One of the candidates [s]; the first if none can be judged.
    """
    best, choice = np.inf, candidates[0]
    for spacing in candidates:
        score = 0.0
        for samples in streams:
            fitted = fit(samples, start, end, spacing, robust=robust)
            if fitted is None:
                score = np.inf
                break
            n = int(np.sum((samples.time >= start) & (samples.time <= end)))
            freedom = len(fitted.spline.t) - DEGREE - 1
            # GCV = (RSS / n) / (1 - freedom / n)^2, as a log likelihood over all numbers of the
            # stream; noise-free data bottom out.
            variance = (
                fitted.sigma**2 / (1 - freedom / n)
                + 1e-18 * float(np.mean(samples.values**2))
                + 1e-300
            )
            score += samples.values.size * float(np.log(variance))
        if score < best:
            best, choice = score, spacing
    return choice
