"""Which shifts between two clocks are likely: all at once, by correlation.

At every shift the readings of one clock are regressed on those of the other one; sums over the
overlap are correlations, which fast Fourier transforms give for all shifts together.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.clocks.clock_signals import ClockSignals, LogClock, Signal
from steelyard.clocks.relations import relations
from steelyard.clocks.settings import SEARCH, SearchSettings
from steelyard.spectra import convolved

_TINY = 1e-300
"""Keeps quotients finite where all readings are zero."""


@dataclass(frozen=True)
class Candidate:
    """A likely shift between two clocks."""

    shift: float
    """Time on the second clock less that on the first one at the same instant [s]."""
    gain: float
    """Log likelihood against clocks whose streams have nothing in common."""


def candidates(
    first: LogClock, second: LogClock, most: int, settings: SearchSettings = SEARCH
) -> list[Candidate]:
    """The likeliest shifts between two clocks, best first.

    Args:
        first: A clock.
        second: Another one.
        most: How many at most, beside that of clocks that were set alike.
        settings: Levels of the search.
    """
    longest = max(c.span[1] - c.span[0] for c in (first, second))
    step = max(settings.step, longest / settings.most_steps)
    one, other = (_thinned(c, step, settings) for c in (first, second))
    if not (one.signals and other.signals):
        return []
    signals = [ClockSignals(c, *_bounds(c), settings.smoothing) for c in (one, other)]
    total = _total_gains(signals[0], signals[1], step, settings)
    if total is None:
        return []
    origin = signals[1].start - signals[0].start
    # Index 0 of each grid is its first bin; place 0 is the shift of the last bin of the first one.
    last = len(_grid(signals[0], step)) - 1
    found: list[Candidate] = []
    rises = total > np.roll(total, 1)
    falls = total >= np.roll(total, -1)
    peaks = np.flatnonzero(rises & falls & (total > 0))
    for place in peaks[np.argsort(-total[peaks])]:
        shift = float(origin + (int(place) - last) * step)
        if all(abs(shift - c.shift) > settings.distinct for c in found):
            found.append(Candidate(shift, float(total[place])))
        if len(found) == most:
            break
    # Clocks that were set alike: where the search hardly knows better, that is what to begin with.
    zero = round(last - origin / step)
    if found and 0 <= zero < len(total) and total[zero] > settings.zero_gain * found[0].gain:
        found.append(Candidate(0.0, float(total[zero])))
    return found


def _total_gains(
    one: ClockSignals, other: ClockSignals, step: float, settings: SearchSettings
) -> Array | None:
    """Log likelihood of every shift of the second grid against the first one, over all relations,
    shape (n + n' - 1,); None: the clocks share none.
    """
    total: Array | None = None
    for of, by, sign in ((one, other, 1), (other, one, -1)):
        grid_of, grid_by = _grid(of, step), _grid(by, step)
        for relation in relations(of, by):
            readings = _on_grid(relation.response, grid_of, step)
            gains = _gains(readings, relation.other(grid_by), step, settings)[::sign]
            total = gains if total is None else total + gains
    return total


def _grid(signals: ClockSignals, step: float) -> Array:
    """Times of the bins of a clock, shape (n,)."""
    count = round((signals.end - signals.start) / step) + 1
    return np.asarray(signals.start + np.arange(count) * step)


def _bounds(clock: LogClock) -> tuple[float, float]:
    """First and last sample of any signal."""
    starts = [signal.time[0] for signal in clock.signals.values()]
    ends = [signal.time[-1] for signal in clock.signals.values()]
    return min(starts), max(ends)


def _thinned(clock: LogClock, step: float, settings: SearchSettings) -> LogClock:
    """Means over the bins of a grid."""
    start = _bounds(clock)[0]
    signals = {}
    for kind, signal in clock.signals.items():
        thin = signal
        if signal.step <= 0.7 * step:
            bins = np.floor((signal.time - start) / step + 0.5).astype(np.int64)
            first = np.flatnonzero(np.diff(bins, prepend=bins[0] - 1))
            counts = np.diff(np.append(first, len(bins)))
            values = np.add.reduceat(signal.values, first, axis=0) / counts[:, None]
            thin = Signal(np.add.reduceat(signal.time, first) / counts, values)
        if len(thin.time) >= settings.fewest:
            signals[kind] = thin
    return LogClock(clock.instruments, signals, clock.forces)


def _on_grid(signal: Signal, grid: Array, step: float) -> Array:
    """Samples at the times of a grid, NaN in gaps, shape (n, k)."""
    columns = [np.interp(grid, signal.time, column) for column in signal.values.T]
    values = np.column_stack(columns)
    after = np.clip(np.searchsorted(signal.time, grid), 1, len(signal.time) - 1)
    gap = signal.time[after] - signal.time[after - 1] > 4 * max(signal.step, step)
    outside = (grid < signal.time[0]) | (grid > signal.time[-1])
    values[gap | outside] = np.nan
    return values


def _gains(readings: Array, regressors: Array, step: float, settings: SearchSettings) -> Array:
    """Log likelihood of every shift: lag of the regressors, shape (n', p), against the readings,
    shape (n, k), from ``-(n - 1)`` to ``n' - 1`` steps, shape (n + n' - 1,).
    """
    nothing = np.zeros(len(readings) + len(regressors) - 1)
    use = np.asarray(np.isfinite(readings).all(axis=1))
    use_by = np.asarray(np.isfinite(regressors).all(axis=1))
    fewer = min(use.sum(), use_by.sum())
    if fewer < settings.fewest:
        return nothing
    independent = fewer * step / settings.correlation_time
    most = max(1, int(settings.least_overlap * independent / settings.per_regressor))
    Y = _standardised(readings, use)
    X = _principal(regressors, use_by, most)
    if not Y.shape[1] or not X.shape[1]:
        return nothing
    count, variances = _residual_variances(Y, X, use, use_by)
    k, p = Y.shape[1], X.shape[1]
    freedom = np.maximum(count * step / settings.correlation_time, 1e-9)
    # What the coefficients have taken of the residuals is given back.
    left = np.maximum(freedom - p, 0.2 * freedom)
    variances = np.minimum(1.0, variances * freedom[:, None] / left[:, None])
    gains = -0.5 * freedom * np.log(np.maximum(variances, 1e-12)).mean(axis=1) * min(k, 3)
    gains[count < settings.least_overlap * fewer] = 0.0
    return np.asarray(gains)


def _residual_variances(
    Y: Array, X: Array, use: NDArray[np.bool_], use_by: NDArray[np.bool_]
) -> tuple[Array, Array]:
    """Overlap, shape (lags,), and residual variances in units of the readings' own, shape (lags,
    k), of regressions at all lags.

    Args:
        Y: Readings of variance 1, zero where there is none, shape (n, k).
        X: Regressors of variance 1, zero where there is none, shape (n', p).
        use: Where there are readings, shape (n,).
        use_by: Where there are regressors, shape (n',).
    """
    a, b = use.astype(np.float64)[:, None], use_by.astype(np.float64)[:, None]
    k, p = Y.shape[1], X.shape[1]

    def over(first: Array, second: Array) -> Array:
        """Sum of first[i] second[i + lag] for all lags, for columns side by side, shape (lags,
        k).
        """
        return convolved(second, first[::-1])

    count: Array = np.maximum(over(a, b)[:, 0], 0.0)
    some: Array = np.asarray(np.maximum(count, 1.0))[:, None]
    mean_y = over(Y, np.repeat(b, k, axis=1)) / some
    mean_x = over(np.repeat(a, p, axis=1), X) / some
    yy = over(Y**2, np.repeat(b, k, axis=1)) / some - mean_y**2
    i, j = np.triu_indices(p)
    products = over(np.repeat(a, len(i), axis=1), X[:, i] * X[:, j]) / some
    xx = np.empty((len(count), p, p))
    xx[:, i, j] = xx[:, j, i] = products - mean_x[:, i] * mean_x[:, j]
    xy = np.empty((len(count), p, k))
    for c in range(k):
        xy[:, :, c] = over(np.repeat(Y[:, [c]], p, axis=1), X) / some - mean_x * mean_y[:, [c]]
    # Parts in which nothing moves determine no coefficient.
    xx += 1e-3 * np.eye(p)
    fitted = np.einsum("npk,npk->nk", xy, np.linalg.solve(xx, xy))
    return count, np.clip(1 - fitted / np.maximum(yy, 1e-3), 1e-6, 1.0)


def _standardised(values: Array, use: NDArray[np.bool_]) -> Array:
    """Columns that vary about their means, of variance 1, zero where there is nothing, shape (n,
    k).
    """
    centred = np.zeros_like(values)
    centred[use] = values[use] - values[use].mean(axis=0)
    deviation = centred[use].std(axis=0)
    moving = deviation > 1e-9 * (np.abs(values[use]).max(axis=0) + _TINY)
    return np.asarray(centred[:, moving] / deviation[moving])


def _principal(values: Array, use: NDArray[np.bool_], most: int) -> Array:
    """Principal components of columns, of variance 1, zero where there is nothing, shape (n, q)."""
    scaled = _standardised(values, use)[use]
    if not scaled.shape[1]:
        return np.zeros((len(values), 0))
    _, sizes, directions = np.linalg.svd(scaled, full_matrices=False)
    kept = min(most, int(np.sum(sizes > 0.05 * sizes[0])))
    X = np.zeros((len(values), kept))
    X[use] = scaled @ directions[:kept].T * (np.sqrt(len(scaled)) / sizes[:kept])
    return X
