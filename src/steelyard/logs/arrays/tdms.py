"""TDMS files of LabVIEW."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import InputError
from steelyard.logs.arrays.nested import Arrays, Key, Source, is_number
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
    stated = [_started(channel) for group in contents.groups() for channel in group.channels()]
    begin = min((start for start in stated if start is not None), default=0.0)
    for group in contents.groups():
        channels = {
            channel.name: channel for channel in group.channels() if is_number(channel.dtype)
        }
        for name, channel in channels.items():
            sources[group.name, name] = _source(path, channel)
        sources.update(_times(group.name, channels, begin))
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
    """The values of a channel, with its unit."""
    # Nothing is packed in these files, whatever they state.
    if len(channel) > path.stat().st_size:
        raise InputError(
            f"{path}: expected a TDMS file, found one that states {len(channel)} values of a"
            " channel; copy it again"
        )
    unit = next((str(channel.properties[key]) for key in _UNITS if key in channel.properties), "")
    return Source((len(channel),), channel.dtype, lambda: channel, unit if is_unit(unit) else None)


class _Waveform(NamedTuple):
    """Times of the values of a channel at a constant rate."""

    start: float
    """Of the first value, from the first of all channels [s]."""
    increment: float
    """[s]."""
    n: int

    def times(self) -> Array:
        """Shape (n,) [s]."""
        return self.start + self.increment * np.arange(self.n, dtype=np.float64)

    def source(self) -> Source:
        """A column of them."""
        return Source((self.n,), _FLOAT, self.times, "s")


def _times(group: str, channels: dict[str, Any], begin: float) -> Iterator[tuple[Key, Source]]:
    """Times of channels that state but their rate: a column ``t`` of a group; where its channels
    differ in rate, length or start, one of each.

    Args:
        group: Its name.
        channels: Name -> channel of numbers.
        begin: Of the clock that all channels of a file share, since 1970 [s].
    """
    waveforms = {}
    for name, channel in channels.items():
        increment = channel.properties.get("wf_increment")
        if isinstance(increment, float) and increment > 0 and len(channel):
            offset = float(channel.properties.get("wf_start_offset", 0.0))
            began = _started(channel)
            start = offset if began is None else offset + (began - begin)
            waveforms[name] = _Waveform(start, increment, len(channel))
    if len(set(waveforms.values())) == 1 and _TIME not in channels:
        yield (group, _TIME), next(iter(waveforms.values())).source()
    elif len(set(waveforms.values())) > 1:
        for name, waveform in waveforms.items():
            yield (group, name, _TIME), waveform.source()


def _started(channel: Any) -> float | None:
    """Time of the first value, since 1970 [s]."""
    start = channel.properties.get("wf_start_time")
    if not isinstance(start, np.datetime64):
        return None
    return float((start - np.datetime64(0, "s")) / np.timedelta64(1, "s"))
