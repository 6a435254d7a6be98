"""Readings of a short stretch of the motion, linearised, as equations of motion and border."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.identification.model.balance import Forces
from steelyard.identification.model.motion_segment import Segment
from steelyard.identification.model.segment import Rows
from steelyard.identification.recursive.window.past import Linear, Point, in_one
from steelyard.identification.solve.border.segment_equations import whitened_rows
from steelyard.identification.solve.fit_state import FitState, Task


@dataclass(frozen=True, eq=False)
class Chunk:
    """Readings of a short stretch of the motion."""

    segment: Segment
    forces: Forces
    rows: Sequence[Rows]
    """Their residuals with derivatives by the columns of the border that are estimated, or by
    more."""
    border: Array
    """The ten and all calibration parameters where they were linearised, shape (k,)."""
    use: NDArray[np.intp]
    """Columns of the border that are estimated, shape (e,)."""
    task: Task
    """What is fitted."""
    state: FitState
    """Where they were linearised."""
    every: bool = False
    """Whether their derivatives are by all columns of the border."""

    @cached_property
    def linear(self) -> Linear:
        """Equations with the smoothness of the motion, over the columns that are estimated: most
        are not, and steps ask for none of these.
        """
        if self.every:
            # Both are asked for, and to sum up once is less than twice.
            return self.whole.of_columns(self.use)
        own = in_one(self.rows, self.use, len(self.border))
        if own.columns is None:
            return self._of([own], self.border[self.use])
        # Rows that follow no column of the border: the columns stay empty.
        return self._of([own], np.zeros(0)).with_empty_border(self.border[self.use])

    @cached_property
    def whole(self) -> Linear:
        """The same over all columns, which are hardly ever asked for."""
        rows = self.rows
        if not self.every:
            _, rows = whitened_rows(self.task, self.state, self.segment, self.forces)
        return self._of(rows, self.border)

    def _of(self, rows: Sequence[Rows], border: Array) -> Linear:
        """Equations of rows with what is known of motion and processes."""
        equations = self.segment.smooth(self.segment.equations(len(border), rows))
        return Linear(equations, Point(self.segment.coefficients, border))
