"""Accelerations as the first-order filter of a force amplifier lets fast ones through."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np

from steelyard.arrays import Array
from steelyard.identification.model.balance.amplifier_filter import ReadingChanges
from steelyard.identification.model.motion_segment import Segment
from steelyard.identification.model.segment import POSE, Basis, values_at

_NODES = 40
"""Instants in the past at which a filter looks: they pass what is six times as fast as it within a
hundredth."""
_LEAST = 1e-7
"""Weight of an instant, below which it is of no account."""
_BESIDE = 0.4
"""Time beside the readings for which accelerations are filtered as well [s]: a third derivative looks
so far."""


@dataclass(frozen=True, eq=False)
class FilteredMotion:
    """What the filter of the forces changes of fast accelerations, beside the delay by its time
    constant; shape (n, 7) each, as the second derivative of the pose.
    """

    acceleration: Array
    by_time: Array
    """Its derivative by time [1/s]."""
    by_constant: Array
    """Its derivative by the time constant [1/s]."""
    constant: float
    """Time constant of the filter [s]."""
    here: Basis
    """Spline functions at the n times at which the balance looks."""
    past: Basis
    """Spline functions at k instants before each reading, one time after the other."""

    @classmethod
    def of(cls, segment: Segment, times: Array, read: Array, constant: float) -> FilteredMotion:
        """Of the accelerations that the filter makes ``integral of exp(-u) a(t - u T) du`` of, by Gauss
        and Laguerre's quadrature, and of which the same is taken off as of the readings, so that what
        is slow is compared as it was before the filter.

        Args:
            segment: With its motion.
            times: At which the balance looks, the time constant before the readings [s], ascending,
                shape (n,).
            read: Times of the readings by their own clock [s], which are the same whatever the delays,
                shape (n,).
            constant: Time constant of the filter T [s].
        """
        back, weights = _instants()
        further, own = _beside(times, segment.span)
        grid, clock = (
            np.concatenate([t[0] - further[0], t, t[-1] + further[1]]) for t in (times, read)
        )
        asked = (grid + constant)[:, None] - constant * back
        # Before the beginning acceleration changes as it does there.
        known = np.maximum(asked, segment.span[0])
        local = segment.basis(known.ravel())
        coefficients = segment.coefficients[:, :POSE]
        acceleration, jerk = (
            values_at(local, coefficients, order).reshape(*asked.shape, POSE) for order in (2, 3)
        )
        acceleration += jerk * (asked - known)[:, :, None]
        filtered = np.hstack(
            [
                np.einsum("k,nka->na", weights, acceleration),
                np.einsum("k,nka->na", weights, jerk),
                -np.einsum("k,nka->na", weights * back, jerk),
            ]
        )
        changes = ReadingChanges.of(clock, filtered)
        found = filtered - changes.added(constant)
        found[:, 2 * POSE :] -= changes.added_by_constant(constant)[:, :POSE]
        here = segment.basis(times)
        late, later = (values_at(here, coefficients, order) for order in (2, 3))
        by_time, by_constant = found[own, POSE : 2 * POSE], found[own, 2 * POSE :]
        k = len(back)
        mine = slice(own.start * k, own.stop * k)
        past = Basis(local.first[mine], local.values[:, mine])
        return cls(
            found[own, :POSE] - late, by_time - later, by_constant + later, constant, here, past
        )

    @cached_property
    def local(self) -> Basis:
        """Spline functions at the times at which the balance looks, second derivatives behind the filter,
        as far as they depend on the functions that are not zero there. Of those before a row knows
        nothing, and what it does not know it takes for no acceleration: a step is a little shorter than
        it might be where the filter looks far back, and ends at the same motion.
        """
        _, weights = _instants()
        n, k, width = len(self.here.first), len(weights), self.here.values.shape[2]
        before = self.here.first[:, None] - self.past.first.reshape(n, k)
        second = self.past.values[2].reshape(n, k, width) * weights[:, None]
        found = np.zeros((n, width))
        for away in np.unique(before):
            own = np.where((before == away)[:, :, None], second, 0.0).sum(axis=1)
            found += own @ _continued(int(away), width)
        values = self.here.values.copy()
        values[2] = found
        return Basis(self.here.first, values)


@cache
def _instants() -> tuple[Array, Array]:
    """How long before a reading a filter looks, in its time constant, and the weight of each instant,
    shape (k,) each.
    """
    back, weights = np.polynomial.laguerre.laggauss(_NODES)
    return back[weights > _LEAST], weights[weights > _LEAST]


def _beside(times: Array, span: tuple[float, float]) -> tuple[tuple[Array, Array], slice]:
    """How long before the first and after the last of some times there are more, as far as a motion goes
    [s], and where the times themselves stand among all: slopes are poor at their ends.

    Args:
        times: Ascending [s], shape (n,).
        span: Of the motion [s].
    """
    step = float(np.median(np.diff(times))) if len(times) > 1 else 0.0
    further = step * np.arange(1, int(_BESIDE / step) + 1) if step > 0 else np.zeros(0)
    before, after = further[times[0] - further >= span[0]], further[times[-1] + further <= span[1]]
    return (before[::-1], after), slice(len(before), len(before) + len(times))


@cache
def _continued(away: int, width: int) -> Array:
    """Coefficients of as many functions, so many before some, by the coefficients of these, shape
    (width, width), if nothing accelerates there.

    Args:
        away: How many before; negative: after.
        width: Number of functions.
    """
    rows = list(np.eye(width))
    for _ in range(away):
        rows.insert(0, 2 * rows[0] - rows[1])
    for _ in range(-away):
        rows.append(2 * rows[-1] - rows[-2])
    return np.array(rows[:width] if away >= 0 else rows[-width:])
