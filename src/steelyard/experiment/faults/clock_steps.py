"""Clocks that were set while a sensor read on: times from then on are put back to where the readings
say that they belong.

A logger whose clock follows a network's is set by tenths of a second or by hours. Its times have a
pause then, its readings have none: they go on from one sample to the next as they do elsewhere, while
what moves would have gone far. Where nothing moves a pause is taken for a pause. Nothing here knows
what the numbers mean.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from steelyard.arrays import Array
from steelyard.experiment.faults.fault import Fault
from steelyard.experiment.faults.of_streams import channels, timing
from steelyard.experiment.recording import Stream
from steelyard.instruments import Instrument


@dataclass(frozen=True)
class ClockStepSettings:
    """When a pause of the times is one of the clock alone."""

    samples: tuple[int, ...] = (6, 16)
    """Of a straight line before a pause, and of one after it: more where there is much noise, fewer
    where the motion bends it."""
    usual: float = 99.0
    """Percentile of the distances of such lines where there is no pause, which is one unit of
    distance."""
    goes_on: float = 1.5
    """Units by which the lines on both sides of a pause may be apart for readings that go on."""
    moves: float = 5.0
    """Units by which lines as far apart in time as the pause says are apart beside it, where the
    pause would have been seen."""
    longest: float = 0.5
    """Of a pause, within which it would have been seen at least [s]."""
    read: float = 0.5
    """Share of the readings of a channel that are there, from which on it is looked at."""
    fewest: int = 50
    """Samples from which on it is known how readings go on."""


CLOCK_STEPS = ClockStepSettings()


def without_clock_steps(
    streams: Mapping[str, Stream],
    instruments: Mapping[str, Instrument],
    events: Mapping[str, float],
    settings: ClockStepSettings = CLOCK_STEPS,
) -> tuple[dict[str, Stream], tuple[Fault, ...]]:
    """Streams with times as if their clocks had not been set meanwhile.

    Args:
        streams: Instrument -> its stream, in motion.
        instruments: Of the experiment; commands rest and go on when they like.
        events: Instrument -> time of the event from which common time is counted, on its own clock
            [s]: times about it stay as they are.
        settings: Levels of the decision.

    Returns:
        The streams, and by how much the clock was set: ``start`` and ``end`` of a fault are the times
        before and after.
    """
    pauses = [
        pause
        for name, stream in streams.items()
        if not instruments[name].commanded and len(stream) >= settings.fewest
        for pause in _pauses(name, stream, settings)
    ]
    kept, faults = dict(streams), list[Fault]()
    for pause in pauses:
        alike = [each for each in pauses if each.is_same(pause)]
        if not any(each.goes_on for each in alike):
            continue
        stream = kept[pause.name]
        off = float(np.mean([each.off for each in alike]))
        time, last = stream.time.copy(), pause.last
        if events.get(pause.name, -np.inf) > pause.start:
            time[: last + 1] += off
        else:
            time[last + 1 :] -= off
        kept[pause.name] = replace(stream, time=time)
        count = len(time) - last - 1
        faults.append(Fault("set", pause.name, "", pause.start, pause.end, count))
    return kept, tuple(faults)


@dataclass(frozen=True)
class _Pause:
    """A pause in the times of a stream."""

    name: str
    """Of the instrument."""
    start: float
    """Time of the last sample before it [s]."""
    end: float
    """Of the first one after it [s]."""
    last: int
    """Number of the last sample before it."""
    period: float
    """Of the samples [s]."""
    goes_on: bool
    """Whether the readings go on across it."""

    @property
    def off(self) -> float:
        """By how much the clock was set, if it was [s]."""
        return self.end - self.start - self.period

    def is_same(self, other: _Pause) -> bool:
        """Whether two pauses are at one time and as long, as where streams have one clock: what one of
        them shows, noise may hide in another.
        """
        close = 2 * (self.period + other.period)
        return abs(self.start - other.start) < close and abs(self.off - other.off) < close


def _pauses(name: str, stream: Stream, settings: ClockStepSettings) -> Iterator[_Pause]:
    """Pauses of a stream."""
    seen = timing(stream.time)
    if not seen.gaps:
        return
    flat = np.hstack([values for *_, values in channels(stream)])
    flat = flat[:, np.isfinite(flat).mean(axis=0) > settings.read]
    lasts = [int(np.searchsorted(stream.time, start, side="right")) - 1 for start, _ in seen.gaps]
    every = [_Lines.of(flat, lasts, samples, settings) for samples in settings.samples]
    for last, (start, end) in zip(lasts, seen.gaps, strict=True):
        lag = round(min(end - start, settings.longest) * seen.rate)
        goes_on = any(lines is not None and lines.go_on(last, lag, settings) for lines in every)
        yield _Pause(name, start, end, last, 1 / seen.rate, goes_on)


@dataclass(frozen=True, eq=False)
class _Lines:
    """Straight lines through the samples up to each one, and from each one on."""

    until: Array
    """Half a sample after each, of those up to it, shape (n, c); NaN where there are too few."""
    since: Array
    """Half a sample before each, of those from it on, shape (n, c)."""
    unit: Array
    """Usual distance of a line from the next, shape (c,)."""

    @classmethod
    def of(
        cls, flat: Array, pauses: Sequence[int], k: int, settings: ClockStepSettings
    ) -> _Lines | None:
        """Of a stream, shape (n, c); None: nothing is known of how its readings go on.

        Args:
            flat: Its readings.
            pauses: Samples before each pause.
            k: Samples of a line.
            settings: Levels of the decision.
        """
        if len(flat) < k:
            return None
        windows = np.lib.stride_tricks.sliding_window_view(flat, k, axis=0)
        place = np.arange(k) - (k - 1) / 2
        along = place / np.sum(place**2)
        ahead = 1 / k + along * (k / 2)
        none = np.full((k - 1, flat.shape[1]), np.nan)
        until = np.concatenate([none, windows @ ahead])
        since = np.concatenate([windows @ ahead[::-1], none])
        apart = np.abs(until[:-1] - since[1:])
        # Lines that reach across a pause are none.
        for last in pauses:
            apart[max(0, last - k) : last + k + 1] = np.nan
        told = np.isfinite(apart).all(axis=1)
        if np.sum(told) < settings.fewest:
            return None
        unit = np.percentile(apart[told], settings.usual, axis=0)
        return cls(until, since, unit)

    def go_on(self, last: int, lag: int, settings: ClockStepSettings) -> bool:
        """Whether readings go on across a pause, though they move so far elsewhere beside it.

        Args:
            last: Sample before the pause.
            lag: Samples in the time within which it would have been seen.
            settings: Levels of the decision.
        """
        # Of what is not known no comparison holds.
        return self.apart(last, last + 1) <= settings.goes_on and all(
            self.apart(*both) > settings.moves
            for both in ((last - lag, last), (last + 1, last + 1 + lag))
        )

    def apart(self, last: int, first: int) -> float:
        """By how much the line up to a sample is off that from another one on, in the channel that
        says so most; NaN where either is not known.
        """
        if not 0 <= last < first < len(self.until):
            return np.nan
        off = np.abs(self.until[last] - self.since[first])
        moving = self.unit > 0
        return float(np.max(off[moving] / self.unit[moving])) if moving.any() else np.nan
