"""The shift between two clocks to a fraction of a sample, with what it is uncertain by."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.optimize import minimize_scalar

from steelyard.arrays import Array
from steelyard.clocks.clock_signals import Clock, ClockSignals
from steelyard.clocks.relations import Relation, relations

_BLOCK = 0.5
"""Residuals further apart have nothing to do with each other [s]."""
REACH = 0.3
"""Beside the first guess [s]."""
_GRID = 41
_LEAST_FREE = 0.25
"""Part of the blocks that are free at least, however many coefficients are fitted."""
_LASTING = 0.1
"""Time after which a motion tells something new [s]."""
_PER_COEFFICIENT = 3.0
_ROUNDING = 1e-7
"""Of readings in units of how far they vary."""
_STEP = 1e-3
"""Of differences [s]."""


@dataclass(frozen=True)
class Shift:
    """Time on a second clock less that on a first one at the same instant."""

    value: float
    """[s]"""
    sigma: float
    """1-sigma as the residuals show it [s]."""
    cost: float
    """Mean logarithm of the variance that is left; less is better."""


class ShiftTerm(Protocol):
    """Readings of one clock, explained by another one at any shift."""

    @property
    def time(self) -> Array:
        """Of the readings [s], shape (n,)."""
        ...

    @property
    def coefficients(self) -> float:
        """Numbers that are fitted along, for each channel."""
        ...

    def residual(self, shift: float) -> Array:
        """What is not explained, in any unit, shape (n, k); NaN where a reading meets nothing that
        could explain it.
        """
        ...


def refined(
    first: Clock, second: Clock, guess: float, *, around: tuple[float, float], reach: float = REACH
) -> Shift | None:
    """Improve a first guess; None where too little overlaps.

    Args:
        first: A clock.
        second: Another one.
        guess: Of the shift [s].
        around: Interval of the first clock to look at [s].
        reach: How far from the guess to look [s].
    """
    start, end = around
    one = ClockSignals(first, start, end)
    other = ClockSignals(second, start + guess - 2 * reach, end + guess + 2 * reach)
    found = [(r, 1) for r in relations(one, other)] + [(r, -1) for r in relations(other, one)]
    if any(r.exact for r, _ in found):
        found = [(r, sign) for r, sign in found if r.exact]
    terms = [_Regression(relation, sign, guess, reach) for relation, sign in found]
    return least([term for term in terms if term.enough], guess, reach)


def least(terms: Sequence[ShiftTerm], guess: float, reach: float) -> Shift | None:
    """The shift that leaves least unexplained; None where there is nothing to explain.

    Args:
        terms: Readings to explain, of the first clock or of the second one.
        guess: About which to look [s].
        reach: How far from it to look [s].
    """
    if not terms:
        return None

    def cost(shift: float) -> float:
        return float(np.mean([np.mean(_log_variance(term.residual(shift))) for term in terms]))

    shifts = guess + np.linspace(-reach, reach, _GRID)
    costs = [cost(float(s)) for s in shifts]
    lowest = int(np.argmin(costs))
    low, high = shifts[max(lowest - 1, 0)], shifts[min(lowest + 1, _GRID - 1)]
    best = float(
        minimize_scalar(cost, bounds=(low, high), method="bounded", options={"xatol": 1e-6}).x
    )
    return Shift(best, _deviation(terms, best), cost(best))


def _log_variance(residual: Array) -> Array:
    return np.asarray(np.log(np.nanmean(residual**2, axis=0) + 1e-300))


class _Regression:
    """One relation as a regression at any shift."""

    time: Array
    coefficients: float

    def __init__(self, relation: Relation, sign: int, guess: float, reach: float) -> None:
        self.relation, self.sign = relation, sign
        time, values = relation.samples.time, relation.samples.values
        beside = relation.beside(time) if len(time) else np.zeros((0, 0))
        use = np.asarray(np.isfinite(values).all(axis=1) & np.isfinite(beside).all(axis=1))
        # The same samples at every shift, or costs could not be compared.
        for shift in (guess - reach - _STEP, guess, guess + reach + _STEP):
            if use.any():
                use[use] = np.isfinite(relation.explain(time[use] + sign * shift)).all(axis=1)
        lasting = float(np.ptp(time[use])) if use.any() else 0.0
        if beside.shape[1] * _LASTING > lasting / _PER_COEFFICIENT:
            # So short a motion would be explained by lever arms alone.
            beside = beside[:, :0]
        self.time, self.values, self.beside = time[use], values[use], beside[use]
        deviation = self.values.std(axis=0) if use.any() else np.zeros(values.shape[1])
        moving = deviation > 1e-9 * (np.abs(self.values).max(axis=0, initial=0.0) + 1e-300)
        self.values = self.values[:, moving] / np.maximum(deviation[moving], 1e-300)
        self.coefficients = (
            (1 + beside.shape[1] + relation.explain(self.time[:1] + sign * guess).shape[1])
            if use.any()
            else 0
        )
        self.enough = bool(moving.any()) and len(self.time) > 2 * self.coefficients

    def residual(self, shift: float) -> Array:
        """What is not explained, shape (n, k)."""
        X = np.hstack(
            [
                np.ones((len(self.time), 1)),
                self.beside,
                self.relation.explain(self.time + self.sign * shift),
            ]
        )
        # At some shifts a reading may meet a gap.
        whole = np.isfinite(X).all(axis=1)
        X = X[whole]
        X[:, 1:] -= X[:, 1:].mean(axis=0)
        X /= np.maximum(np.linalg.norm(X, axis=0), 1e-300)
        left = np.full(self.values.shape, np.nan)
        left[whole] = self.values[whole] - X @ np.linalg.lstsq(X, self.values[whole], rcond=1e-8)[0]
        # Noise-free readings are explained to rounding; that is not worth more than a seventh
        # digit.
        return np.asarray(np.sqrt(left**2 + _ROUNDING**2) * np.sign(left + (left == 0)))


def _deviation(terms: Sequence[ShiftTerm], shift: float) -> float:
    """1-sigma [s] from how much stretches of the recording contradict each other."""
    curvature, scores = 0.0, []
    for term in terms:
        residual = term.residual(shift)
        slope = (term.residual(shift + _STEP) - term.residual(shift - _STEP)) / (2 * _STEP)
        weight = 1 / (np.nanmean(residual**2, axis=0) + 1e-300)
        curvature += float(np.nansum(slope**2 * weight))
        blocks = np.floor((term.time - term.time[0]) / _BLOCK).astype(np.int64)
        scores.append(np.bincount(blocks, np.nansum(slope * residual * weight, axis=1)))
    if curvature <= 0:
        return np.inf
    # Relations of the same instants err together. What is fitted along has taken its part of every
    # residual.
    count = max(len(s) for s in scores)
    together = np.sum([np.pad(s, (0, count - len(s))) for s in scores], axis=0)
    free = max(count - min(term.coefficients for term in terms), _LEAST_FREE * count)
    return float(np.sqrt(np.sum(together**2) * count / free) / curvature)
