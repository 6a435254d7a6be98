"""An arc: a stretch of one run in which the pose is one spline in time, and what the instruments read along it.

The pose is position over quaternion; the quaternion's length is free, since no state depends on it, and is held near one.
Readings are linearised about the spline by the instruments' own measurement equations. The normal matrix of the spline's
coefficients is banded; systematic errors, which act on all of it, border it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.sparse import csr_array, diags_array

from steelyard.arrays import Array
from steelyard.identification.smoothing import DEGREE

POSE = 7
"""Numbers in a pose: position and quaternion."""
WIDTH = POSE * (DEGREE + 1)
"""Coefficients that a pose depends on at one instant."""


@dataclass(frozen=True, eq=False)
class Basis:
    """Spline functions that are not zero at n times."""

    first: NDArray[np.intp]
    """First of them, shape (n,)."""
    values: Array
    """Of the functions and their derivatives, order on axis 0, shape (4, n, 6)."""


def basis(knots: Array, times: Array) -> Basis:
    """B-splines and their first three derivatives at times within the knots.

    Args:
        knots: Of a quintic spline [s].
        times: [s], shape (n,).
    """
    n, functions = len(times), len(knots) - DEGREE - 1
    first = np.clip(np.searchsorted(knots, times, side="right") - 1, DEGREE, functions - 1) - DEGREE
    columns = first[:, None] + np.arange(DEGREE + 1)
    values = np.empty((4, n, DEGREE + 1))
    # The derivative of a spline has the differences of its coefficients as its own, on knots of one degree less.
    differences = diags_array(np.ones(functions), format="csr")
    for order in range(4):
        degree = DEGREE - order
        inner = knots[order : len(knots) - order]
        design = csr_array(BSpline.design_matrix(times, inner, degree)) @ differences
        values[order] = np.asarray(design[np.arange(n)[:, None], columns].todense()).reshape(n, -1)
        count = len(inner) - degree - 1
        if degree:
            scale = degree / (inner[degree + 1 : degree + count] - inner[1:count])
            step = diags_array([-scale, scale], offsets=[0, 1], shape=(count - 1, count), format="csr")
            differences = step @ differences
    return Basis(first.astype(np.intp), values)


@dataclass(frozen=True, eq=False)
class Rows:
    """Linearised readings of n samples, whitened, k numbers each."""

    first: NDArray[np.intp]
    """First coefficient function that each depends on, ascending, shape (n,)."""
    residual: Array
    """Shape (n, k)."""
    by_motion: Array
    """Derivative by the coefficients, shape (n, k, 42)."""
    by_errors: Array
    """Derivative by the border parameters, shape (n, k, b)."""


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """Banded matrix with a border: N coefficients of the motion and b parameters that act on all of it."""

    band: Array
    """Lower banded form, shape (42, N)."""
    side: Array
    """Between motion and border, shape (N, b)."""
    corner: Array
    """Shape (b, b)."""
    motion_gradient: Array
    """Minus half the gradient of the cost by the coefficients, shape (N,)."""
    border_gradient: Array
    """The same by the border parameters, shape (b,)."""

    def reduced(self) -> tuple[Array, Array]:
        """Matrix and right-hand side of the border with the motion eliminated (Schur complement), shapes (b, b) and (b,).

        Raises:
            numpy.linalg.LinAlgError: The motion is not determined.
        """
        factor = cholesky_banded(self.band, lower=True)
        solved = cho_solve_banded((factor, True), np.column_stack([self.side, self.motion_gradient]))
        return (
            self.corner - self.side.T @ solved[:, :-1],
            self.border_gradient - self.side.T @ solved[:, -1],
        )

    def motion_step(self, border: Array) -> Array:
        """Step of the coefficients that goes with a step of the border, shape (N,)."""
        factor = cholesky_banded(self.band, lower=True)
        return np.asarray(cho_solve_banded((factor, True), self.motion_gradient - self.side @ border))


_ROW, _COLUMN = np.tril_indices(WIDTH)


def accumulate(functions: int, border: int, rows: Iterator[Rows]) -> NormalEquations:
    """Normal equations of linearised readings.

    Args:
        functions: Spline functions of the arc.
        border: Number of border parameters.
        rows: All there are.
    """
    size = functions * POSE
    band, side = np.zeros((WIDTH, size)), np.zeros((size, border))
    corner, by_motion, by_border = np.zeros((border, border)), np.zeros(size), np.zeros(border)
    for part in rows:
        edges = np.flatnonzero(np.diff(part.first, prepend=-1, append=-1))
        for start, end in pairwise(edges):
            A = part.by_motion[start:end].reshape(-1, WIDTH)
            E = part.by_errors[start:end].reshape(-1, border)
            r = part.residual[start:end].ravel()
            place = int(part.first[start]) * POSE
            local = slice(place, place + WIDTH)
            band[_ROW - _COLUMN, place + _COLUMN] += (A.T @ A)[_ROW, _COLUMN]
            side[local] += A.T @ E
            corner += E.T @ E
            by_motion[local] -= A.T @ r
            by_border -= E.T @ r
    return NormalEquations(band, side, corner, by_motion, by_border)


def spread(basis: Basis, *by_order: Array) -> Array:
    """Derivatives by pose, rate, acceleration as derivatives by the coefficients.

    Args:
        basis: At n times.
        *by_order: Shape (n, k, 7) each, the first by the pose.

    Returns:
        Shape (n, k, 42).
    """
    n, k, _ = by_order[0].shape
    total = np.zeros((n, k, DEGREE + 1, POSE))
    for order, jacobian in enumerate(by_order):
        total += basis.values[order][:, None, :, None] * jacobian[:, :, None, :]
    return total.reshape(n, k, WIDTH)


def motion_at(basis: Basis, coefficients: Array) -> tuple[Array, Array, Array, Array]:
    """Pose and its first three time derivatives, shape (n, 7) each.

    Args:
        basis: At n times.
        coefficients: Of the spline, shape (f, 7).
    """
    local = coefficients[basis.first[:, None] + np.arange(DEGREE + 1)]
    pose, rate, acceleration, jerk = np.einsum("oni,nid->ond", basis.values, local)
    return pose, rate, acceleration, jerk
