"""The information of an experiment that has not been made yet, and how it follows from the
commanded motion.

The same matrix as that of the bound and of maximum likelihood: motion, body and systematic errors
unknown together, the motion eliminated. Readings of a quantity are taken at instants of a grid,
each standing for as many as its rate gives.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from steelyard.arrays import Array
from steelyard.excitation.information.instrument_information import (
    InstrumentInformation,
    instrument_information,
)
from steelyard.excitation.information.linearisation_point import LinearisationPoint
from steelyard.excitation.settings import DEFAULT, DesignSettings
from steelyard.identification.model.motion_segment import Segment, holding_rows
from steelyard.identification.model.segment import (
    POSE,
    Basis,
    NormalEquations,
    Rows,
    spread,
)
from steelyard.inertia import TEN


@dataclass(frozen=True, eq=False)
class PredictedInformation:
    """Of a run of given length, as a function of its n commands."""

    point: LinearisationPoint
    segment: Segment
    """Knots and smoothness of the motion as the estimator would have it; its coefficients are those
    of some motion."""
    duration: float
    """[s]"""
    settings: DesignSettings = DEFAULT

    @cached_property
    def border(self) -> int:
        """Number of border parameters b, see :class:`.InstrumentInformation`."""
        uncertain = self.point.calibration.calibration_parameters.deviation > 0
        return TEN + int(uncertain.sum())

    @cached_property
    def instruments(self) -> tuple[InstrumentInformation, ...]:
        """Every quantity of every instrument."""
        return tuple(instrument_information(self.point))

    @cached_property
    def times(self) -> Array:
        """Instants [s], shape (n,): middles of equal steps."""
        n = int(np.ceil(self.settings.instants_per_knot * self.duration / self.segment.spacing))
        return (np.arange(n) + 0.5) * self.duration / n

    @cached_property
    def _basis(self) -> Basis:
        return self.segment.basis(self.times)

    def information(self, commands: Array) -> tuple[Array, InformationTerms]:
        """Information on the border, shape (b, b), and what its gradient is made of.

        Args:
            commands: Pose and derivatives at :attr:`times`, shape (n, 24).
        """
        local = self._basis
        derivatives = tuple(self._weighted(each, commands) for each in self.instruments)
        rows = []
        for instrument, (by_motion, by_border) in zip(self.instruments, derivatives, strict=True):
            n, k, _ = by_motion.shape
            by_order = by_motion.reshape(n, k, -1, POSE).transpose(2, 0, 1, 3)
            by_coefficients = spread(local, *by_order)
            none = np.zeros((n, k))
            rows.append(Rows(local.first, none, by_coefficients, by_border, instrument.columns))
        rows.append(holding_rows(self.segment))
        equations = self.segment.smooth(self.segment.equations(self.border, rows))
        return equations.reduced()[0], InformationTerms(commands, derivatives, equations)

    def gradient(self, terms: InformationTerms, weight: Array) -> Array:
        """Gradient of the sum of weight times information by the commands, shape (n, 24).

        With the motion that follows the border the information is a plain sum over instants, which
        is stationary in that motion: one adjoint evaluation of each instant.

        Args:
            terms: From :meth:`information`.
            weight: Symmetric, shape (b, b).
        """
        following = self._following(terms)
        total = np.zeros_like(terms.commands)
        for instrument, derivatives in zip(self.instruments, terms.derivatives, strict=True):
            by_border = _total_derivative(instrument, derivatives, following)
            weights = 2 * self._root(instrument) * (by_border @ weight)
            total += instrument.gradient(
                terms.commands,
                weights @ following.transpose(0, 2, 1),
                weights[:, :, instrument.columns],
            )
        return total

    def shares(self, terms: InformationTerms, directions: Array) -> Array:
        """What every instant adds to the information along some directions of the border, shape (n,
        d).

        Args:
            terms: From :meth:`information`.
            directions: Shape (b, d).
        """
        following = self._following(terms)
        total = np.zeros((len(self.times), directions.shape[1]))
        for instrument, derivatives in zip(self.instruments, terms.derivatives, strict=True):
            along = _total_derivative(instrument, derivatives, following) @ directions
            total = total + np.sum(along**2, axis=1)
        return total

    def _following(self, terms: InformationTerms) -> Array:
        """How the eliminated motion at every instant follows the border, order by order, shape (n,
        21, b).
        """
        coefficients = -terms.equations.followed.reshape(-1, POSE, self.border)
        local = self._basis
        near = coefficients[local.first[:, None] + np.arange(local.values.shape[2])]
        orders = np.einsum("oni,nidb->nodb", local.values[:3], near)
        return np.asarray(orders.reshape(len(self.times), -1, self.border))

    def _root(self, instrument: InstrumentInformation) -> float:
        """Root of the number of readings that an instant stands for."""
        return float(np.sqrt(instrument.rate * self.duration / len(self.times)))

    def _weighted(self, instrument: InstrumentInformation, commands: Array) -> tuple[Array, Array]:
        """Derivatives by motion and border, each instant for all readings that it stands for."""
        by_motion, by_border = instrument.derivatives(commands)
        return self._root(instrument) * by_motion, self._root(instrument) * by_border


@dataclass(frozen=True, eq=False)
class InformationTerms:
    """Commands and the normal equations of what would be read of them."""

    commands: Array
    """Shape (n, 24)."""
    derivatives: tuple[tuple[Array, Array], ...]
    """Of every instrument, by motion and by border, weighted."""
    equations: NormalEquations


def _total_derivative(
    instrument: InstrumentInformation, derivatives: tuple[Array, Array], following: Array
) -> Array:
    """Derivative of what is read by the border, with the motion that follows it, shape (n, k,
    b).
    """
    by_motion, by_border = derivatives
    total = by_motion @ following
    total[:, :, instrument.columns] += by_border
    return np.asarray(total)
