"""Parametrisation of the motions that a design chooses from: splines in all six coordinates that
begin and end at rest.
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

COORDINATES = 6
"""Of a commanded pose: x, y, z [m], roll, pitch, yaw [rad]."""
FIXED_AT_ENDS = 4
"""Coefficients at either end that are not free: velocity, acceleration and jerk vanish there."""
_FIT_INSTANTS = 8
"""Instants per interval at which a motion is approximated by a spline."""


@dataclass(frozen=True, eq=False)
class MotionSpline:
    """Quintic splines from one pose at rest to another, with f free coefficients a coordinate."""

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
        """Free coefficients of a coordinate, f."""
        return self.intervals + DEGREE - 2 * FIXED_AT_ENDS

    @property
    def size(self) -> int:
        """Free coefficients of all coordinates, 6 f."""
        return self.free * COORDINATES

    @cached_property
    def direct_move(self) -> Array:
        """Coefficients of the direct move from start to end, shape (c, 6)."""
        count = self.intervals + DEGREE
        # Greville abscissae: where each basis function is centred.
        centres = np.array([self.knots[i + 1 : i + 1 + DEGREE].mean() for i in range(count)])
        centres = centres / self.duration
        centres[:FIXED_AT_ENDS] = 0.0
        centres[-FIXED_AT_ENDS:] = 1.0
        return np.asarray(self.start + REST_TO_REST(centres)[:, None] * (self.end - self.start))

    def coefficients(self, x: Array) -> Array:
        """All coefficients for free ones in units of the reach, shape (c, 6).

        Args:
            x: Shape (6 f,).
        """
        found = self.direct_move.copy()
        found[FIXED_AT_ENDS:-FIXED_AT_ENDS] += x.reshape(-1, COORDINATES) * self.reach
        return found

    def trajectory(self, x: Array) -> Sampled:
        """The motion itself."""
        return Sampled(BSpline(self.knots, self.coefficients(x), DEGREE), self.duration)

    def fitted_to(self, trajectory: Sampled) -> Array:
        """Free coefficients of the least-squares fit to a motion of the same duration, shape (6
        f,).
        """
        times = np.linspace(0.0, self.duration, _FIT_INSTANTS * self.intervals + 1)
        values = BSpline.design_matrix(times, self.knots, DEGREE).toarray()
        missing = trajectory.derivative(times, 0) - values @ self.direct_move
        free = values[:, FIXED_AT_ENDS:-FIXED_AT_ENDS]
        found, *_ = np.linalg.lstsq(free, missing, rcond=None)
        return np.asarray(found / self.reach).ravel()

    def midpoints(self, per_interval: int) -> Array:
        """Middles of equal steps [s]."""
        n = per_interval * self.intervals
        return (np.arange(n) + 0.5) * self.duration / n

    def at(self, times: Array) -> SplineSamples:
        """What turns coefficients into commands at times [s]."""
        return SplineSamples(self, basis(self.knots, times))


@dataclass(frozen=True, eq=False)
class SplineSamples:
    """A motion spline at n fixed instants, and the chain rule from commands to coefficients."""

    spline: MotionSpline
    basis: Basis

    def commands(self, x: Array) -> Array:
        """Pose and its first three derivatives, one beside the other, shape (n, 24)."""
        local = self.spline.coefficients(x)[self._functions]
        return np.concatenate(list(np.einsum("oni,nid->ond", self.basis.values, local)), axis=1)

    def gradient(self, by_command: Array) -> Array:
        """Gradient by the free coefficients of a function of all commands, shape (6 f,).

        Args:
            by_command: Its gradient by the commands, shape (n, 24) or, by their pose, rate and
                acceleration alone, (n, 18).
        """
        orders = by_command.reshape(len(by_command), -1, COORDINATES)
        each = np.einsum("oni,nod->nid", self.basis.values[: orders.shape[1]], orders)
        total = np.zeros((len(self.spline.direct_move), COORDINATES))
        np.add.at(total, self._functions, each)
        return (total[FIXED_AT_ENDS:-FIXED_AT_ENDS] * self.spline.reach).ravel()

    @cached_property
    def _functions(self) -> NDArray[np.intp]:
        """Basis functions that each instant depends on, shape (n, 6)."""
        return self.basis.first[:, None] + np.arange(self.basis.values.shape[2])

    @cached_property
    def sparsity(self) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
        """Free coefficients that each instant depends on, shape (n, 36), and which of them there
        are.
        """
        columns = (self._functions[:, :, None] - FIXED_AT_ENDS) * COORDINATES
        columns = columns + np.arange(COORDINATES)
        columns = columns.reshape(len(columns), -1)
        return columns, (columns >= 0) & (columns < self.spline.size)

    def jacobian(self, by_command: Array) -> Array:
        """Derivatives by the coefficients of :attr:`sparsity` of g functions of each command,
        shape (n, g, 36).

        Args:
            by_command: By pose, rate and acceleration (and jerk), shape (n, g, 18) or (n, g, 24).
        """
        n, g, _ = by_command.shape
        orders = by_command.reshape(n, g, -1, COORDINATES)
        each = np.einsum("oni,ngod->ngid", self.basis.values[: orders.shape[2]], orders)
        return np.asarray((each * self.spline.reach).reshape(n, g, -1))
