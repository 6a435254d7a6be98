"""Where the streams of two clocks may lie to each other: all shifts at once, by correlation.

At every shift the readings of one clock are regressed on what the other one tells; sums over the
part that overlaps are correlations, which fast Fourier transforms give for all shifts together.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import fftconvolve

from steelyard.arrays import Array
from steelyard.clocks.clock_signals import ClockSignals, LogClock, Signal
from steelyard.clocks.relations import relations

_STEP = 0.04
"""Of the grid on which shifts are looked for [s]."""
_MOST_STEPS = 100_000
"""Of the grid: of long recordings it is coarser."""
_LASTING = 0.2
"""Time after which a motion tells something new [s]."""
_PER_FEATURE = 3.0
"""Independent instants for each number that is fitted."""
_LEAST_OVERLAP = 0.4
"""Of the shorter recording; what overlaps less was not recorded together."""
_FEWEST = 10
"""Instants of a regression."""
_ALIKE = 0.7
"""Part of the largest gain that no shift at all must have to be looked at."""
_APART = 0.3
"""Of shifts that are different ones [s]."""


@dataclass(frozen=True)
class Candidate:
    """A shift between two clocks that would explain what they say."""

    shift: float
    """Time on the second clock less that on the first one at the same instant [s]."""
    gain: float
    """Log likelihood against clocks that have nothing to do with each other."""


def candidates(first: LogClock, second: LogClock, most: int) -> list[Candidate]:
    """The likeliest shifts between two clocks, best first.

    Args:
        first: A clock.
        second: Another one.
        most: How many at most, beside that of clocks that were set alike.
    """
    longest = max(c.span[1] - c.span[0] for c in (first, second))
    step = max(_STEP, longest / _MOST_STEPS)
    one, other = (_thinned(c, step) for c in (first, second))
    if not (one.signals and other.signals):
        return []
    all_signals = [ClockSignals(c, *_bounds(c)) for c in (one, other)]
    total: Array | None = None
    # Index 0 of each grid is the first bin; shifts are those of the second grid against the first
    # one.
    for of, by, sign in ((0, 1, 1), (1, 0, -1)):
        start_of, start_by = all_signals[of].start, all_signals[by].start
        for relation in relations(all_signals[of], all_signals[by]):
            n_of = round((all_signals[of].end - start_of) / step) + 1
            n_by = round((all_signals[by].end - start_by) / step) + 1
            t_of = np.asarray(start_of + np.arange(n_of) * step)
            t_by = np.asarray(start_by + np.arange(n_by) * step)
            gains = _gains(_on_grid(relation.samples, t_of, step), relation.explain(t_by), step)
            gains = gains if sign > 0 else gains[::-1]
            total = gains if total is None else total + gains
    if total is None:
        return []
    n_first = round((all_signals[0].end - all_signals[0].start) / step) + 1
    origin = all_signals[1].start - all_signals[0].start
    found: list[Candidate] = []

    def shift_at(place: int) -> float:
        return float(origin + (place - (n_first - 1)) * step)

    peaks = np.flatnonzero(
        (total > np.roll(total, 1)) & (total >= np.roll(total, -1)) & (total > 0)
    )
    for place in peaks[np.argsort(-total[peaks])]:
        shift = shift_at(int(place))
        if all(abs(shift - c.shift) > _APART for c in found):
            found.append(Candidate(shift, float(total[place])))
        if len(found) == most:
            break
    # Clocks that were set alike: where the search hardly knows better, that is what to begin with.
    alike = round((n_first - 1) - origin / step)
    if 0 <= alike < len(total) and found and total[alike] > _ALIKE * found[0].gain:
        found.append(Candidate(0.0, float(total[alike])))
    return found


def _bounds(clock: LogClock) -> tuple[float, float]:
    return min(s.time[0] for s in clock.signals.values()), max(
        s.time[-1] for s in clock.signals.values()
    )


def _thinned(clock: LogClock, step: float) -> LogClock:
    """Means over the bins of a grid."""
    start = _bounds(clock)[0]
    signals = {}
    for kind, signal in clock.signals.items():
        if signal.step > 0.7 * step:
            signals[kind] = signal
            continue
        bins = np.floor((signal.time - start) / step + 0.5).astype(np.int64)
        first = np.flatnonzero(np.diff(bins, prepend=bins[0] - 1))
        counts = np.diff(np.append(first, len(bins)))
        values = np.add.reduceat(signal.values, first, axis=0) / counts[:, None]
        signals[kind] = Signal(np.add.reduceat(signal.time, first) / counts, values)
    return LogClock(
        clock.instruments,
        {k: s for k, s in signals.items() if len(s.time) >= _FEWEST},
        clock.forces,
    )


def _on_grid(signal: Signal, grid: Array, step: float) -> Array:
    """Samples at the times of a grid, NaN in gaps, shape (n, k)."""
    values = np.column_stack(
        [np.interp(grid, signal.time, signal.values[:, i]) for i in range(signal.values.shape[1])]
    )
    after = np.clip(np.searchsorted(signal.time, grid), 1, len(signal.time) - 1)
    apart = signal.time[after] - signal.time[after - 1]
    outside = (
        (grid < signal.time[0])
        | (grid > signal.time[-1])
        | (apart > max(4 * signal.step, 4 * step))
    )
    values[outside] = np.nan
    return values


def _gains(readings: Array, explanation: Array, step: float) -> Array:
    """Log likelihood of every shift: lag of the explanation from ``-(n - 1)`` to ``n' - 1`` steps,
    shape (n + n' - 1,).
    """
    n, n_by = len(readings), len(explanation)
    use: NDArray[np.bool_] = np.asarray(np.isfinite(readings).all(axis=1))
    use_by: NDArray[np.bool_] = np.asarray(np.isfinite(explanation).all(axis=1))
    nothing = np.zeros(n + n_by - 1)
    if use.sum() < _FEWEST or use_by.sum() < _FEWEST:
        return nothing
    Y = np.zeros_like(readings)
    Y[use] = readings[use] - readings[use].mean(axis=0)
    deviation = Y[use].std(axis=0)
    moving = deviation > 1e-9 * (np.abs(readings[use]).max(axis=0) + 1e-300)
    Y = Y[:, moving] / deviation[moving]
    independent = min(use.sum(), use_by.sum()) * step / _LASTING
    X = _leading(explanation, use_by, max(1, int(_LEAST_OVERLAP * independent / _PER_FEATURE)))
    if not Y.shape[1] or not X.shape[1]:
        return nothing
    a, b = use.astype(np.float64), use_by.astype(np.float64)

    def over(first: Array, second: Array) -> Array:
        """Sum of first[i] second[i + lag] for all lags, for columns side by side, shape (lags,
        k).
        """
        found: Array = fftconvolve(second, first[::-1], axes=0)
        return found

    count: Array = np.maximum(over(a[:, None], b[:, None])[:, 0], 0.0)
    k, p = Y.shape[1], X.shape[1]
    some: Array = np.asarray(np.maximum(count, 1.0))
    mean_y, mean_x = (
        over(Y, np.repeat(b[:, None], k, axis=1)) / some[:, None],
        over(np.repeat(a[:, None], p, axis=1), X) / some[:, None],
    )
    yy = over(Y**2, np.repeat(b[:, None], k, axis=1)) / some[:, None] - mean_y**2
    i, j = np.triu_indices(p)
    xx_flat = (
        over(np.repeat(a[:, None], len(i), axis=1), X[:, i] * X[:, j]) / some[:, None]
        - mean_x[:, i] * mean_x[:, j]
    )
    xx = np.empty((len(count), p, p))
    xx[:, i, j] = xx[:, j, i] = xx_flat
    xy = np.stack(
        [
            over(np.repeat(Y[:, [c]], p, axis=1), X) / some[:, None] - mean_x * mean_y[:, [c]]
            for c in range(k)
        ],
        axis=2,
    )
    # Parts in which nothing moves explain nothing.
    xx += 1e-3 * np.eye(p)
    explained = np.einsum("npk,npk->nk", xy, np.linalg.solve(xx, xy))
    left = np.clip(1 - explained / np.maximum(yy, 1e-3), 1e-6, 1.0)
    freedom = count * step / _LASTING
    freedom = np.maximum(freedom, 1e-9)
    left = np.minimum(
        1.0, left * freedom[:, None] / np.maximum(freedom - p, 0.2 * freedom)[:, None]
    )
    gains = -0.5 * freedom * np.log(np.maximum(left, 1e-12)).mean(axis=1) * min(k, 3)
    gains[count < _LEAST_OVERLAP * min(use.sum(), use_by.sum())] = 0.0
    return np.asarray(gains)


def _leading(explanation: Array, use: NDArray[np.bool_], most: int) -> Array:
    """Leading directions of what varies, each of variance 1, zero where there is nothing, shape (n,
    q).
    """
    raw = explanation[use] - explanation[use].mean(axis=0)
    deviation = raw.std(axis=0)
    moving = deviation > 1e-9 * (np.abs(explanation[use]).max(axis=0) + 1e-300)
    if not moving.any():
        return np.zeros((len(explanation), 0))
    scaled = raw[:, moving] / deviation[moving]
    _, sizes, directions = np.linalg.svd(scaled, full_matrices=False)
    kept = min(most, int(np.sum(sizes > 0.05 * sizes[0])))
    X = np.zeros((len(explanation), kept))
    X[use] = scaled @ directions[:kept].T * (np.sqrt(len(scaled)) / sizes[:kept])
    return X
