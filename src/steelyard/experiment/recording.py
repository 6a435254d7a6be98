"""A recording: raw streams, each on its own clock."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.display import printable
from steelyard.experiment.faults.fault import Fault


@dataclass(frozen=True, eq=False)
class Stream:
    """What one instrument recorded in one run."""

    time: Array
    """On the instrument's own clock, never decreasing [s], shape (n,); of a static run, the number
    of the pose."""
    values: Mapping[str, Array]
    """Quantity -> vectors, shape (n, k), or rotations, shape (n, 3, 3); NaN where there is no
    sample."""
    source: str
    """Where it came from, for messages."""
    angles: Mapping[str, Array] = field(default_factory=dict)
    """Quantity -> roll, pitch, yaw as they stand in the log, where a rotation was read from angles
    [rad], shape (n, 3)."""
    forms: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """Quantity -> columns of the contract that it was read from; what was not read from a log has
    none."""
    clock: str | None = None
    """What its times were taken from: streams that name one and the same clock share its times, as
    those of one file do; None: a clock of its own, whatever ``source`` says."""
    off: Mapping[str, Array] = field(default_factory=dict)
    """Quantity -> how far the numbers of its log are from a rotation: the length of a quaternion
    from one, a matrix from its inverse's transpose; shape (n,). Only until damaged ones are left
    out."""
    mean_of: int = 1
    """Samples that each row is the mean of: its noise is by the root of it less than stated."""

    def __len__(self) -> int:
        return len(self.time)

    def at_rows(self, rows: NDArray[np.bool_] | NDArray[np.intp] | slice) -> Stream:
        """With some of its samples alone.

        Args:
            rows: Which, shape (n,), or in which order; of a slice nothing is copied.
        """
        return replace(
            self,
            time=self.time[rows],
            values={key: each[rows] for key, each in self.values.items()},
            angles={key: each[rows] for key, each in self.angles.items()},
            off={key: each[rows] for key, each in self.off.items()},
        )

    def __repr__(self) -> str:
        quantities = f", {', '.join(self.values)}" if self.values else ""
        return f"Stream: {self._extent()}{quantities}, from {printable(self.source)}"

    def _extent(self) -> str:
        """How many samples, and when."""
        if len(self) < 2:
            return f"{len(self)} sample{'' if len(self) else 's'}"
        first, last = self.time[[0, -1]]
        rate = f", {(len(self) - 1) / (last - first):.4g} Hz" if last > first else ""
        return f"{len(self)} samples from {first:.2f} to {last:.2f} s{rate}"


BESIDE = 5.0
"""Of a stream beside the window of its run that is read along [s]: clocks may differ by their
delays, filters have edges."""


@dataclass(frozen=True, eq=False)
class Run:
    """One recording."""

    name: str
    streams: Mapping[str, Stream]
    """Instrument -> its stream."""
    sync: Mapping[str, float] = field(default_factory=dict)
    """Instrument -> time of one common event on its clock [s]; empty: the clocks agree."""
    window: tuple[float, float] | None = None
    """Part to use [s], after the event (without sync: after the first force sample)."""
    static: bool = False
    """Whether the rows are poses at rest."""
    unsynchronised: bool = False
    """Whether the clocks have nothing in common yet: how far they are apart is to be found from the
    data."""
    found: bool = False
    """Whether the times under ``sync`` were found from the data: they are no better known than any
    clock."""
    locked: bool = False
    """Whether the winches were locked, so that the unstrained lengths of the cables are
    constant."""
    load: str | None = None
    """What the platform carried, of several loads; None: the first, or there is only one."""
    continues: str | None = None
    """Run that went on as this one when the load changed: clocks and all errors that hold for a run
    are those of that one; None: it is a recording by itself."""
    excluded: tuple[Fault, ...] = ()
    """Readings that were taken out of the streams when they were read, since their sensors had
    stopped."""

    def __repr__(self) -> str:
        kind = "poses at rest" if self.static else "in motion"
        counts = ", ".join(
            f"{printable(name)} {len(stream)}" for name, stream in self.streams.items()
        )
        return f"Run '{printable(self.name)}', {kind}: samples of {counts or 'nothing'}"
