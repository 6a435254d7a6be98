"""The best body that can exist: least squares over positive definite pseudo-inertia matrices,
solved in two independent ways.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from steelyard.arrays import Array, readonly
from steelyard.bodies.mass_region import Region
from steelyard.bodies.newton import DIRECTIONS, NewtonSolution, WhitenedProblem, newton, smat, svec
from steelyard.errors import InputError, SteelyardError
from steelyard.inertia import Inertia, six, symmetric

_WHOLE = 1e-13
"""Rounding of an information matrix whose diagonal is one."""
_UNTOLD = 1e-3, 1e-5
"""What the reference body is worth where data are silent: a standard deviation of a thousand such
bodies, but never more than a hundred-thousandth of what the data tell best; it only decides between
bodies that fit equally well."""
_POLISH = 12
"""Newton steps, at most, on the prior within the semidefinite programme."""
_AGREEMENT = 1e-6
"""Of the two solutions, in sigmas per (1 + distance of the solution in sigmas)."""


@dataclass(frozen=True, eq=False)
class BodyProblem:
    r"""Least squares over the bodies that can exist.

    Minimises :math:`\frac12 (\phi - \hat\phi)^T \mathcal{I} (\phi - \hat\phi) +
    w\,(\mathrm{tr}(P_0^{-1} P) - \log\det(P_0^{-1} P) - 4)` over the ten of
    :data:`steelyard.inertia.LINEAR_PARAMETERS`, subject to :math:`P - \epsilon P_{ref} \succeq 0`
    with P the pseudo-inertia of :math:`\phi` and to :math:`\mathrm{tr}(P Q) \ge 0` for each
    condition of each region [Wensing2018]_. The second term is the entropic divergence of
    [Lee2020]_.
    """

    estimate: Array
    """What the data say alone: any ten numbers; those that nothing tells may be anything, shape
    (10,)."""
    information: Array
    """Inverse covariance of the estimate; singular where data are silent, shape (10, 10)."""
    reference: Inertia
    """A body of about the same size: in coordinates in which its pseudo-inertia is the identity
    nothing has a unit. Where the data are silent, the solution is the nearest to it of those that
    fit equally well."""
    margin: float = 1e-6
    """epsilon. A millionth of the reference, a thickness of a thousandth of its own: far above
    rounding and far below what anybody weighs."""
    regions: Sequence[Region] = ()
    """Where the mass lies: in all of them. The conditions are necessary ones; they do not tell a
    body of the right first and second moments from one that fits."""
    nominal: Inertia | None = None
    """The body P_0 to which the solution is pulled."""
    prior_weight: float = 0.0
    """w, in the unit of the objective: 1/2 is a sigma."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "estimate", readonly(self.estimate, (10,), "estimate"))
        matrix = readonly(self.information, (10, 10), "information")
        scale = np.sqrt(np.abs(np.diag(matrix)))
        outer = np.outer(scale, scale)
        if (np.abs(matrix - matrix.T) > 1e-9 * outer).any() or (np.diag(matrix) < 0).any():
            raise ValueError(
                "information: expected a symmetric positive semidefinite matrix, found another"
            )
        matrix = readonly((matrix + matrix.T) / 2, (10, 10), "information")
        if np.linalg.eigvalsh(over(matrix, outer))[0] < -1e-8:
            raise ValueError(
                "information: expected a symmetric positive semidefinite matrix, found a negative"
                " eigenvalue"
            )
        object.__setattr__(self, "information", matrix)
        object.__setattr__(self, "regions", tuple(self.regions))
        for name, body in (("reference", self.reference), ("nominal", self.nominal)):
            if body is not None and not body.is_physical:
                raise ValueError(f"{name}: expected a body that can exist, found {body.to_dict()}")
        if not 0 < self.margin < 1:
            raise ValueError(f"margin: expected a number between 0 and 1, found {self.margin}")
        if not 0 <= self.prior_weight < np.inf or (self.prior_weight > 0 and self.nominal is None):
            raise ValueError(
                f"prior_weight: expected 0, or more with a nominal body, found {self.prior_weight}"
            )

    @property
    def conditions(self) -> dict[str, Array]:
        """Name -> Q of every condition of the regions."""
        return {name: Q for region in self.regions for name, Q in region.conditions.items()}

    @property
    def to_whitened(self) -> Array:
        """D of z = D phi, with z = svec(L^-1 P L^-T) and P_ref = L L^T, shape (10, 10)."""
        inverse = np.linalg.inv(np.linalg.cholesky(self.reference.pseudo_inertia))
        return svec(inverse @ _PSEUDO_INERTIAS @ inverse.T).T

    @property
    def from_whitened(self) -> Array:
        """Inverse of :attr:`to_whitened`, shape (10, 10)."""
        L = np.linalg.cholesky(self.reference.pseudo_inertia)
        return np.column_stack([_parameters(L @ smat(e) @ L.T) for e in np.eye(10)])

    @property
    def root_information(self) -> Array:
        """F with F^T F = information; rows of directions that nothing tells are zero, shape (10,
        10).
        """
        scale = np.sqrt(np.diag(self.information))
        # In units in which the diagonal is one, so that rounding of the mass does not drown the
        # products of inertia.
        values, vectors = np.linalg.eigh(over(self.information, np.outer(scale, scale)))
        root: Array = (
            np.sqrt(np.where(values > _WHOLE * values[-1], values, 0.0))[:, None]
            * vectors.T
            * scale
        )
        return root

    def misfit(self, parameters: Array) -> float:
        """(phi - estimate)^T information (phi - estimate)."""
        F = self.root_information
        # Not of the difference: what nothing tells may be huge.
        return float(np.sum((F @ parameters - F @ self.estimate) ** 2))

    @property
    def whitened(self) -> WhitenedProblem:
        """The same without units, made definite."""
        F, T = self.root_information, self.from_whitened
        left, s, right = np.linalg.svd(F @ T)
        least = min(_UNTOLD[0], _UNTOLD[1] * s[0]) if s[0] > 0 else _UNTOLD[0]
        told = s > least
        along = np.where(
            told, left.T @ (F @ self.estimate) / np.where(told, s, 1.0), right @ svec(np.eye(4))
        )
        L = np.linalg.cholesky(self.reference.pseudo_inertia)
        rows = np.array([svec(L.T @ Q @ L) for Q in self.conditions.values()]).reshape(-1, 10)
        nominal = self.reference if self.nominal is None else self.nominal
        root = np.linalg.solve(np.linalg.cholesky(nominal.pseudo_inertia), L)
        return WhitenedProblem(
            weights=np.where(told, s, least)[:, None] * right,
            center=right.T @ along,
            rows=rows / np.linalg.norm(rows, axis=1)[:, None],
            margin=self.margin,
            prior=self.prior_weight,
            nominal_inverse=root.T @ root,
        )


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
    whitened: Array | None = None
    """The same as an eigenvector of the whitened pseudo-inertia, shape (4,)."""

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
    """Between the two, in sigmas per (1 + distance in sigmas)."""

    @property
    def objective(self) -> float:
        """What was minimised."""
        return self.misfit / 2 + self.prior


def solve(problem: BodyProblem) -> ConsistentBody:
    """Solve as a semidefinite programme and by Newton's method, and compare.

    Returns:
        Newton's solution, which lies strictly inside.

    Raises:
        InputError: No body has its mass in all the regions, or the regions are nowhere near what
            the data show.
        SteelyardError: The two differ, or one of them fails: an error.
    """
    whitened = problem.whitened
    z = problem.to_whitened @ problem.estimate
    if problem.prior_weight == 0 and _is_inside(whitened, z):
        body = Inertia.from_parameters(problem.estimate)
        return ConsistentBody(problem.estimate, body, 0.0, 0.0, (), "unchanged", (0, 0), 0.0)
    try:
        # Numbers that end in nothing are caught below.
        with np.errstate(all="ignore"):
            first, first_iterations = _semidefinite(whitened)
            second = newton(whitened)
    except np.linalg.LinAlgError as error:
        if problem.regions:
            raise InputError(
                "regions: expected some near the body that the data show, found none of that mass"
                " anywhere near; correct their places in the platform frame [m]"
            ) from error
        raise SteelyardError(
            "the nearest body that can exist: expected a solution, found none; please report the"
            " estimate with its information matrix"
        ) from error
    disagreement = _distance(whitened, first, second.z)
    if not disagreement <= _AGREEMENT:
        raise SteelyardError(
            f"the nearest body that can exist: expected two methods within {_AGREEMENT:g} sigma of"
            f" each other, found {disagreement:.2g};"
            f" {'check whether the regions are where the mass is, or' if problem.regions else 'please'}"
            " report the estimate with its information matrix"
        )
    parameters = readonly(problem.from_whitened @ second.z, (10,), "parameters")
    binding = _binding(problem, whitened, second)
    return ConsistentBody(
        parameters=parameters,
        body=Inertia.from_parameters(parameters),
        misfit=problem.misfit(parameters),
        prior=whitened.prior_term(second.z),
        binding=binding,
        status="boundary" if binding else "inside",
        iterations=(first_iterations, second.iterations),
        disagreement=disagreement,
    )


def covariance(problem: BodyProblem, solution: ConsistentBody, *, projected: bool) -> Array:
    """Covariance of a solution, to first order.

    Projected, nothing varies across a constraint that binds (the errors are those along its
    tangent), which is too little on its free side: an estimate from other data may lie inside. Not
    projected, it is the inverse of information and prior, as if there were no constraint, which is
    too much. The curvature of the boundary, which holds a solution the more the further outside the
    estimate lies, is left out of both. Where the data are silent it holds the huge standard
    deviation of :attr:`BodyProblem.whitened`.

    Args:
        problem: As it was solved.
        solution: Of it.
        projected: Whether to project on the tangent of the constraints that bind.

    Returns:
        Of the ten of :data:`steelyard.inertia.LINEAR_PARAMETERS`, shape (10, 10).
    """
    whitened, T = problem.whitened, problem.from_whitened
    B = whitened.hessian_root(problem.to_whitened @ solution.parameters)
    N = _tangent(problem, whitened, solution.binding) if projected else np.eye(10)
    root = np.linalg.qr(B @ N, mode="r")
    factor = T @ N @ np.linalg.inv(root)
    return factor @ factor.T


def _tangent(problem: BodyProblem, whitened: WhitenedProblem, binding: Sequence[Binding]) -> Array:
    """Orthonormal directions along all constraints that bind, shape (10, k)."""
    flat = [b.whitened for b in binding if b.whitened is not None]
    normals = [svec(np.outer(u, v) + np.outer(v, u)) for i, u in enumerate(flat) for v in flat[i:]]
    names = [b.name for b in binding if b.whitened is None]
    normals += [
        row for name, row in zip(problem.conditions, whitened.rows, strict=True) if name in names
    ]
    if not normals:
        return np.eye(10)
    _, s, right = np.linalg.svd(np.array(normals))
    return right[int((s > 1e-9 * s[0]).sum()) :].T


def _semidefinite(problem: WhitenedProblem) -> tuple[Array, int]:
    """Solve by Clarabel; returns z, shape (10,), and the number of iterations."""
    value, vector = np.linalg.eigh(smat(problem.center))
    start = svec((vector * np.maximum(value, 10 * problem.margin)) @ vector.T)
    z, iterations = start, 0
    # In units of the solution's distance, so that the solver's absolute tolerances mean something;
    # a guess at first.
    for _ in range(5):
        distance = float(np.sqrt(1.0 + 2 * problem.data_term(z)))
        z, more = _clarabel(problem, float(np.hypot(distance, np.sqrt(problem.prior))))
        iterations += more
        if np.sqrt(1.0 + 2 * problem.data_term(z)) > distance / 10:
            break
    for _ in range(_POLISH if problem.prior else 0):
        before = z
        z, more = _clarabel(_quadratic(problem, z), distance)
        iterations += more
        if (
            np.linalg.norm(problem.weights @ (z - before)) < 1e-9 * distance
            and np.linalg.norm(z - before) < 1e-9
        ):
            break
    return z, iterations


def _quadratic(problem: WhitenedProblem, z: Array) -> WhitenedProblem:
    """With the prior replaced by its second-order model about z, for the digits that exponential
    cones do not give.
    """
    value, vector = np.linalg.eigh(smat(z))
    z = svec((vector * np.maximum(value, 0.5 * problem.margin)) @ vector.T)
    _, s, right = np.linalg.svd(problem.hessian_root(z), full_matrices=False)
    center = z - right.T @ (right @ problem.gradient(z) / s**2)
    return replace(problem, weights=s[:, None] * right, center=center, prior=0.0)


def _clarabel(problem: WhitenedProblem, unit: float) -> tuple[Array, int]:
    """One call of Clarabel.

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
    blocks = [(problem.rows @ B, problem.rows @ problem.center)] if len(problem.rows) else []
    blocks.append((B, problem.center - problem.margin * svec(np.eye(4))))
    cones = [clarabel.NonnegativeConeT(len(problem.rows))] if len(problem.rows) else []
    cones.append(clarabel.PSDTriangleConeT(4))
    linear = np.zeros(10)
    if problem.prior:
        blocks = [(np.hstack([left, np.zeros((len(left), 14))]), right) for left, right in blocks]
        share = problem.prior / unit**2
        linear = np.concatenate(
            [share * B.T @ svec(problem.nominal_inverse), np.zeros(10), np.full(4, -share)]
        )
        blocks += _log_determinant(problem, B)
        cones += [clarabel.PSDTriangleConeT(8), *[clarabel.ExponentialConeT()] * 4]
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
    quadratic = sparse.diags([1.0] * 10 + [0.0] * (len(linear) - 10), format="csc")
    solution = clarabel.DefaultSolver(
        quadratic,
        linear,
        sparse.csc_matrix(-np.vstack([left for left, _ in blocks])),
        np.concatenate([right for _, right in blocks]),
        cones,
        settings,
    ).solve()
    if "Infeasible" in str(solution.status):
        raise InputError(
            "regions: expected at least one body with its mass in all of them, found none; enlarge"
            " them"
        )
    # Its tolerances are beyond reach on purpose; whether it came near enough the comparison tells.
    return problem.center + B @ np.array(solution.x[:10]), int(solution.iterations)


def _log_determinant(problem: WhitenedProblem, B: Any) -> list[tuple[Array, Array]]:
    """Rows of the cones that bound log det: slack = left @ (y, Z, t) + right."""
    N = np.linalg.cholesky(problem.nominal_inverse).T
    upper = [(i, j) for j in range(8) for i in range(j + 1)]
    place = {(i, j): k for k, (i, j) in enumerate((i, j) for j in range(4) for i in range(j, 4))}
    left, right = np.zeros((36, 24)), np.zeros(36)
    M = svec(N @ DIRECTIONS @ N.T).T  # of W, (10, 10)
    left[:10, :10], right[:10] = M @ B, M @ problem.center
    for k, (i, j) in enumerate(upper):
        if j >= 4 and (i, j - 4) in place:
            left[k, 10 + place[i, j - 4]] = np.sqrt(2.0)
        if i == j >= 4:
            left[k, 10 + place[i - 4, i - 4]] = 1.0
    logarithms, ones = np.zeros((12, 24)), np.tile([0.0, 1.0, 0.0], 4)
    for i in range(4):
        logarithms[3 * i, 20 + i] = logarithms[3 * i + 2, 10 + place[i, i]] = 1.0
    return [(left, right), (logarithms, ones)]


def _is_inside(whitened: WhitenedProblem, z: Array) -> bool:
    flattest = np.linalg.eigvalsh(smat(z))[0]
    return bool(flattest >= whitened.margin and (whitened.rows @ z >= 0).all())


def _distance(whitened: WhitenedProblem, first: Array, second: Array) -> float:
    """In sigmas of data and prior at the second; a direction that they do not tell counts for
    nothing.
    """
    sigmas = np.linalg.norm(whitened.hessian_root(second) @ (first - second))
    return float(sigmas / (1 + np.sqrt(2 * whitened.value(second))))


def _binding(
    problem: BodyProblem, whitened: WhitenedProblem, found: NewtonSolution
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
            binding.append(Binding("pseudo-inertia", multiplier, plane, u))
    for name, row, multiplier in zip(
        problem.conditions, whitened.rows, found.multipliers, strict=True
    ):
        if row @ found.z < multiplier / float(np.sum((B @ row) ** 2)):
            binding.append(Binding(name, float(multiplier)))
    return tuple(binding)


def _parameters(P: Array) -> Array:
    """The ten linear parameters of a pseudo-inertia, shape (10,)."""
    return np.concatenate([[P[3, 3]], P[:3, 3], six(np.trace(P[:3, :3]) * np.eye(3) - P[:3, :3])])


def _pseudo_inertia(phi: Array) -> Array:
    """Of the ten linear parameters, also where the mass is zero, shape (4, 4)."""
    J, h = symmetric(phi[4:]), phi[1:4, None]
    return np.block([[np.trace(J) / 2 * np.eye(3) - J, h], [h.T, phi[:1, None]]])


def over(matrix: Array, scale: Array) -> Array:
    """Quotient that is zero where the scale is."""
    return np.divide(matrix, scale, out=np.zeros_like(matrix), where=scale > 0)


_PSEUDO_INERTIAS = np.stack([_pseudo_inertia(e) for e in np.eye(10)])
"""The pseudo-inertia is linear in the ten: its part of each, shape (10, 4, 4)."""
