"""The best body that can exist, in whitened coordinates, by Newton's method on a triangular
factor.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from steelyard.arrays import Array
from steelyard.bodies.whitened_problem import COLUMN, DIAGONAL, ROW, WhitenedProblem, smat, svec


class SolverEnd(NamedTuple):
    """Where a solver ended."""

    z: Array
    """Shape (10,)."""
    multipliers: Array
    """Of the regions, shape (k,)."""
    iterations: int


class _Factored(NamedTuple):
    """A factor, and what follows from it."""

    U: Array
    """X = U U^T, shape (4, 4)."""
    z: Array
    slack: Array
    """Positive; C z as soon as that is, shape (k,)."""
    missing: Array
    """C z less the slack, shape (k,)."""


class _Direction(NamedTuple):
    """A Newton step."""

    step: Array
    """Of the unknowns, shape (10,)."""
    dz: Array
    """Shape (10,)."""
    dslack: Array
    """Shape (k,)."""
    dual: Array
    """Multipliers of the regions after it, shape (k,)."""
    decrement: float
    """Squared."""


def newton(problem: WhitenedProblem) -> SolverEnd:
    r"""Newton's method on the log-Cholesky coordinates of :math:`X = W - \epsilon 1`.

    :math:`X = U U^T` with U upper triangular; the unknowns are the logarithms of its diagonal and
    the elements above it ([Rucker2022]_, with the common scale multiplied in). Where the optimum
    lies on the boundary a logarithm tends to minus infinity and Newton alone takes half a unit per
    step; a barrier :math:`-\mu \log\det X`, which is linear in these unknowns, keeps that step well
    conditioned while :math:`\mu` shrinks. Regions have slacks and multipliers of their own
    (primal-dual), so that the start need not satisfy them.

    Returns:
        The optimum; where it does not converge, the last point, which may violate regions.
    """
    chosen = problem.settings
    value, vector = np.linalg.eigh(smat(problem.center))
    lift = np.clip(value, 0.1 * max(1.0, value[-1]), None)
    point = _factored(problem, _factor((vector * lift) @ vector.T), np.ones(len(problem.rows)))
    mu = max(1.0, problem.value(point.z)) / 10
    dual = mu / point.slack
    waited = 0
    for iteration in range(1, chosen.iterations + 1):
        point, dual, decrement = _step(problem, point, dual, mu)
        squared = 1 + 2 * problem.value(point.z)
        last = chosen.last_barrier * squared
        waited += 1
        if point.missing.any():
            continue
        impatient = waited > chosen.patience
        if mu <= last and (decrement <= chosen.converged * squared or impatient):
            return SolverEnd(point.z, dual, iteration)
        if mu > last and (decrement <= mu or impatient):
            mu = max(chosen.barrier_shrink * mu, 0.99 * last)
            waited = 0
    return SolverEnd(point.z, dual, chosen.iterations)


def _step(
    problem: WhitenedProblem, at: _Factored, dual: Array, mu: float
) -> tuple[_Factored, Array, float]:
    """One damped step; returns the squared Newton decrement too."""
    way = _direction(problem, at, dual, mu)
    penalty = 2 * float(np.abs([*dual, *way.dual]).max(initial=0.0))
    new = _line_search(problem, at, way, mu, penalty)
    fall = dual - way.dual
    falling = fall > 0
    reach = min(1.0, float(np.min(0.99 * dual[falling] / fall[falling], initial=np.inf)))
    return new, dual + reach * (way.dual - dual), way.decrement


def _direction(problem: WhitenedProblem, at: _Factored, dual: Array, mu: float) -> _Direction:
    """The Newton step of the objective with its barriers."""
    U, C, slack = at.U, problem.rows, at.slack
    chain = np.where(DIAGONAL, U[ROW, COLUMN], 1.0)
    moved = np.zeros((10, 4, 4))
    moved[np.arange(10), ROW] = U[:, COLUMN].T * chain[:, None]
    J = svec(moved + moved.swapaxes(1, 2)).T  # dz / d(unknowns), (10, 10)
    slope = problem.gradient(at.z)
    gradient = J.T @ (slope - C.T @ ((mu - dual * at.missing) / slack)) - 2 * mu * DIAGONAL
    rows = np.vstack(
        [
            problem.hessian_root(at.z) @ J,
            np.sqrt(dual / slack)[:, None] * C @ J,
            *_curvature_rows(problem, at, slope - C.T @ dual, chain, mu),
        ]
    )
    # Factors throughout: the Hessian itself would square the range of scales.
    unit = 1 / np.linalg.norm(rows, axis=0)
    R = np.asarray(np.linalg.qr(rows * unit, mode="r"))
    down = np.linalg.solve(R.T, unit * gradient)
    step = -unit * np.linalg.solve(R, down)
    dz = J @ step
    dslack = C @ dz + at.missing
    return _Direction(step, dz, dslack, (mu - dual * dslack) / slack, float(down @ down))


def _curvature_rows(
    problem: WhitenedProblem, at: _Factored, multiplier: Array, chain: Array, mu: float
) -> tuple[Array, Array]:
    """Rows whose squares are the second derivatives of X = U U^T, weighted by its multiplier.

    That is mu X^-1 on the central path and may be indefinite elsewhere: its part below the
    barrier's own is lifted, which keeps the direction one of descent.

    Args:
        problem: Without units.
        at: The present factor.
        multiplier: Of X >= 0, shape (10,).
        chain: Derivatives of the elements of U by the unknowns, shape (10,).
        mu: Weight of the barrier.

    Returns:
        Shapes (16, 10) and (10, 10).
    """
    U = at.U
    inverse = np.linalg.inv(U)
    values, vectors = np.linalg.eigh(U.T @ smat(multiplier) @ U)
    least = problem.settings.least_curvature * mu
    lifted = vectors * np.sqrt(np.maximum(values, least))
    root = lifted.T @ inverse  # G = root^T root, (4, 4)
    # tr(G dU dU^T) column by column, and what the exponentials of the diagonal add.
    same_column = np.arange(4)[:, None] == COLUMN
    bend = np.sqrt(2.0) * (root[:, ROW] * chain)[:, None] * same_column  # (4, 4, 10)
    exponential = np.clip((root.T @ root @ U)[ROW, COLUMN] * chain, 0.0, None)
    return bend.reshape(-1, 10), np.diag(np.sqrt(2 * DIAGONAL * exponential))


def _line_search(
    problem: WhitenedProblem, at: _Factored, way: _Direction, mu: float, penalty: float
) -> _Factored:
    """The better of two ways along a step that lowers the objective with its barriers.

    Along the logarithms the matrix stays positive whatever the length; along the straight line of W
    the objective stays quadratic, where precise data make the other way a narrow bent valley.
    """
    chosen, step = problem.settings, way.step

    def merit(point: _Factored) -> float:
        barrier = 2 * np.log(np.diag(point.U)).sum() + np.log(point.slack).sum()
        violated = penalty * float(np.abs(point.missing).sum())
        return problem.value(point.z) - mu * float(barrier) + violated

    # Of X + dX = U (1 + E) U^T, so that small pivots keep their digits.
    dU = np.zeros((4, 4))
    dU[ROW, COLUMN] = step * np.where(DIAGONAL, at.U[ROW, COLUMN], 1.0)
    half = np.linalg.solve(at.U, dU)
    E = half + half.T
    to_edge = -np.linalg.eigvalsh(E)[0]
    to_side = float(np.max(-way.dslack / at.slack, initial=0.0))
    straight = chosen.to_edge / max(chosen.to_edge, to_edge, to_side)
    longest = max(float(np.abs(step[DIAGONAL]).max()), 1e-300)
    bent = min(1.0, chosen.longest_step / longest, chosen.to_edge / max(to_side, chosen.to_edge))
    by_barrier = mu * float(2 * step[DIAGONAL].sum() + (way.dslack / at.slack).sum())
    slope = problem.gradient(at.z) @ way.dz - by_barrier
    slope -= penalty * float(np.abs(at.missing).sum())
    start = merit(at)
    noise = chosen.objective_rounding * (1 + abs(start) + problem.prior)
    for _ in range(chosen.halvings):
        U = at.U @ _factor(np.eye(4) + straight * E)
        along_line = _factored(problem, U, at.slack + straight * way.dslack)
        U = _moved(at.U, bent * step)
        along_logarithms = _factored(problem, U, at.slack + bent * way.dslack)
        new = along_line
        if abs(slope) >= noise:
            new = min([along_line, along_logarithms], key=merit)
        if merit(new) <= start + 1e-4 * min(straight, bent) * slope + noise:
            return new
        straight, bent = straight / 2, bent / 2
    return at


def _factored(problem: WhitenedProblem, U: Array, slack: Array) -> _Factored:
    """The point of a factor; slacks become C z where that is at least half of them."""
    z = svec(U @ U.T + problem.margin * np.eye(4))
    inside = problem.rows @ z
    slack = np.where(inside > 0.5 * slack, inside, slack)
    return _Factored(U, z, slack, inside - slack)


def _factor(X: Array) -> Array:
    """The upper triangular U with X = U U^T."""
    return np.asarray(np.linalg.cholesky(X[::-1, ::-1])[::-1, ::-1], dtype=np.float64)


def _moved(U: Array, step: Array) -> Array:
    """The factor after a step of the logarithms of its diagonal and of its other elements."""
    moved = U.copy()
    moved[ROW, COLUMN] += step
    np.fill_diagonal(moved, np.diag(U) * np.exp(step[DIAGONAL]))
    return moved
