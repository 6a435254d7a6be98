"""Whether differences of estimates are within their uncertainty: a chi-square test."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from steelyard.arrays import Array
from steelyard.estimates.comparison_settings import SETTINGS, ComparisonSettings
from steelyard.estimates.estimate import plain
from steelyard.inertia import BODY_PARAMETERS

_UNDERFLOW = 1e-290
"""Chance below which its logarithm is computed directly: double precision ends at 1e-308."""


@dataclass(frozen=True, eq=False)
class ChiSquareTest:
    """Whether differences are within their uncertainty as a whole."""

    chi_square: float
    """Infinite where numbers that are given as exact differ."""
    freedom: int
    """Independent differences that were compared."""
    p_value: float
    """Chance of such differences or larger ones where nothing but the stated uncertainty is behind
    them; NaN: nothing was compared."""
    sigmas: float
    """The same as sigmas of one normal difference of either sign."""
    parameters: tuple[str, ...]
    """Body parameters that all know."""
    contradicted: tuple[str, ...] = ()
    """Those that are exact in both of two estimates, yet differ."""
    dropped: int = 0
    """Combinations of parameters without any stated uncertainty, which were left out."""
    settings: ComparisonSettings = SETTINGS
    """Levels of its words."""

    def __str__(self) -> str:
        """The outcome in words, with its numbers."""
        if np.isnan(self.p_value):
            return "no parameter is known to all of them, so that nothing can be compared"
        if self.contradicted:
            return (
                f"disagree: {', '.join(self.contradicted)} given as exact by both, but with"
                " different values"
            )
        if not self.freedom:
            return f"{self.outcome}: the same exact values"
        least = self.settings.least_p
        p_value = f"p = {self.p_value:.2g}" if self.p_value > least else f"p < {least:g}"
        text = f"{self.outcome}: chi-square {self.chi_square:.1f} on {self.freedom}, {p_value}"
        if self.sigmas > self.settings.usual:
            text += f", as rare as {self.sigmas:.1f} sigmas"
        if len(self.parameters) < len(BODY_PARAMETERS):
            text += f" ({', '.join(self.parameters)})"
        return text

    @property
    def outcome(self) -> str:
        """Whether they agree, in words without numbers."""
        if self.sigmas <= self.settings.usual:
            return "agree within their uncertainty"
        if self.sigmas <= self.settings.significant:
            return "differ more than is usual"
        return "disagree"

    def to_dict(self) -> dict[str, Any]:
        """Plain values; an infinite chi-square is None with a p-value of 0."""
        names = [name for name in self.__dataclass_fields__ if name != "settings"]
        return {name: plain(getattr(self, name)) for name in names}


def agreement(
    values: Sequence[Array],
    covariances: Sequence[Array],
    *,
    difference: Array | None = None,
    settings: ComparisonSettings = SETTINGS,
) -> ChiSquareTest:
    r"""Chi-square of the differences of estimates over the parameters that all know.

    With :math:`d` the differences from the first, stacked, and :math:`\Sigma` their covariance it
    is
    :math:`d^T \Sigma^+ d`. For independent estimates that is Cochran's :math:`\sum (x_i - \bar x)^T
    C_i^{-1} (x_i - \bar x)` about the weighted mean [Cochran1954]_, also where a :math:`C_i` is
    singular.

    Args:
        values: Body parameters of k estimates, each of shape (10,).
        covariances: Each of shape (10, 10).
        difference: Covariance of the difference of two, shape (10, 10); None: they are independent.
        settings: Levels and tolerances.
    """
    k = len(values)
    variances = [np.diag(covariance) for covariance in covariances]
    known = np.isfinite([*values, *variances]).all(axis=0)
    block = np.ix_(known, known)
    d = np.concatenate([x[known] - values[0][known] for x in values[1:]])
    if difference is not None:
        sigma = difference[block]
    else:
        sigma = _of_independent([covariance[block] for covariance in covariances])
    names = tuple(np.array(BODY_PARAMETERS)[known].tolist())
    largest = np.tile(np.max(np.abs([x[known] for x in values]), axis=0), k - 1)
    exact = np.diag(sigma) == 0
    differ = exact & (np.abs(d) > settings.same * largest)
    contradicted = tuple(dict.fromkeys(np.array(names * (k - 1))[differ].tolist()))
    free = np.ix_(~exact, ~exact)
    chi_square, freedom, dropped = _chi_square(d[~exact], sigma[free], settings.no_direction)
    if contradicted:
        p_value, sigmas = 0.0, np.inf
        chi_square = np.inf
    elif freedom:
        p_value, sigmas = _tail(chi_square, freedom)
    elif exact.any():
        # Equal exact numbers agree.
        p_value, sigmas = 1.0, 0.0
    else:
        # Of no numbers nothing can be said.
        p_value, sigmas = np.nan, np.nan
    return ChiSquareTest(
        chi_square, freedom, p_value, sigmas, names, contradicted, dropped, settings
    )


def _of_independent(covariances: Sequence[Array]) -> Array:
    """Covariance of the differences of k independent estimates from the first one.

    Args:
        covariances: Of the estimates, each of shape (p, p).

    Returns:
        Shape ((k - 1) p, (k - 1) p).
    """
    k, p = len(covariances), len(covariances[0])
    sigma = np.kron(np.ones((k - 1, k - 1)), covariances[0])
    for i, covariance in enumerate(covariances[1:]):
        own = slice(i * p, (i + 1) * p)
        sigma[own, own] += covariance
    return np.asarray(sigma, dtype=np.float64)


def _chi_square(d: Array, covariance: Array, no_direction: float) -> tuple[float, int, int]:
    """Of correlated differences: its value, the degrees of freedom, and the directions that were
    dropped.
    """
    sigma = np.sqrt(np.diag(covariance))
    variances, directions = np.linalg.eigh(covariance / np.outer(sigma, sigma))
    keep = variances > no_direction
    along = directions[:, keep].T @ (d / sigma)
    return float(np.sum(along**2 / variances[keep])), int(keep.sum()), int((~keep).sum())


def _tail(chi_square: float, freedom: int) -> tuple[float, float]:
    """Probability beyond, and the sigmas of one normal number that is as improbable."""
    from scipy.special import chdtrc, gammaln, ndtri_exp

    if not np.isfinite(chi_square):
        return 0.0, np.inf
    p_value = float(chdtrc(freedom, chi_square))
    if p_value > _UNDERFLOW:
        log_p = np.log(p_value)
    else:
        # The expansion of the incomplete gamma function for large x, DLMF 8.11.2: its logarithm
        # lives on where p underflows.
        a, x = freedom / 2, chi_square / 2
        series = 1 + np.cumprod((a - np.arange(1, np.ceil(a))) / x).sum()
        log_p = -x + (a - 1) * np.log(x) + np.log(series) - gammaln(a)
    return p_value, float(max(0.0, -ndtri_exp(log_p - np.log(2))))
