"""What makes one experiment better than another: the worst 1-sigma of the ten parameters in units
of what is wanted.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array
from steelyard.identification.solve.normal_equations import TEN
from steelyard.inertia import Inertia, body_jacobian

_POWER = 2.0
"""Of the variances in units of the wanted ones: their norm stands for the worst of them, and still
asks for all others."""
_REPEATED = 1e6
"""Times that an experiment is repeated to see what no motion can tell, such as a gain that all
force sensors share."""
_OF_THAT = 0.99
"""Part of it that is taken off, so that something is left."""


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
class Criterion:
    """How good an information matrix over body and systematic errors is."""

    parameters: Array
    """The ten linear ones of the body, shape (10,)."""
    target: Target
    known: Array
    """Information that is there anyway: priors, other runs, earlier estimates; shape (b, b)."""
    untold: Array
    """Variances of the ten that no motion improves, in units of the wanted ones, shape (10,)."""

    @classmethod
    def about(
        cls, parameters: Array, target: Target, known: Array, information: Array
    ) -> Criterion:
        """For experiments like one whose information is given."""
        plain = cls(parameters, target, known, np.zeros(TEN))
        return cls(
            parameters, target, known, _OF_THAT * plain.ratios(_REPEATED * information)[0] ** 2
        )

    def covariance(self, information: Array) -> Array:
        """Of body (ten linear parameters) and systematic errors, shape (b, b)."""
        matrix = information + self.known
        scale = 1 / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
        inverse = np.linalg.pinv(matrix * np.outer(scale, scale), rcond=1e-14, hermitian=True)
        return np.asarray(inverse * np.outer(scale, scale))

    def ratios(self, information: Array) -> tuple[Array, Array]:
        """1-sigma of the ten in units of the target, shape (10,), and how border and body covary,
        shape (b, 10).
        """
        by = (
            self.covariance(information)[:, :TEN]
            @ body_jacobian(self.parameters).T
            / self.target.each
        )
        variance = (
            np.einsum("ij,ji->i", body_jacobian(self.parameters), by[:TEN]) / self.target.each
        )
        return np.sqrt(np.maximum(variance, 0.0)), by

    def value(self, information: Array) -> tuple[float, Array]:
        """Logarithm of the norm, and its derivative by the information, symmetric, shape (b, b)."""
        ratio, by = self.ratios(information)
        left = np.maximum(ratio**2 - self.untold, 1e-12)
        total = float(np.sum(left**_POWER))
        weight = left ** (_POWER - 1) / total / 2
        return float(np.log(total)) / (2 * _POWER), -(by * weight) @ by.T
