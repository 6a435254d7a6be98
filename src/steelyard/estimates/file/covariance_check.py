"""Whether a matrix that was read is a covariance."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array

ROUNDED = 1e-6
"""Part of the sigmas by which a matrix may fail to be symmetric or semidefinite: others may write
fewer digits."""
_LEAST_VARIANCE = 1e-40
"""Of any parameter, SI; a smaller one is a mistake of units, and its square is no number."""


def covariance_problem(matrix: Array, names: Sequence[str]) -> str | None:
    """Why a matrix is not the covariance of n parameters; None: it is one.

    Args:
        matrix: With numbers on its diagonal, shape (n, n).
        names: Of the parameters.
    """
    variance = np.diag(matrix)
    if (variance < 0).any():
        worst = names[int(variance.argmin())]
        return f"expected no variance below 0, found {variance.min():g} of {worst}"
    tiny = (variance > 0) & (variance < _LEAST_VARIANCE)
    if tiny.any():
        return (
            f"expected variances of 0 or of a possible size, found {variance[tiny][0]:.3g} of"
            f" {names[int(tiny.argmax())]}"
        )
    if np.isnan(matrix).any():
        return (
            f"expected a number for {_first(np.isnan(matrix), names)}, which both have a variance,"
            " found null"
        )
    # By magnitude first: where one is exact, nothing is left to divide by.
    product = np.outer(np.sqrt(variance), np.sqrt(variance))
    beyond = np.abs(matrix) > (1 + ROUNDED) * product
    if beyond.any():
        return (
            f"expected correlations from -1 to 1, found one beyond between {_first(beyond, names)}"
        )
    scaled = np.divide(matrix, product, out=np.eye(len(names)), where=product > 0)
    skew = np.abs(scaled - scaled.T) > ROUNDED
    if skew.any():
        return f"expected a symmetric matrix, found two different numbers for {_first(skew, names)}"
    lowest = float(np.linalg.eigvalsh((scaled + scaled.T) / 2).min(initial=1.0))
    if lowest < -ROUNDED * len(names):
        return (
            f"expected a matrix without negative eigenvalues, found {lowest:.3g} in units of the"
            " 1-sigmas"
        )
    return None


def _first(wrong: NDArray[np.bool_], names: Sequence[str]) -> str:
    """The first two parameters whose entry of shape (n, n) is wrong."""
    return " and ".join(names[j] for j in np.argwhere(wrong)[0])
