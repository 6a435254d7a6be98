"""Which body is sought: the nearest to an estimate of those that can exist, and the same problem
without units.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array, readonly
from steelyard.bodies.mass_region import Region
from steelyard.bodies.settings import DEFAULT, BodySettings
from steelyard.bodies.whitened_problem import WhitenedProblem, smat, svec
from steelyard.inertia import Inertia, six, symmetric

_ASYMMETRY = 1e-9
"""Relative rounding of an information matrix that comes from elsewhere."""
_NEGATIVE = -1e-8
"""Least eigenvalue of such a matrix with a unit diagonal."""


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
    """What the data say alone: any ten numbers; those without information may be anything, shape
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
    settings: BodySettings = DEFAULT

    def __post_init__(self) -> None:
        object.__setattr__(self, "estimate", readonly(self.estimate, (10,), "estimate"))
        object.__setattr__(self, "information", _semidefinite_matrix(self.information))
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
        """F with F^T F = information; rows of directions without information are zero, shape (10,
        10).
        """
        scale = np.sqrt(np.diag(self.information))
        # In units in which the diagonal is one, so that rounding of the mass does not drown the
        # products of inertia.
        values, vectors = np.linalg.eigh(quotient(self.information, np.outer(scale, scale)))
        above_rounding = values > self.settings.information_rounding * values[-1]
        root = np.sqrt(np.where(above_rounding, values, 0.0))
        return np.asarray(root[:, None] * vectors.T * scale)

    def misfit(self, parameters: Array) -> float:
        """(phi - estimate)^T information (phi - estimate)."""
        F = self.root_information
        # Not of the difference: numbers without information may be huge.
        return float(np.sum((F @ parameters - F @ self.estimate) ** 2))

    @property
    def whitened(self) -> WhitenedProblem:
        """The same without units, made definite."""
        F, T = self.root_information, self.from_whitened
        left, s, right = np.linalg.svd(F @ T)
        least = 1 / self.settings.reference_sigma
        if s[0] > 0:
            least = min(least, self.settings.reference_share * s[0])
        informed = s > least
        by_data = left.T @ (F @ self.estimate) / np.where(informed, s, 1.0)
        along = np.where(informed, by_data, right @ svec(np.eye(4)))
        L = np.linalg.cholesky(self.reference.pseudo_inertia)
        rows = np.array([svec(L.T @ Q @ L) for Q in self.conditions.values()]).reshape(-1, 10)
        nominal = self.reference if self.nominal is None else self.nominal
        root = np.linalg.solve(np.linalg.cholesky(nominal.pseudo_inertia), L)
        return WhitenedProblem(
            weights=np.where(informed, s, least)[:, None] * right,
            center=right.T @ along,
            rows=rows / np.linalg.norm(rows, axis=1)[:, None],
            margin=self.margin,
            prior=self.prior_weight,
            nominal_inverse=root.T @ root,
            settings=self.settings,
        )


def _semidefinite_matrix(matrix: Array) -> Array:
    """A symmetric positive semidefinite matrix, shape (10, 10), without its rounding.

    Raises:
        ValueError: It is another.
    """
    matrix = readonly(matrix, (10, 10), "information")
    scale = np.sqrt(np.abs(np.diag(matrix)))
    outer = np.outer(scale, scale)
    asymmetric = (np.abs(matrix - matrix.T) > _ASYMMETRY * outer).any()
    if asymmetric or (np.diag(matrix) < 0).any():
        raise ValueError(
            "information: expected a symmetric positive semidefinite matrix, found another"
        )
    matrix = readonly((matrix + matrix.T) / 2, (10, 10), "information")
    if np.linalg.eigvalsh(quotient(matrix, outer))[0] < _NEGATIVE:
        raise ValueError(
            "information: expected a symmetric positive semidefinite matrix, found a negative"
            " eigenvalue"
        )
    return matrix


def _parameters(P: Array) -> Array:
    """The ten linear parameters of a pseudo-inertia, shape (10,)."""
    return np.concatenate([[P[3, 3]], P[:3, 3], six(np.trace(P[:3, :3]) * np.eye(3) - P[:3, :3])])


def _pseudo_inertia(phi: Array) -> Array:
    """Of the ten linear parameters, also where the mass is zero, shape (4, 4)."""
    J, h = symmetric(phi[4:]), phi[1:4, None]
    return np.block([[np.trace(J) / 2 * np.eye(3) - J, h], [h.T, phi[:1, None]]])


def quotient(matrix: Array, scale: Array) -> Array:
    """Quotient that is zero where the scale is."""
    return np.divide(matrix, scale, out=np.zeros_like(matrix), where=scale > 0)


_PSEUDO_INERTIAS = np.stack([_pseudo_inertia(e) for e in np.eye(10)])
"""The pseudo-inertia is linear in the ten: its part of each, shape (10, 4, 4)."""
