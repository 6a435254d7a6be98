"""How often a verdict rejects: each mistake (its power), and sound experiments (its size)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from steelyard.arrays import Array
from steelyard.campaigns.rows import DONE, REFUSED
from steelyard.campaigns.study.summary import squared_error
from steelyard.estimates.estimate import BEST_FIRST
from steelyard.estimates.quantiles import chi2_tail, normal_quantile
from steelyard.inertia import BODY_PARAMETERS

if TYPE_CHECKING:
    import polars as pl

SOUND = ""
"""In place of a mistake: nothing was wrong."""
LEVEL = 0.95
"""Of the intervals of probabilities."""
WRONG = 1e-3
"""Probability of errors as large, by the stated covariance, below which an accepted estimate is
called wrong."""


@dataclass(frozen=True)
class Rejections:
    """How one method judges one mistake, over n draws."""

    method: str
    mistake: str
    """Name of it, or :data:`SOUND`."""
    count: int
    rejected: int
    """With those that were refused before anything was estimated."""
    wrong: int
    """Accepted, though the errors contradict the stated covariance (:data:`WRONG`)."""

    @property
    def interval(self) -> tuple[float, float]:
        """Of the probability of a rejection."""
        return wilson_interval(self.rejected, self.count)

    def to_dict(self) -> dict[str, Any]:
        """Plain values."""
        return {
            "method": self.method,
            "mistake": self.mistake or None,
            "count": self.count,
            "rejected": self.rejected,
            "interval": list(self.interval),
            "accepted_and_wrong": self.wrong,
        }


def wilson_interval(hits: int, count: int, level: float = LEVEL) -> tuple[float, float]:
    """Interval of a probability from how often something has happened, Eq. (1) in [Wilson1927]_;
    from 0 to 1 where nothing was counted.

    Args:
        hits: How often it has.
        count: How often it could.
        level: Of the interval.
    """
    if not count:
        return 0.0, 1.0
    z = float(normal_quantile((1 + level) / 2))
    middle = hits + z**2 / 2
    half = z * np.sqrt(hits * (count - hits) / count + z**2 / 4)
    low, high = (middle - half) / (count + z**2), (middle + half) / (count + z**2)
    return max(0.0, float(low)), min(1.0, float(high))


def rejections(
    table: pl.DataFrame, truth: Array, mistakes: Sequence[str]
) -> tuple[Rejections, ...]:
    """Of every method, the best first: sound experiments, then each mistake.

    Args:
        table: Rows of all draws; the name of one with a mistake is that of :func:`mistaken`.
        truth: The ten that were simulated, shape (10,).
        mistakes: Names of those that were made.
    """
    found = set(table["method"])
    methods = [method for method in BEST_FIRST if method in found]
    return tuple(_counted(table, truth, methods, (SOUND, *mistakes)))


def mistaken(draw: str, mistake: str) -> str:
    """Name of a draw with a mistake in it."""
    return f"{draw}/{mistake}" if mistake else draw


def _counted(
    table: pl.DataFrame, truth: Array, methods: Sequence[str], mistakes: Sequence[str]
) -> Iterator[Rejections]:
    """Of every method and mistake; what is refused before an estimate is so for all methods."""
    by_mistake: dict[str, list[dict[str, Any]]] = {name: [] for name in mistakes}
    for row in table.iter_rows(named=True):
        mistake = row["experiment"].partition("/")[2]
        if mistake in by_mistake:
            by_mistake[mistake].append(row)
    for method in methods:
        for mistake, rows in by_mistake.items():
            refused = sum(row["status"] == REFUSED for row in rows)
            own = [row for row in rows if row["status"] == DONE and row["method"] == method]
            rejected = sum(row["accepted"] is False for row in own)
            wrong = sum(row["accepted"] is True and is_wrong(row, truth) for row in own)
            yield Rejections(method, mistake, len(own) + refused, rejected + refused, wrong)


def is_wrong(row: Mapping[str, Any], truth: Array) -> bool:
    """Whether the errors of an estimate contradict its stated covariance; parameters without a
    number claim nothing.
    """
    value = np.array([row[name] for name in BODY_PARAMETERS], dtype=np.float64)
    squared, known = squared_error(value - truth, row["covariance"])
    return known > 0 and bool(chi2_tail(squared, known) < WRONG)
