"""Noise of the balance of wrenches: that of the force readings, and a white wrench that nothing
explains where the readings cannot tell every wrench.

Fewer than six cables with a sensor span fewer than six directions. In the others the balance holds
as exactly as the model of the robot does, which is a noise of its own and never zero: the white
part of the unmodelled wrench. In those that the cables with a sensor carry the noise of the
readings is all, as it is on six cables and more: a further noise there, be it a thousandth of the
tensions, is wrong in directions in which the cables hardly turn the platform, and a wrong ratio of
the noise of forces and motion biases the body. A cable without a sensor pulls as hard as it will:
its direction is taken out of the balance.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.robot.model import DIRECTIONS

_ROUNDING = 1e-12
"""Added to scaled variances of order one, so that rounding leaves them positive."""


@dataclass(frozen=True, eq=False)
class UnmodelledWrench:
    """How a wrench on the platform that nothing explains shows in readings and balance.

    It is told in units of the readings: as wrong as their gains are, so wrong is its size. In
    newtons of true tension, gains that grow would shrink tensions, body and residual against it,
    and the likelihood would rise for nothing. Its torque is told in units of the distance of the
    attachments from their middle for the same reason: the derivative by them has that.
    """

    reading: Array
    """By how much readings of nominal gain follow it, with the least of tensions, shape (n, m,
    6)."""
    wrench: Array
    """What it makes of the balance; in directions that no cable carries itself, shape (n, 6, 6)."""
    across: Array
    """The same of its part that no cable carries, shape (n, 6, 6)."""
    usual: Array
    """By how much tensions follow the readings, in the mean over cables, shape (n,)."""

    @classmethod
    def of(cls, structure: Array, by_reading: Array) -> UnmodelledWrench:
        """On n poses.

        Args:
            structure: Structure matrices, shape (n, 6, m).
            by_reading: How the tensions follow the readings, shape (n, m, m).
        """
        reading = np.asarray(np.linalg.pinv(structure), dtype=np.float64)
        across = np.eye(DIRECTIONS) - structure @ reading
        usual = np.mean(np.diagonal(by_reading, axis1=1, axis2=2), axis=1)
        across = usual[:, None, None] * across
        wrench = structure @ by_reading @ reading + across
        return cls(reading, wrench, across, usual)


@dataclass(frozen=True, eq=False)
class BalanceNoise:
    """Noise of the balance at n samples with r readings each."""

    parts: Array
    """Wrench that 1-sigma of every reading makes, and of every part of the unmodelled wrench where
    there is one [N], [N m], shape (n, 6, r) or (n, 6, r + 6)."""
    readings: int
    """Number r of readings."""
    free: Array
    """Wrench that a unit of every reading makes that is not read, shape (n, 6, f)."""

    @classmethod
    def of(
        cls,
        by_reading: Array,
        sigmas: Array,
        unmodelled: Array | None,
        unread: NDArray[np.bool_] | None = None,
    ) -> BalanceNoise:
        """Of readings and of an unmodelled wrench.

        Args:
            by_reading: How the wrench follows the readings, shape (n, 6, r).
            sigmas: 1-sigma of the readings, shape (n, r).
            unmodelled: Wrench that 1-sigma of every part of the unmodelled wrench makes [N], [N m],
                shape (n, 6, 6); None: there is none, and six readings at least.
            unread: Readings that nobody reads: f of them, shape (r,); None: none.
        """
        if unread is None:
            unread = np.zeros(by_reading.shape[2], dtype=bool)
        parts = by_reading * np.where(unread, 0.0, sigmas)[:, None, :]
        if unmodelled is not None:
            parts = np.concatenate([parts, unmodelled], axis=2)
        return cls(parts, by_reading.shape[2], by_reading[:, :, unread])

    @property
    def variance(self) -> Array:
        """Of each part of the wrench by what is read and by the unmodelled wrench [N^2], [N^2 m^2],
        shape (n, 6).
        """
        return np.asarray(np.sum(self.parts**2, axis=2))

    @cached_property
    def whitener(self) -> Array:
        """Matrices that make the noise white with unit variance, in as many directions as anything
        is known of, shape (n, 6, 6).
        """
        if not self.free.shape[2]:
            return self._of_read
        across, inverse = self._pulled
        return np.asarray(self._of_read - across @ (inverse @ self._of_read))

    @cached_property
    def pulled(self) -> Array:
        """By how much readings that nobody reads have to change so that a wrench that is left over
        vanishes, shape (n, f, 6).
        """
        return np.asarray(self._pulled[1] @ self._of_read)

    @cached_property
    def _pulled(self) -> tuple[Array, Array]:
        """What these make of the whitened balance, shape (n, 6, f), and its pseudo-inverse."""
        across = self._of_read @ self.free
        return across, np.asarray(np.linalg.pinv(across), dtype=np.float64)

    @cached_property
    def _of_read(self) -> Array:
        """The same of what is read alone."""
        parts = self.parts
        if self.free.shape[2]:
            # What is taken out later may be as noisy as one likes: then no direction is without
            # noise.
            size, own = (
                np.sqrt(np.sum(each**2, axis=(1, 2), keepdims=True)) for each in (self.free, parts)
            )
            parts = np.concatenate([parts, own / np.maximum(size, 1e-300) * self.free], axis=2)
        # Rows are scaled first: forces and torques have different units and sizes.
        scale = np.sqrt(np.sum(parts**2, axis=2))
        scaled = parts / scale[:, :, None]
        variance = scaled @ scaled.transpose(0, 2, 1) + _ROUNDING * np.eye(DIRECTIONS)
        return np.asarray(np.linalg.inv(np.linalg.cholesky(variance)) / scale[:, None, :])

    def unmodelled(self, correction: Array) -> Array:
        """The unmodelled wrench of corrections [N], [N m], shape (n, 6).

        Args:
            correction: See :meth:`correction`.
        """
        parts, own = self.parts[:, :, self.readings :], correction[:, self.readings :]
        return np.asarray(np.einsum("nij,nj->ni", parts, own))

    @cached_property
    def shares(self) -> Array:
        """The parts, whitened, shape as of ``parts``: the square of a column is how many of the six
        equations that reading decides.
        """
        return np.asarray(self.whitener @ self.parts)

    def correction(self, residual: Array) -> Array:
        """What balances a whitened residual, of every reading and part in its 1-sigma, shape (n, r)
        or (n, r + 6).

        Args:
            residual: Shape (n, 6).
        """
        return np.asarray(np.einsum("njr,nj->nr", self.shares, residual))

    @cached_property
    def decided(self) -> Array:
        """How many of the six equations every reading and part decides, shape as of corrections."""
        return np.asarray(np.sum(self.shares**2, axis=1))
