"""Linear least squares that knows what it cannot tell, and how each sample moved the result."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array

_ROUNDING = 1e-9
"""Singular values below this part of the largest are rounding."""
_NOISE_MARGIN = 4.0
"""A direction counts as excited where its information is this many times what noise in the regressor alone would give."""


@dataclass(frozen=True, eq=False)
class LinearFit:
    """Solution of an ordinary least-squares problem, n samples of d equations, p parameters."""

    value: Array
    """Shape (p,); the part along directions that were not excited is zero."""
    influence: Array
    """How the residual of each sample moved the result, shape (n, p): their sum over errors is the error of the value."""
    unknown: Array
    """Directions that the data do not tell, in units of the parameters' scales, columns of shape (p, k)."""
    residual: Array
    """Target minus prediction, shape (n, d)."""
    pseudo_inverse: Array
    """Takes equations to parameters, shape (p, n d)."""
    condition: float
    """Of the scaled regressor, over the directions that are excited."""


def solve(regressor: Array, target: Array, scale: Array, noise: Array) -> LinearFit:
    """Solve ``regressor @ value = target`` in the least-squares sense.

    Args:
        regressor: Shape (n, d, p).
        target: Shape (n, d).
        scale: Plausible size of every parameter, shape (p,).
        noise: Mean square that noise alone leaves in each column, summed over the d equations, shape (p,).

    Returns:
        The solution over the directions that are excited beyond noise and rounding.
    """
    n, d, p = regressor.shape
    matrix = (regressor * scale).reshape(n * d, p)
    left, singular, right = np.linalg.svd(matrix, full_matrices=False)
    by_noise = right**2 @ (n * noise * scale**2)
    excited = (singular > _ROUNDING * singular[0]) & (singular**2 > _NOISE_MARGIN * by_noise)
    keep = right[excited]
    inverse = scale[:, None] * (keep.T / singular[excited]) @ left[:, excited].T
    value = inverse @ target.reshape(-1)
    residual = target - regressor @ value
    # inverse[p, n d] * residual[n d] summed over the d equations of each sample.
    influence = np.einsum("pnd,nd->np", inverse.reshape(p, n, d), residual)
    kept = singular[excited]
    return LinearFit(
        value=value,
        influence=influence,
        unknown=right[~excited].T,
        residual=residual,
        pseudo_inverse=inverse,
        condition=float(kept[0] / kept[-1]) if len(kept) else float("inf"),
    )


def block_covariance(influence: Array, block: int) -> Array:
    """Covariance of a sum of influences whose samples are correlated over less than a block [Newey1987]_.

    Sums over blocks are nearly independent, whatever the correlation within them.

    Args:
        influence: Shape (n, p).
        block: Samples per block; 1 where samples are independent.

    Returns:
        Shape (p, p).
    """
    n = len(influence)
    count = max(2, n // max(1, block))
    edges = np.linspace(0, n, count + 1).astype(int)[:-1]
    sums = np.add.reduceat(influence, edges, axis=0)
    return np.asarray(count / (count - 1) * sums.T @ sums)
