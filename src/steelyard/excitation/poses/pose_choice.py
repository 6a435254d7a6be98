"""The choice of poses that leaves the least volume of uncertainty: one after the other, then
exchanged until no exchange helps [Fedorov1972]_.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.excitation.settings import DEFAULT, DesignSettings

_RANK = 1e-12
"""Relative eigenvalue below which a pose tells nothing of a direction: rounding."""


@dataclass(frozen=True, eq=False)
class PoseChoice:
    """Poses to choose from: what each tells of b parameters, and which of these are wanted."""

    prior: Array
    """Information before any pose, shape (b, b)."""
    each: Array
    """Information that each of n poses adds, shape (n, b, b)."""
    wanted: NDArray[np.bool_]
    """Parameters whose uncertainty is to be small; the others have to be found beside them, shape
    (b,)."""

    def value(self, chosen: NDArray[np.intp]) -> float:
        """Minus the logarithm of the determinant of the covariance of what is wanted.

        Args:
            chosen: Numbers of poses.
        """
        total = self.prior + self.each[chosen].sum(axis=0)
        rest = total[np.ix_(~self.wanted, ~self.wanted)]
        return float(np.linalg.slogdet(total)[1] - np.linalg.slogdet(rest)[1])

    def best(self, count: int, settings: DesignSettings = DEFAULT) -> NDArray[np.intp]:
        """The poses to take, in the order in which they help, shape (count,).

        Args:
            count: How many; at most as many as there are.
            settings: When to end.
        """
        roots = _roots(self.each)
        chosen: list[int] = []
        while len(chosen) < count:
            gain = self._gains(roots, chosen)
            gain[chosen] = -np.inf
            chosen.append(int(gain.argmax()))
        for _ in range(settings.exchanges):
            before = self.value(np.array(chosen, dtype=np.intp))
            for place in range(count):
                others = [number for i, number in enumerate(chosen) if i != place]
                gain = self._gains(roots, others)
                gain[others] = -np.inf
                chosen[place] = int(gain.argmax())
            if self.value(np.array(chosen, dtype=np.intp)) - before < settings.exchange_gain:
                break
        return np.array(chosen, dtype=np.intp)

    def _gains(self, roots: Array, chosen: list[int]) -> Array:
        """By how much :meth:`value` grows with each pose beside those that are chosen, shape (n,).

        By the lemma on the determinant of a matrix with an update of low rank.
        """
        total = self.prior + self.each[chosen].sum(axis=0)
        rest = ~self.wanted
        whole = _log_determinants(total, roots)
        return whole - _log_determinants(total[np.ix_(rest, rest)], roots[:, rest])


def _roots(information: Array) -> Array:
    """Matrices whose products with their own transposes are the information, shape (n, b, r)."""
    values, vectors = np.linalg.eigh(information)
    kept = values > _RANK * values.max(axis=1, keepdims=True)
    rank = int(kept.sum(axis=1).max())
    root = vectors * np.sqrt(np.where(kept, values, 0.0))[:, None, :]
    return np.asarray(root[:, :, -rank:])


def _log_determinants(matrix: Array, roots: Array) -> Array:
    """Logarithm of the factor by which each update multiplies the determinant, shape (n,)."""
    lower = np.linalg.cholesky(matrix)
    n, b, r = roots.shape
    white = np.linalg.solve(lower, roots.transpose(1, 0, 2).reshape(b, n * r))
    white = white.reshape(b, n, r).transpose(1, 0, 2)
    grown = np.eye(r) + white.transpose(0, 2, 1) @ white
    return np.asarray(np.linalg.slogdet(grown)[1])
