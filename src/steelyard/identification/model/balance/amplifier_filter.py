"""What the first-order filter of a force amplifier smooths: of slow changes put right in the readings, of
fast ones let stand, and done to the motion.

Of a reading the filter leaves ``1 / (1 + s T)``. Its delay is in the time at which the balance looks at
the motion (:func:`.balance_times`); what it adds beside is ``(s T)^2 / 2 - (s T)^3 / 3`` of the
readings, since ``exp(-s T) (1 + s T) = 1 - (s T)^2 / 2 + (s T)^3 / 3 - ...``.

- What changes slowly is seen in the readings far above their noise, and that is taken off them: cables
  turn as the platform moves, and a tension belongs to where it pulled.
- What is faster (tight cables ring with 10 to 30 Hz) stands in the readings as the filter leaves it:
  attenuated, and less late than T. To undo that would be to blow up their noise. The accelerations of
  the motion that balance them are filtered instead, and corrected in the same way as the readings, so
  that nothing counts twice
  (:class:`~steelyard.identification.model.balance.filtered_motion.FilteredMotion`).

Corrected readings are taken as noisy as they are: else no filter at all would fit best where it
explains little. That the noise of the derivative by the time constant meets that of the readings is
taken off.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.identification.model.balance.slopes import AROUND, means_of, slopes

_TURNS = 50
"""Of what was added to a series, each a fifth of the one before with 50 ms."""
_SAME = 1e-6
"""Part of the largest by which the last may differ."""


@dataclass(frozen=True, eq=False)
class ReadingChanges:
    """How fast readings change, to the third order, as far as that is slow."""

    step: float
    """Between the samples by which they are seen [s]."""
    seen: Callable[[], Array]
    """Makes the values; most recordings have no filter, and never ask for them."""

    @classmethod
    def of(cls, time: Array, readings: Array) -> ReadingChanges:
        """Of readings.

        Args:
            time: Ascending [s], shape (n,).
            readings: Shape (n, r).
        """
        step = float(np.median(np.diff(time))) if len(time) > 1 else 0.0
        return cls(step, partial(_seen, time, readings))

    @cached_property
    def values(self) -> Array:
        """Second and third derivatives [N/s^2], [N/s^3] and of torques, shape (2, n, r)."""
        return self.seen()

    def at(self, own: slice | NDArray[np.bool_]) -> ReadingChanges:
        """At some of the samples."""
        return replace(self, seen=partial(_at, self, own))

    def means(self, many: int) -> ReadingChanges:
        """With means over so many samples in place of each."""
        return replace(self, seen=partial(_means, self, many))

    def added(self, constant: float) -> Array:
        """What a filter of this time constant T [s] adds to slow readings beside its delay, shape (n,
        r).
        """
        second, third = self.values
        return np.asarray(constant**2 / 2 * second - constant**3 / 3 * third)

    def added_by_constant(self, constant: float) -> Array:
        """The derivative of :meth:`added` by the time constant, shape (n, r)."""
        second, third = self.values
        return np.asarray(constant * second - constant**2 * third)

    def louder(self, constant: float) -> float:
        """Noise of readings without what a filter of this time constant T [s] adds, in their own.

        What is fitted best would be no filter at all, if corrected readings were not taken as noisy as
        they are.
        """
        return float(np.sqrt(np.sum(self._corrected(constant) ** 2)))

    def louder_by_constant(self, constant: float) -> float:
        """The relative derivative of :meth:`louder` by the time constant [1/s]: by so much of themselves
        residuals would seem to change with it.
        """
        if self.step <= 0:
            return 0.0
        whole = self._corrected(constant)
        second, third = _kernels(self.step)
        change = constant**2 * third - constant * second
        return float(change @ whole / (whole @ whole))

    def _corrected(self, constant: float) -> Array:
        """What is made of a single reading of one among many of nothing, shape (n,)."""
        if self.step <= 0:
            return np.ones(1)
        second, third = _kernels(self.step)
        whole = np.asarray(constant**3 / 3 * third - constant**2 / 2 * second)
        whole[len(whole) // 2] += 1.0
        return whole


def uncorrected(time: Array, corrected: Array, constant: float) -> Array:
    """What a series was before what a filter adds to slow readings was taken off it, shape (n, k); as it
    is where that cannot be told, beyond a tenth of a second.

    Args:
        time: Ascending [s], shape (n,).
        corrected: Shape (n, k).
        constant: Time constant T of the filter [s].
    """
    found, before = corrected, np.inf
    for _ in range(_TURNS):
        again = corrected + ReadingChanges.of(time, found).added(constant)
        moved = float(np.max(np.abs(again - found), initial=0.0))
        if moved > before:
            return corrected
        if moved <= _SAME * float(np.max(np.abs(corrected), initial=0.0)):
            return again
        found, before = again, moved
    return found


@lru_cache(maxsize=8)
def _kernels(step: float) -> Array:
    """Second and third derivatives of a single reading of one among many of nothing, shape (2, n).

    Args:
        step: Between readings [s].
    """
    reach = 2 * int(2 * AROUND / step) + 4
    single = np.zeros((2 * reach + 1, 1))
    single[reach] = 1.0
    time = np.asarray(step * np.arange(len(single)), dtype=np.float64)
    return _seen(time, single)[..., 0]


def _seen(time: Array, readings: Array) -> Array:
    """See :attr:`ReadingChanges.values`; functions by themselves, which other processes may be sent."""
    second = slopes(time, slopes(time, readings))
    return np.stack([second, slopes(time, second)])


def _at(whole: ReadingChanges, own: slice | NDArray[np.bool_]) -> Array:
    """The values at some of the samples."""
    return whole.values[:, own]


def _means(whole: ReadingChanges, many: int) -> Array:
    """The values as means over so many samples."""
    return np.stack([means_of(each, many) for each in whole.values])
