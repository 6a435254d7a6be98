"""TDMS files of LabVIEW."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import InputError
from steelyard.logs.arrays.nested import Arrays, Key, Source, is_number
from steelyard.logs.arrays.subprocess_reader import serve
from steelyard.logs.packages import require_package
from steelyard.units import is_unit

WHAT = "a TDMS file"
_UNITS = ("unit_string", "NI_UnitDescription", "NI_ChannelUnit")
_TIME = "t"
_LEAD = struct.Struct("<4sIIQQ")
"""Tag, flags, version, bytes to the next segment and to the data."""
_METADATA, _NEW_LIST, _BIG_ENDIAN = 1 << 1, 1 << 2, 1 << 6
_MOST_OBJECTS = 2_000_000
"""In the segments together: every one of them may go on with all the channels before it."""
_FLOAT = np.dtype(np.float64)


def require(path: Path) -> None:
    """Raise InputError unless the library that reads the file is installed."""
    require_package(path, "npTDMS", "nptdms", "TDMS")


@contextmanager
def arrays_here(path: Path, topic: str | None) -> Iterator[Arrays]:
    """The channels of a TDMS file, read in this process; damaged ones may raise anything, or take
    forever.
    """
    from nptdms import TdmsFile

    # As a file that is open: by its name, an index beside it would be read instead, which may be of
    # another recording.
    with path.open("rb") as file:
        _check_segments(path, file)
        file.seek(0)
        with TdmsFile.open(file) as contents:
            yield Arrays(path, _sources(path, contents), joined=True)


def _sources(path: Path, contents: Any) -> dict[Key, Source]:
    """Channels of numbers by group and name, and columns of their times."""
    sources: dict[Key, Source] = {}
    clock = _SharedClock([channel for group in contents.groups() for channel in group.channels()])
    for group in contents.groups():
        channels = {
            channel.name: channel for channel in group.channels() if is_number(channel.dtype)
        }
        for name, channel in channels.items():
            sources[group.name, name] = _source(path, channel)
        sources.update(clock.times(group.name, channels))
    return sources


def _check_segments(path: Path, file: IO[bytes]) -> None:
    """Refuse a file that is cut off, or whose segments together list far too many objects."""
    size, place, listed, objects = path.stat().st_size, 0, 0, 0
    while place < size:
        file.seek(place)
        head = file.read(_LEAD.size + 4).ljust(_LEAD.size + 4, b"\0")
        flags = int.from_bytes(head[4:8], "little")
        order = ">" if flags & _BIG_ENDIAN else "<"
        following, _, number = struct.unpack(order + "QQI", head[12:32])
        if place + _LEAD.size + following > size:
            raise InputError(
                f"{path}: expected a TDMS file with its end, found one that is cut off; copy it"
                " again, or, where the recorder was stopped, open it in LabVIEW and save it again"
            )
        listed = (0 if flags & _NEW_LIST else listed) + (number if flags & _METADATA else 0)
        objects += listed
        if objects > _MOST_OBJECTS:
            raise InputError(
                f"{path}: expected at most {_MOST_OBJECTS} channels in all of its segments, found"
                " more; defragment it in LabVIEW"
            )
        place += _LEAD.size + following


def _source(path: Path, channel: Any) -> Source:
    # Nothing is packed in these files, whatever they state.
    if len(channel) > path.stat().st_size:
        raise InputError(
            f"{path}: expected a TDMS file, found one that states {len(channel)} values of a"
            " channel; copy it again"
        )
    unit = next((str(channel.properties[key]) for key in _UNITS if key in channel.properties), "")
    return Source((len(channel),), channel.dtype, lambda: channel, unit if is_unit(unit) else None)


@dataclass(frozen=True)
class _Waveform:
    """Times of the values of a channel at a constant rate."""

    start: float
    """Of the first value, from the first of all channels [s]."""
    increment: float
    """[s]."""
    n: int

    def times(self) -> Array:
        return self.start + self.increment * np.arange(self.n, dtype=np.float64)


class _SharedClock:
    """Times of channels that state but their rate; all channels of a file share one clock."""

    def __init__(self, channels: list[Any]) -> None:
        stated = [_started(channel) for channel in channels]
        self._begin = min((start for start in stated if start is not None), default=0.0)

    def times(self, group: str, channels: dict[str, Any]) -> Iterator[tuple[Key, Source]]:
        """A column ``t`` of a group; where its channels differ in rate, length or start, one of
        each.
        """
        waveforms = {
            name: found for name, channel in channels.items() if (found := self._waveform(channel))
        }
        if len(set(waveforms.values())) == 1 and _TIME not in channels:
            yield (group, _TIME), _times(next(iter(waveforms.values())))
        elif len(set(waveforms.values())) > 1:
            for name, waveform in waveforms.items():
                yield (group, name, _TIME), _times(waveform)

    def _waveform(self, channel: Any) -> _Waveform | None:
        """Times of a channel that states its rate; None: it does not."""
        increment = channel.properties.get("wf_increment")
        if not isinstance(increment, float) or not increment > 0 or not len(channel):
            return None
        offset = channel.properties.get("wf_start_offset", 0.0)
        began = _started(channel)
        return _Waveform(
            float(offset) + (began - self._begin if began is not None else 0.0),
            increment,
            len(channel),
        )


def _times(waveform: _Waveform) -> Source:
    return Source((waveform.n,), _FLOAT, waveform.times, "s")


def _started(channel: Any) -> float | None:
    """Time of the first value, since 1970 [s]."""
    start = channel.properties.get("wf_start_time")
    return (
        (start - np.datetime64(0, "s")) / np.timedelta64(1, "s")
        if isinstance(start, np.datetime64)
        else None
    )


if __name__ == "__main__":
    serve(arrays_here, WHAT)
