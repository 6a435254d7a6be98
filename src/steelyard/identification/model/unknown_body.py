"""The body that fits measured forces best, and what it leaves of them.

The balance of forces and moments is linear in the ten parameters of the body and in the constants
of the force sensors: a motion and readings are enough, nothing of the body need be known.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array

BODY = slice(0, 10)
"""Columns of the ten of :data:`steelyard.inertia.LINEAR_PARAMETERS`; constants of the sensors
follow."""


@dataclass(frozen=True, eq=False)
class UnknownBody:
    """Body and constants of the sensors, p numbers."""

    value: Array
    """Shape (p,)."""
    covariance: Array
    """Inverse of the normal matrix, shape (p, p)."""
    residual: Array
    """Whitened, shape (n, 6)."""
    penalty: float
    """Sum of squares of the constants in units of their prior."""

    @property
    def standard_deviation(self) -> Array:
        """Shape (p,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))


def unknown_body(
    columns: Array,
    target: Array,
    precision: Array,
    *,
    expected: Array | None = None,
    weight: Array | float = 1.0,
    ridge: float = 0.0,
) -> UnknownBody:
    """Least squares over n samples of a wrench, with a prior.

    Args:
        columns: Whitened derivative of the wrench by body and constants, shape (n, 6, p).
        target: Whitened wrench, shape (n, 6).
        precision: Inverse variances of the prior; 0: nothing is known; shape (p,).
        expected: Mean of the prior, shape (p,); None: zero.
        weight: Of each sample, shape (n,), or of all.
        ridge: Part of its own information that is added to every number, where some of them
            cannot be told from others.
    """
    n, _, p = columns.shape
    flat = columns.reshape(-1, p)
    weights = np.repeat(np.broadcast_to(weight, n), 6)
    # In units in which everything is known equally well.
    scale = np.sqrt(weights @ flat**2 + precision)
    scale = np.where(scale > 0, scale, 1.0)
    unit = flat / scale
    weighted = unit * weights[:, None]
    prior = precision / scale**2
    normal = weighted.T @ unit + np.diag(prior + ridge)
    right = weighted.T @ target.ravel()
    if expected is not None:
        right = right + prior * expected * scale
    inverse = np.linalg.inv(normal)
    value = np.linalg.solve(normal, right)
    return UnknownBody(
        value / scale,
        inverse / np.outer(scale, scale),
        target - (unit @ value).reshape(target.shape),
        float(np.sum(prior * value**2)),
    )
