"""The shift between two clocks to a fraction of a sample, with what it is uncertain by."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.optimize import minimize_scalar

from steelyard.arrays import Array
from steelyard.clocks.clock_signals import ClockSignals, LogClock
from steelyard.clocks.relations import Relation, relations
from steelyard.clocks.settings import SHIFT, ShiftSettings


@dataclass(frozen=True)
class Shift:
    """Time on a second clock less that on a first one at the same instant."""

    value: float
    """[s]"""
    sigma: float
    """1-sigma as the residuals show it [s]."""
    cost: float
    """Mean logarithm of the residual variance; less is better."""


class ShiftTerm(Protocol):
    """Readings of one clock that are regressed on those of another one at any shift."""

    @property
    def time(self) -> Array:
        """Of the readings [s], shape (n,)."""
        ...

    @property
    def coefficients(self) -> float:
        """Of the regression, for each channel."""
        ...

    def residual(self, shift: float) -> Array:
        """Residuals in any unit, shape (n, k); NaN where a reading meets no regressor."""
        ...


def refined(
    first: LogClock,
    second: LogClock,
    guess: float,
    *,
    around: tuple[float, float],
    reach: float | None = None,
    settings: ShiftSettings = SHIFT,
) -> Shift | None:
    """Improve a first guess; None where too little overlaps.

    Args:
        first: A clock.
        second: Another one.
        guess: Of the shift [s].
        around: Interval of the first clock to look at [s].
        reach: How far from the guess to look [s]; None: as the settings say.
        settings: Levels of the refinement.
    """
    reach = settings.reach if reach is None else reach
    start, end = around
    one = ClockSignals(first, start, end, settings.smoothing)
    other = ClockSignals(
        second, start + guess - 2 * reach, end + guess + 2 * reach, settings.smoothing
    )
    found = [(r, 1) for r in relations(one, other)] + [(r, -1) for r in relations(other, one)]
    if any(r.linear for r, _ in found):
        found = [(r, sign) for r, sign in found if r.linear]
    terms = [_Regression(relation, sign, guess, reach, settings) for relation, sign in found]
    return least([term for term in terms if term.enough], guess, reach, settings)


def least(
    terms: Sequence[ShiftTerm], guess: float, reach: float, settings: ShiftSettings = SHIFT
) -> Shift | None:
    """The shift of least residuals; None where there are none.

    Args:
        terms: Regressions of the readings of the first clock or of the second one.
        guess: About which to look [s].
        reach: How far from it to look [s].
        settings: Levels of the refinement.
    """
    if not terms:
        return None

    def cost(shift: float) -> float:
        variances = (np.nanmean(term.residual(shift) ** 2, axis=0) for term in terms)
        return float(np.mean([np.mean(np.log(each + 1e-300)) for each in variances]))

    shifts = guess + np.linspace(-reach, reach, settings.grid)
    costs = [cost(float(s)) for s in shifts]
    lowest = int(np.argmin(costs))
    low, high = shifts[max(lowest - 1, 0)], shifts[min(lowest + 1, settings.grid - 1)]
    best = float(
        minimize_scalar(cost, bounds=(low, high), method="bounded", options={"xatol": 1e-6}).x
    )
    return Shift(best, _deviation(terms, best, settings), cost(best))


class _Regression:
    """One relation as a regression at any shift."""

    time: Array
    coefficients: float

    def __init__(
        self, relation: Relation, sign: int, guess: float, reach: float, settings: ShiftSettings
    ) -> None:
        self.relation, self.sign, self.settings = relation, sign, settings
        time, values = relation.response.time, relation.response.values
        own = relation.own(time) if len(time) else np.zeros((0, 0))
        use = np.asarray(np.isfinite(values).all(axis=1) & np.isfinite(own).all(axis=1))
        # The same samples at every shift, or costs could not be compared.
        farthest = reach + settings.difference
        for shift in (guess - farthest, guess, guess + farthest):
            if use.any():
                use[use] = np.isfinite(relation.other(time[use] + sign * shift)).all(axis=1)
        self.time, self.coefficients, self.enough = time[use], 0, False
        if not use.any():
            return
        duration = float(np.ptp(time[use]))
        if own.shape[1] * settings.correlation_time > duration / settings.per_coefficient:
            # Lever arms alone would fit the readings of so short a motion.
            own = own[:, :0]
        self.own, values = own[use], values[use]
        deviation = values.std(axis=0)
        moving = deviation > 1e-9 * (np.abs(values).max(axis=0) + 1e-300)
        self.values = values[:, moving] / np.maximum(deviation[moving], 1e-300)
        others = relation.other(self.time[:1] + sign * guess).shape[1]
        self.coefficients = 1 + own.shape[1] + others
        self.enough = bool(moving.any()) and len(self.time) > 2 * self.coefficients

    def residual(self, shift: float) -> Array:
        """Residuals in units of how far the readings vary, shape (n, k)."""
        other = self.relation.other(self.time + self.sign * shift)
        X = np.hstack([np.ones((len(self.time), 1)), self.own, other])
        # At some shifts a reading may meet a gap.
        whole = np.isfinite(X).all(axis=1)
        X = X[whole]
        X[:, 1:] -= X[:, 1:].mean(axis=0)
        X /= np.maximum(np.linalg.norm(X, axis=0), 1e-300)
        values = self.values[whole]
        left = np.full(self.values.shape, np.nan)
        left[whole] = values - X @ np.linalg.lstsq(X, values, rcond=1e-8)[0]
        signs = np.sign(left + (left == 0))
        return np.asarray(np.sqrt(left**2 + self.settings.rounding**2) * signs)


def _deviation(terms: Sequence[ShiftTerm], shift: float, settings: ShiftSettings) -> float:
    """1-sigma [s] from how much blocks of the recording contradict each other."""
    step = settings.difference
    curvature, scores = 0.0, []
    for term in terms:
        residual = term.residual(shift)
        slope = (term.residual(shift + step) - term.residual(shift - step)) / (2 * step)
        weight = 1 / (np.nanmean(residual**2, axis=0) + 1e-300)
        curvature += float(np.nansum(slope**2 * weight))
        blocks = np.floor((term.time - term.time[0]) / settings.block).astype(np.int64)
        scores.append(np.bincount(blocks, np.nansum(slope * residual * weight, axis=1)))
    if curvature <= 0:
        return np.inf
    # Relations of the same instants err together. The coefficients have taken their part of every
    # residual.
    count = max(len(s) for s in scores)
    together = np.sum([np.pad(s, (0, count - len(s))) for s in scores], axis=0)
    coefficients = min(term.coefficients for term in terms)
    free = max(count - coefficients, settings.least_free * count)
    return float(np.sqrt(np.sum(together**2) * count / free) / curvature)
