"""What makes one experiment better than another: the worst 1-sigma of the ten parameters in units
of the target.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array
from steelyard.excitation.settings import DEFAULT, DesignSettings
from steelyard.inertia import TEN, Inertia, body_jacobian

_LEAST_DIAGONAL = 1e-300
"""Of a matrix that is scaled to a unit diagonal."""
_RANK = 1e-14
"""Relative singular value below which the scaled information is singular: rounding."""
_LEAST_VARIANCE = 1e-12
"""Of what is left above the floor, so that its powers stay finite."""


@dataclass(frozen=True)
class Target:
    """1-sigma that is wanted."""

    mass: float
    """[kg]"""
    cog: float
    """Of each coordinate of the centre of gravity [m]."""
    inertia: float
    """Of each element of the inertia matrix [kg m^2]."""

    @classmethod
    def default(cls, body: Inertia) -> Target:
        """1 % of the mass, 2 mm, 1 % of the largest moment."""
        return cls(0.01 * body.mass, 0.002, 0.01 * float(np.max(np.diag(body.inertia))))

    @property
    def each(self) -> Array:
        """Of the ten of :data:`steelyard.inertia.BODY_PARAMETERS`, shape (10,)."""
        return np.repeat([self.mass, self.cog, self.inertia], [1, 3, 6])


@dataclass(frozen=True, eq=False)
class OptimalityCriterion:
    """How good an information matrix over body and systematic errors (b in all) is."""

    parameters: Array
    """The ten linear ones of the body, shape (10,)."""
    target: Target
    prior_information: Array
    """Priors, other runs, earlier estimates; shape (b, b)."""
    variance_floor: Array
    """Variances of the ten that no motion lowers, in units of the target, shape (10,)."""
    settings: DesignSettings = DEFAULT

    @classmethod
    def with_floor(
        cls,
        parameters: Array,
        target: Target,
        prior_information: Array,
        information: Array,
        settings: DesignSettings = DEFAULT,
    ) -> OptimalityCriterion:
        """With the floor that motions like one of given information cannot get below."""
        plain = cls(parameters, target, prior_information, np.zeros(TEN), settings)
        ratios, _ = plain.ratios(settings.floor_repetitions * information)
        floor = settings.floor_share * ratios**2
        return cls(parameters, target, prior_information, floor, settings)

    def covariance(self, information: Array) -> Array:
        """Of body (ten linear parameters) and systematic errors, shape (b, b)."""
        matrix = information + self.prior_information
        scale = 1 / np.sqrt(np.maximum(np.diag(matrix), _LEAST_DIAGONAL))
        unit = matrix * np.outer(scale, scale)
        inverse = np.linalg.pinv(unit, rcond=_RANK, hermitian=True)
        return np.asarray(inverse * np.outer(scale, scale))

    def ratios(self, information: Array) -> tuple[Array, Array]:
        """1-sigma of the ten in units of the target, shape (10,), and how border and body covary,
        shape (b, 10).
        """
        jacobian = body_jacobian(self.parameters)
        by = self.covariance(information)[:, :TEN] @ jacobian.T / self.target.each
        variance = np.einsum("ij,ji->i", jacobian, by[:TEN]) / self.target.each
        return np.sqrt(np.maximum(variance, 0.0)), by

    def value(self, information: Array) -> tuple[float, Array]:
        """Logarithm of the norm, and its derivative by the information, symmetric, shape (b, b)."""
        power = self.settings.norm_power
        ratio, by = self.ratios(information)
        above = np.maximum(ratio**2 - self.variance_floor, _LEAST_VARIANCE)
        total = float(np.sum(above**power))
        weight = above ** (power - 1) / total / 2
        return float(np.log(total)) / (2 * power), -(by * weight) @ by.T
