"""Control charts of a series of estimates, parameter by parameter."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from steelyard.arrays import Array
from steelyard.campaigns.charts.run_length import decision_interval
from steelyard.campaigns.charts.settings import CHARTS, ChartSettings
from steelyard.estimates.quantiles import chi2_below, chi2_tail
from steelyard.inertia import BODY_PARAMETERS


@dataclass(frozen=True)
class Alarm:
    """A change of a parameter that a chart has seen."""

    parameter: int
    """Place in :data:`steelyard.inertia.BODY_PARAMETERS`."""
    at: int
    """Recording that gave the alarm."""
    since: int
    """First recording that is different, as far as the chart tells."""
    change: float
    """Mean from then to the next change (or the end) less the mean before it, SI."""
    sigma: float
    """Its 1-sigma, from the stated ones."""


@dataclass(frozen=True, eq=False)
class ParameterChart:
    """One parameter over n recordings."""

    z: Array
    """Each recording against the mean of those before it since the last change, in units of the
    1-sigma of that difference; NaN of the first one, of those between a change and its alarm, and
    where there is no number, shape (n,)."""
    mean: Array
    """Weighted mean of those before it, shape (n,)."""
    sums: Array
    """Larger of the upwards and downwards sum after each recording in parts of the decision
    interval, chart by chart, shape (charts, n)."""
    alarms: tuple[Alarm, ...]

    @property
    def count(self) -> int:
        """Of differences."""
        return int(np.isfinite(self.z).sum())

    @property
    def chi_square(self) -> float:
        """Sum of squares of the differences: chi-square with :attr:`count` degrees of freedom where
        the stated sigma is true.
        """
        return float(np.nansum(self.z**2))

    @property
    def ratio(self) -> float:
        """Scatter between recordings over the stated 1-sigma; NaN where there is no difference."""
        return float(np.sqrt(self.chi_square / self.count)) if self.count else float("nan")

    @property
    def p_values(self) -> tuple[float, float]:
        """Probability of a scatter as large, and of one as small, if the stated sigma is true."""
        if not self.count:
            return float("nan"), float("nan")
        found = self.chi_square, self.count
        return float(chi2_tail(*found)), float(chi2_below(*found))


def intervals(settings: ChartSettings = CHARTS) -> tuple[float, ...]:
    """Decision interval of each chart [sigmas]: alarms of all parameters, both directions and all
    charts together are as seldom as the settings say.
    """
    charts = 2 * len(BODY_PARAMETERS) * len(settings.allowances)
    length = charts * settings.recordings_per_alarm
    return tuple(decision_interval(k, length) for k in settings.allowances)


def parameter_chart(
    values: Array, sigmas: Array, parameter: int = 0, settings: ChartSettings = CHARTS
) -> ParameterChart:
    """The charts of one parameter: self-starting CUSUM [Hawkins1987]_ with known sigmas.

    Each recording is compared with the weighted mean of all before it. With independent estimates
    of true sigmas these differences, over their own 1-sigma, are independent normal numbers of unit
    variance from the second recording on: the uncertainty of the reference is part of them, and
    no recording has to be set aside for it. After an alarm the reference begins anew with the
    first recording that is different.

    Args:
        values: NaN where there is none, shape (n,).
        sigmas: 1-sigma of each, shape (n,).
        parameter: Which of the ten.
        settings: Levels.
    """
    h = np.array(intervals(settings))
    k = np.array(settings.allowances)
    n = len(values)
    z, mean = np.full(n, np.nan), np.full(n, np.nan)
    sums = np.zeros((len(k), n))
    seen: list[tuple[int, int]] = []
    reference = _Reference()
    up, down = np.zeros(len(k)), np.zeros(len(k))
    # First recording of the present excursion of each sum.
    began = np.zeros((2, len(k)), dtype=int)
    for i in range(n):
        if not (np.isfinite(values[i]) and np.isfinite(sigmas[i]) and sigmas[i] > 0):
            sums[:, i] = sums[:, i - 1] if i else 0.0
            continue
        if reference.weight:
            mean[i] = reference.mean
            z[i] = (values[i] - mean[i]) / np.hypot(sigmas[i], reference.sigma)
            for side, (total, sign) in enumerate(((up, 1.0), (down, -1.0))):
                began[side] = np.where(total == 0, i, began[side])
                total[:] = np.maximum(0.0, total + sign * z[i] - k)
            sums[:, i] = np.maximum(up, down) / h
        reference.add(values[i], sigmas[i])
        over = np.array([up, down]) / h
        if over.max() > 1:
            since = int(began.flat[over.argmax()])
            reference = _Reference.of(values[since : i + 1], sigmas[since : i + 1])
            seen.append((i, since))
            # A change is no scatter.
            z[since : i + 1] = np.nan
            up[:], down[:] = 0.0, 0.0
    return ParameterChart(z, mean, sums, tuple(_alarms(seen, values, sigmas, parameter)))


def _alarms(
    seen: list[tuple[int, int]], values: Array, sigmas: Array, parameter: int
) -> Iterator[Alarm]:
    """Changes between the stretches in which nothing changed.

    Args:
        seen: Recording of each alarm, and since when it is different.
        values: Shape (n,).
        sigmas: Shape (n,).
        parameter: Which of the ten.
    """
    bounds = [0, *(since for _, since in seen), len(values)]
    means = [_Reference.of(values[a:b], sigmas[a:b]) for a, b in pairwise(bounds)]
    for (at, since), (before, after) in zip(seen, pairwise(means), strict=True):
        change = after.mean - before.mean
        yield Alarm(parameter, at, since, change, float(np.hypot(after.sigma, before.sigma)))


@dataclass
class _Reference:
    """Weighted mean of recordings."""

    weight: float = 0.0
    total: float = 0.0

    @classmethod
    def of(cls, values: Array, sigmas: Array) -> _Reference:
        """Of all that have a number."""
        found = cls()
        for value, sigma in zip(values, sigmas, strict=True):
            if np.isfinite(value) and np.isfinite(sigma) and sigma > 0:
                found.add(value, sigma)
        return found

    def add(self, value: float, sigma: float) -> None:
        self.weight += sigma**-2
        self.total += value * sigma**-2

    @property
    def mean(self) -> float:
        return self.total / self.weight

    @property
    def sigma(self) -> float:
        return float(self.weight**-0.5)
