"""Numbers of ROS messages, straight from their bytes.

The layout of a type is worked out as steps that each read some bytes. Nothing is made of a
definition but those steps: libraries that write Python code from it and execute that code are no
choice for files from anyone.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Any

from steelyard.logs.arrays.nested import MOST_ELEMENTS
from steelyard.logs.messages.recording import Decoder, Values
from steelyard.logs.messages.ros_types import TIMES, Types, full_name

_CODES = {
    "bool": "?",
    "byte": "b",
    "char": "B",
    "octet": "B",
    "int8": "b",
    "uint8": "B",
    "int16": "h",
    "uint16": "H",
    "int32": "i",
    "uint32": "I",
    "int64": "q",
    "uint64": "Q",
    "float32": "f",
    "float64": "d",
}
_BASE, _NAME, _ARRAY, _SEQUENCE = 1, 2, 3, 4
"""Kinds of fields, in ``rosbags.interfaces.Nodetype``."""
_PLACEHOLDER = "structure_needs_at_least_one_member"
_MOST_FIELDS = 100_000
"""Fields of one message with those of its fields; a type may be made to have any number of them."""
_DEEPEST = 50
"""Types within types."""
_PADDING = 7
"""Bytes behind a message that mean nothing."""

Step = Callable[[bytes, int, Values], int]
"""Reads from a place of a message, adds what it reads, and gives the place behind it."""


def ros1_decoder(types: Types, name: str) -> Decoder:
    """Decoder of ROS 1 messages of a type: little endian, without gaps."""
    steps = _Layout(types, "<", widest=1, ros1=True).steps(full_name(name), "")

    def decode(data: bytes) -> Values:
        return _read(steps, data)

    return decode


def cdr_decoder(types: Types, name: str) -> Decoder:
    """Decoder of ROS 2 messages of a type, in plain CDR of version 1; their first bytes state
    the byte order.
    """
    layouts: dict[str, list[Step]] = {}

    def decode(data: bytes) -> Values:
        if len(data) < 4 or data[0] != 0 or data[1] > 1:
            raise ValueError("no plain CDR")
        order = "<" if data[1] else ">"
        if order not in layouts:
            layouts[order] = _Layout(types, order, widest=8, ros1=False).steps(full_name(name), "")
        # Places count from behind these bytes.
        return _read(layouts[order], data[4:])

    return decode


def _read(steps: list[Step], data: bytes) -> Values:
    values: Values = {}
    place = 0
    for step in steps:
        place = step(data, place, values)
    if len(data) - place > _PADDING:
        raise ValueError(f"{len(data) - place} bytes more than the type has")
    return values


class _Layout:
    """Works out the steps of types."""

    def __init__(self, types: Types, order: str, *, widest: int, ros1: bool) -> None:
        self.types, self.order, self.widest, self.ros1 = types, order, widest, ros1
        self._fields = 0
        self._done: list[Step] = []
        self._run: list[tuple[str, str]] = []

    def steps(self, name: str, label: str) -> list[Step]:
        """Steps that read a message of a type; names of its numbers begin with a label."""
        self._done, self._run, self._fields = [], [], 0
        self._add_type(name, label, 0)
        self._end_run()
        return self._done

    def _end_run(self) -> None:
        if self._run:
            self._done.append(_NumberBlock(self._run, self.order, self.widest))
            self._run = []

    def _append(self, step: Step) -> None:
        self._end_run()
        self._done.append(step)

    def _add_type(self, name: str, label: str, depth: int) -> None:
        """Add the steps of a message type; times are one number each."""
        if depth > _DEEPEST:
            raise ValueError("a type within itself")
        if name in TIMES and label:
            signed = not self.ros1 or name.endswith("Duration")
            self._append(
                _Time("i" if signed else "I", "i" if self.ros1 and signed else "I", label, self)
            )
            return
        if name not in self.types:
            raise ValueError(f"the type {name}, which is not defined")
        fields = [field for field in self.types[name] if field[0] != _PLACEHOLDER]
        if not fields and not self.ros1:
            self._append(_Skipped(1, 1, 1))
        for field, description in fields:
            self._add(description, f"{label}.{field}" if label else field, depth)

    def _add(self, description: Any, label: str, depth: int) -> None:
        """Add the steps of a field."""
        self._fields += 1
        if self._fields > _MOST_FIELDS:
            raise ValueError(f"a type of more than {_MOST_FIELDS} fields")
        kind, detail = description
        if kind == _NAME:
            self._add_type(detail, label, depth + 1)
        elif kind == _BASE:
            self._add_base(detail[0], [label])
        else:
            (inner, name), size = detail
            number = size if kind == _ARRAY else None
            if inner == _NAME:
                self._append(_MessageList(name, label, number, self))
            elif inner != _BASE:
                raise ValueError("an array of arrays")
            elif name[0] == "string":
                self._append(_Texts(number, self))
            elif number is None:
                self._append(_Numbers(self._code(name[0]), label, self))
            elif number <= MOST_ELEMENTS:
                self._add_base(name[0], [f"{label}[{i}]" for i in range(number)])
            else:
                width = struct.calcsize("=" + self._code(name[0]))
                self._append(_Skipped(width, number, min(width, self.widest)))

    def _add_base(self, name: str, labels: list[str]) -> None:
        if name == "string":
            self._append(_Texts(1, self))
            return
        self._fields += len(labels) - 1
        self._run += [(self._code(name), label) for label in labels]

    def _code(self, name: str) -> str:
        if name not in _CODES:
            raise ValueError(f"a field of type {name}")
        return _CODES[name]

    def count(self, data: bytes, place: int) -> tuple[int, int]:
        """Length of a list or of a text, and the place behind it."""
        place += -place % min(4, self.widest)
        return struct.unpack_from(self.order + "I", data, place)[0], place + 4


class _NumberBlock:
    """Numbers in a row, read at once."""

    def __init__(self, fields: list[tuple[str, str]], order: str, widest: int) -> None:
        self._codes = [code for code, _ in fields]
        self._names = [name for _, name in fields]
        self._order, self._widest = order, widest
        self._packed: dict[int, struct.Struct] = {}

    def __call__(self, data: bytes, place: int, values: Values) -> int:
        """See :data:`Step`."""
        # Where numbers lie depends on the place of the first only by what is left after division by
        # the widest of them.
        packed = self._packed.get(place % self._widest)
        if packed is None:
            packed = self._packed[place % self._widest] = self._from(place % self._widest)
        values.update(zip(self._names, packed.unpack_from(data, place), strict=True))
        return place + packed.size

    def _from(self, start: int) -> struct.Struct:
        parts, place = [self._order], start
        for code in self._codes:
            width = struct.calcsize("=" + code)
            gap = -place % min(width, self._widest)
            parts.append("x" * gap + code)
            place += gap + width
        return struct.Struct("".join(parts))


class _Time:
    """A time or a duration, in seconds."""

    def __init__(self, seconds: str, nanoseconds: str, label: str, layout: _Layout) -> None:
        self._packed = struct.Struct(layout.order + seconds + nanoseconds)
        self._label, self._align = label, min(4, layout.widest)

    def __call__(self, data: bytes, place: int, values: Values) -> int:
        """See :data:`Step`."""
        place += -place % self._align
        seconds, nanoseconds = self._packed.unpack_from(data, place)
        values[self._label] = (seconds * 10**9 + nanoseconds) / 10**9
        return place + 8


class _Skipped:
    """Bytes of no interest."""

    def __init__(self, width: int, number: int, align: int) -> None:
        self._size, self._align = width * number, align

    def __call__(self, data: bytes, place: int, values: Values) -> int:
        """See :data:`Step`."""
        return _within(data, place + -place % self._align + self._size)


class _Texts:
    """Texts, which are no numbers."""

    def __init__(self, number: int | None, layout: _Layout) -> None:
        self._number, self._layout = number, layout

    def __call__(self, data: bytes, place: int, values: Values) -> int:
        """See :data:`Step`."""
        number = self._number
        if number is None:
            number, place = self._layout.count(data, place)
        for _ in range(number):
            length, place = self._layout.count(data, place)
            place = _within(data, place + length)
        return place


class _Numbers:
    """A list of any number of numbers."""

    def __init__(self, code: str, label: str, layout: _Layout) -> None:
        self._code, self._label, self._layout = code, label, layout
        self._width = struct.calcsize("=" + code)
        self._names: list[str] = []

    def __call__(self, data: bytes, place: int, values: Values) -> int:
        """See :data:`Step`."""
        number, place = self._layout.count(data, place)
        if not number:
            return place
        place += -place % min(self._width, self._layout.widest)
        end = _within(data, place + number * self._width)
        if number <= MOST_ELEMENTS:
            self._names += [f"{self._label}[{i}]" for i in range(len(self._names), number)]
            found = struct.unpack_from(f"{self._layout.order}{number}{self._code}", data, place)
            values.update(zip(self._names[:number], found, strict=True))
        return end


class _MessageList:
    """A list of messages."""

    def __init__(self, name: str, label: str, number: int | None, layout: _Layout) -> None:
        self._name, self._label, self._number = name, label, number
        self._layout = layout
        # Of its own: steps are worked out while others are read.
        self._inner = _Layout(layout.types, layout.order, widest=layout.widest, ros1=layout.ros1)
        self._elements: list[list[Step]] = []

    def __call__(self, data: bytes, place: int, values: Values) -> int:
        """See :data:`Step`."""
        number = self._number
        if number is None:
            number, place = self._layout.count(data, place)
        for i in range(number):
            before = place
            if i == len(self._elements) and i <= MOST_ELEMENTS:
                self._elements.append(self._inner.steps(self._name, f"{self._label}[{i}]"))
            # Beyond the bound they are read only to find their end.
            target = values if i < MOST_ELEMENTS else {}
            for step in self._elements[min(i, MOST_ELEMENTS)]:
                place = step(data, place, target)
            if place == before:
                break
        return place


def _within(data: bytes, end: int) -> int:
    if end > len(data):
        raise ValueError("a length beyond its end")
    return end
