"""Messages in JSON."""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import Any

from steelyard.logs.arrays.nested import MOST_ELEMENTS
from steelyard.logs.messages.recording import Values

_STAMPS = ({"sec", "nanosec"}, {"sec", "nsec"}, {"secs", "nsecs"}, {"seconds", "nanoseconds"})
"""Keys of a time or a duration in whole seconds and nanoseconds."""
_DEEPEST = 50
"""Values within values: messages have a few; the parser stops at a thousand."""


def decode_json(data: bytes) -> Values:
    """Numbers of a message in JSON.

    Raises:
        ValueError: It is no JSON object, or has a name twice.
    """
    message = _READER.decode(data.decode())
    if not isinstance(message, dict):
        raise ValueError("no JSON object")
    values: Values = {}
    _collect(message.items(), values)
    return values


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    made = dict(pairs)
    if len(made) < len(pairs):
        raise ValueError("a JSON object with a key twice")
    return made


_READER = json.JSONDecoder(object_pairs_hook=_object)


def _collect(parts: Iterable[tuple[str, Any]], values: Values, depth: int = 0) -> None:
    """Numbers of parts of a message by name; texts and nulls are none."""
    if depth > _DEEPEST:
        raise ValueError(f"values within values, more than {_DEEPEST} deep")
    for name, value in parts:
        kind = type(value)
        if kind is dict:
            seconds = _seconds(value) if len(value) == 2 else None
            if seconds is None:
                _collect(
                    [(f"{name}.{key}", part) for key, part in value.items()], values, depth + 1
                )
                continue
            value = seconds
        elif kind is list:
            if len(value) <= MOST_ELEMENTS:
                _collect(
                    [(f"{name}[{i}]", part) for i, part in enumerate(value)], values, depth + 1
                )
            continue
        elif kind is str or value is None:
            continue
        if name in values:
            raise ValueError(f"the name '{name}' twice")
        values[name] = value if kind is float else _quotient(value, 1)


def _seconds(value: dict[str, Any]) -> float | None:
    """A time or a duration [s]; None: it is none."""
    if value.keys() not in _STAMPS or not all(type(part) is int for part in value.values()):
        return None
    seconds, nanoseconds = value.values()
    if next(iter(value)).startswith("n"):
        seconds, nanoseconds = nanoseconds, seconds
    return _quotient(seconds * 10**9 + nanoseconds, 10**9)


def _quotient(number: float, by: int) -> float:
    try:
        return number / by
    except OverflowError:
        return float("inf") if number > 0 else float("-inf")
