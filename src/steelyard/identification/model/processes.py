"""Disturbances along a segment that nothing explains: Gauss-Markov processes beside the motion.

A process is a spline on the knots of the motion, so that the normal matrix stays banded. What is
known of it is its level and its correlation time: the prior of a stationary Gauss-Markov process
(Ornstein and Uhlenbeck), which is the constant at one end and the random walk at the other
[Rasmussen2006]_.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky_banded

from steelyard.arrays import Array
from steelyard.identification.banded import banded_product
from steelyard.identification.model.segment import POSE, basis, quadrature
from steelyard.identification.model.sources import Source
from steelyard.instruments.noise import Cause, Disturbance
from steelyard.smoothing import DEGREE

_NODES = DEGREE + 1
"""Of the quadrature between two knots: exact for squares of the spline."""
_LOG_STEP = 1e-4
"""Step of the logarithm of a correlation time that shows how a determinant follows it."""


class SplineIntegrals(NamedTuple):
    """Integrals of a spline as quadratic forms of its coefficients, lower banded form, shape (6, f)
    each.
    """

    value: Array
    """Of the squared value [s]."""
    rate: Array
    """Of the squared rate [1/s]."""
    ends: Array
    """Sum of the squared values at both ends."""


@dataclass(frozen=True, eq=False)
class Process:
    """A disturbance of several components with one level and one correlation time."""

    source: Source
    """Owner and what it is: the quantity that it disturbs, with its cause behind unless it is the
    noise of that quantity itself."""
    sizes: Array
    """Units that the components are told in: 1-sigma at level 1, shape (p,)."""
    level: float
    """1-sigma in these units."""
    time: float
    """Correlation time [s]."""
    integrals: SplineIntegrals
    """Of a spline on the knots of the motion."""
    cause: Cause = "colored"
    """Of what is stated; what nobody has stated is noise."""
    upright: bool = False
    """Whether its components are along the axes of the world; else, along those of what it
    disturbs."""
    level_stated: bool = False
    time_stated: bool = False

    @property
    def disturbs(self) -> Source:
        """Owner and quantity that it disturbs."""
        owner, name = self.source
        return owner, name.removesuffix(f" {self.cause}")

    @property
    def is_stated(self) -> bool:
        """Whether somebody says that it is there."""
        return self.level_stated or self.time_stated

    @property
    def components(self) -> int:
        """Number p of components."""
        return len(self.sizes)

    @cached_property
    def precision(self) -> Array:
        """Of the coefficients of one component, lower banded form, shape (6, f)."""
        value, rate, ends = self.integrals
        return (value / self.time + rate * self.time + ends) / (2 * self.level**2)

    @cached_property
    def changes(self) -> tuple[Array, Array]:
        """Of the precision by the logarithms of level and correlation time, lower banded form,
        shape (6, f) each.
        """
        value, rate, _ = self.integrals
        by_time = (rate * self.time - value / self.time) / (2 * self.level**2)
        return -2 * self.precision, by_time

    @property
    def log_determinant(self) -> float:
        """Of the precision of all components."""
        return float(self.components * _log_determinant(self.precision))

    @cached_property
    def log_determinant_changes(self) -> tuple[float, float]:
        """Of the logarithm of the determinant of one component by the logarithms of level and
        correlation time.
        """
        longer, shorter = (
            _log_determinant(self.at(self.level, self.time * np.exp(step)).precision)
            for step in (_LOG_STEP, -_LOG_STEP)
        )
        return -2.0 * self.precision.shape[1], (longer - shorter) / (2 * _LOG_STEP)

    def roughness(self, coefficients: Array) -> float:
        """Cost of the coefficients of all components, shape (f, p)."""
        return float(np.vdot(coefficients, banded_product(self.precision, coefficients)))

    def at(self, level: float, time: float) -> Process:
        """The same of another level and correlation time."""
        return replace(self, level=level, time=time)


def _log_determinant(precision: Array) -> float:
    """Of a matrix in lower banded form."""
    factor = cholesky_banded(precision, lower=True, check_finite=False)
    return float(2 * np.sum(np.log(factor[0])))


def integrals_of(grid: Array) -> SplineIntegrals:
    """Integrals of a spline, which all processes on its knots share.

    Args:
        grid: Knots [s].
    """
    local, weight = quadrature(grid, _NODES)
    functions = len(grid) - DEGREE - 1
    return SplineIntegrals(
        _squares(local.values[0], local.first, weight, functions),
        _squares(local.values[1], local.first, weight, functions),
        np.sum(ends_of(grid), axis=0),
    )


def ends_of(grid: Array) -> tuple[Array, Array]:
    """Squared values of a spline at its beginning and at its end, as in :class:`SplineIntegrals`.

    Args:
        grid: Knots [s].
    """
    ends = basis(grid, grid[[DEGREE, len(grid) - DEGREE - 1]])
    functions, one = len(grid) - DEGREE - 1, np.ones(1)
    first, last = (
        _squares(ends.values[0][i : i + 1], ends.first[i : i + 1], one, functions) for i in (0, 1)
    )
    return first, last


def _squares(values: Array, first: NDArray[np.intp], weight: Array, functions: int) -> Array:
    """Weighted sum of products of spline functions, lower banded form, shape (6, f)."""
    width = values.shape[1]
    band = np.zeros((width, functions))
    for column in range(width):
        for row in range(column, width):
            product = weight * values[:, row] * values[:, column]
            np.add.at(band[row - column], first + column, product)
    return band


def embedded(band: Array, place: int, block: int) -> Array:
    """A banded matrix of one component among the coefficients of all, lower banded form, shape (6
    block, f block).

    Args:
        band: Shape (6, f).
        place: Of the component among the coefficients of one function.
        block: Coefficients of one function.
    """
    width, functions = band.shape
    found = np.zeros((width * block, functions * block))
    found[::block, place::block] = band
    return found


def unresolved(stated: Iterable[Disturbance], spacing: float, step: float) -> float:
    """1-sigma of white noise that stands for what is stated of disturbances and goes on for too
    short a while to be a spline on knots.

    It has the spectral density of the disturbances at the frequency of half a period per spacing,
    where the spline ends: what is above is less, so that nothing is taken to be more certain than
    it is.

    Args:
        stated: Of one quantity.
        spacing: Of the knots [s].
        step: Between samples [s].
    """
    square, highest = 0.0, np.pi / spacing
    for each in stated:
        if each.level is None:
            continue
        if each.cause == "drift":
            square += (each.level / highest) ** 2 / step
        elif each.time is not None:
            low = 2 * each.level**2 * each.time / step
            square += low / (1 + (highest * each.time) ** 2)
    return float(np.sqrt(square))


def named(source: Source, cause: Cause) -> Source:
    """What a process is called by what it disturbs and its cause."""
    owner, quantity = source
    return source if cause == "colored" else (owner, f"{quantity} {cause}")


def places(processes: Sequence[Process]) -> Mapping[Source, slice]:
    """Where each stands among the coefficients of one function."""
    found, start = {}, POSE
    for each in processes:
        found[each.source] = slice(start, start + each.components)
        start += each.components
    return found
