"""From single numbers with time stamps, as controllers have them, to samples of instruments."""

from __future__ import annotations

import bisect
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from steelyard.errors import InputError
from steelyard.experiment.model import Experiment
from steelyard.experiment.streams.of_columns import stream_of_columns
from steelyard.instruments import Instrument
from steelyard.live.message import Arrival, arrival_of
from steelyard.live.settings import LIVE, LiveSettings
from steelyard.live.sources.source import Received

TOGETHER = 4e-4
"""Time stamps of one sample are apart by this at most [s]."""
_OPEN = 5_000
"""Samples of an instrument of which numbers are still to come, at most."""


@dataclass(frozen=True)
class NodeName:
    """Where the values of a column come from."""

    instrument: str
    column: str
    node: str
    """As its controller calls it."""


@dataclass(frozen=True)
class NodeValue:
    """One number."""

    name: NodeName
    time: float
    """[s]"""
    value: Any
    """A number; None where the controller has none at that time."""


class NodeReader(Protocol):
    """A connection that numbers come over."""

    def values(self, seconds: float) -> tuple[list[NodeValue], list[str]]:
        """What comes within so many seconds [s], and what has happened to the connection."""

    def close(self) -> None:
        """End the connection."""


def nodes_of(experiment: Experiment, url: str) -> list[NodeName]:
    """All nodes that an experiment names.

    Args:
        experiment: Whose instruments have them.
        url: Of the source, for messages.

    Raises:
        InputError: There are none, or some of an instrument are missing.
    """
    found = []
    for name, instrument in experiment.instruments.items():
        if instrument.nodes:
            nothing = dict.fromkeys(dict(instrument.nodes), np.empty(0))
            try:
                stream_of_columns(name, instrument, experiment.robot.m, np.empty(0), nothing)
            except InputError as error:
                raise InputError(f"'nodes' of {error}") from error
            found += [NodeName(name, column, node) for column, node in instrument.nodes]
    if not found:
        raise InputError(
            f"--source: expected instruments with 'nodes' for {url}, found none; say in the"
            " experiment file which node has which column"
        )
    return found


@dataclass
class OpenSamples:
    """Samples of one instrument of which not all numbers have come."""

    columns: frozenset[str]
    times: list[float] = field(default_factory=list)
    """Ascending [s]."""
    rows: list[dict[str, tuple[float, Any]]] = field(default_factory=list)
    """Column -> time and value of each."""

    def with_value(self, column: str, time: float, value: Any) -> dict[str, Any] | None:
        """Take a number; the sample, where it is whole now."""
        first = bisect.bisect_left(self.times, time - TOGETHER)
        at = first
        while at < len(self.times) and self.times[at] <= time + TOGETHER:
            if column not in self.rows[at]:
                break
            at += 1
        else:
            at = bisect.bisect_left(self.times, time)
            self.times.insert(at, time)
            self.rows.insert(at, {})
        row = self.rows[at]
        row[column] = (time, value)
        if len(row) < len(self.columns):
            return None
        del self.times[at], self.rows[at]
        stamps = [each for each, _ in row.values()]
        mean = stamps[0] + math.fsum(each - stamps[0] for each in stamps) / len(stamps)
        return {"t": mean, **{name: own for name, (_, own) in row.items()}}

    def without_oldest(self) -> set[str] | None:
        """Let the oldest go where there are too many; the columns that it has not."""
        if len(self.times) <= _OPEN:
            return None
        del self.times[0]
        return set(self.columns - self.rows.pop(0).keys())


class NodeSource:
    """A source of numbers, over whatever they come."""

    def __init__(
        self,
        reader: NodeReader,
        names: Sequence[NodeName],
        instruments: Mapping[str, Instrument],
        m: int,
        settings: LiveSettings = LIVE,
    ) -> None:
        self._reader, self._instruments, self._m = reader, instruments, m
        self._settings = settings
        self._open = {
            instrument: OpenSamples(
                frozenset(n.column for n in names if n.instrument == instrument)
            )
            for instrument in dict.fromkeys(name.instrument for name in names)
        }

    def receive(self, seconds: float) -> Received:
        """See :meth:`.SampleSource.receive`."""
        values, remarks = self._reader.values(seconds)
        whole, refused, why = self._sorted(values)
        arrivals = []
        for name, rows in whole.items():
            for first in range(0, len(rows), self._settings.most_samples):
                part = rows[first : first + self._settings.most_samples]
                found, wrong, said = self._arrivals(name, part)
                arrivals += found
                refused, why = refused + wrong, said or why
        return Received(tuple(arrivals), refused, why, tuple(remarks))

    def _sorted(
        self, values: Iterable[NodeValue]
    ) -> tuple[dict[str, list[dict[str, Any]]], int, str]:
        """Samples that are whole now, by instrument; how many never will be, and why."""
        whole: dict[str, list[dict[str, Any]]] = {}
        refused, why = 0, ""
        for each in values:
            name = each.name.instrument
            if not math.isfinite(each.time):
                refused += 1
                why = f"{name}: '{each.name.column}': expected a time stamp, found none"
                continue
            own = self._open[name]
            row = own.with_value(each.name.column, each.time, each.value)
            if row is not None:
                whole.setdefault(name, []).append(row)
            missing = own.without_oldest()
            if missing is not None:
                refused += 1
                why = (
                    f"{name}: expected time stamps of all its nodes within {TOGETHER * 1e3:g} ms,"
                    f" found none of {', '.join(sorted(missing))}; have the controller write them"
                    " together"
                )
        return whole, refused, why

    def _arrivals(self, name: str, rows: list[dict[str, Any]]) -> tuple[list[Arrival], int, str]:
        """Samples of an instrument; where some of them are none, one by one."""
        try:
            return [self._arrival(name, rows)], 0, ""
        except InputError as error:
            if len(rows) == 1:
                return [], 1, str(error)
        found, refused, why = list[Arrival](), 0, ""
        for row in rows:
            try:
                found.append(self._arrival(name, [row]))
            except InputError as error:
                refused, why = refused + 1, str(error)
        return found, refused, why

    def _arrival(self, name: str, rows: list[dict[str, Any]]) -> Arrival:
        """As of a message."""
        columns: dict[str, Any] = {key: [row[key] for row in rows] for key in rows[0]}
        return arrival_of(
            {"instrument": name, **columns}, self._instruments, self._m, self._settings
        )

    def close(self) -> None:
        """See :meth:`.SampleSource.close`."""
        self._reader.close()
