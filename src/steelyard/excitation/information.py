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
from steelyard.excitation.sight import Sight, View, sights
from steelyard.identification.model.motion_residuals import Segment, holding_rows
from steelyard.identification.model.segment import (
    POSE,
    Basis,
    NormalEquations,
    Rows,
    accumulate,
    spread,
)
from steelyard.smoothing import DEGREE

_PER_KNOT = 2.0
"""Instants of the grid between two knots of the motion."""


@dataclass(frozen=True, eq=False)
class Outlook:
    """What is seen along a run of given length, whatever the motion."""

    view: View
    segment: Segment
    """Knots and smoothness of the motion as the estimator would have it; its coefficients are those
    of some motion."""
    duration: float
    """[s]"""
    border: int
    """Number of border parameters, see :class:`.Sight`."""

    @cached_property
    def sights(self) -> tuple[Sight, ...]:
        """All that is seen."""
        return tuple(sights(self.view))

    @cached_property
    def times(self) -> Array:
        """Instants [s], shape (n,): middles of equal steps."""
        spacing = self.segment.knots[DEGREE + 1] - self.segment.knots[DEGREE]
        n = int(np.ceil(_PER_KNOT * self.duration / spacing))
        return (np.arange(n) + 0.5) * self.duration / n

    @cached_property
    def _basis(self) -> Basis:
        return self.segment.basis(self.times)

    def information(self, commands: Array) -> tuple[Array, Seen]:
        """Information on the border, shape (b, b), and what its slope is made of.

        Args:
            commands: Pose and derivatives at :attr:`times`, shape (n, 24).
        """
        rows, local = [], self._basis
        derivatives = tuple(self._weighted(sight, commands) for sight in self.sights)
        for sight, (by_motion, by_border) in zip(self.sights, derivatives, strict=True):
            n, k, _ = by_motion.shape
            by_order = by_motion.reshape(n, k, -1, POSE).transpose(2, 0, 1, 3)
            rows.append(
                Rows(
                    local.first,
                    np.zeros((n, k)),
                    spread(local, *by_order),
                    by_border,
                    sight.columns,
                )
            )
        held = holding_rows(self.segment)
        equations = self.segment.smooth(
            accumulate(len(self.segment.coefficients), self.border, [*rows, held])
        )
        return equations.reduced()[0], Seen(commands, derivatives, equations)

    def slope(self, seen: Seen, weight: Array) -> Array:
        """Derivative of the sum of weight times information by the commands, shape (n, 24).

        Args:
            seen: From :meth:`information`.
            weight: Symmetric, shape (b, b).
        """
        moved = self._moved(seen)
        total = np.zeros_like(seen.commands)
        for sight, derivatives in zip(self.sights, seen.derivatives, strict=True):
            left = 2 * self._root(sight) * (_left(sight, derivatives, moved) @ weight)
            total += sight.slope(
                seen.commands, left @ moved.transpose(0, 2, 1), left[:, :, sight.columns]
            )
        return total

    def shares(self, seen: Seen, by: Array) -> Array:
        """What every instant adds to the information along some directions of the border, shape (n,
        d).

        The motion follows the border; what is seen of both together adds up over the instants to
        the information.

        Args:
            seen: From :meth:`information`.
            by: Directions, shape (b, d).
        """
        moved = self._moved(seen)
        lefts = (
            _left(sight, each, moved)
            for sight, each in zip(self.sights, seen.derivatives, strict=True)
        )
        return np.asarray(sum(np.sum((left @ by) ** 2, axis=1) for left in lefts))

    def _moved(self, seen: Seen) -> Array:
        """How the motion at every instant follows the border, order by order, shape (n, 21, b)."""
        followed = -seen.equations.followed.reshape(-1, POSE, self.border)
        local = self._basis
        near = followed[local.first[:, None] + np.arange(local.values.shape[2])]
        orders = np.einsum("oni,nidb->nodb", local.values[:3], near)
        return np.asarray(orders.reshape(len(self.times), -1, self.border))

    def _root(self, sight: Sight) -> float:
        """Root of the number of readings that an instant stands for."""
        return float(np.sqrt(sight.rate * self.duration / len(self.times)))

    def _weighted(self, sight: Sight, commands: Array) -> tuple[Array, Array]:
        """Derivatives by motion and border, each instant for all readings that it stands for."""
        by_motion, by_border = sight.derivatives(commands)
        return self._root(sight) * by_motion, self._root(sight) * by_border


@dataclass(frozen=True, eq=False)
class Seen:
    """Commands and the normal equations of what would be seen of them."""

    commands: Array
    derivatives: tuple[tuple[Array, Array], ...]
    """Of every sight, by motion and by border, weighted."""
    equations: NormalEquations


def _left(sight: Sight, derivatives: tuple[Array, Array], moved: Array) -> Array:
    """Derivative of what is seen by the border, with the motion that follows it, shape (n, k,
    b).
    """
    by_motion, by_border = derivatives
    left = by_motion @ moved
    left[:, :, sight.columns] += by_border
    return np.asarray(left)
