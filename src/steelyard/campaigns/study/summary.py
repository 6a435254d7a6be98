"""What the draws of a study say of each method: errors, coverage, chi-square, verdicts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from steelyard.arrays import Array
from steelyard.campaigns.rows import DONE
from steelyard.campaigns.study.draw import BOUND
from steelyard.estimates.estimate import BEST_FIRST, plain
from steelyard.estimates.quantiles import chi2_below, chi2_tail, normal_quantile
from steelyard.inertia import BODY_PARAMETERS

if TYPE_CHECKING:
    import polars as pl

LEVEL = 0.95
"""Of the intervals whose coverage is counted."""
UNLIKELY = 1e-3
"""Probability, over all ten parameters of a method, below which a scatter is not that of the stated
1-sigma."""


@dataclass(frozen=True, eq=False)
class MethodSummary:
    """One method over n draws; arrays have shape (10,), NaN where there are no numbers."""

    method: str
    count: int
    """Estimates."""
    accepted: int
    rejected: int
    known: Array
    """How many of the estimates have a number."""
    bias: Array
    """Mean error, SI."""
    rmse: Array
    """Root mean square of the errors, SI."""
    stated: Array
    """Root mean square of the stated 1-sigma, SI."""
    bound: Array
    """Root mean square of the Cramer-Rao bound of the same draws, SI."""
    coverage: Array
    """Part of the intervals of :data:`LEVEL` that contain the truth."""
    chi_square: Array
    """Mean of the squared errors over their stated variances; 1 where these are true."""
    joint: float
    """Mean of the squared errors of all ten over their covariance; 10 where that is true."""
    joint_count: int
    """Estimates with all ten numbers."""

    def p_value(self, parameter: int) -> tuple[float, float]:
        """Probability of a chi-square as large, and of one as small, if the 1-sigma is true."""
        n = float(self.known[parameter])
        if not n:
            return float("nan"), float("nan")
        total = self.chi_square[parameter] * n
        return float(chi2_tail(total, n)), float(chi2_below(total, n))

    def outcome(self, parameter: int) -> str:
        """Whether the draws contradict the stated 1-sigma, in words; few draws contradict
        little.
        """
        above, below = self.p_value(parameter)
        level = UNLIKELY / len(BODY_PARAMETERS)
        if np.isnan(above):
            return "-"
        return "too small" if above < level else "too large" if below < level else "consistent"

    def to_dict(self) -> dict[str, Any]:
        """Plain values."""
        return {
            "count": self.count,
            "accepted": self.accepted,
            "rejected": self.rejected,
            "joint_chi_square": plain(self.joint),
            "joint_count": self.joint_count,
            "parameters": {
                name: {
                    "count": int(self.known[p]),
                    "bias": plain(self.bias[p]),
                    "rmse": plain(self.rmse[p]),
                    "stated": plain(self.stated[p]),
                    "bound": plain(self.bound[p]),
                    "coverage": plain(self.coverage[p]),
                    "chi_square": plain(self.chi_square[p]),
                }
                for p, name in enumerate(BODY_PARAMETERS)
            },
        }


def summaries(table: pl.DataFrame, truth: Mapping[str, Array]) -> dict[str, MethodSummary]:
    """Method -> what its estimates say, the best method first.

    Args:
        table: Rows of the draws.
        truth: Method -> what the draws are about: the true ten of a simulation, shape (10,).
    """
    import polars as pl

    done = table.filter((pl.col("status") == DONE) & (pl.col("method") != ""))
    bounds = done.filter(pl.col("method") == BOUND)
    bound = _rms(_numbers(bounds, "sigma_")) if len(bounds) else np.full(10, np.nan)
    there = set(done["method"])
    return {
        method: _summary(method, done.filter(pl.col("method") == method), truth[method], bound)
        for method in BEST_FIRST
        if method in there and method in truth
    }


def _summary(method: str, rows: pl.DataFrame, truth: Array, bound: Array) -> MethodSummary:
    """Of the rows of one method."""
    error = _numbers(rows, "") - truth
    sigma = _numbers(rows, "sigma_")
    known = np.isfinite(error) & np.isfinite(sigma) & (sigma > 0)
    error, sigma = np.where(known, error, np.nan), np.where(known, sigma, np.nan)
    z = error / sigma
    half = float(normal_quantile((1 + LEVEL) / 2))
    count = known.sum(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        inside = np.nansum(np.abs(z) < half, axis=0) / count
        bias = np.nansum(error, axis=0) / count
    joint = _joint(rows, error)
    accepted = rows["accepted"]
    return MethodSummary(
        method,
        len(rows),
        int(accepted.fill_null(False).sum()),
        int((~accepted.fill_null(True)).sum()),
        count.astype(float),
        bias,
        _rms(error),
        _rms(sigma),
        bound,
        inside,
        _rms(z) ** 2,
        float(np.mean(joint)) if len(joint) else float("nan"),
        len(joint),
    )


def _joint(rows: pl.DataFrame, error: Array) -> Array:
    """Squared errors of all ten over their covariance, of the estimates that have all."""
    pairs = zip(error, rows["covariance"].to_list(), strict=True)
    found = [squared_error(own, covariance) for own, covariance in pairs]
    return np.array([squared for squared, known in found if known == len(BODY_PARAMETERS)])


def squared_error(error: Array, covariance: Sequence[float | None] | None) -> tuple[float, int]:
    """Squared errors over their covariance, of the parameters that have a number, and how many
    these are.

    Args:
        error: NaN where there is no number, shape (10,).
        covariance: Row by row, as in the table; None: there is none.
    """
    if covariance is None:
        return 0.0, 0
    C = np.array(covariance, dtype=np.float64).reshape(10, 10)
    known = np.isfinite(error) & (np.diag(C) > 0)
    C = C[np.ix_(known, known)]
    if not np.isfinite(C).all():
        return 0.0, 0
    # Scaled: kilograms and metres are far apart.
    scale = np.sqrt(np.diag(C))
    z = error[known] / scale
    return float(z @ np.linalg.pinv(C / np.outer(scale, scale)) @ z), int(known.sum())


def _numbers(table: pl.DataFrame, prefix: str) -> Array:
    """The ten columns of a prefix, NaN where there is no number, shape (n, 10)."""
    import polars as pl

    names = [f"{prefix}{name}" for name in BODY_PARAMETERS]
    return np.asarray(table.select(pl.col(names).fill_null(float("nan"))).to_numpy())


def _rms(values: Array) -> Array:
    """Root mean square of the numbers of each column; NaN where there is none."""
    count = np.isfinite(values).sum(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.sqrt(np.nansum(values**2, axis=0) / count))
