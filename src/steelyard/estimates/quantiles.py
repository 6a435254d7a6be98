"""Quantiles and tail probabilities of the distributions that verdicts ask for, by the special
functions of SciPy: its package of all distributions takes half a second to load.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import (
    chdtr,
    chdtrc,
    chdtri,
    fdtrc,
    gammainc,
    gammaincinv,
    ndtr,
    ndtri,
    stdtr,
    stdtrit,
)


def chi2_quantile(p: ArrayLike, k: ArrayLike) -> Any:
    """Of chi-square with k degrees of freedom, what a share p stays below."""
    return 2 * gammaincinv(np.asarray(k) / 2, p)


def chi2_exceeded(p: ArrayLike, k: ArrayLike) -> Any:
    """Of chi-square with k degrees of freedom, what a share p exceeds."""
    return chdtri(k, p)


def chi2_tail(x: ArrayLike, k: ArrayLike) -> Any:
    """Probability that chi-square with k degrees of freedom exceeds x."""
    return chdtrc(k, np.maximum(x, 0.0))


def chi2_below(x: ArrayLike, k: ArrayLike) -> Any:
    """Probability that chi-square with k degrees of freedom stays below x."""
    return chdtr(k, np.maximum(x, 0.0))


def normal_quantile(p: ArrayLike) -> Any:
    """Of a standard normal number, what a share p stays below."""
    return ndtri(p)


def normal_exceeded(p: ArrayLike) -> Any:
    """Of a standard normal number, what a share p exceeds."""
    return -ndtri(p)


def normal_tail(x: ArrayLike) -> Any:
    """Probability that a standard normal number exceeds x."""
    return ndtr(-np.asarray(x))


def student_quantile(p: ArrayLike, k: ArrayLike) -> Any:
    """Of Student's t with k degrees of freedom, what a share p stays below."""
    return stdtrit(k, p)


def student_tail(x: ArrayLike, k: ArrayLike) -> Any:
    """Probability that Student's t with k degrees of freedom exceeds x."""
    return stdtr(k, -np.asarray(x))


def fisher_tail(x: ArrayLike, k: ArrayLike, n: ArrayLike) -> Any:
    """Probability that Fisher's F with k and n degrees of freedom exceeds x."""
    return fdtrc(k, n, x)


def poisson_tail(count: ArrayLike, mean: ArrayLike) -> Any:
    """Probability that a Poisson number of a mean reaches a count of one or more."""
    return gammainc(count, mean)
