"""Messages as tables: one topic is one table, one message one row."""

from __future__ import annotations

import heapq
import math
import struct
from array import array
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import InputError
from steelyard.logs.log import MOST_COLUMNS, Log, Part
from steelyard.logs.packages import listed, shown

RECEIVED, PUBLISHED = "receive_time", "publish_time"
"""Columns with the times of a message, beside those within it."""
_PROBED = 200
"""Messages that tell which columns a topic has: lists in them may differ in length."""
_OF_ROS_ITSELF = {"rosout", "rosout_agg", "parameter_events", "clock"}
"""Topics with numbers that are no reading of any sensor."""
_MAY_BE_ABSENT = {
    f"{quantity}_covariance[0]": (f"{quantity}.", f"{quantity}_covariance[")
    for quantity in ("orientation", "angular_velocity", "linear_acceleration")
}
"""Number of ``sensor_msgs/Imu`` that is -1 where there is no such quantity -> how names of its
numbers begin."""

Values = dict[str, float]
"""Numbers of a message by name; nested fields with dots, elements of lists with brackets."""
Decoder = Callable[[bytes], Values]
"""Reads the numbers of a message; raises ValueError or struct.error for what is no message of its
type."""


class Message(NamedTuple):
    """A message as it was recorded."""

    received: int
    """[ns]."""
    published: int | None
    """[ns]; None: the format has no such time."""
    channel: int
    """Which decoder reads it."""
    data: bytes


@dataclass(frozen=True, eq=False)
class Recording:
    """Messages of several topics."""

    path: Path
    topics: Mapping[str, str]
    """Topic -> type of its messages."""
    messages: Callable[[str], Iterator[Message]]
    """Those of a topic, in the order in which they were received."""
    decoder: Callable[[int], Decoder]
    """Of a channel; raises InputError if its messages cannot be read, and ValueError if their type
    cannot."""


def log_of_topic(recording: Recording, topic: str | None) -> Log:
    """The table of one topic.

    Args:
        recording: Messages of all topics.
        topic: Its name, with or without the slash it begins with; None: the only one with numbers.

    Raises:
        InputError: There is no such topic, or several with numbers and none is named, or its
            messages cannot be read.
    """
    name, columns = _only_topic(recording) if topic is None else _named(recording, topic)

    def load(names: Sequence[str], part: Part | None, rows: int | None) -> Mapping[str, Array]:
        columns = {name: array("d") for name in names}
        found = 0
        for row in _rows(recording, name):
            if part is not None and not part.start <= row.get(part.column, math.nan) <= part.end:
                continue
            if found == rows:
                break
            found += 1
            for column, values in columns.items():
                values.append(row.get(column, math.nan))
        return {
            column: np.frombuffer(values, dtype=np.float64) for column, values in columns.items()
        }

    return Log(recording.path, tuple(columns), load)


def in_time_order(
    pieces: Iterable[tuple[int, Callable[[], Iterable[Message]]]],
) -> Iterator[Message]:
    """Messages of pieces of a file that may overlap in time, with no more pieces in memory than
    overlap.

    Args:
        pieces: Time of the first message [ns], and what reads the messages, of each.
    """
    # The next message of every piece that has begun, and those behind it.
    begun: list[tuple[int, int, Message, Iterator[Message]]] = []
    in_order = sorted(pieces, key=lambda piece: piece[0])
    for number, (_, read) in enumerate(in_order):
        _begin(begun, number, iter(sorted(read(), key=lambda message: message.received)))
        until = in_order[number + 1][0] if number + 1 < len(in_order) else math.inf
        while begun and begun[0][0] < until:
            _, first, message, behind = heapq.heappop(begun)
            yield message
            _begin(begun, first, behind)


def _begin(
    begun: list[tuple[int, int, Message, Iterator[Message]]],
    number: int,
    messages: Iterator[Message],
) -> None:
    message = next(messages, None)
    if message is not None:
        heapq.heappush(begun, (message.received, number, message, messages))


def _named(recording: Recording, topic: str) -> tuple[str, list[str]]:
    by_bare_name = {name.strip("/"): name for name in recording.topics}
    name = topic if topic in recording.topics else by_bare_name.get(topic.strip("/"))
    if name is None:
        raise InputError(
            f"{recording.path}: expected a topic '{shown(topic)}', found"
            f" {_described(recording, recording.topics)}; correct 'topic'"
        )
    columns = _columns(recording, name)
    if not columns:
        raise InputError(
            f"{recording.path}: expected messages with numbers in topic '{shown(name)}', found"
            " none; name another one"
        )
    return name, columns


def _only_topic(recording: Recording) -> tuple[str, list[str]]:
    found, problems = {}, []
    for name in recording.topics:
        if name.strip("/").rpartition("/")[2] in _OF_ROS_ITSELF:
            continue
        try:
            columns = _columns(recording, name)
        except InputError as problem:
            problems.append(problem)
            continue
        if any(column not in {RECEIVED, PUBLISHED} for column in columns):
            found[name] = columns
    if len(found) == 1:
        return next(iter(found.items()))
    if found:
        raise InputError(
            f"{recording.path}: expected 'topic' to say which of its topics to read, found"
            f" {_described(recording, found)}; name one"
        )
    if problems:
        raise problems[0]
    raise InputError(
        f"{recording.path}: expected messages with numbers, found topics"
        f" {_described(recording, recording.topics)}; check the recording"
    )


def _described(recording: Recording, names: Iterable[str]) -> str:
    return listed(f"{shown(name)} ({shown(recording.topics[name])})" for name in names)


def _columns(recording: Recording, topic: str) -> list[str]:
    columns: dict[str, None] = {}
    for row in islice(_rows(recording, topic), _PROBED):
        columns.update(dict.fromkeys(row))
        if len(columns) > MOST_COLUMNS:
            break
    return list(columns)


def _rows(recording: Recording, topic: str) -> Iterator[Values]:
    decoders: dict[int, Decoder] = {}
    for i, (received, published, channel, data) in enumerate(recording.messages(topic)):
        row = {RECEIVED: received / 10**9}
        if published is not None:
            row[PUBLISHED] = published / 10**9
        try:
            if channel not in decoders:
                decoders[channel] = recording.decoder(channel)
            row.update(decoders[channel](data))
        except (ValueError, struct.error, RecursionError) as error:
            kind = shown(recording.topics[topic])
            raise InputError(
                f"{recording.path}: message {i + 1} of topic '{shown(topic)}': expected one of type"
                f" {kind}, found something else ({shown(str(error), 120)}); copy the file again"
            ) from None
        for mark, own in _MAY_BE_ABSENT.items():
            if row.get(mark) == -1.0:
                row = {name: value for name, value in row.items() if not name.startswith(own)}
        yield row
