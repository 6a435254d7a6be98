"""Clocks that were set while a sensor read on: times from then on are put back to where the
readings say that they belong.

A logger whose clock follows a network's is set by tenths of a second or by hours. Its times have a
pause then, its readings have none: they go on from one sample to the next as they do elsewhere,
while what moves would have gone far. Where nothing moves a pause is taken for a pause. Nothing here
knows what the numbers mean.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from steelyard.arrays import Array
from steelyard.experiment.faults.fault import Fault
from steelyard.experiment.faults.of_streams import channels
from steelyard.experiment.recording import Stream
from steelyard.instruments import Instrument


@dataclass(frozen=True)
class ClockStepSettings:
    """When a pause of the times is one of the clock alone."""

    least: float = 0.02
    """By how much the clock was set, at least [s]: less is hardly more than stamps scatter by."""
    periods: float = 4.0
    """The same in samples; the larger of the two counts."""
    scatters: float = 8.0
    """The same in scatters of the steps."""
    regained: float = 0.25
    """Part of a pause by which the times around it may run faster than usual: a logger that catches
    up afterwards has not set its clock."""
    often: float = 1 / 3
    """Share of the pauses of a stream across which readings go on, at least: where a network or a
    logger makes many, one of them may look so by chance."""
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
        The streams, and by how much the clock was set: ``start`` and ``end`` of a fault are the
        times before and after.
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
        """Whether two pauses are at one time and as long, as where streams have one clock: what one
        of them shows, noise may hide in another.
        """
        close = 2 * (self.period + other.period)
        return abs(self.start - other.start) < close and abs(self.off - other.off) < close


def _pauses(name: str, stream: Stream, settings: ClockStepSettings) -> list[_Pause]:
    """Pauses of a stream."""
    steps, found = np.diff(stream.time), list[_Pause]()
    if not np.any(steps > 0):
        return found
    period = float(np.median(steps[steps > 0]))
    scatter = float(np.subtract(*np.percentile(steps, [75, 25]))) / 1.35
    least = max(settings.least, settings.periods * period, settings.scatters * scatter)
    lasts = np.flatnonzero(steps > period + least).tolist()
    if not lasts:
        return found
    flat = np.hstack([values for *_, values in channels(stream)])
    flat = flat[:, np.isfinite(flat).mean(axis=0) > settings.read]
    every = [_Lines.of(flat, lasts, samples, settings) for samples in settings.samples]
    for last in lasts:
        off = float(steps[last]) - period
        lag = round(min(off, settings.longest) / period)
        # What was late is followed, or led, by as much that came close together.
        beside = steps[max(0, last - 2 * lag) : last], steps[last + 1 : last + 1 + 2 * lag]
        regained = max(float(np.sum(period - each)) for each in beside)
        goes_on = regained < settings.regained * off and any(
            lines is not None and lines.go_on(last, lag, settings) for lines in every
        )
        start, end = stream.time[last : last + 2].tolist()
        found.append(_Pause(name, start, end, last, period, goes_on))
    if sum(each.goes_on for each in found) < settings.often * len(found):
        return [replace(each, goes_on=False) for each in found]
    return found


@dataclass(frozen=True, eq=False)
class _Lines:
    """Straight lines through the samples up to each one, and from each one on: where they meet, and
    by how much they rise. At a turn both sides of a pause are at one place, and move away from it.
    """

    until: Array
    """Half a sample after each, of those up to it, and their rise, shape (n, 2 c); NaN where there
    are too few."""
    since: Array
    """Half a sample before each, of those from it on, and their rise, shape (n, 2 c)."""
    unit: Array
    """Usual distance of a line from the next, shape (2 c,)."""

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
        rise = windows @ (k * along)
        none = np.full((k - 1, 2 * flat.shape[1]), np.nan)
        until = np.concatenate([none, np.hstack([windows @ ahead, rise])])
        since = np.concatenate([np.hstack([windows @ ahead[::-1], rise]), none])
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
