"""Messages of samples: JSON objects, one instrument each, columns of the contract in SI.

``{"instrument": "cables", "t": 12.34, "f1": 210.5, ...}``; arrays in place of numbers for several
samples, a list of such objects for several instruments. Whatever is not that is refused whole.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import InputError
from steelyard.experiment.recording import Stream
from steelyard.experiment.streams.of_columns import stream_of_columns
from steelyard.instruments import Instrument
from steelyard.live.settings import LIVE, LiveSettings

_LATEST = 1e12
"""Time stamp beyond which it is none [s]: nanoseconds since 1970 are."""
_LARGEST = 1e15
"""Reading beyond which it is none, in any SI unit."""


class MessageError(InputError):
    """A message that is none."""


@dataclass(frozen=True, eq=False)
class Arrival:
    """Samples of one instrument."""

    instrument: str
    stream: Stream


def arrivals_of(
    data: bytes, instruments: Mapping[str, Instrument], m: int, settings: LiveSettings = LIVE
) -> list[Arrival]:
    """Samples in a message.

    Args:
        data: JSON in UTF-8.
        instruments: Those of the experiment.
        m: Number of cables.
        settings: Limits of a message.

    Raises:
        MessageError: It is not as it should be.
    """
    if len(data) > settings.largest_message:
        raise MessageError(
            f"message: expected at most {settings.largest_message} bytes, found {len(data)}; send"
            " fewer samples at once"
        )
    try:
        found = json.loads(data, parse_constant=_refuse)
    except (ValueError, RecursionError) as error:
        raise MessageError(
            "message: expected JSON, found something else; see docs/watch.md"
        ) from error
    objects = found if isinstance(found, list) else [found]
    if not objects:
        raise MessageError("message: expected samples, found an empty list; send some")
    return [arrival_of(each, instruments, m, settings) for each in objects]


def _refuse(word: str) -> float:
    """NaN and infinity are no JSON."""
    raise ValueError(word)


def arrival_of(
    found: Any, instruments: Mapping[str, Instrument], m: int, settings: LiveSettings
) -> Arrival:
    """Samples in one object of a message.

    Args:
        found: The object.
        instruments: Those of the experiment.
        m: Number of cables.
        settings: Limits of a message.

    Raises:
        MessageError: It is not as it should be.
    """
    if not isinstance(found, dict):
        raise MessageError("message: expected an object, found something else; see docs/watch.md")
    name = found.get("instrument")
    if not isinstance(name, str) or name not in instruments:
        raise MessageError(
            f"message: 'instrument': expected one of {', '.join(instruments)}, found another;"
            " name it as the experiment file does"
        )
    columns = {
        key: _numbers(key, value, settings) for key, value in found.items() if key != "instrument"
    }
    if "t" not in columns:
        raise MessageError(f"message: {name}: expected 't', found none; add the time stamp [s]")
    time = columns.pop("t")
    count = len(time)
    if not np.isfinite(time).all() or np.abs(time).max(initial=0.0) > _LATEST:
        raise MessageError(f"message: {name}: 't': expected times [s], found no such number")
    if any(len(each) != count for each in columns.values()):
        raise MessageError(
            f"message: {name}: expected as many numbers in every column, found different counts"
        )
    return Arrival(name, stream_of_columns(name, instruments[name], m, time, columns))


def _numbers(key: str, value: Any, settings: LiveSettings) -> Array:
    """A column; null is no sample of it.

    Raises:
        MessageError: It is not of numbers.
    """
    values = value if isinstance(value, list) else [value]
    if not 0 < len(values) <= settings.most_samples:
        raise MessageError(
            f"message: '{key[:30]}': expected 1 to {settings.most_samples} numbers, found"
            f" {len(values)}"
        )
    found = np.empty(len(values))
    for i, each in enumerate(values):
        if each is None:
            found[i] = np.nan
        elif isinstance(each, bool) or not isinstance(each, (int, float)):
            raise MessageError(f"message: '{key[:30]}': expected numbers, found something else")
        elif not -_LARGEST <= each <= _LARGEST or math.isnan(each):
            raise MessageError(
                f"message: '{key[:30]}': expected a reading, found one beyond {_LARGEST:g}"
            )
        else:
            found[i] = each
    return found
