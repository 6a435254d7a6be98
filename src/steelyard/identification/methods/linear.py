"""Linear least squares that knows what it cannot tell, and how each sample moved the result."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array
from steelyard.identification.methods.settings import TWO_STEP, TwoStepSettings


@dataclass(frozen=True, eq=False)
class LinearFit:
    """Solution of an ordinary least-squares problem, n samples of d equations, p parameters."""

    value: Array
    """Shape (p,); the part along directions that were not excited is zero."""
    influence: Array
    """How the residual of each sample moved the result, shape (n, p): their sum over errors is the
    error of the value."""
    unknown: Array
    """Directions that the data do not tell, in units of the parameters' scales, columns of shape
    (p, k)."""
    residual: Array
    """Target minus prediction, shape (n, d)."""
    normal_inverse: Array
    """Inverse of the normal matrix over the directions that are excited, shape (p, p): with the
    regressor's transpose before it, it takes equations to parameters."""
    condition: float
    """Of the scaled regressor, over the directions that are excited."""


def solve(
    regressor: Array,
    target: Array,
    scale: Array,
    noise: Array,
    settings: TwoStepSettings = TWO_STEP,
) -> LinearFit:
    """Solve ``regressor @ value = target`` in the least-squares sense.

    Args:
        regressor: Shape (n, d, p).
        target: Shape (n, d).
        scale: Plausible size of every parameter, shape (p,).
        noise: Mean square that noise alone leaves in each column, summed over the d equations,
            shape (p,).
        settings: With what is excited.

    Returns:
        The solution over the directions that are excited beyond noise and rounding.
    """
    n = len(regressor)
    _, singular, right = np.linalg.svd(_triangle(regressor) * scale)
    by_noise = right**2 @ (n * noise * scale**2)
    excited = singular > settings.rounding * singular[0]
    excited &= singular**2 > settings.noise_margin * by_noise
    root = scale[:, None] * (right[excited].T / singular[excited])
    normal_inverse = root @ root.T
    value = normal_inverse @ np.einsum("ndp,nd->p", regressor, target)
    # Once more on what is left: with the triangle of an orthogonal reduction that makes up for the
    # normal equations.
    value += normal_inverse @ np.einsum("ndp,nd->p", regressor, target - regressor @ value)
    residual = target - regressor @ value
    influence = np.einsum("ndp,nd->np", regressor, residual) @ normal_inverse
    kept = singular[excited]
    return LinearFit(
        value=value,
        influence=influence,
        unknown=right[~excited].T,
        residual=residual,
        normal_inverse=normal_inverse,
        condition=float(kept[0] / kept[-1]) if len(kept) else float("inf"),
    )


_ROWS = 20_000
"""Samples that are reduced at once."""


def _triangle(regressor: Array) -> Array:
    """Triangular factor of a tall matrix of shape (n, d, p), block by block; shape (p, p)."""
    p = regressor.shape[2]
    triangle = np.zeros((p, p))
    for start in range(0, len(regressor), _ROWS):
        block = regressor[start : start + _ROWS].reshape(-1, p)
        triangle = np.asarray(np.linalg.qr(np.vstack([triangle, block]), mode="r"))
    return triangle


def block_sums(influence: Array, block: int) -> Array:
    """Sums of influences over blocks, which are nearly independent whatever the correlation within
    them.

    Args:
        influence: Shape (n, p).
        block: Samples per block; 1 where samples are independent.

    Returns:
        Shape (b, p), at least two blocks.
    """
    n = len(influence)
    edges = np.linspace(0, n, max(2, n // max(1, block)) + 1).astype(int)[:-1]
    return np.asarray(np.add.reduceat(influence, edges, axis=0))


def covariance_of(sums: Array) -> Array:
    """Covariance of a result from the influences of independent blocks [Newey1987]_.

    Args:
        sums: Shape (b, p), see :func:`block_sums`.

    Returns:
        Shape (p, p).
    """
    count = len(sums)
    return np.asarray(count / (count - 1) * sums.T @ sums)
