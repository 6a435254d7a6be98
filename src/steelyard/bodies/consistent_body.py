"""The best body that can exist: least squares over positive definite pseudo-inertia matrices,
solved in two independent ways.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from steelyard.arrays import Array, readonly
from steelyard.bodies.body_problem import BodyProblem as BodyProblem
from steelyard.bodies.newton import SolverEnd, newton
from steelyard.bodies.semidefinite_programme import semidefinite_programme
from steelyard.bodies.settings import DEFAULT
from steelyard.bodies.whitened_problem import WhitenedProblem, lifted, smat, svec
from steelyard.errors import InputError, SteelyardError
from steelyard.inertia import Inertia


@dataclass(frozen=True, eq=False)
class Binding:
    """A constraint without which the solution would be another."""

    name: str
    """``pseudo-inertia``, or the condition of a region."""
    multiplier: float
    """How fast the objective would fall if the constraint gave way, in whitened coordinates."""
    plane: Array | None = None
    """The plane (n, d) with n^T r = d [m] in which the body is flat, n of unit length in the
    platform frame, shape (4,). None: a region."""

    def about(self, point: Array) -> Binding:
        """The same in a platform frame whose origin is at a point of the present one [m], shape
        (3,).
        """
        if self.plane is None:
            return self
        off = np.array([0.0, 0.0, 0.0, self.plane[:3] @ point])
        return replace(self, plane=self.plane - off)

    def __str__(self) -> str:
        if self.plane is None:
            return f"the mass reaches the edge of the region ({self.name})"
        x, y, z, d = self.plane
        return (
            f"the body is flat: all mass lies in the plane ({x:.3f}, {y:.3f}, {z:.3f}) r ="
            f" {d:.3f} m"
        )


@dataclass(frozen=True, eq=False)
class ConsistentBody:
    """The best body that can exist."""

    parameters: Array
    """The ten of :data:`steelyard.inertia.LINEAR_PARAMETERS`, shape (10,)."""
    body: Inertia
    misfit: float
    """What the constraints and the prior cost, (phi - estimate)^T information (phi - estimate): a
    chi-square."""
    prior: float
    """The divergence from the nominal body times its weight."""
    binding: tuple[Binding, ...]
    status: Literal["unchanged", "inside", "boundary"]
    """The estimate itself, a body inside all constraints, or one on the boundary."""
    iterations: tuple[int, int]
    """Of the semidefinite programme and of Newton's method."""
    disagreement: float
    """Between the two, in sigmas per (1 + distance in sigmas); infinite where one of them ended
    nowhere."""
    agreement: float = DEFAULT.agreement
    """Disagreement up to which the two count as one."""

    @property
    def remark(self) -> str | None:
        """That the last digits are uncertain; None where the two solvers agree."""
        if self.disagreement <= self.agreement:
            return None
        how = "one of its two solvers ended nowhere"
        if np.isfinite(self.disagreement):
            how = f"its two solvers differ by {self.disagreement:.2g} of its distance in sigmas"
        return (
            f"the nearest body that can exist is known less exactly than usual: {how}; the better"
            " solution is used"
        )


def solve(problem: BodyProblem) -> ConsistentBody:
    """Solve as a semidefinite programme and by Newton's method, and compare.

    Returns:
        Newton's solution, which lies strictly inside; where the two differ, the better one, see
        :attr:`ConsistentBody.remark`.

    Raises:
        InputError: No body has its mass in all the regions, or the regions are nowhere near what
            the data show.
        SteelyardError: Neither solver ends at a body: the information spans too many orders of
            magnitude.
    """
    whitened = problem.whitened
    z = problem.to_whitened @ problem.estimate
    if problem.prior_weight == 0 and whitened.is_feasible(z):
        body = Inertia.from_parameters(problem.estimate)
        return ConsistentBody(problem.estimate, body, 0.0, 0.0, (), "unchanged", (0, 0), 0.0)
    first = _end(semidefinite_programme, whitened)
    second = _end(newton, whitened)
    if first is None and second is None:
        raise _no_solution(problem)
    disagreement = np.inf
    if first is not None and second is not None:
        disagreement = _distance(whitened, first.z, second.z)
    agreement = problem.settings.agreement
    found = second if disagreement <= agreement else _better(whitened, first, second)
    if found is None:
        raise _no_solution(problem)
    parameters = readonly(problem.from_whitened @ found.z, (10,), "parameters")
    nothing = problem.misfit(np.zeros(10))
    if problem.regions and problem.misfit(parameters) > problem.settings.far_away * nothing:
        raise _no_solution(problem)
    binding = _binding(problem, whitened, found)
    return ConsistentBody(
        parameters=parameters,
        body=Inertia.from_parameters(parameters),
        misfit=problem.misfit(parameters),
        prior=whitened.prior_term(found.z),
        binding=binding,
        status="boundary" if binding else "inside",
        iterations=(first.iterations if first else 0, second.iterations if second else 0),
        disagreement=disagreement,
        agreement=agreement,
    )


def _end(
    solver: Callable[[WhitenedProblem], SolverEnd], problem: WhitenedProblem
) -> SolverEnd | None:
    """Where a solver ends; None where its numbers overflow or a matrix is singular."""
    try:
        with np.errstate(all="ignore"):
            end = solver(problem)
    except np.linalg.LinAlgError:
        return None
    return end if np.isfinite(end.z).all() and np.isfinite(end.multipliers).all() else None


def _better(problem: WhitenedProblem, *ends: SolverEnd | None) -> SolverEnd | None:
    """The feasible end of lower cost, moved inside by its rounding; None: neither is feasible."""
    found = []
    for end in ends:
        if end is not None and problem.is_feasible(end.z, problem.settings.feasibility):
            found.append(end._replace(z=lifted(end.z, problem.margin)))
    return min(found, key=lambda end: problem.value(end.z), default=None)


def _no_solution(problem: BodyProblem) -> SteelyardError:
    """What to say where neither solver ends at a body."""
    if problem.regions:
        return InputError(
            "regions: expected some near the body that the data show, found none of that mass"
            " anywhere near; correct their places in the platform frame [m]"
        )
    return SteelyardError(
        "the nearest body that can exist: expected an estimate whose information double precision"
        " resolves, found one of too many orders of magnitude; give a reference body of about the"
        " same size, or a larger 1-sigma of what is known best"
    )


def covariance(problem: BodyProblem, solution: ConsistentBody) -> Array:
    """Covariance of a solution, to first order: the inverse of information and prior.

    That is as if there were no constraint, which is too much where one binds; along its tangent
    alone it would be too little, since an estimate from other data may lie inside. Where the data
    are silent it holds the huge standard deviation of :attr:`BodyProblem.whitened`.

    Args:
        problem: As it was solved.
        solution: Of it.

    Returns:
        Of the ten of :data:`steelyard.inertia.LINEAR_PARAMETERS`, shape (10, 10).
    """
    B = problem.whitened.hessian_root(problem.to_whitened @ solution.parameters)
    factor = problem.from_whitened @ np.linalg.inv(np.linalg.qr(B, mode="r"))
    return factor @ factor.T


def _distance(whitened: WhitenedProblem, first: Array, second: Array) -> float:
    """In sigmas of data and prior at the second; a direction without information counts for
    nothing.
    """
    try:
        sigmas = np.linalg.norm(whitened.hessian_root(second) @ (first - second))
    except np.linalg.LinAlgError:
        return np.inf
    return float(sigmas / (1 + np.sqrt(2 * whitened.value(second))))


def _binding(
    problem: BodyProblem, whitened: WhitenedProblem, found: SolverEnd
) -> tuple[Binding, ...]:
    """Constraints that are nearer than the objective alone would go beyond them."""
    B = whitened.hessian_root(found.z)
    G = smat(whitened.gradient(found.z) - whitened.rows.T @ found.multipliers)
    L = np.linalg.cholesky(problem.reference.pseudo_inertia)
    binding = []
    values, vectors = np.linalg.eigh(smat(found.z))
    for eigenvalue, u in zip(values, vectors.T, strict=True):
        multiplier, normal = float(u @ G @ u), svec(np.outer(u, u))
        if eigenvalue - whitened.margin < multiplier / float(np.sum((B @ normal) ** 2)):
            # The mass within: u^T W u = integral of (q^T [r; 1])^2 dm with q = L^-T u.
            q = np.linalg.solve(L.T, u)
            plane = np.append(q[:3], -q[3]) / max(float(np.linalg.norm(q[:3])), 1e-300)
            binding.append(Binding("pseudo-inertia", multiplier, plane))
    for name, row, multiplier in zip(
        problem.conditions, whitened.rows, found.multipliers, strict=True
    ):
        if row @ found.z < multiplier / float(np.sum((B @ row) ** 2)):
            binding.append(Binding(name, float(multiplier)))
    return tuple(binding)
