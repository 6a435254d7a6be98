"""What remains of motion that has passed: a quadratic form of the last coefficients and of the
border, about where they were when it passed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from steelyard.arrays import Array
from steelyard.identification.model.segment import NormalEquations, Rows
from steelyard.identification.solve.border.normal_equations import BorderEquations
from steelyard.inertia import TEN


@dataclass(frozen=True, eq=False)
class Point:
    """Values about which equations are linearised."""

    motion: Array
    """Coefficients of the motion, shape (f, block)."""
    border: Array
    """The ten and all calibration parameters, shape (k,)."""


@dataclass(frozen=True, eq=False)
class Linear:
    """Normal equations, and where they were linearised."""

    equations: NormalEquations
    at: Point

    @cached_property
    def _matrix(self) -> Array:
        """Of the motion, shape (N, N): it is small, and asked for again and again."""
        return dense(self.equations.band)

    def seen_from(self, point: Point) -> NormalEquations:
        """The same with the gradient at another point: the matrix stays.

        Args:
            point: With the same coefficients.
        """
        own = self.equations
        motion = (point.motion - self.at.motion).ravel()
        border = point.border - self.at.border
        return replace(
            own,
            motion_gradient=(own.motion_gradient - self._matrix @ motion - own.side @ border),
            border_gradient=own.border_gradient - own.side.T @ motion - own.corner @ border,
            parts={},
        )

    def of_columns(self, use: NDArray[np.intp]) -> Linear:
        """The same with some columns of the border alone; all others stay where they were
        linearised.

        Args:
            use: Which, shape (e,).
        """
        own = self.equations
        narrow = replace(
            own,
            side=own.side[:, use],
            corner=own.corner[np.ix_(use, use)],
            border_gradient=own.border_gradient[use],
            parts={},
        )
        return Linear(narrow, Point(self.at.motion, self.at.border[use]))

    def with_empty_border(self, border: Array) -> Linear:
        """Equations without a border as those of one that they say nothing about.

        Args:
            border: Its values, shape (e,).
        """
        own, count = self.equations, len(border)
        whole = replace(
            own,
            side=np.zeros((own.band.shape[1], count)),
            corner=np.zeros((count, count)),
            border_gradient=np.zeros(count),
        )
        return Linear(whole, Point(self.at.motion, border))


def in_one(rows: Sequence[Rows], use: NDArray[np.intp], border: int) -> Rows:
    """All rows of a short stretch of the motion together, number by number, with derivatives by
    some columns of the border alone: their products are few then.

    Args:
        rows: As they are.
        use: Which columns, shape (e,).
        border: Columns k.

    Returns:
        Without columns where no row follows any.
    """
    place = np.full(border, -1, dtype=np.intp)
    place[use] = np.arange(len(use))
    counts = [each.residual.size for each in rows]
    held = all(each.columns is not None and not len(each.columns) for each in rows)
    by_errors = np.zeros((sum(counts), 1, 0 if held else len(use)))
    start = 0
    for each, count in zip(rows, counts, strict=True):
        columns = place if each.columns is None else place[each.columns]
        kept = np.flatnonzero(columns >= 0)
        if len(kept):
            own = each.by_errors[:, :, kept].reshape(count, len(kept))
            by_errors[start : start + count, 0, columns[kept]] = own
        start += count
    return Rows(
        np.concatenate([np.repeat(each.first, each.residual.shape[1]) for each in rows]),
        np.concatenate([each.residual.reshape(-1, 1) for each in rows]),
        np.concatenate([each.by_motion.reshape(-1, 1, each.by_motion.shape[2]) for each in rows]),
        by_errors,
        np.zeros(0, dtype=np.intp) if held else None,
    )


def narrowed(rows: Rows, use: NDArray[np.intp]) -> Rows:
    """Rows with derivatives by some columns of the border alone, as the only ones there are.

    Args:
        rows: With columns in any order.
        use: Which, ascending, shape (e,).
    """
    assert rows.columns is not None
    place = np.searchsorted(use, rows.columns)
    kept = place < len(use)
    kept[kept] = use[place[kept]] == rows.columns[kept]
    return replace(rows, by_errors=rows.by_errors[:, :, kept], columns=place[kept])


def together(parts: Sequence[NormalEquations], places: Sequence[int]) -> NormalEquations:
    """Equations of parts of a motion as those of the whole.

    Args:
        parts: Over functions in a row each.
        places: First function of each.
    """
    block = parts[0].block
    ends = [p * block + each.band.shape[1] for p, each in zip(places, parts, strict=True)]
    size, border = max(ends), len(parts[0].corner)
    whole = NormalEquations(
        np.zeros((len(parts[0].band), size)),
        np.zeros((size, border)),
        np.zeros((border, border)),
        np.zeros(size),
        np.zeros(border),
        block=block,
    )
    for place, end, each in zip(places, ends, parts, strict=True):
        own = slice(place * block, end)
        whole.band[:, own] += each.band
        whole.side[own] += each.side
        whole.corner[...] += each.corner
        whole.motion_gradient[own] += each.motion_gradient
        whole.border_gradient[...] += each.border_gradient
    return whole


def scaled(rows: Rows, factor: float) -> Rows:
    """Rows of readings that are less noisy by a factor."""
    return replace(
        rows,
        residual=factor * rows.residual,
        by_motion=factor * rows.by_motion,
        by_errors=factor * rows.by_errors,
    )


def eliminated(equations: NormalEquations, kept: int) -> NormalEquations:
    """The same without the functions but the last ones (Schur complement).

    Args:
        equations: Of the past and the chunk that passes.
        kept: Functions that are kept.

    Raises:
        numpy.linalg.LinAlgError: The motion is not determined.
    """
    block, width = equations.block, len(equations.band)
    size, rest = equations.band.shape[1], kept * block
    matrix = dense(equations.band)
    gone = size - rest
    right = np.hstack(
        [matrix[:gone, gone:], equations.side[:gone], equations.motion_gradient[:gone, None]]
    )
    solved = cho_solve(cho_factor(matrix[:gone, :gone], lower=True), right)
    left = right.T @ solved
    last = slice(rest, -1)
    whole = matrix[gone:, gone:] - left[:rest, :rest]
    return NormalEquations(
        banded(whole, width),
        equations.side[gone:] - left[:rest, last],
        equations.corner - left[last, last],
        equations.motion_gradient[gone:] - left[:rest, -1],
        equations.border_gradient - left[last, -1],
        block=block,
    )


def nothing_told(border: int) -> BorderEquations:
    """Equations of no reading."""
    none = np.zeros((TEN, TEN))
    return BorderEquations(np.zeros((border, border)), np.zeros(border), none, 0.0)


def of_border(equations: NormalEquations, point: Array) -> BorderEquations:
    """What equations say of the border about a point, calibration parameters counted from
    nothing.
    """
    if equations.band.any():
        normal, gradient = equations.reduced()
    else:
        # No motion has passed.
        normal, gradient = equations.corner, equations.border_gradient
    none = np.zeros((TEN, TEN))
    return BorderEquations(normal, gradient + normal @ point, none, 0.0)


def dense(band: Array) -> Array:
    """A symmetric matrix in lower banded form as a whole, shape (N, N)."""
    width, size = band.shape
    row, column = _lower(min(width, size), size)
    matrix = np.zeros((size, size))
    matrix[row, column] = matrix[column, row] = band[row - column, column]
    return matrix


def banded(matrix: Array, width: int) -> Array:
    """A symmetric matrix in lower banded form, shape (w, N); the inverse of :func:`dense`.

    Args:
        matrix: Shape (N, N), zero beyond the band.
        width: Rows of the band w.
    """
    size = len(matrix)
    row, column = _lower(min(width, size), size)
    band = np.zeros((width, size))
    band[row - column, column] = matrix[row, column]
    return band


@lru_cache(maxsize=16)
def _lower(width: int, size: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows and columns of the lower half of a banded matrix, as far as its band reaches."""
    row, column = np.tril_indices(size)
    inside = row - column < width
    return row[inside], column[inside]
