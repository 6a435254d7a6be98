"""The ten inertial parameters of a rigid body and the forms in which people write them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from steelyard.arrays import Array, complex_step_jacobian, readonly
from steelyard.errors import WrongValueError

LINEAR_PARAMETERS = ("m", "hx", "hy", "hz", "Jxx", "Jyy", "Jzz", "Jyz", "Jxz", "Jxy")
"""The ten parameters in which the dynamics is linear: mass [kg], first moment h = m c [kg m] and
inertia matrix about the platform origin [kg m^2]. Moments in the order of the paper's k_2; products
are elements of the matrix."""

TEN = len(LINEAR_PARAMETERS)
"""Number of the inertial parameters of a body."""

BODY_PARAMETERS = ("mass", "cx", "cy", "cz", "Jxx", "Jyy", "Jzz", "Jyz", "Jxz", "Jxy")
"""The same body as people quote it: mass [kg], centre of gravity [m], inertia matrix about it [kg
m^2]."""

BODY_UNITS = ("kg", "m", "m", "m", *["kg m^2"] * 6)
"""Of :data:`BODY_PARAMETERS`."""

ROWS, COLUMNS = (0, 1, 2, 1, 0, 0), (0, 1, 2, 2, 2, 1)
"""Where xx, yy, zz, yz, xz, xy stand in the matrix."""


def symmetric(six: ArrayLike) -> Array:
    """Symmetric matrix, shape (3, 3), of its elements xx, yy, zz, yz, xz, xy."""
    six = np.asarray(six, dtype=np.float64)
    matrix = np.empty((3, 3))
    matrix[ROWS, COLUMNS] = six
    matrix[COLUMNS, ROWS] = six
    return matrix


def six(matrix: ArrayLike) -> Any:
    """Elements xx, yy, zz, yz, xz, xy of a symmetric matrix of shape (3, 3); complex numbers stay
    complex.
    """
    return np.asarray(matrix)[ROWS, COLUMNS]


def point_inertia(mass: Any, position: ArrayLike) -> Any:
    """Inertia matrix of a point mass about the origin, m [c]x^T [c]x of Eq. (7) of [Tempel2017]_
    [kg m^2], shape (3, 3).

    Complex numbers stay complex, so that derivatives can be had by a complex step.
    """
    c = np.asarray(position)
    return mass * ((c @ c) * np.eye(3) - np.outer(c, c))


def body_jacobian(parameters: ArrayLike) -> Array:
    """Derivative of the ten of :data:`BODY_PARAMETERS` by the ten of :data:`LINEAR_PARAMETERS`,
    shape (10, 10).

    Args:
        parameters: Of :data:`LINEAR_PARAMETERS`, the mass not zero, shape (10,).
    """
    p = np.asarray(parameters, dtype=np.float64)

    def body(x: Any) -> Any:
        cog = x[1:4] / x[0]
        return np.concatenate([[x[0]], cog, x[4:] - six(point_inertia(x[0], cog))])

    return complex_step_jacobian(body, p)


@dataclass(frozen=True, eq=False)
class Inertia:
    """Mass, centre of gravity and inertia of a body, in platform axes.

    Any numbers may stand here, also those of a body that cannot exist: an estimate has to be shown
    as it is. :attr:`is_physical` says whether it can.
    """

    mass: float
    """[kg]"""
    center_of_gravity: Array
    """In the platform frame [m], shape (3,)."""
    inertia: Array
    """About the centre of gravity, platform axes; products are elements of the matrix [kg m^2],
    shape (3, 3)."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "mass", float(readonly(self.mass, (), "mass")))
        object.__setattr__(
            self, "center_of_gravity", readonly(self.center_of_gravity, (3,), "center_of_gravity")
        )
        matrix = readonly(self.inertia, (3, 3), "inertia")
        if not np.allclose(
            matrix, matrix.T, rtol=1e-9, atol=1e-12 * float(np.abs(matrix).max(initial=0.0))
        ):
            raise WrongValueError(
                f"inertia: expected a symmetric matrix, found {matrix.tolist()}; products are"
                " elements of the matrix"
            )
        object.__setattr__(self, "inertia", readonly(matrix / 2 + matrix.T / 2, (3, 3), "inertia"))

    def about(self, point: Array) -> Inertia:
        """The same body in a frame whose origin is at a point of the present one.

        Args:
            point: In the present frame [m], shape (3,).
        """
        return Inertia(self.mass, self.center_of_gravity - point, self.inertia)

    # Forms

    @property
    def first_moment(self) -> Array:
        """H = m c [kg m], shape (3,)."""
        return self.mass * self.center_of_gravity

    @property
    def inertia_about_origin(self) -> Array:
        """J_P = J_C + m [c]x^T [c]x, Eq. (7) of [Tempel2017]_ [kg m^2], shape (3, 3)."""
        return np.asarray(self.inertia + point_inertia(self.mass, self.center_of_gravity))

    @property
    def parameters(self) -> Array:
        """The ten of :data:`LINEAR_PARAMETERS`, shape (10,)."""
        return np.concatenate([[self.mass], self.first_moment, six(self.inertia_about_origin)])

    @classmethod
    def from_parameters(cls, parameters: ArrayLike) -> Inertia:
        """From the ten of :data:`LINEAR_PARAMETERS`; the mass must not be zero."""
        p = readonly(parameters, (10,), "parameters")
        cog = p[1:4] / p[0]
        return cls(float(p[0]), cog, symmetric(p[4:]) - point_inertia(float(p[0]), cog))

    @property
    def body_parameters(self) -> Array:
        """The ten of :data:`BODY_PARAMETERS`, shape (10,)."""
        return np.concatenate([[self.mass], self.center_of_gravity, six(self.inertia)])

    @classmethod
    def from_body_parameters(cls, parameters: ArrayLike) -> Inertia:
        """From the ten of :data:`BODY_PARAMETERS`."""
        p = readonly(parameters, (10,), "parameters")
        return cls(float(p[0]), p[1:4], symmetric(p[4:]))

    @classmethod
    def from_points(cls, masses: ArrayLike, positions: ArrayLike) -> Inertia:
        """Of a cloud of point masses.

        Args:
            masses: [kg], shape (n,).
            positions: In the platform frame [m], shape (n, 3).
        """
        m, r = np.asarray(masses, dtype=np.float64), np.asarray(positions, dtype=np.float64)
        cog = m @ r / m.sum()
        d = r - cog
        second = np.einsum("n,ni,nj->ij", m, d, d)
        return cls(float(m.sum()), cog, np.trace(second) * np.eye(3) - second)

    # Pseudo-inertia

    @property
    def pseudo_inertia(self) -> Array:
        """Second moments of the homogeneous position [r; 1] about the origin, shape (4, 4)
        [Wensing2018]_.

        ``[[S, h], [h^T, m]]`` with S = integral of r r^T dm = tr(J_P) / 2 - J_P [kg m^2]. The body
        can exist exactly if this matrix is positive definite (semidefinite for a flat or pointlike
        one).
        """
        J = self.inertia_about_origin
        h = self.first_moment[:, None]
        return np.block([[np.trace(J) / 2 * np.eye(3) - J, h], [h.T, np.array([[self.mass]])]])

    @classmethod
    def from_pseudo_inertia(cls, matrix: ArrayLike) -> Inertia:
        """Inverse of :attr:`pseudo_inertia`."""
        P = readonly(matrix, (4, 4), "pseudo_inertia")
        J = np.trace(P[:3, :3]) * np.eye(3) - P[:3, :3]
        return cls.from_parameters(np.concatenate([[P[3, 3]], P[:3, 3], six(J)]))

    @property
    def log_cholesky(self) -> Array:
        """Ten unconstrained numbers (alpha, d1, d2, d3, s12, s23, s13, t1, t2, t3) of
        [Rucker2022]_, shape (10,).

        ``pseudo_inertia = U U^T`` with ``U = exp(alpha) [[exp(d1), s12, s13, t1], [0, exp(d2), s23,
        t2], [0, 0, exp(d3), t3], [0, 0, 0, 1]]``.

        Raises:
            ValueError: The body cannot exist, so it has no such form.
        """
        if not self.is_physical:
            raise ValueError(
                "log_cholesky: expected a body that can exist, found a pseudo-inertia that is not"
                " positive definite"
            )
        flip = np.arange(3, -1, -1)
        # The upper factor is the lower one of the matrix with its axes in reverse order.
        U = np.linalg.cholesky(self.pseudo_inertia[np.ix_(flip, flip)])[np.ix_(flip, flip)]
        V = U / U[3, 3]
        return np.array(
            [np.log(U[3, 3]), *np.log(np.diag(V)[:3]), V[0, 1], V[1, 2], V[0, 2], *V[:3, 3]]
        )

    @classmethod
    def from_log_cholesky(cls, values: ArrayLike) -> Inertia:
        """Inverse of :attr:`log_cholesky`; every ten numbers give a body that can exist."""
        a, d1, d2, d3, s12, s23, s13, t1, t2, t3 = readonly(values, (10,), "log_cholesky")
        U = np.exp(a) * np.array(
            [
                [np.exp(d1), s12, s13, t1],
                [0, np.exp(d2), s23, t2],
                [0, 0, np.exp(d3), t3],
                [0, 0, 0, 1],
            ]
        )
        return cls.from_pseudo_inertia(U @ U.T)

    # Physics

    @property
    def principal_moments(self) -> Array:
        """Eigenvalues of the inertia matrix about the centre of gravity, ascending [kg m^2], shape
        (3,).
        """
        return np.asarray(np.linalg.eigvalsh(self.inertia), dtype=np.float64)

    @property
    def triangle_margin(self) -> float:
        """How far the principal moments keep the triangle inequality, I1 + I2 - I3 [kg m^2];
        negative: no body.
        """
        i1, i2, i3 = self.principal_moments
        return float(i1 + i2 - i3)

    @property
    def is_physical(self) -> bool:
        """Whether a mass distribution with these values exists (a positive definite pseudo-inertia
        matrix).
        """
        return self.mass > 0 and bool(self.principal_moments[0] > 0) and self.triangle_margin > 0

    def __repr__(self) -> str:
        x, y, z = (f"{value * 1e3:.6g}" for value in self.center_of_gravity)
        moments = zip(BODY_PARAMETERS[4:], six(self.inertia), strict=True)
        listed = ", ".join(f"{name[1:]} {value:.6g}" for name, value in moments)
        return f"Inertia: {self.mass:.6g} kg at ({x}, {y}, {z}) mm, {listed} kg m²"

    # What other programs want

    def to_pinocchio(self) -> PinocchioParameters:
        """Dynamic parameters as ``pinocchio.Inertia.toDynamicParameters`` orders them."""
        h, J = self.first_moment, self.inertia_about_origin
        return PinocchioParameters(
            self.mass, h[0], h[1], h[2], J[0, 0], J[0, 1], J[1, 1], J[0, 2], J[1, 2], J[2, 2]
        )

    @classmethod
    def from_pinocchio(cls, values: PinocchioParameters | ArrayLike) -> Inertia:
        """From the order of ``pinocchio.Inertia.toDynamicParameters``."""
        v = PinocchioParameters(*np.asarray(values, dtype=np.float64))
        return cls.from_parameters(
            [v.m, v.mx, v.my, v.mz, v.Ixx, v.Iyy, v.Izz, v.Iyz, v.Ixz, v.Ixy]
        )

    def to_mujoco(self) -> MujocoInertial:
        """The ``inertial`` element of MJCF with ``fullinertia``."""
        J = self.inertia
        return MujocoInertial(
            self.mass,
            tuple(float(v) for v in self.center_of_gravity),
            (J[0, 0], J[1, 1], J[2, 2], J[0, 1], J[0, 2], J[1, 2]),
        )

    @classmethod
    def from_mujoco(cls, values: MujocoInertial) -> Inertia:
        """Inverse of :meth:`to_mujoco`."""
        xx, yy, zz, xy, xz, yz = values.fullinertia
        return cls(values.mass, np.array(values.pos), symmetric([xx, yy, zz, yz, xz, xy]))

    def to_urdf(self) -> UrdfInertial:
        """The ``inertial`` element of URDF, with an ``origin`` that is not turned."""
        J = self.inertia
        return UrdfInertial(
            self.mass,
            tuple(float(v) for v in self.center_of_gravity),
            J[0, 0],
            J[0, 1],
            J[0, 2],
            J[1, 1],
            J[1, 2],
            J[2, 2],
        )

    @classmethod
    def from_urdf(cls, values: UrdfInertial) -> Inertia:
        """Inverse of :meth:`to_urdf`."""
        v = values
        return cls(
            v.mass, np.array(v.origin_xyz), symmetric([v.ixx, v.iyy, v.izz, v.iyz, v.ixz, v.ixy])
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers under the names of the contract."""
        return {
            "mass": self.mass,
            "center_of_gravity": self.center_of_gravity.tolist(),
            "inertia": self.inertia.tolist(),
        }

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Inertia:
        """From the names of the contract, as in ``truth.json`` or an estimate; other keys are
        passed over.

        Raises:
            KeyError: A name is missing.
            ValueError: A value has the wrong shape, or is null.
        """
        return cls(
            values["mass"], np.asarray(values["center_of_gravity"]), np.asarray(values["inertia"])
        )


class PinocchioParameters(NamedTuple):
    """Pinocchio: mass, first moment, inertia about the origin (elements of the matrix), [kg], [kg
    m], [kg m^2].
    """

    m: float
    mx: float
    my: float
    mz: float
    Ixx: float
    Ixy: float
    Iyy: float
    Ixz: float
    Iyz: float
    Izz: float


class MujocoInertial(NamedTuple):
    """MuJoCo: mass [kg], position of the centre of gravity [m], inertia about it as xx, yy, zz, xy,
    xz, yz [kg m^2].
    """

    mass: float
    pos: tuple[float, ...]
    fullinertia: tuple[float, float, float, float, float, float]


class UrdfInertial(NamedTuple):
    """URDF: mass [kg], origin of the inertial frame [m], inertia in it; products are elements of
    the matrix [kg m^2].
    """

    mass: float
    origin_xyz: tuple[float, ...]
    ixx: float
    ixy: float
    ixz: float
    iyy: float
    iyz: float
    izz: float
