"""One topic of a recording as a table: one message is one row."""

from __future__ import annotations

import math
import struct
from array import array
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import islice

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import InputError
from steelyard.logs.log import MOST_COLUMNS, Log, RowRange
from steelyard.logs.messages.recording import Decoder, Interval, Message, Recording, Values
from steelyard.logs.messages.time_search import interval_of_values
from steelyard.logs.packages import listed, shown

RECEIVED, PUBLISHED = "receive_time", "publish_time"
"""Columns with the times of a message, beside those within it."""
_PROBED = 200
"""Messages that show which columns a topic has: lists in them may differ in length."""
_SEARCH_COST = 4
"""Bytes that the search for a window may unpack, in units of all: a topic that is in no index would
be looked for without end."""
_OF_ROS_ITSELF = {"rosout", "rosout_agg", "parameter_events", "clock"}
"""Topics with numbers that are no reading of any sensor."""
_MAY_BE_ABSENT = {
    f"{quantity}_covariance[0]": (f"{quantity}.", f"{quantity}_covariance[")
    for quantity in ("orientation", "angular_velocity", "linear_acceleration")
}
"""Number of ``sensor_msgs/Imu`` that is -1 where there is no such quantity -> how names of its
numbers begin."""


def log_of_topic(recording: Recording, topic: str | None) -> Log:
    """The table of one topic.

    Args:
        recording: Messages of all topics.
        topic: Its name, with or without the slash it begins with; None: the only one with numbers.

    Raises:
        InputError: There is no such topic, or several with numbers and none is named, or its
            messages cannot be read.
    """
    name, names = _only_topic(recording) if topic is None else _named(recording, topic)
    rows_of_topic = _TopicRows(recording, name)

    def load(names: Sequence[str], part: RowRange | None, rows: int | None) -> Mapping[str, Array]:
        columns = {name: array("d") for name in names}
        for row in islice(rows_of_topic.read(part), rows):
            for column, values in columns.items():
                values.append(row.get(column, math.nan))
        return {column: np.frombuffer(values) for column, values in columns.items()}

    return Log(recording.path, tuple(names), load)


def _named(recording: Recording, topic: str) -> tuple[str, list[str]]:
    """The topic of a name, with or without slash, and its columns."""
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
    """The only topic with numbers, and its columns."""
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
    for row in islice(_TopicRows(recording, topic).read(None), _PROBED):
        columns.update(dict.fromkeys(row))
        if len(columns) > MOST_COLUMNS:
            break
    return list(columns)


class _TopicRows:
    """Decodes the messages of a topic, no more of them than a part of its rows needs."""

    def __init__(self, recording: Recording, topic: str) -> None:
        self._recording, self._topic = recording, topic
        self._decoders: dict[int, Decoder] = {}

    def read(self, part: RowRange | None) -> Iterator[Values]:
        """Rows of a part, in the order in which the messages were received."""
        if part is None:
            for i, message in enumerate(self._recording.messages(self._topic, None)):
                yield self._row(message, f"message {i + 1}")
            return
        for message in self._recording.messages(self._topic, self._interval(part)):
            value = _times(message).get(part.column)
            if value is not None and not part.start <= value <= part.end:
                continue
            row = self._row(message, _when(message))
            if part.start <= row.get(part.column, math.nan) <= part.end:
                yield row

    def _interval(self, part: RowRange) -> Interval | None:
        """When the messages of a part were received."""
        before = self._recording.bytes_read()

        def first_after(received: int) -> tuple[int, float] | None:
            """The first message from a time on: when it was received, and its value; NaN, which
            ends the search, once it has cost some times as much as reading everything.
            """
            assert self._recording.interval is not None
            if self._recording.bytes_read() - before > _SEARCH_COST * self._recording.size:
                return received, math.nan
            behind = Interval(received, self._recording.interval.end)
            message = next(self._recording.messages(self._topic, behind), None)
            if message is None:
                return None
            times = _times(message)
            row = times if part.column in times else self._row(message, _when(message))
            return message.received, row.get(part.column, math.nan)

        return interval_of_values(self._recording.interval, first_after, part.start, part.end)

    def _row(self, message: Message, which: str) -> Values:
        """Decode a message."""
        row = _times(message)
        try:
            if message.channel not in self._decoders:
                self._decoders[message.channel] = self._recording.decoder(message.channel)
            row.update(self._decoders[message.channel](message.data))
        except (ValueError, struct.error, RecursionError) as error:
            kind = shown(self._recording.topics[self._topic])
            raise InputError(
                f"{self._recording.path}: {which} of topic '{shown(self._topic)}': expected one of"
                f" type {kind}, found something else ({shown(str(error), 120)}); copy the file"
                " again"
            ) from None
        for mark, own in _MAY_BE_ABSENT.items():
            if row.get(mark) == -1.0:
                row = {name: value for name, value in row.items() if not name.startswith(own)}
        return row


def _times(message: Message) -> Values:
    """Columns of a message that are known before it is decoded."""
    times = {RECEIVED: message.received / 10**9}
    if message.published is not None:
        times[PUBLISHED] = message.published / 10**9
    return times


def _when(message: Message) -> str:
    return f"message received at {message.received / 10**9:.9g} s"
