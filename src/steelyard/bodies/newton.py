"""The nearest body that can exist, in whitened coordinates, by Newton's method on a triangular
factor.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import SteelyardError

ROW, COLUMN = (
    np.array(k) for k in zip(*((i, j) for j in range(4) for i in range(j + 1)), strict=True)
)
"""Where the ten of :func:`svec` stand in the matrix: the upper triangle by columns, as Clarabel
wants it."""
_DIAGONAL = ROW == COLUMN
_SAME_COLUMN = np.equal.outer(COLUMN, COLUMN)
_SCALE = np.where(_DIAGONAL, 1.0, np.sqrt(2.0))

_GAP = 1e-14
"""Last weight of the barrier, in parts of the objective: a distance of 1e-7 sigma at worst."""
_SHRINK = 0.1
"""Of the weight of the barrier from one stage to the next."""
_LEAST_CURVATURE = 0.5
"""Lowest multiplier that counts, in parts of the central one."""
_TO_EDGE = 0.95
"""Part of the way to the boundary that a straight step may go."""
_CONVERGED = 1e-15
"""Squared decrement, in parts of the squared distance, at which it ends: 3e-8 sigma."""
_PATIENCE = 20
"""Steps of a stage: a longer one has met rounding, and the comparison will tell whether the end is
near enough."""
_ROUNDING = 1e-14
"""Of the objective, in parts of it: a step that changes it by less is taken on trust."""
_LARGEST = 2.0
"""Longest step of a logarithm: a pivot changes by at most e^2."""
_ITERATIONS = 500


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


DIRECTIONS = np.stack([smat(e) for e in np.eye(10)])
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
        g: Array = self.weights.T @ (self.weights @ (z - self.center))
        return (
            g + self.prior * svec(self.nominal_inverse - np.linalg.inv(smat(z)))
            if self.prior
            else g
        )

    def hessian_root(self, z: Array) -> Array:
        """Rows B with B^T B the Hessian of :meth:`value`, shape (10 or 20, 10)."""
        if self.prior == 0:
            return self.weights
        # d(-W^-1) = W^-1 dW W^-1, for each of the ten orthonormal directions dW.
        root = np.linalg.inv(np.linalg.cholesky(smat(z)))
        return np.vstack([self.weights, np.sqrt(self.prior) * svec(root @ DIRECTIONS @ root.T).T])


class NewtonSolution(NamedTuple):
    """Where Newton's method ended."""

    z: Array
    """Shape (10,)."""
    multipliers: Array
    """Of the regions, shape (k,)."""
    iterations: int


class _Point(NamedTuple):
    """A factor, and what follows from it."""

    U: Array
    """X = U U^T, shape (4, 4)."""
    z: Array
    slack: Array
    """Positive; C z as soon as that is, shape (k,)."""
    missing: Array
    """C z less the slack, shape (k,)."""


def newton(problem: WhitenedProblem) -> NewtonSolution:
    r"""Newton's method on the log-Cholesky coordinates of :math:`X = W - \epsilon 1`.

    :math:`X = U U^T` with U upper triangular; the unknowns are the logarithms of its diagonal and
    the elements above it ([Rucker2022]_, with the common scale multiplied in). Where the optimum
    lies on the boundary a logarithm tends to minus infinity and Newton alone takes half a unit per
    step; a barrier :math:`-\mu \log\det X`, which is linear in these unknowns, keeps that step well
    conditioned while :math:`\mu` shrinks. Regions have slacks and multipliers of their own
    (primal-dual), so that the start need not satisfy them.

    Raises:
        SteelyardError: It does not converge.
    """
    value, vector = np.linalg.eigh(smat(problem.center))
    lift = np.clip(value, 0.1 * max(1.0, value[-1]), None)
    point = _point(problem, _factor((vector * lift) @ vector.T), np.ones(len(problem.rows)))
    mu = max(1.0, problem.value(point.z)) / 10
    dual = mu / point.slack
    waited = 0
    for iteration in range(1, _ITERATIONS + 1):
        point, dual, decrement = _step(problem, point, dual, mu)
        squared = 1 + 2 * problem.value(point.z)
        last = _GAP * squared
        waited += 1
        if point.missing.any():
            continue
        if mu <= last and (decrement <= _CONVERGED * squared or waited > _PATIENCE):
            return NewtonSolution(point.z, dual, iteration)
        if mu > last and (decrement <= mu or waited > _PATIENCE):
            mu, waited = max(_SHRINK * mu, 0.99 * last), 0
    raise SteelyardError(
        f"the Newton method for the nearest body did not converge in {_ITERATIONS} iterations"
    )


def _step(
    problem: WhitenedProblem, at: _Point, dual: Array, mu: float
) -> tuple[_Point, Array, float]:
    """One damped step; returns the squared Newton decrement too."""
    U, C, slack = at.U, problem.rows, at.slack
    chain = np.where(_DIAGONAL, U[ROW, COLUMN], 1.0)
    moved = np.zeros((10, 4, 4))
    moved[np.arange(10), ROW] = U[:, COLUMN].T * chain[:, None]
    J = svec(moved + moved.swapaxes(1, 2)).T  # dz / d(unknowns), (10, 10)

    slope = problem.gradient(at.z)
    gradient = J.T @ (slope - C.T @ ((mu - dual * at.missing) / slack)) - 2 * mu * _DIAGONAL
    # Second derivatives of X = U U^T, weighted by the multiplier of X >= 0. That is mu X^-1 on the central path and may be
    # indefinite elsewhere: its part below the barrier's own is lifted, which keeps the direction
    # one of descent.
    inverse = np.linalg.inv(U)
    values, vectors = np.linalg.eigh(U.T @ smat(slope - C.T @ dual) @ U)
    root = (
        vectors * np.sqrt(np.maximum(values, _LEAST_CURVATURE * mu))
    ).T @ inverse  # G = root^T root, (4, 4)
    # tr(G dU dU^T) column by column, and what the exponentials of the diagonal add.
    bend = (
        np.sqrt(2.0) * (root[:, ROW] * chain)[:, None] * (np.arange(4)[:, None] == COLUMN)
    )  # (4, 4, 10)
    more = np.diag(
        np.sqrt(2 * _DIAGONAL * np.clip((root.T @ root @ U)[ROW, COLUMN] * chain, 0.0, None))
    )
    rows = np.vstack(
        [
            problem.hessian_root(at.z) @ J,
            np.sqrt(dual / slack)[:, None] * C @ J,
            bend.reshape(-1, 10),
            more,
        ]
    )
    # Factors throughout: the Hessian itself would square the range of scales.
    unit = 1 / np.linalg.norm(rows, axis=0)
    R = np.asarray(np.linalg.qr(rows * unit, mode="r"))
    down = np.linalg.solve(R.T, unit * gradient)
    step = -unit * np.linalg.solve(R, down)

    dz = J @ step
    dslack = C @ dz + at.missing
    new_dual = (mu - dual * dslack) / slack
    new = _searched(
        problem, at, step, dz, dslack, mu, 2 * float(np.abs([*dual, *new_dual]).max(initial=0.0))
    )
    fall = dual - new_dual
    reach = min(1.0, float(np.min(0.99 * dual[fall > 0] / fall[fall > 0], initial=np.inf)))
    return new, dual + reach * (new_dual - dual), float(down @ down)


def _searched(
    problem: WhitenedProblem,
    at: _Point,
    step: Array,
    dz: Array,
    dslack: Array,
    mu: float,
    penalty: float,
) -> _Point:
    """The better of two ways along a step that lowers the objective with its barriers.

    Along the logarithms the matrix stays positive whatever the length; along the straight line of W
    the objective stays quadratic, where precise data make the other way a narrow bent valley.
    """

    def merit(point: _Point) -> float:
        barrier = 2 * np.log(np.diag(point.U)).sum() + np.log(point.slack).sum()
        return (
            problem.value(point.z)
            - mu * float(barrier)
            + penalty * float(np.abs(point.missing).sum())
        )

    # Of X + dX = U (1 + E) U^T, so that small pivots keep their digits.
    dU = np.zeros((4, 4))
    dU[ROW, COLUMN] = step * np.where(_DIAGONAL, at.U[ROW, COLUMN], 1.0)
    half = np.linalg.solve(at.U, dU)
    E = half + half.T
    to_edge = -np.linalg.eigvalsh(E)[0]
    to_side = float(np.max(-dslack / at.slack, initial=0.0))
    straight = _TO_EDGE / max(_TO_EDGE, to_edge, to_side)
    bent = min(
        1.0,
        _LARGEST / max(float(np.abs(step[_DIAGONAL]).max()), 1e-300),
        _TO_EDGE / max(to_side, _TO_EDGE),
    )
    slope = problem.gradient(at.z) @ dz - mu * float(
        2 * step[_DIAGONAL].sum() + (dslack / at.slack).sum()
    )
    slope -= penalty * float(np.abs(at.missing).sum())
    start = merit(at)
    noise = _ROUNDING * (1 + abs(start) + problem.prior)
    for _ in range(40):
        points = [
            _point(problem, at.U @ _factor(np.eye(4) + straight * E), at.slack + straight * dslack),
            _point(problem, _moved(at.U, bent * step), at.slack + bent * dslack),
        ]
        new = points[0] if abs(slope) < noise else min(points, key=merit)
        if merit(new) <= start + 1e-4 * min(straight, bent) * slope + noise:
            return new
        straight, bent = straight / 2, bent / 2
    return at


def _point(problem: WhitenedProblem, U: Array, slack: Array) -> _Point:
    z = svec(U @ U.T + problem.margin * np.eye(4))
    inside = problem.rows @ z
    slack = np.where(inside > 0.5 * slack, inside, slack)
    return _Point(U, z, slack, inside - slack)


def _factor(X: Array) -> Array:
    """The upper triangular U with X = U U^T."""
    return np.asarray(np.linalg.cholesky(X[::-1, ::-1])[::-1, ::-1], dtype=np.float64)


def _moved(U: Array, step: Array) -> Array:
    """The factor after a step of the logarithms of its diagonal and of its other elements."""
    moved = U.copy()
    moved[ROW, COLUMN] += step
    np.fill_diagonal(moved, np.diag(U) * np.exp(step[_DIAGONAL]))
    return moved
