"""The best body that can exist, in whitened coordinates, as a semidefinite programme (Clarabel)."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from steelyard.arrays import Array
from steelyard.bodies.newton import SolverEnd
from steelyard.bodies.whitened_problem import BASIS, WhitenedProblem, lifted, svec
from steelyard.errors import InputError


def semidefinite_programme(problem: WhitenedProblem) -> SolverEnd:
    """Solve by Clarabel.

    Raises:
        InputError: No body has its mass in all the regions.
    """
    chosen = problem.settings
    start = lifted(problem.center, 10 * problem.margin)
    end = SolverEnd(start, np.zeros(len(problem.rows)), 0)
    # In units of the solution's distance, so that the solver's absolute tolerances mean something;
    # a guess at first.
    for _ in range(chosen.rescalings):
        distance = float(np.sqrt(1.0 + 2 * problem.data_term(end.z)))
        unit = float(np.hypot(distance, np.sqrt(problem.prior)))
        end = _clarabel(problem, unit, end.iterations)
        if np.sqrt(1.0 + 2 * problem.data_term(end.z)) > distance / 10:
            break
    for _ in range(chosen.polish_steps if problem.prior else 0):
        before = end.z
        end = _clarabel(_quadratic(problem, before), distance, end.iterations)
        moved = end.z - before
        in_sigmas = float(np.linalg.norm(problem.weights @ moved))
        settled = in_sigmas < chosen.polish_end * distance
        if settled and np.linalg.norm(moved) < chosen.polish_end:
            break
    return end


def _quadratic(problem: WhitenedProblem, z: Array) -> WhitenedProblem:
    """With the prior replaced by its second-order model about z, for the digits that exponential
    cones do not give.
    """
    z = lifted(z, 0.5 * problem.margin)
    _, s, right = np.linalg.svd(problem.hessian_root(z), full_matrices=False)
    center = z - right.T @ (right @ problem.gradient(z) / s**2)
    return replace(problem, weights=s[:, None] * right, center=center, prior=0.0)


def _clarabel(problem: WhitenedProblem, unit: float, iterations: int) -> SolverEnd:
    """One call of Clarabel, whose iterations are added to earlier ones.

    Unknowns are the deviations from the centre in units of so many sigmas: the quadratic form is
    the identity whatever the data. The determinant of the prior is that of a triangular Z with [[M,
    Z], [Z^T, diag(Z)]] >= 0, whose diagonal has logarithms t in exponential cones, for M = N W N^T
    and N^T N = W_0^-1.
    """
    import clarabel
    from scipy import sparse

    # The rows are orthogonal: no general inverse, which would mix precise directions into vague
    # ones.
    B = (problem.weights / np.sum(problem.weights**2, axis=1)[:, None]).T * unit
    k = len(problem.rows)
    blocks = [(problem.rows @ B, problem.rows @ problem.center)] if k else []
    blocks.append((B, problem.center - problem.margin * svec(np.eye(4))))
    cones = [clarabel.NonnegativeConeT(k)] if k else []
    cones.append(clarabel.PSDTriangleConeT(4))
    linear = np.zeros(10)
    if problem.prior:
        blocks = [(np.hstack([left, np.zeros((len(left), 14))]), right) for left, right in blocks]
        share = problem.prior / unit**2
        by_z = share * B.T @ svec(problem.nominal_inverse)
        linear = np.concatenate([by_z, np.zeros(10), np.full(4, -share)])
        blocks += _log_determinant(problem, B)
        cones += [clarabel.PSDTriangleConeT(8), *[clarabel.ExponentialConeT()] * 4]
    quadratic = sparse.diags([1.0] * 10 + [0.0] * (len(linear) - 10), format="csc")
    solution = clarabel.DefaultSolver(
        quadratic,
        linear,
        sparse.csc_matrix(-np.vstack([left for left, _ in blocks])),
        np.concatenate([right for _, right in blocks]),
        cones,
        _clarabel_settings(),
    ).solve()
    if k and "Infeasible" in str(solution.status):
        raise InputError(
            "regions: expected at least one body with its mass in all of them, found none; enlarge"
            " them"
        )
    # Its tolerances are beyond reach on purpose; whether it came near enough the comparison shows.
    z = problem.center + B @ np.array(solution.x[:10])
    multipliers = unit**2 * np.array(solution.z[:k])
    return SolverEnd(z, multipliers, iterations + int(solution.iterations))


def _clarabel_settings() -> Any:
    """The tightest tolerances, for the last digits of well scaled problems."""
    import clarabel

    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.presolve_enable = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = settings.tol_ktratio = 1e-14
    settings.static_regularization_constant = 1e-10
    settings.equilibrate_enable = False
    settings.iterative_refinement_reltol = settings.iterative_refinement_abstol = 1e-15
    settings.iterative_refinement_max_iter = 50
    # Short steps: near the boundary long ones end in rounding four digits earlier.
    settings.max_step_fraction = 0.7
    settings.min_terminate_step_length = 1e-8
    return settings


def _log_determinant(problem: WhitenedProblem, B: Any) -> list[tuple[Array, Array]]:
    """Rows of the cones that bound log det: slack = left @ (y, Z, t) + right."""
    N = np.linalg.cholesky(problem.nominal_inverse).T
    upper = [(i, j) for j in range(8) for i in range(j + 1)]
    triangle = [(i, j) for j in range(4) for i in range(j, 4)]
    place = {element: k for k, element in enumerate(triangle)}
    left, right = np.zeros((36, 24)), np.zeros(36)
    M = svec(N @ BASIS @ N.T).T  # of W, (10, 10)
    left[:10, :10] = M @ B
    right[:10] = M @ problem.center
    for k, (i, j) in enumerate(upper):
        if j >= 4 and (i, j - 4) in place:
            left[k, 10 + place[i, j - 4]] = np.sqrt(2.0)
        if i == j >= 4:
            left[k, 10 + place[i - 4, i - 4]] = 1.0
    logarithms, ones = np.zeros((12, 24)), np.tile([0.0, 1.0, 0.0], 4)
    for i in range(4):
        logarithms[3 * i, 20 + i] = 1.0
        logarithms[3 * i + 2, 10 + place[i, i]] = 1.0
    return [(left, right), (logarithms, ones)]
