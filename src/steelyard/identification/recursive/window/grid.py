"""Knots that go on for as long as data arrive, in chunks of equal length."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from steelyard.arrays import Array
from steelyard.identification.model.motion_segment import Segment, jerk_matrices
from steelyard.identification.model.processes import SplineIntegrals, ends_of, integrals_of
from steelyard.identification.model.segment import basis, values_at
from steelyard.smoothing import DEGREE

_DENSE = 6
"""Instants between two knots at which a motion is taken over to other knots."""


@dataclass(frozen=True, eq=False)
class KnotGrid:
    """Knots of equal spacing; a chunk has so many intervals between them, and its matrices are
    those of every other.
    """

    start: float
    """Of the first chunk [s]."""
    spacing: float
    """Between knots [s]."""
    intervals: int
    """Of a chunk."""
    block: int
    """Coefficients of one spline function."""

    @property
    def length(self) -> float:
        """Of a chunk [s]."""
        return self.spacing * self.intervals

    @property
    def functions(self) -> int:
        """That are not zero within a chunk; the last :data:`.DEGREE` of them are the first of the
        next one.
        """
        return self.intervals + DEGREE

    def span(self, number: int) -> tuple[float, float]:
        """Where a chunk begins and ends [s]."""
        return self.start + number * self.length, self.start + (number + 1) * self.length

    def knots(self, number: int, count: int = 1) -> Array:
        """Of chunks in a row [s].

        Args:
            number: Of the first of them.
            count: Of them.
        """
        first = number * self.intervals
        places = np.arange(first - DEGREE, first + count * self.intervals + DEGREE + 1)
        return np.asarray(self.start + self.spacing * places, dtype=float)

    @cached_property
    def jerks(self) -> dict[str, Array]:
        """See :func:`.jerk_matrices`, of a chunk."""
        return jerk_matrices(self.knots(0), self.block)

    @cached_property
    def integrals(self) -> SplineIntegrals:
        """See :func:`.integrals_of`, of a chunk."""
        return integrals_of(self.knots(0))

    @cached_property
    def ends(self) -> tuple[Array, Array]:
        """See :func:`.ends_of`, of a chunk."""
        return ends_of(self.knots(0))


def coefficients_on(grid: KnotGrid, segment: Segment) -> Array:
    """Coefficients of a segment on a grid, of the chunks that it covers, shape (f, block)."""
    count = int((segment.span[1] - grid.start) // grid.length)
    if not count:
        return np.zeros((0, segment.block))
    knots = grid.knots(0, count)
    end = grid.start + count * grid.length
    times = np.linspace(grid.start, end, _DENSE * count * grid.intervals + 1)
    local = basis(knots, times)
    matrix = np.zeros((len(times), len(knots) - DEGREE - 1))
    np.put_along_axis(matrix, local.first[:, None] + np.arange(DEGREE + 1), local.values[0], axis=1)
    values = values_at(segment.basis(times), segment.coefficients)
    coefficients, *_ = np.linalg.lstsq(matrix, values, rcond=None)
    return np.asarray(coefficients)
