"""Inertia per mass: what free swinging tells of a body that nobody has weighed."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from steelyard.arrays import Array
from steelyard.inertia import symmetric

PER_MASS_PARAMETERS = (
    "cx",
    "cy",
    "cz",
    "Jxx/m",
    "Jyy/m",
    "Jzz/m",
    "Jyz/m",
    "Jxz/m",
    "Jxy/m",
)
"""Centre of gravity [m] and inertia about it over the mass [m^2]."""


@dataclass(frozen=True, eq=False)
class PerMass:
    """Centre of gravity and inertia over mass; NaN where the data do not tell one."""

    value: Array
    """The nine of :data:`PER_MASS_PARAMETERS`, shape (9,)."""
    covariance: Array
    """Shape (9, 9)."""

    @classmethod
    def of(cls, value: Array, covariance: Array) -> PerMass:
        """Of the ten of :data:`steelyard.inertia.BODY_PARAMETERS` and their covariance, shapes
        (10,) and (10, 10).
        """
        jacobian = cls.jacobian(value)
        known = np.isfinite(value[1:])
        whole = np.where(np.isfinite(covariance), covariance, 0.0)
        spread = jacobian @ whole @ jacobian.T
        return cls(
            np.concatenate([value[1:4], value[4:] / value[0]]),
            np.where(np.outer(known, known), (spread + spread.T) / 2, np.nan),
        )

    @staticmethod
    def jacobian(value: Array) -> Array:
        """Derivative of the nine by the ten body parameters, shape (9, 10)."""
        mass, ratios = value[0], value[4:] / value[0]
        found = np.zeros((9, 10))
        found[:3, 1:4] = np.eye(3)
        found[3:, 4:] = np.eye(6) / mass
        found[3:, 0] = -np.where(np.isfinite(ratios), ratios, 0.0) / mass
        return found

    def about(self, point: Array) -> PerMass:
        """The same in a platform frame whose origin is at a point of the present one.

        Args:
            point: In the platform frame [m], shape (3,).
        """
        return replace(self, value=self.value - np.concatenate([point, np.zeros(6)]))

    @property
    def inertia(self) -> Array:
        """About the centre of gravity over the mass, platform axes [m^2], shape (3, 3)."""
        return symmetric(self.value[3:])

    @property
    def standard_deviation(self) -> Array:
        """1-sigma of the nine, shape (9,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))
