"""What remains of motion that has passed: a quadratic form of the last coefficients and of the
border, about where they were when it passed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from steelyard.arrays import Array
from steelyard.identification.model.segment import NormalEquations


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
        return _dense(self.equations.band)

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


def scaled(equations: NormalEquations, factor: float) -> NormalEquations:
    """Equations of readings that count so many times as much."""
    return NormalEquations(
        factor * equations.band,
        factor * equations.side,
        factor * equations.corner,
        factor * equations.motion_gradient,
        factor * equations.border_gradient,
        block=equations.block,
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
    matrix = _dense(equations.band)
    gone = size - rest
    right = np.hstack(
        [matrix[:gone, gone:], equations.side[:gone], equations.motion_gradient[:gone, None]]
    )
    solved = cho_solve(cho_factor(matrix[:gone, :gone], lower=True), right)
    left = right.T @ solved
    last = slice(rest, -1)
    whole = matrix[gone:, gone:] - left[:rest, :rest]
    band = np.zeros((width, rest))
    for d in range(rest):
        band[d, : rest - d] = np.diagonal(whole, -d)
    return NormalEquations(
        band,
        equations.side[gone:] - left[:rest, last],
        equations.corner - left[last, last],
        equations.motion_gradient[gone:] - left[:rest, -1],
        equations.border_gradient - left[last, -1],
        block=block,
    )


def _dense(band: Array) -> Array:
    """A symmetric matrix in lower banded form as a whole, shape (N, N)."""
    width, size = band.shape
    matrix = np.zeros((size, size))
    for d in range(min(width, size)):
        own = np.arange(size - d)
        matrix[own + d, own] = matrix[own, own + d] = band[d, : size - d]
    return matrix
