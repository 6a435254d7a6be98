"""A segment: a stretch of one run in which the pose is one spline in time, and what the instruments
read along it.

The pose is position over quaternion; the quaternion's length is free, since no state depends on it,
and is held near one. Readings are linearised about the spline by the instruments' own measurement
equations. The normal matrix of the spline's coefficients is banded; systematic errors, which act on
all of it, border it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky_banded
from scipy.linalg.lapack import dtbtrs

from steelyard.arrays import Array
from steelyard.identification.banded import (
    banded_product,
    banded_sum,
    banded_trace,
    banded_window,
    selected_inverse,
    solved,
)
from steelyard.smoothing import DEGREE

POSE = 7
"""Numbers in a pose: position and quaternion."""
WIDTH = POSE * (DEGREE + 1)
"""Coefficients that a pose depends on at one instant."""

_EQUAL = 1e-9
"""Part of the spacing of knots by which it may differ and still be the same."""
_ROUNDING = 1e-11
"""Part of its diagonal by which a matrix that rounding has made indefinite is held."""
Label = tuple[str, str] | None
"""What rows are readings of: instrument and quantity; None: of nothing."""


@dataclass(frozen=True, eq=False)
class Basis:
    """Spline functions that are not zero at n times."""

    first: NDArray[np.intp]
    """First of them, shape (n,)."""
    values: Array
    """Of the functions and their derivatives, order on axis 0, shape (4, n, 6); of poses at rest
    (4, n, 1)."""


def basis(knots: Array, times: Array) -> Basis:
    """B-splines and their first three derivatives at times within the knots.

    Between knots of equal spacing, which nearly all are, by the polynomials that they are there;
    else by Cox and de Boor's recursion over all times at once, in which a derivative is made of
    differences of functions of one degree less [DeBoor1978]_.

    Args:
        knots: Of a quintic spline [s].
        times: [s], shape (n,).
    """
    n, functions = len(times), len(knots) - DEGREE - 1
    interval = np.clip(np.searchsorted(knots, times, side="right") - 1, DEGREE, functions - 1)
    first = (interval - DEGREE).astype(np.intp)
    steps = np.diff(knots)
    spacing = float(knots[-1] - knots[0]) / len(steps)
    if np.abs(steps - spacing).max() < _EQUAL * spacing:
        behind = np.vander((times - knots[interval]) / spacing, DEGREE + 1, increasing=True)
        return Basis(first, behind @ (_pieces() / spacing ** np.arange(4.0)[:, None, None]))
    # What lies around each time: knot j of the interval's neighbours is own[j + DEGREE].
    own = knots[interval[:, None] + np.arange(-DEGREE, DEGREE + 2)].T
    powers = [np.ones((1, n))]
    since, until = times - own[: DEGREE + 1], own[DEGREE + 1 :] - times
    for degree in range(1, DEGREE + 1):
        left, right = since[DEGREE - degree + 1 :], until[:degree]
        share = powers[-1] / (left + right)
        raised = np.empty((degree + 1, n))
        raised[0] = 0.0
        np.multiply(left, share, out=raised[1:])
        raised[:-1] += right * share
        powers.append(raised)
    # A rate of a function is the difference of two of one degree less, over their lengths.
    by_length = {
        degree: degree / (since[DEGREE - degree + 1 :] + until[:degree])
        for degree in range(DEGREE - 2, DEGREE + 1)
    }
    values = np.empty((4, n, DEGREE + 1))
    for order in range(4):
        found = powers[DEGREE - order]
        for degree in range(DEGREE - order + 1, DEGREE + 1):
            slope = found * by_length[degree]
            found = np.empty((degree + 1, n))
            found[0] = 0.0
            found[1:] = slope
            found[:-1] -= slope
        values[order] = found.T
    return Basis(first, values)


@cache
def _pieces() -> Array:
    """Spline functions of knots that are one apart, and their first three derivatives, between two
    of them: coefficients of the powers of what lies behind the first one, shape (4, 6, 6), powers
    on axis 1, functions on axis 2 [DeBoor1978]_.
    """
    u = np.polynomial.Polynomial([0.0, 1.0])
    nothing = 0.0 * u
    functions = [1.0 + nothing]
    for degree in range(1, DEGREE + 1):
        before = [nothing, *functions, nothing]
        functions = [
            ((u + degree - j) * before[j] + (j + 1 - u) * before[j + 1]) / degree
            for j in range(degree + 1)
        ]
    found = np.zeros((4, DEGREE + 1, DEGREE + 1))
    for order in range(4):
        for j, each in enumerate(functions):
            coefficients = (each.deriv(order) if order else each).coef
            found[order, : len(coefficients), j] = coefficients
    return found


def quadrature(knots: Array, count: int) -> tuple[Basis, Array]:
    """Spline functions at the nodes of Gauss and Legendre between the knots, and the weights of
    these [s], shape (n,).

    Args:
        knots: Of a quintic spline [s].
        count: Nodes between two knots: exact for polynomials of degree 2 count - 1.
    """
    inner = knots[DEGREE : len(knots) - DEGREE]
    nodes, weights = np.polynomial.legendre.leggauss(count)
    half = np.diff(inner) / 2
    times = ((inner[1:] + inner[:-1]) / 2)[:, None] + half[:, None] * nodes
    return basis(knots, times.ravel()), (half[:, None] * weights).ravel()


def at_rest(poses: NDArray[np.intp]) -> Basis:
    """Basis of samples of poses at rest, each of which stands alone.

    Args:
        poses: Number of the pose of each sample, shape (n,).
    """
    values = np.zeros((4, len(poses), 1))
    values[0] = 1.0
    return Basis(np.asarray(poses, dtype=np.intp), values)


@dataclass(frozen=True, eq=False)
class Rows:
    """Linearised readings of n samples, whitened, k numbers each."""

    first: NDArray[np.intp]
    """First coefficient function that each depends on, shape (n,)."""
    residual: Array
    """Shape (n, k)."""
    by_motion: Array
    """Derivative by the coefficients of the functions at that instant, shape (n, k, 42), or (n, k,
    7) where each sample has a pose of its own."""
    by_errors: Array
    """Derivative by border parameters, shape (n, k, c)."""
    columns: NDArray[np.intp] | None = None
    """Which of the border parameters these are, shape (c,); None: all."""
    label: Label = None
    """What they are readings of."""

    @property
    def without_border(self) -> Rows:
        """The same with the border held."""
        none = self.by_errors[:, :, :0]
        return replace(self, by_errors=none, columns=np.zeros(0, dtype=np.intp))


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """Banded matrix with a border: N coefficients of the motion and b parameters that act on all of
    it.
    """

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
    parts: Mapping[Label, Array] = field(default_factory=dict)
    """Label of rows -> what they have added to the band."""
    block: int = POSE
    """Coefficients of one spline function: of the pose, and of processes beside it."""

    def __add__(self, other: NormalEquations) -> NormalEquations:
        """Of both kinds of readings."""
        return NormalEquations(
            banded_sum([self.band, other.band]),
            self.side + other.side,
            self.corner + other.corner,
            self.motion_gradient + other.motion_gradient,
            self.border_gradient + other.border_gradient,
            {**self.parts, **other.parts},
            self.block,
        )

    @cached_property
    def factor(self) -> Array:
        """Cholesky factor of the motion's matrix, lower banded form.

        Raises:
            numpy.linalg.LinAlgError: The motion is not determined.
        """
        try:
            return np.asarray(cholesky_banded(self.band, lower=True, check_finite=False))
        except np.linalg.LinAlgError:
            # A place that only accelerations tell is known many orders worse than its third
            # derivative is held.
            held = self.band.copy()
            held[0] *= 1 + _ROUNDING
            return np.asarray(cholesky_banded(held, lower=True, check_finite=False))

    def solve(self, right: Array) -> Array:
        """Solve with the motion's matrix."""
        return solved(self.factor, right, self.block)

    @cached_property
    def followed(self) -> Array:
        """How the motion follows the border parameters, with the opposite sign, shape (N, b)."""
        return self.solve(self.side)

    @cached_property
    def settled(self) -> Array:
        """Step of the motion with the border held, shape (N,)."""
        return self.solve(self.motion_gradient)

    def drawn(self, rng: np.random.Generator) -> Array:
        """Coefficients with the covariance that the motion's matrix leaves, shape (N,)."""
        white = rng.standard_normal(self.factor.shape[1])
        solved, _ = dtbtrs(self.factor, white, uplo="L", trans="T")
        return np.asarray(solved)

    def reduced(self) -> tuple[Array, Array]:
        """Matrix and right-hand side of the border with the motion eliminated (Schur complement),
        shapes (b, b) and (b,).

        Raises:
            numpy.linalg.LinAlgError: The motion is not determined.
        """
        return (
            self.corner - self.side.T @ self.followed,
            self.border_gradient - self.side.T @ self.settled,
        )

    def motion_step(self, border: Array) -> Array:
        """Step of the coefficients that goes with a step of the border, shape (N,)."""
        return np.asarray(self.settled - self.followed @ border)

    @property
    def log_determinant(self) -> float:
        """Of the motion's matrix."""
        return float(2 * np.sum(np.log(self.factor[0])))

    @cached_property
    def inverse(self) -> Array:
        """Inverse of the motion's matrix as far as its own band reaches, lower banded form, shape
        (42, N).

        Formed by recursion over blocks of the factor [Takahashi1973]_: linear in the length.
        """
        return selected_inverse(self.factor, self.block)

    def spent(self) -> dict[Label, float]:
        """Label of rows -> degrees of freedom that the motion takes of them."""
        return {label: banded_trace(part, self.inverse) for label, part in self.parts.items()}

    def stiffened(self, bands: Iterable[Array], coefficients: Array) -> NormalEquations:
        """The same with a quadratic cost of the coefficients themselves.

        Args:
            bands: Its matrices, lower banded form, shape (42, N) each; their sum counts.
            coefficients: Present ones, shape (f, block).
        """
        total = banded_sum(bands)
        pull = banded_product(total, coefficients.ravel())
        return replace(
            self, band=banded_sum([self.band, total]), motion_gradient=self.motion_gradient - pull
        )


def covariance_of(inverse: Array, rows: Array, first: NDArray[np.intp], block: int = POSE) -> Array:
    """Covariance of linear functions of the motion at n instants, each by itself, shape (n, k, k).

    Args:
        inverse: Covariance of the coefficients, lower banded form, shape (42, N).
        rows: Derivatives by the coefficients at that instant, shape (n, k, w).
        first: First coefficient function of each instant, shape (n,).
        block: Coefficients of one function.
    """
    n, k, width = rows.shape
    found = np.empty((n, k, k))
    for function in np.unique(first):
        own = np.flatnonzero(first == function)
        J = rows[own]
        found[own] = J @ banded_window(inverse, function * block, width) @ J.transpose(0, 2, 1)
    return found


def spread(basis: Basis, *by_order: Array, block: int = POSE) -> Array:
    """Derivatives by pose, rate, acceleration as derivatives by the coefficients.

    Args:
        basis: At n times.
        *by_order: Shape (n, k, 7) each, the first by the pose; wider where processes stand beside
            it.
        block: Coefficients of one function.

    Returns:
        Shape (n, k, 6 block); (n, k, block) of poses at rest.
    """
    n, k, _ = by_order[0].shape
    total = np.zeros((n, k, basis.values.shape[2], block))
    for order, jacobian in enumerate(by_order):
        if not jacobian.any():
            continue
        by_function = basis.values[order][:, None, :, None] * jacobian[:, :, None, :]
        total[..., : jacobian.shape[2]] += by_function
    return total.reshape(n, k, -1)


def motion_at(basis: Basis, coefficients: Array) -> tuple[Array, Array, Array, Array]:
    """Pose and its first three time derivatives, shape (n, 7) each.

    Args:
        basis: At n times.
        coefficients: Of the spline, shape (f, 7); what stands beside the pose is left out.
    """
    local = coefficients[:, :POSE][basis.first[:, None] + np.arange(basis.values.shape[2])]
    pose, rate, acceleration, jerk = np.einsum("oni,nid->ond", basis.values, local)
    return pose, rate, acceleration, jerk


def values_at(basis: Basis, coefficients: Array, order: int = 0) -> Array:
    """Values of splines or of their derivatives, shape (n, p).

    Args:
        basis: At n times.
        coefficients: Shape (f, p).
        order: Of the derivative by time.
    """
    local = coefficients[basis.first[:, None] + np.arange(basis.values.shape[2])]
    return np.asarray(np.einsum("ni,nip->np", basis.values[order], local))
