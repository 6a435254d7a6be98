"""The motions that a design chooses from: splines in all six coordinates that begin and end at
rest.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline

from steelyard.arrays import Array
from steelyard.identification.model.segment import Basis, basis
from steelyard.motion.trajectory import REST_TO_REST, Sampled
from steelyard.smoothing import DEGREE

SIX = 6
"""Coordinates of a commanded pose: x, y, z [m], roll, pitch, yaw [rad]."""
HELD = 4
"""Coefficients at either end that stay where they are: velocity, acceleration and jerk vanish
there."""


@dataclass(frozen=True, eq=False)
class Course:
    """Quintic splines from one pose at rest to another."""

    start: Array
    """Pose, shape (6,)."""
    end: Array
    """Pose, shape (6,)."""
    duration: float
    """[s]"""
    intervals: int
    """Equal parts of it between knots."""
    reach: Array
    """How far each coordinate may be from the middle of its range, shape (6,): the unit of the free
    coefficients."""

    @cached_property
    def knots(self) -> Array:
        """Of the spline [s]."""
        inner = np.linspace(0.0, self.duration, self.intervals + 1)
        return np.concatenate([np.zeros(DEGREE), inner, np.full(DEGREE, self.duration)])

    @property
    def free(self) -> int:
        """Free coefficients of a coordinate."""
        return self.intervals + DEGREE - 2 * HELD

    @property
    def size(self) -> int:
        """Free coefficients of all coordinates."""
        return self.free * SIX

    @cached_property
    def plain(self) -> Array:
        """Coefficients of the plain move from start to end, shape (c, 6)."""
        count = self.intervals + DEGREE
        # Each coefficient where its function is centred.
        centres = (
            np.array([self.knots[i + 1 : i + 1 + DEGREE].mean() for i in range(count)])
            / self.duration
        )
        centres[:HELD], centres[-HELD:] = 0.0, 1.0
        return np.asarray(self.start + REST_TO_REST(centres)[:, None] * (self.end - self.start))

    def coefficients(self, x: Array) -> Array:
        """All coefficients for free ones in units of the reach, shape (c, 6).

        Args:
            x: Shape (6 f,).
        """
        found = self.plain.copy()
        found[HELD:-HELD] += x.reshape(-1, SIX) * self.reach
        return found

    def trajectory(self, x: Array) -> Sampled:
        """The motion itself."""
        return Sampled(BSpline(self.knots, self.coefficients(x), DEGREE), self.duration)

    def near(self, trajectory: Sampled) -> Array:
        """Free coefficients of the course nearest to another motion of the same duration, shape (6
        f,).
        """
        times = np.linspace(0.0, self.duration, 8 * self.intervals + 1)
        design = BSpline.design_matrix(times, self.knots, DEGREE).toarray()
        missing = trajectory.derivative(times, 0) - design @ self.plain
        found, *_ = np.linalg.lstsq(design[:, HELD:-HELD], missing, rcond=None)
        return np.asarray(found / self.reach).ravel()

    def instants(self, per_interval: int) -> Array:
        """Middles of equal steps [s]."""
        n = per_interval * self.intervals
        return (np.arange(n) + 0.5) * self.duration / n

    def at(self, times: Array) -> Along:
        """What turns coefficients into commands at times [s]."""
        return Along(self, basis(self.knots, times))


@dataclass(frozen=True, eq=False)
class Along:
    """A course at fixed instants."""

    course: Course
    basis: Basis

    def commands(self, x: Array) -> Array:
        """Pose and its first three derivatives, one beside the other, shape (n, 24)."""
        local = self.course.coefficients(x)[self._functions]
        return np.concatenate(list(np.einsum("oni,nid->ond", self.basis.values, local)), axis=1)

    def gathered(self, slope: Array) -> Array:
        """Derivative by the free coefficients of what depends so on the commands, shape (6 f,).

        Args:
            slope: Derivative by the commands, shape (n, 24) or, of their pose, rate and
                acceleration alone, (n, 18).
        """
        orders = slope.reshape(len(slope), -1, SIX)
        each = np.einsum("oni,nod->nid", self.basis.values[: orders.shape[1]], orders)
        total = np.zeros((len(self.course.plain), SIX))
        np.add.at(total, self._functions, each)
        return (total[HELD:-HELD] * self.course.reach).ravel()

    @cached_property
    def _functions(self) -> NDArray[np.intp]:
        return self.basis.first[:, None] + np.arange(self.basis.values.shape[2])

    @cached_property
    def pattern(self) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
        """Free coefficients that each instant depends on, shape (n, 36), and which of them there
        are.
        """
        columns = (self._functions[:, :, None] - HELD) * SIX + np.arange(SIX)
        columns = columns.reshape(len(columns), -1)
        return columns, (columns >= 0) & (columns < self.course.size)

    def spread(self, derivative: Array) -> Array:
        """Derivatives by commands as derivatives by the coefficients of :attr:`pattern`, shape (n,
        g, 36).

        Args:
            derivative: By pose, rate and acceleration (and jerk), shape (n, g, 18) or (n, g, 24).
        """
        n, g, _ = derivative.shape
        orders = derivative.reshape(n, g, -1, SIX)
        each = np.einsum("oni,ngod->ngid", self.basis.values[: orders.shape[2]], orders)
        return np.asarray((each * self.course.reach).reshape(n, g, -1))
