"""What the first-order filter of a force amplifier smooths, told by how its readings change.

Of a reading the filter leaves ``1 / (1 + s T)``. Its delay is in the time at which the balance looks at
the motion (:func:`.balance_times`); what it adds beside is ``(s T)^2 / 2 - (s T)^3 / 3`` of the
readings, since ``exp(-s T) (1 + s T) = 1 - (s T)^2 / 2 + (s T)^3 / 3 - ...``.

The closer the samples are by which a change is looked at, the faster are the changes that are seen (a
cable that goes slack or comes taut within some hundredths of a second), and the more noise is seen
with them. The readings are corrected by changes over as short a time as their noise allows, and taken
as noisy as they are then: else no filter at all would fit best where it explains little. Derivatives
by the time constant are those over the longest; that their noise meets that of the readings is taken
off.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.identification.model.balance.slopes import AROUND, means_of, slopes

_TIMES = AROUND * 2.0 ** -np.arange(4)
"""Half the times over which changes are looked at, the longest first [s]."""
_NOISE = 0.05
"""Part of their own noise by which corrected readings may be noisier."""
_FASTEST = 2.0
"""Half the time over which changes are looked at, in time constants of the filter, at least."""


@dataclass(frozen=True, eq=False)
class ReadingChanges:
    """How fast readings change, to the third order, as is seen over times of several lengths."""

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
        """Second and third derivatives over each time, the longest first [N/s^2], [N/s^3] and of
        torques, shape (w, 2, n, r).
        """
        return self.seen()

    def at(self, own: slice | NDArray[np.bool_]) -> ReadingChanges:
        """At some of the samples."""
        return replace(self, seen=partial(_at, self, own))

    def means(self, many: int) -> ReadingChanges:
        """With means over so many samples in place of each."""
        return replace(self, seen=partial(_means, self, many))

    def added(self, constant: float) -> Array:
        """What a filter of this time constant T [s] adds to readings beside its delay, shape (n, r)."""
        second, third = np.tensordot(self._weights(constant), self.values, axes=1)
        return np.asarray(constant**2 / 2 * second - constant**3 / 3 * third)

    def added_by_constant(self, constant: float) -> Array:
        """The derivative of :meth:`added` by the time constant, over the longest times, shape (n,
        r).
        """
        second, third = self.values[0]
        return np.asarray(constant * second - constant**2 * third)

    def louder(self, constant: float) -> float:
        """Noise of readings without what a filter of this time constant T [s] adds, in their own.

        What is fitted best would be no filter at all, if corrected readings were not taken as noisy as
        they are.
        """
        return float(np.sqrt(np.sum(self._corrected(constant) ** 2)))

    def louder_by_constant(self, constant: float) -> float:
        """The relative derivative of :meth:`louder` by the time constant [1/s], as far as it is that of
        :meth:`added_by_constant`: by so much of themselves residuals would seem to change with it.
        """
        if self.step <= 0:
            return 0.0
        whole = self._corrected(constant)
        second, third = _kernels(self.step)[0]
        change = constant**2 * third - constant * second
        return float(change @ whole / (whole @ whole))

    def _corrected(self, constant: float) -> Array:
        """What is made of a single reading of one among many of nothing, shape (n,)."""
        if self.step <= 0:
            return np.ones(1)
        second, third = np.tensordot(self._weights(constant), _kernels(self.step), axes=1)
        whole = np.asarray(constant**3 / 3 * third - constant**2 / 2 * second)
        whole[len(whole) // 2] += 1.0
        return whole

    def _weights(self, constant: float) -> Array:
        """Of what is seen over each time, shape (w,): of the two next to the shortest that noise
        allows, so that what is added has no step along the time constant.
        """
        # A second derivative by lines over h on either side has 3 dt / (2 h^3) of each sample in
        # itself; of what is faster than the filter itself the series says nothing.
        by_noise = np.cbrt(3 * self.step * constant**2 / (4 * _NOISE))
        shortest = max(float(by_noise), _FASTEST * constant)
        place = np.log2(AROUND / max(shortest, _TIMES[-1]))
        return np.asarray(np.maximum(0.0, 1 - np.abs(np.arange(len(_TIMES)) - max(place, 0.0))))


@lru_cache(maxsize=8)
def _kernels(step: float) -> Array:
    """Second and third derivatives of a single reading of one among many of nothing, over each time,
    shape (w, 2, n).

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

    def over(around: float) -> Array:
        second = slopes(time, slopes(time, readings, around), around)
        return np.stack([second, slopes(time, second, around)])

    return np.stack([over(float(around)) for around in _TIMES])


def _at(whole: ReadingChanges, own: slice | NDArray[np.bool_]) -> Array:
    """The values at some of the samples."""
    return whole.values[:, :, own]


def _means(whole: ReadingChanges, many: int) -> Array:
    """The values as means over so many samples."""
    return np.stack([[means_of(each, many) for each in over] for over in whole.values])
