"""Samples that have arrived and are not used up yet, in the order of their times."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from steelyard.experiment.recording import Stream
from steelyard.live.message import Arrival
from steelyard.live.settings import LIVE, LiveSettings


@dataclass(frozen=True)
class Counts:
    """Samples that were not taken, and messages that were none."""

    taken: int = 0
    late: int = 0
    """Older than what has been used already."""
    doubled: int = 0
    """With the time of another of the same instrument."""
    ahead: int = 0
    """With a time far ahead of all others."""
    refused: int = 0
    """Messages that could not be read."""


@dataclass(frozen=True, eq=False)
class Buffer:
    """Streams of all instruments, as far as they have arrived."""

    streams: Mapping[str, Stream] = field(default_factory=dict)
    counts: Counts = field(default_factory=Counts)
    suspects: Mapping[str, tuple[Stream, ...]] = field(default_factory=dict)
    """Instrument -> samples far ahead, until enough of them agree."""

    def with_arrivals(
        self,
        arrivals: Iterable[Arrival],
        used: Mapping[str, float],
        settings: LiveSettings = LIVE,
    ) -> Buffer:
        """With more samples.

        Args:
            arrivals: In any order.
            used: Instrument -> time on its clock until which samples have been used [s].
            settings: What is late, and what is far ahead.
        """
        by_name: dict[str, list[Stream]] = {}
        for each in arrivals:
            by_name.setdefault(each.instrument, []).append(each.stream)
        found = self
        for name, streams in by_name.items():
            found = found._with(name, joined(streams), used.get(name, -np.inf), settings)
        return found

    def refused(self, count: int = 1) -> Buffer:
        """With messages that could not be read."""
        return replace(self, counts=replace(self.counts, refused=self.counts.refused + count))

    def since(self, oldest: Mapping[str, float]) -> Buffer:
        """Without samples that are older.

        Args:
            oldest: Instrument -> time on its clock [s].
        """
        streams = {}
        for name, stream in self.streams.items():
            first = int(np.searchsorted(stream.time, oldest.get(name, -np.inf)))
            streams[name] = stream.at_rows(slice(first, None)) if first else stream
        return replace(self, streams=streams)

    def _with(self, name: str, new: Stream, used: float, settings: LiveSettings) -> Buffer:
        """With samples of one instrument."""
        counts = self.counts
        order = np.argsort(new.time, kind="stable")
        new = new.at_rows(order)
        late = int(np.searchsorted(new.time, used))
        new = new.at_rows(slice(late, None))
        old = self.streams.get(name)
        suspects = dict(self.suspects)
        if old is not None and len(old):
            # What goes on from one sample to the next is not ahead, however much comes at once.
            steps = np.diff(new.time, prepend=old.time[-1])
            near = (
                int(np.argmax(steps > settings.ahead))
                if (steps > settings.ahead).any()
                else len(new)
            )
            far, new = new.at_rows(slice(near, None)), new.at_rows(slice(0, near))
            if len(far):
                waiting = joined([*suspects.get(name, ()), far])
                waiting = waiting.at_rows(np.argsort(waiting.time, kind="stable"))
                group = np.cumsum(np.diff(waiting.time, prepend=waiting.time[0]) > settings.ahead)
                agree = np.bincount(group)[group] >= settings.agreeing
                if agree.any():
                    # The clock has moved on, or the connection was lost for a while.
                    counts = replace(counts, ahead=counts.ahead + int(np.sum(~agree)))
                    new, waiting = (
                        joined([new, waiting.at_rows(agree)]),
                        waiting.at_rows(slice(0)),
                    )
                elif group[-1]:
                    counts = replace(counts, ahead=counts.ahead + len(waiting) - len(far))
                    waiting = far
                suspects[name] = (waiting,) if len(waiting) else ()
        if old is not None and len(old):
            whole = joined([old, new])
            if len(new) and new.time[0] <= old.time[-1]:
                whole = whole.at_rows(np.argsort(whole.time, kind="stable"))
        else:
            whole = new
        keep = np.ones(len(whole), dtype=bool)
        keep[1:] = np.diff(whole.time) > 0
        doubled = int(np.sum(~keep))
        whole = whole.at_rows(keep) if doubled else whole
        counts = replace(
            counts,
            taken=counts.taken + len(new) - doubled,
            late=counts.late + late,
            doubled=counts.doubled + doubled,
        )
        return replace(
            self, streams={**self.streams, name: whole}, counts=counts, suspects=suspects
        )


def joined(streams: Iterable[Stream]) -> Stream:
    """Samples of several streams of one instrument, one after the other; NaN where one has no
    sample of a quantity that another has.
    """
    each = list(streams)
    if len(each) == 1:
        return each[0]
    names = dict.fromkeys(quantity for stream in each for quantity in stream.values)
    values = {}
    for quantity in names:
        shape = next(s.values[quantity].shape[1:] for s in each if quantity in s.values)
        values[quantity] = np.concatenate(
            [
                stream.values[quantity]
                if quantity in stream.values
                else np.full((len(stream), *shape), np.nan)
                for stream in each
            ]
        )
    return Stream(np.concatenate([s.time for s in each]), values, each[0].source)
