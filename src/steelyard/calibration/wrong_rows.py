"""Rows that contradict all others: found, named and left out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from steelyard.arrays import Array
from steelyard.calibration.settings import CalibrationSettings
from steelyard.identification.model.looked_at import looked_at
from steelyard.identification.model.motion_segment import Reading, Segment
from steelyard.identification.solve.fit_state import Fit, Task


@dataclass(frozen=True)
class WrongRow:
    """A reading that contradicts all others, and was left out."""

    run: str
    instrument: str
    row: int
    """Of the stream, from 1."""
    channel: str
    off: float
    """Measured less predicted, in the unit of the reading."""
    unit: str

    def __str__(self) -> str:
        return (
            f"run '{self.run}': row {self.row} of {self.instrument}: {self.channel} is off by"
            f" {self.off:+.3g} {self.unit} against all others: left out; correct it, or leave the"
            " row out"
        )


def are_many(
    wrong: Sequence[WrongRow], segments: Sequence[Segment], settings: CalibrationSettings
) -> bool:
    """Whether so many rows of one channel are wrong that it is no row but what is said of it.

    Args:
        wrong: All of them.
        segments: With the poses.
        settings: What is many.
    """
    counts = Counter((each.instrument, each.channel) for each in wrong)
    return any(
        count > max(2, settings.most_wrong * _rows_of(name, segments))
        for (name, _), count in counts.items()
    )


def _rows_of(name: str, segments: Sequence[Segment]) -> int:
    """Rows that an instrument has read: it may have seen few of the poses."""
    return sum(
        max(
            (len(reading.time) for reading in segment.readings if reading.source[0] == name),
            default=0,
        )
        for segment in segments
    )


def without_wrong(
    task: Task, found: Fit, settings: CalibrationSettings
) -> tuple[tuple[Segment, ...], list[WrongRow]]:
    """Segments without the channels that stand farthest from all others, pose by pose the worst.

    Args:
        task: What was fitted.
        found: How.
        settings: What is wrong.
    """
    wrong, segments = [], []
    for segment in found.state.segments:
        worst: dict[int, tuple[float, int, int, int]] = {}
        off = [_off(task, found, segment, reading) for reading in segment.readings]
        for place, (reading, own) in enumerate(zip(segment.readings, off, strict=True)):
            factor = found.state.factors.get(segment.label(*reading.source), 1.0)
            size = np.abs(own) / (reading.sigma * factor)
            for i, k in zip(*np.nonzero(size > settings.wrong), strict=True):
                number = int(reading.time[i])
                if size[i, k] > worst.get(number, (0.0,))[0]:
                    worst[number] = float(size[i, k]), place, int(i), int(k)
        dropped: dict[int, list[tuple[int, int]]] = {}
        for _, place, i, k in worst.values():
            dropped.setdefault(place, []).append((i, k))
            wrong.append(
                _named(task, segment, segment.readings[place], i, k, float(off[place][i, k]))
            )
        readings = [
            _dropped(task, reading, dropped.get(place, []))
            for place, reading in enumerate(segment.readings)
        ]
        segments.append(replace(segment, readings=tuple(readings)))
    return tuple(segments), wrong


def _off(task: Task, found: Fit, segment: Segment, reading: Reading) -> Array:
    """Measured less predicted, in the unit of the reading, shape (n, k)."""
    whole = slice(0, len(reading.time))
    calibration = found.state.calibration
    linear = looked_at(task.experiment, segment, reading, whole, calibration, {})[-1]
    return np.asarray(linear["residual"])


def _dropped(task: Task, reading: Reading, cells: Sequence[tuple[int, int]]) -> Reading:
    """A reading without some numbers; a rotation is one, and goes as a whole."""
    if not cells:
        return reading
    instrument = task.experiment.instruments[reading.source[0]]
    if not instrument.quantity(reading.source[1], task.experiment.robot.m).rotation:
        values = reading.values.copy()
        for i, k in cells:
            values[i, k] = np.nan
        return replace(reading, values=values)
    keep = ~np.isin(np.arange(len(reading.values)), [i for i, _ in cells])
    tension = None if reading.tension is None else reading.tension[keep]
    return replace(reading, time=reading.time[keep], values=reading.values[keep], tension=tension)


def _named(task: Task, segment: Segment, reading: Reading, i: int, k: int, off: float) -> WrongRow:
    """What is wrong with a reading."""
    name, what = reading.source
    quantity = task.experiment.instruments[name].quantity(what, task.experiment.robot.m)
    channel, unit = quantity.forms[0][k], quantity.unit
    if quantity.rotation:
        channel, unit = quantity.name, "rad"
    return WrongRow(segment.run, name, int(reading.time[i]) + 1, channel, off, unit)
