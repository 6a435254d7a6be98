"""An experiment as an immutable value: raw streams, each on its own clock."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from steelyard.arrays import Array
from steelyard.instruments import Command, Instrument, Length, Tension, Wrench
from steelyard.instruments.base import DEFAULT_DELAY, Prior, exact, sigma
from steelyard.robot.model import Robot


@dataclass(frozen=True)
class Fault:
    """Something wrong with a stream itself, whatever it says of the motion."""

    kind: Literal["gap", "dropped", "late", "repeated", "stuck", "clipped", "held", "missing"]
    instrument: str
    channel: str
    """Quantity, with the number of the component where it has several that fail alone; empty: the whole stream."""
    start: float
    """On the clock of the stream [s]."""
    end: float
    """[s]"""
    count: int
    """Samples that it concerns; of gaps and dropped packets those that are not there."""


@dataclass(frozen=True, eq=False)
class Stream:
    """What one instrument recorded in one run."""

    time: Array
    """On the instrument's own clock, never decreasing [s], shape (n,); of a static run, the number of the pose."""
    values: Mapping[str, Array]
    """Quantity -> vectors, shape (n, k), or rotations, shape (n, 3, 3); NaN where there is no sample."""
    source: str
    """Where it came from, for messages."""
    angles: Mapping[str, Array] = field(default_factory=dict)
    """Quantity -> roll, pitch, yaw as they stand in the log, where a rotation was read from angles [rad], shape (n, 3)."""

    def __len__(self) -> int:
        return len(self.time)


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
    """Whether the clocks have nothing in common yet: how far they are apart is to be found from the data."""
    found: bool = False
    """Whether the times under ``sync`` were found from the data: they are no better known than any clock."""
    excluded: tuple[Fault, ...] = ()
    """Readings that were taken out of the streams when they were read, since their sensors had stopped."""


@dataclass(frozen=True, eq=False)
class Experiment:
    """One robot, the instruments on it, and the runs recorded with them."""

    name: str
    robot: Robot
    instruments: Mapping[str, Instrument]
    runs: tuple[Run, ...]
    known: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Body parameter (:data:`steelyard.inertia.BODY_PARAMETERS`) -> value and 1-sigma, where known beforehand."""
    uncertainty: Mapping[str, float] = field(default_factory=dict)
    """1-sigma of the robot file's ``anchor`` and ``attachment`` [m] and ``gravity`` [m/s^2], per coordinate."""
    source: str = ""
    """File that it was read from."""

    def of_kind(self, kind: type[Instrument]) -> dict[str, Instrument]:
        """Instruments of one kind, in the order of the file."""
        return {name: i for name, i in self.instruments.items() if isinstance(i, kind)}

    def force_instrument(self, run: Run) -> str | None:
        """The instrument whose clock defines the time of a run: its first tension or wrench stream."""
        return next((n for n in self.instruments if n in run.streams and self.is_force(n)), None)

    def is_force(self, name: str) -> bool:
        """Whether an instrument reads what carries the platform."""
        return is_force(self.instruments[name])

    def delay(self, run: Run, name: str) -> Prior:
        """Prior of the clock error of an instrument in a run [s]: as stated, else 0 for the clock that defines the time."""
        instrument = self.instruments[name]
        reference = self.force_instrument(run)
        stated = instrument.calibration.delay
        if run.found and stated is not None and name != reference:
            widest = max(DEFAULT_DELAY, float(np.max(stated.sigma or 0.0)))
            return stated.model_copy(update={"sigma": widest})
        if stated is not None:
            return stated
        if reference is None:
            return sigma(DEFAULT_DELAY)
        same_clock = name == reference or (
            instrument.clock is not None and instrument.clock == self.instruments[reference].clock
        )
        return exact() if same_clock else sigma(DEFAULT_DELAY)

    def common_time(self, run: Run, name: str, delay: float | None = None) -> Array:
        """Times of a stream on the common clock [s], shape (n,): 0 is the common event, or the first force sample.

        Args:
            run: One of the runs.
            name: Instrument.
            delay: Of its clock [s]; None: as known beforehand.
        """
        if run.static:
            return run.streams[name].time
        value = self.delay(run, name).value
        late = delay if delay is not None else float(np.mean(value)) if value is not None else 0.0
        if run.sync:
            return run.streams[name].time - run.sync[name] - late
        reference = self.force_instrument(run)
        origin = run.streams[reference].time[0] if reference else 0.0
        return run.streams[name].time - origin - late


def is_force(instrument: Instrument) -> bool:
    """Whether an instrument reads what carries the platform."""
    return isinstance(instrument, Tension | Wrench)


def is_motion(instrument: Instrument) -> bool:
    """Whether an instrument measures how the platform moves."""
    if isinstance(instrument, Command):
        return instrument.is_measurement
    return not isinstance(instrument, Tension | Wrench | Length)
