"""Readings of a chunk that stand alone against all others and against what is known of its motion:
each is asked how far it would be off the motion that all others show (deletion residuals
[Cook1982]_). The farthest are left out first, for they bend what the others are held against.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.identification.model.force_residuals import WhitenedBalance
from steelyard.identification.model.segment import NormalEquations, Rows
from steelyard.identification.recursive.arriving.spikes import LEAST_OWN, MOST_FAR, Mask
from steelyard.identification.recursive.window.past import dense, eliminated
from steelyard.identification.tally import median
from steelyard.robot.model import DIRECTIONS
from steelyard.smoothing import NORMAL_MEDIAN

_TURNS = 120
"""At most, of leaving out and of giving back: a chunk has some dozens of readings that stand alone,
or there is something else."""
_AGREES = 1.5
"""Median of what is left of a quantity, in that of its noise, up to which it agrees with a
motion."""
_MOST = 0.6
"""Part of the samples of the forces beyond which what is off in them is no spike."""


@dataclass(frozen=True, eq=False)
class Foreknown:
    """What is known of the coefficients of a chunk."""

    precision: Array
    """Shape (p, p)."""
    pull: Array
    """Minus half the gradient of the cost, shape (p,)."""
    block: int
    """Coefficients of one function."""

    @classmethod
    def of(cls, equations: NormalEquations, functions: int) -> Foreknown:
        """Of the last functions of a window, all others eliminated and the border held.

        Args:
            equations: Of the window.
            functions: Of the chunk.
        """
        size, own = equations.band.shape[1], functions * equations.block
        last = eliminated(equations, functions) if size > own else equations
        return cls(dense(last.band), last.motion_gradient, equations.block)

    def with_rows(self, by_motion: Array, residual: Array) -> Foreknown:
        """With readings.

        Args:
            by_motion: Shape (m, p).
            residual: Shape (m,).
        """
        precision = self.precision + by_motion.T @ by_motion
        return replace(self, precision=precision, pull=self.pull - by_motion.T @ residual)

    def solved(self) -> tuple[Array, Array]:
        """Step of the coefficients and their covariance, shapes (p,) and (p, p).

        Raises:
            numpy.linalg.LinAlgError: The motion is not determined.
        """
        scale = 1 / np.sqrt(np.diag(self.precision))
        sizes = np.outer(scale, scale)
        inverse = np.linalg.inv(self.precision * sizes) * sizes
        return inverse @ self.pull, inverse

    def placed(self, first: NDArray[np.intp], by_motion: Array) -> Array:
        """Derivatives by the coefficients of an instant as those by all, shape (n, k, p).

        Args:
            first: First function of each instant, shape (n,).
            by_motion: Shape (n, k, w).
        """
        n, k, width = by_motion.shape
        found = np.zeros((n, k, len(self.pull)))
        columns = first[:, None] * self.block + np.arange(width)
        columns = np.broadcast_to(columns[:, None], by_motion.shape)
        np.put_along_axis(found, columns, by_motion, axis=2)
        return found


@dataclass(frozen=True, eq=False)
class Alone:
    """Readings that stand alone."""

    motion: Mask
    """Numbers of the motion's instruments, one after the other, shape (m,)."""
    single: Mask
    """Force readings, shape (n, r)."""


@dataclass(frozen=True, eq=False)
class Deletion:
    """All readings of a chunk, whitened, none of them weighed."""

    known: Foreknown
    """Without them."""
    by_motion: Array
    """Derivatives of the numbers of the motion's instruments, shape (m, p)."""
    residual: Array
    """Shape (m,)."""
    part: NDArray[np.intp]
    """Which of their rows each is of, shape (m,)."""
    balance_by_motion: Array
    """Derivatives of the balance, shape (n, 6, p)."""
    balance: Array
    """Shape (n, 6)."""
    shares: Array
    """What 1-sigma of every force reading makes of it, shape (n, 6, r)."""

    @classmethod
    def of(
        cls,
        known: Foreknown,
        rows: Sequence[Rows],
        balances: Sequence[WhitenedBalance],
        wide: float = 1.0,
        beside: Array | None = None,
    ) -> Deletion:
        """Of rows of the motion's instruments and of balances.

        Args:
            known: Without them.
            rows: May be none.
            balances: May be none.
            wide: By how much readings are taken as noisier in these.
            beside: How far readings are off those of the balances, in 1-sigma, shape (n, r); None:
                they are the same.
        """
        size = len(known.pull)
        flat = [
            known.placed(each.first, each.by_motion).reshape(each.residual.size, size)
            for each in rows
        ]
        own = [_of_balance(known, each) for each in balances] or [_no_balance(known)]
        by_motion, balance, shares = (np.concatenate(each) for each in zip(*own, strict=True))
        balance = wide * balance
        if beside is not None:
            balance = balance + np.einsum("nir,nr->ni", shares, beside)
        return cls(
            known,
            np.concatenate([np.zeros((0, size)), *flat]),
            np.concatenate([np.zeros(0), *(each.residual.ravel() for each in rows)]),
            np.repeat(np.arange(len(rows)), [int(each.residual.size) for each in rows]).astype(int),
            wide * by_motion,
            balance,
            shares,
        )

    def alone(self, level: float) -> Alone:
        """What stands alone.

        Args:
            level: Distance from which on a reading does, in its own 1-sigma.

        Raises:
            numpy.linalg.LinAlgError: The motion is not determined.
        """
        found = nothing = self._nothing
        for _ in range(_TURNS):
            motion, single = self.far(found)
            motion = self._as_usual(motion)
            farthest = max(motion.max(initial=0.0), single.max(initial=0.0))
            if farthest <= level:
                break
            # One at a time: those beside a spike are off, too, for it has bent the motion.
            found = Alone(found.motion | (motion >= farthest), found.single | (single >= farthest))
        for _ in range(_TURNS):
            motion, single = self.off(found)
            nearest = min(motion.min(initial=np.inf), single.min(initial=np.inf))
            if nearest > level:
                break
            # What was left out before another one that had bent the motion.
            found = Alone(found.motion & (motion > nearest), found.single & (single > nearest))
        if found.single.size and found.single.any(axis=1).mean() > _MOST:
            # Another load, or a hand: no reading of these is wrong.
            return Alone(found.motion, nothing.single)
        return found

    def jumped(self, level: float) -> Mask:
        """Numbers of the one quantity that has jumped: all others agree without them, and these are
        far off the motion that the others show; shape (m,), none where that is true of no quantity.

        Args:
            level: Distance from which on a number is far, in 1-sigma.

        Raises:
            numpy.linalg.LinAlgError: The motion is not determined.
        """
        nothing, least = self._nothing, np.inf
        best = nothing.motion
        for part in np.unique(self.part):
            off, _ = self.off(replace(nothing, motion=self.part == part))
            far = np.isfinite(off) & (off > level)
            if not far.any():
                continue
            step, _, _ = self._solved(replace(nothing, motion=far))
            left = np.where(far, 0.0, self.residual + self.by_motion @ step)
            cost = float(left @ left)
            if cost < least and self._agree(left, ~far, level):
                best, least = far, cost
        return best

    @property
    def _nothing(self) -> Alone:
        """Nothing that is left out."""
        none = np.zeros(self.shares.shape[::2], dtype=bool)
        return Alone(np.zeros(len(self.residual), dtype=bool), none)

    def _agree(self, left: Array, kept: Mask, level: float) -> bool:
        """Whether numbers are as near to a motion as noise lets them be.

        Args:
            left: Their residuals, shape (m,).
            kept: Those that count, shape (m,).
            level: Distance from which on a number is far, in 1-sigma.
        """
        counts = kept & self.by_motion.any(axis=1)
        off = np.abs(left)
        return all(
            median(off[own]) <= _AGREES * NORMAL_MEDIAN and np.mean(off[own] > level) <= MOST_FAR
            for own in (counts & (self.part == part) for part in np.unique(self.part))
            if own.any()
        )

    def _solved(self, without: Alone) -> tuple[Array, Array, Array]:
        """Step and covariance of the coefficients without some readings, and what is left of the
        equations of every balance, as projections, shape (n, 6, 6).
        """
        kept = ~without.motion
        left = self._left(without.single)
        A, e = left @ self.balance_by_motion, np.einsum("nij,nj->ni", left, self.balance)
        known = self.known.with_rows(self.by_motion[kept], self.residual[kept])
        return *known.with_rows(A.reshape(e.size, len(self.known.pull)), e.ravel()).solved(), left

    def far(self, without: Alone) -> tuple[Array, Array]:
        """How far readings are off the motion that all others show, in 1-sigma, shapes (m,) and (n,
        r); 0 of those that are left out.

        Args:
            without: What is left out.

        Raises:
            numpy.linalg.LinAlgError: The motion is not determined.
        """
        step, covariance, left = self._solved(without)
        own = 1 - np.einsum("mi,mi->m", self.by_motion @ covariance, self.by_motion)
        off = np.abs(self.residual + self.by_motion @ step)
        motion = np.where(without.motion, 0.0, off) / np.sqrt(np.maximum(own, LEAST_OWN))
        A = left @ self.balance_by_motion
        noise = left - A @ covariance @ A.transpose(0, 2, 1)
        shares = left @ self.shares
        rest = np.einsum("nij,nj->ni", left, self.balance) + A @ step
        size = np.einsum("nir,nij,njr->nr", shares, noise, shares)
        usual = np.maximum(np.sum(shares**2, axis=1), LEAST_OWN)
        single = np.abs(np.einsum("nir,ni->nr", shares, rest))
        single /= np.sqrt(np.maximum(size, LEAST_OWN * usual))
        return motion, np.where(without.single, 0.0, single)

    def off(self, without: Alone) -> tuple[Array, Array]:
        """How far readings that are left out are off the motion that the others show, in 1-sigma,
        shapes (m,) and (n, r); infinitely far those that are not; arguments as of :meth:`far`.
        """
        step, covariance, left = self._solved(without)
        motion, single = np.full(len(self.residual), np.inf), np.full(without.single.shape, np.inf)
        J = self.by_motion[without.motion]
        own = 1 + np.einsum("mi,mi->m", J @ covariance, J)
        motion[without.motion] = np.abs(self.residual[without.motion] + J @ step) / np.sqrt(own)
        for i, k in np.argwhere(without.single):
            fewer = without.single[i : i + 1].copy()
            fewer[0, k] = False
            # The one direction that comes back with it.
            values, vectors = np.linalg.eigh(self._left(fewer, self.shares[i : i + 1])[0] - left[i])
            by_motion = vectors[:, -1] @ self.balance_by_motion[i]
            own = values[-1] + by_motion @ covariance @ by_motion
            off = vectors[:, -1] @ self.balance[i] + by_motion @ step
            single[i, k] = abs(off) / np.sqrt(max(own, LEAST_OWN))
        return motion, single

    def _as_usual(self, far: Array) -> Array:
        """Distances in units of what is usual for a quantity where that is more than noise
        makes.
        """
        found = far.copy()
        for part in np.unique(self.part):
            own = (self.part == part) & (far > 0)
            if own.any():
                found[own] /= max(1.0, median(far[own]) / NORMAL_MEDIAN)
        return found

    def _left(self, gone: Mask, shares: Array | None = None) -> Array:
        """What is left of the six equations without readings, as projections, shape (n, 6, 6)."""
        taken = self.shares if shares is None else shares
        found = np.tile(np.eye(DIRECTIONS), (len(gone), 1, 1))
        for i in np.flatnonzero(gone.any(axis=1)):
            own = taken[i][:, gone[i]]
            found[i] -= own @ np.linalg.pinv(own)
        return found


def _of_balance(known: Foreknown, balance: WhitenedBalance) -> tuple[Array, Array, Array]:
    """Derivatives of the six whitened equations, these and the shares of the readings; see
    :class:`Deletion`.
    """
    at, rows, count = balance.at, balance.rows, balance.at.noise.readings
    shares = at.noise.shares
    by_motion = rows[0].by_motion
    if len(rows) > 1:
        # Told as corrections of readings and as parts of the unmodelled wrench.
        by_motion = shares[:, :, :count] @ by_motion + shares[:, :, count:] @ rows[1].by_motion
    own = balance.root[:, None]
    return (
        known.placed(rows[0].first, by_motion),
        own * at.residual,
        own[:, :, None] * shares[:, :, :count],
    )


def _no_balance(known: Foreknown) -> tuple[Array, Array, Array]:
    """The same of no sample."""
    none = np.zeros((0, DIRECTIONS))
    return np.zeros((0, DIRECTIONS, len(known.pull))), none, none[:, :, None]
