"""Where the stream of an instrument is, and how its log writes it."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path

from steelyard.instruments import Instrument
from steelyard.logs.formats import open_log
from steelyard.logs.log import Log


@dataclass(frozen=True)
class StreamPlace:
    """Where the stream of an instrument is, and how its log writes it."""

    path: Path
    """Of the log."""
    topic: str | None = None
    """Of a log that holds several."""
    columns: Mapping[str, str] = field(default_factory=dict)
    """Names of the contract -> names in the log, where they differ."""
    units: Mapping[str, str] = field(default_factory=dict)
    """Names in the log (or of the contract) -> unit, where neither SI nor what the log itself
    states."""
    scale: Mapping[str, float] = field(default_factory=dict)
    """The same -> what they are multiplied by, after their unit."""
    log: Log | None = None
    """Where it is no file: what has been handed over in memory."""

    def opened(self) -> AbstractContextManager[Log]:
        """The log, open for reading.

        Raises:
            InputError: It cannot be opened.
        """
        return open_log(self.path, self.topic) if self.log is None else nullcontext(self.log)

    def of_all_runs(self, instrument: Instrument) -> StreamPlace:
        """With the columns that the instrument says are exchanged in all runs."""
        exchanged = {c: self.columns.get(name, name) for c, name in instrument.columns}
        return replace(self, columns={**self.columns, **exchanged})


def as_named(log: Log, place: StreamPlace) -> StreamPlace:
    """A place whose columns are called as the log calls them, not as it spells them."""
    columns = {column: log.spellings.get(name, name) for column, name in place.columns.items()}
    units = {log.spellings.get(name, name): unit for name, unit in place.units.items()}
    return replace(place, columns=columns, units=units)
