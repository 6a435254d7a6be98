"""The problem of the best body in coordinates without unit, and the vectors that stand for
symmetric matrices there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array
from steelyard.bodies.settings import DEFAULT, BodySettings

_UPPER = [(i, j) for j in range(4) for i in range(j + 1)]
ROW, COLUMN = np.array(_UPPER).T
"""Where the ten of :func:`svec` stand in the matrix: the upper triangle by columns, as Clarabel
wants it."""
DIAGONAL = ROW == COLUMN
"""Which of them are on the diagonal."""
_SCALE = np.where(DIAGONAL, 1.0, np.sqrt(2.0))


def svec(matrix: Array) -> Array:
    """Symmetric matrices, shape (..., 4, 4), as vectors of the same Frobenius norm, shape (...,
    10).
    """
    return np.asarray(matrix[..., ROW, COLUMN] * _SCALE)


def smat(vector: Array) -> Array:
    """Inverse of :func:`svec`, shape (4, 4)."""
    matrix = np.empty((4, 4))
    matrix[ROW, COLUMN] = matrix[COLUMN, ROW] = vector / _SCALE
    return matrix


def lifted(vector: Array, least: float) -> Array:
    """The nearest vector of :func:`svec` whose matrix has no eigenvalue below the least, shape
    (10,).
    """
    values, axes = np.linalg.eigh(smat(vector))
    return svec((axes * np.maximum(values, least)) @ axes.T)


BASIS = np.stack([smat(e) for e in np.eye(10)])
"""Orthonormal basis of the symmetric matrices, shape (10, 4, 4)."""


@dataclass(frozen=True, eq=False)
class WhitenedProblem:
    r"""Least squares over bodies in the coordinates in which the reference body is the identity.

    Minimises :math:`\frac12 |A (z - z_0)|^2 + w (\mathrm{tr}(W_0^{-1} W) - \log\det(W_0^{-1} W) -
    4)` over
    :math:`z = \mathrm{svec}(W)` subject to :math:`W - \epsilon 1 \succeq 0` and :math:`C z \ge 0`.
    All is without unit.
    """

    weights: Array
    """A, one row per direction: deviations in sigmas; orthogonal, none zero, shape (10, 10)."""
    center: Array
    """z_0, shape (10,)."""
    rows: Array
    """C, of unit length, shape (k, 10)."""
    margin: float
    """epsilon."""
    prior: float
    """w."""
    nominal_inverse: Array
    """Inverse of W_0, shape (4, 4)."""
    settings: BodySettings = DEFAULT

    def data_term(self, z: Array) -> float:
        """Half the squared distance in sigmas."""
        y = self.weights @ (z - self.center)
        return float(y @ y) / 2

    def prior_term(self, z: Array) -> float:
        """The divergence from the nominal body, times its weight."""
        if self.prior == 0:
            return 0.0
        ratio = smat(z) @ self.nominal_inverse
        sign, logdet = np.linalg.slogdet(ratio)
        return self.prior * float(np.trace(ratio) - logdet - 4) if sign > 0 else np.inf

    def value(self, z: Array) -> float:
        """What is minimised."""
        return self.data_term(z) + self.prior_term(z)

    def gradient(self, z: Array) -> Array:
        """Of :meth:`value`, shape (10,)."""
        gradient: Array = self.weights.T @ (self.weights @ (z - self.center))
        if self.prior:
            gradient = gradient + self.prior * svec(self.nominal_inverse - np.linalg.inv(smat(z)))
        return gradient

    def hessian_root(self, z: Array) -> Array:
        """Rows B with B^T B the Hessian of :meth:`value`, shape (10 or 20, 10)."""
        if self.prior == 0:
            return self.weights
        # d(-W^-1) = W^-1 dW W^-1, for each of the ten orthonormal directions dW.
        root = np.linalg.inv(np.linalg.cholesky(smat(z)))
        return np.vstack([self.weights, np.sqrt(self.prior) * svec(root @ BASIS @ root.T).T])

    def is_feasible(self, z: Array, tolerance: float = 0.0) -> bool:
        """Whether the constraints hold.

        Args:
            z: Shape (10,).
            tolerance: By how much they may be violated, in parts of the norm of z.
        """
        if not np.isfinite(z).all():
            return False
        allowed = tolerance * float(np.linalg.norm(z)) if tolerance else 0.0
        flattest = float(np.linalg.eigvalsh(smat(z))[0])
        return flattest >= self.margin - allowed and bool((self.rows @ z >= -allowed).all())
