"""Readings of the force instrument within a segment, and what processes add to them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.identification.model.balance.slopes import means_of
from steelyard.identification.model.calibration_parameters import (
    ROBOT,
)
from steelyard.identification.model.motion_segment import Segment
from steelyard.identification.model.sources import Source
from steelyard.instruments.tension import RollerState
from steelyard.robot.model import DIRECTIONS

UNMODELLED = "unmodelled wrench"
"""Quantity of the platform: what acts on it and nothing explains."""
UNMODELLED_PARTS: Mapping[Source, slice] = {
    (ROBOT, "unmodelled force"): slice(0, 3),
    (ROBOT, "unmodelled torque"): slice(3, 6),
}
"""Processes that are parts of it -> where they stand in a wrench."""
_AT_ONCE = 2048
"""Force readings whose rows are held at once: they depend on everything."""
_LEFT_OUT = 1e2
"""1-sigma of a reading that is left out, in units of the largest reading: the balance goes on
without it."""
_GAP = 2.0
"""Time over which samples follow each other, in units of the usual one, across which none are
averaged."""


@dataclass(frozen=True, eq=False)
class Forces:
    """Readings of the force instrument within a segment."""

    name: str
    """Of the instrument."""
    time: Array
    """By its clock, moved to the common event [s]; of poses at rest their number; shape (n,)."""
    readings: Mapping[str, Array]
    """Quantity -> readings, r numbers a sample in all."""
    sigma: Array
    """1-sigma of single readings, shape (r,)."""
    left_out: NDArray[np.bool_]
    """Readings that stand alone against all others, shape (n, r)."""
    unmodelled: Array | None = None
    """1-sigma of the white part of the wrench that nothing explains, in units of its level [N],
    [N m], shape (6,); None: the readings explain every wrench within their noise."""
    everywhere: bool = False
    """Whether that is in all directions; else in those that no cable carries."""
    late: Array | None = None
    """1-sigma that time stamps which scatter add to each reading, shape (n, r); None: none."""
    unread: NDArray[np.bool_] | None = None
    """Readings of cables without a sensor, whose values are a guess, shape (r,); None: there are
    none."""
    smoothed: bool = True
    """Whether what a filter smooths is looked at; else its delay alone, where the motion before is
    not known."""
    before: RollerState | None = None
    """What rollers remember of the samples before the first one; None: the run begins."""

    @property
    def touched(self) -> NDArray[np.bool_]:
        """Samples in which something else than the body pulls, shape (n,)."""
        return np.asarray(self.left_out.all(axis=1))

    @property
    def guessed(self) -> NDArray[np.bool_]:
        """Readings that nobody reads, shape (r,)."""
        none = np.zeros(self.left_out.shape[1], dtype=bool)
        return none if self.unread is None else self.unread

    @property
    def places(self) -> dict[str, slice]:
        """Quantity -> where its readings stand among the r numbers of a sample."""
        ends = np.cumsum([values.shape[1] for values in self.readings.values()]).tolist()
        starts = [0, *ends[:-1]]
        return {q: slice(*each) for q, *each in zip(self.readings, starts, ends, strict=True)}

    def parts(self) -> Iterator[Forces]:
        """The same, some samples at a time: rows take much memory."""
        for start in range(0, len(self.time), _AT_ONCE):
            yield self.part(slice(start, start + _AT_ONCE))

    def part(self, own: slice | NDArray[np.bool_]) -> Forces:
        """Some of its samples.

        Args:
            own: Which.
        """
        return replace(
            self,
            time=self.time[own],
            readings={quantity: values[own] for quantity, values in self.readings.items()},
            left_out=self.left_out[own],
            late=None if self.late is None else self.late[own],
        )

    def means(self, many: int) -> Forces:
        """Means of so many samples each, without what is faster; without a reading of one there is
        none of all, and none across a gap.

        Args:
            many: At least one; fewer samples than that at the end are left.
        """
        n = len(self.time) // many * many
        if many == 1 or not n:
            return self
        time = self.time[:n].reshape(-1, many)
        usual = float(np.median(np.diff(self.time)))
        apart = np.ptp(time, axis=1) > _GAP * (many - 1) * usual
        left_out = self.left_out[:n].reshape(n // many, many, -1).any(axis=1) | apart[:, None]
        return replace(
            self,
            time=time.mean(axis=1),
            readings={
                quantity: means_of(values, many) for quantity, values in self.readings.items()
            },
            left_out=left_out,
            late=None if self.late is None else means_of(self.late, many),
        )

    def bridged(self, alone: NDArray[np.bool_]) -> Forces:
        """With what lies between those before and after in the place of readings: a cable pulls and
        sags by what it reads, even where that does not count.

        Args:
            alone: Readings that are no tensions, shape (n, r).
        """
        gone = alone | self.left_out
        readings = dict(self.readings)
        for quantity, own in self.places.items():
            values = self.readings[quantity].copy()
            for column, lost, out in zip(values.T, alone[:, own].T, gone[:, own].T, strict=True):
                if lost.any() and not out.all():
                    column[lost] = np.interp(self.time[lost], self.time[~out], column[~out])
            readings[quantity] = values
        return replace(self, readings=readings)

    def sigmas(self, segment: Segment, factors: Mapping[Source, float]) -> Array:
        """1-sigma of every reading, shape (n, r)."""
        factor = np.concatenate(
            [
                np.full(v.shape[1], factors.get(segment.label(self.name, q), 1.0))
                for q, v in self.readings.items()
            ]
        )
        largest = np.concatenate(
            [np.abs(v).max(axis=0, initial=0.0) for v in self.readings.values()]
        )
        # So wide that no reading of it matters, however good the sensor was.
        without = _LEFT_OUT * np.maximum(self.sigma * factor, largest)
        own = self.sigma * factor
        if self.late is not None:
            own = np.hypot(own, self.late)
        return np.asarray(np.where(self.left_out, without, own))

    def unmodelled_sigma(self, segment: Segment, factors: Mapping[Source, float]) -> Array:
        """1-sigma of the white part of the wrench that nothing explains [N], [N m], shape (6,)."""
        if self.unmodelled is None:
            return np.zeros(DIRECTIONS)
        return factors.get(segment.label(ROBOT, UNMODELLED), 1.0) * self.unmodelled


def undisturbed(force_samples: Forces, added: Array) -> Forces:
    """Force readings less what processes add to them.

    Args:
        force_samples: Force readings.
        added: See :func:`disturbance_of_forces`.
    """
    readings = {
        quantity: values - added[:, force_samples.places[quantity]]
        for quantity, values in force_samples.readings.items()
    }
    return replace(force_samples, readings=readings)
