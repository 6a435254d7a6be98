"""Bags of ROS 2: a folder with its parts, or one SQLite database alone.

Databases are read here and not by ``rosbags.rosbag2``, which runs what a file computes in columns
of its own, and counts all messages when it opens one.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePath

from steelyard.errors import InputError
from steelyard.files.regular_file import require_file
from steelyard.files.yaml_file import read_yaml
from steelyard.logs.messages import mcap
from steelyard.logs.messages.blocks import MOST_UNPACKED
from steelyard.logs.messages.recording import Decoder, Interval, Message, Recording, spanned
from steelyard.logs.messages.ros_message import cdr_decoder
from steelyard.logs.messages.ros_types import types_of
from steelyard.logs.packages import damaged, listed, require_package, shown
from steelyard.logs.size import check_unpacked

_WHAT, _DAMAGED = "a bag of ROS 2", "a database that is damaged"
_METADATA = "metadata.yaml"
_FORMS = {"ros2msg": "msg", "ros2idl": "idl"}
_TABLES = {"topics", "messages"}
_TIME_INDEX = "timestamp_idx"
"""Index of messages by time, as all recorders make it."""
_STEPS = 1_000_000
"""Of the database's machine, between looks at how many there were."""
_MOST_STEPS, _STEPS_PER_BYTE = 50, 20
"""Steps of a query, in units of the above, and beyond that per byte: pages of a damaged database
may lead in circles."""
_LEAST_MESSAGE = 32
"""Bytes that a message takes."""


def require(path: Path) -> None:
    """Raise InputError unless the library that reads the file is installed."""
    require_package(path, "rosbags", "rosbags", "ROS 2 bag")


@contextmanager
def opened(path: Path) -> Iterator[Recording]:
    """Open a bag of ROS 2.

    Args:
        path: Of the folder with its ``metadata.yaml``, or of a database.

    Raises:
        InputError: It is damaged or cut off, or parts are missing.
    """
    with ExitStack() as stack:
        if not path.is_dir():
            yield stack.enter_context(_database(path))
            return
        parts, storage = _parts(path)
        part_opened = mcap.opened if storage == "mcap" else _database
        yield _joined(path, [stack.enter_context(part_opened(part)) for part in parts])


def _parts(folder: Path) -> tuple[list[Path], str]:
    """Files of a bag and the format they are stored in, by its metadata."""
    document = read_yaml(folder / _METADATA)
    about = (
        document.data.get("rosbag2_bagfile_information")
        if isinstance(document.data, dict)
        else None
    )
    names = about.get("relative_file_paths") if isinstance(about, dict) else None
    if not isinstance(about, dict) or not isinstance(names, list) or not names:
        raise document.error(
            (),
            "expected 'rosbag2_bagfile_information' with 'relative_file_paths', found none; copy"
            " the bag again",
        )
    storage = about.get("storage_identifier")
    if storage not in {"sqlite3", "mcap"}:
        raise document.error(
            ("rosbag2_bagfile_information", "storage_identifier"),
            f"expected sqlite3 or mcap, found '{shown(str(storage))}'; convert it with: ros2 bag"
            " convert",
        )
    if str(about.get("compression_mode") or "none").lower() != "none":
        raise document.error(
            ("rosbag2_bagfile_information", "compression_mode"),
            "expected files that are not packed, found a bag packed as a whole or message by"
            " message; convert it with: ros2 bag convert",
        )
    # Only files of the folder itself, whatever path is stated.
    parts = [folder / PurePath(str(name)).name for name in names]
    for part in parts:
        require_file(part, "part of the bag")
    return list(dict.fromkeys(parts)), str(storage)


def _joined(path: Path, recordings: list[Recording]) -> Recording:
    """Parts of a bag that were recorded one after the other."""
    topics = {name: kind for recording in recordings for name, kind in recording.topics.items()}
    channels: list[tuple[Recording, int]] = []
    places: dict[tuple[int, int], int] = {}

    def messages(topic: str, within: Interval | None) -> Iterator[Message]:
        for i, recording in enumerate(recordings):
            for message in recording.messages(topic, within):
                place = places.setdefault((i, message.channel), len(channels))
                if place == len(channels):
                    channels.append((recording, message.channel))
                yield message._replace(channel=place)

    def decoder(channel: int) -> Decoder:
        recording, number = channels[channel]
        return recording.decoder(number)

    whole = spanned(recording.interval for recording in recordings)
    return Recording(
        path,
        topics,
        whole,
        messages,
        sum(recording.size for recording in recordings),
        lambda: sum(recording.bytes_read() for recording in recordings),
        decoder,
    )


@contextmanager
def _database(path: Path) -> Iterator[Recording]:
    """The messages of a SQLite database."""
    _check_complete(path)
    connection = sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro&immutable=1", uri=True)
    try:
        connection.text_factory = lambda text: text.decode("utf-8", "replace")
        database = _Database(path, connection)
        try:
            database.look_through()
        except (sqlite3.Error, ValueError) as error:  # the latter of names that are no text
            raise damaged(path, _WHAT, error, _DAMAGED) from None
        topics = {topic.name: topic.type for topic in database.topics.values()}
        yield Recording(
            path,
            topics,
            database.interval,
            database.messages,
            path.stat().st_size,
            lambda: database.bytes_read,
            database.decoder,
        )
    finally:
        connection.close()


def _check_complete(path: Path) -> None:
    """Raise InputError for a database that is cut off, or whose last messages are still in a file
    beside it.
    """
    with path.open("rb") as file:
        header = file.read(100)
    page = int.from_bytes(header[16:18], "big")
    stated = (65536 if page == 1 else page) * int.from_bytes(header[28:32], "big")
    if len(header) < 100 or stated > path.stat().st_size:
        raise InputError(
            f"{path}: expected a database of {stated >> 10} KiB, found one of"
            f" {path.stat().st_size >> 10} KiB that is cut off; copy it again, or save what is left"
            f" with: sqlite3 {shown(path.name)} .recover"
        )
    for ending in ("-wal", "-journal"):
        beside = path.with_name(path.name + ending)
        if beside.is_file() and beside.stat().st_size:
            raise InputError(
                f"{path}: expected a database that was closed, found messages left in"
                f" {shown(beside.name)}, since the recorder was stopped; put them in place with:"
                f" sqlite3 {shown(path.name)} 'PRAGMA wal_checkpoint(TRUNCATE)'"
            )


@dataclass(frozen=True)
class _Topic:
    name: str
    type: str


class _Database:
    """A database of messages, as far as it has been looked through."""

    def __init__(self, path: Path, connection: sqlite3.Connection) -> None:
        self.path, self.connection = path, connection
        self.topics: dict[int, _Topic] = {}
        self.definitions: dict[str, tuple[str, str]] = {}
        self.interval: Interval | None = None
        self.bytes_read = 0
        self._size = path.stat().st_size
        self._steps = 0
        connection.set_progress_handler(self._is_too_long, _STEPS)

    def _is_too_long(self) -> bool:
        self._steps += 1
        return self._steps > _MOST_STEPS + _STEPS_PER_BYTE * self._size // _STEPS

    def look_through(self) -> None:
        """Find topics and definitions of their types."""
        self._check_tables()
        for table in _TABLES:
            self._columns(table)
        for number, name, kind, form in self.connection.execute(
            "SELECT id, name, type, serialization_format FROM topics ORDER BY id"
        ):
            if form != "cdr":
                raise InputError(
                    f"{self.path}: expected messages in cdr, found '{shown(str(form))}'; convert it"
                    " with: ros2 bag convert"
                )
            self.topics[number] = _Topic(str(name), str(kind))
        if self._columns("message_definitions"):
            self.definitions = {
                str(kind): (_FORMS.get(str(form), ""), str(text))
                for kind, form, text in self.connection.execute(
                    "SELECT topic_type, encoding, encoded_message_definition FROM"
                    " message_definitions"
                )
            }
        self.interval = self._interval()

    def _interval(self) -> Interval | None:
        """From the first message to the last, where the database has an index of its times."""
        query = "SELECT count(*) FROM sqlite_master WHERE type = 'index' AND name = ?"
        if not self.connection.execute(query, (_TIME_INDEX,)).fetchone()[0]:
            return None
        first, last = (
            self.connection.execute(f"SELECT {end}(timestamp) FROM messages").fetchone()[0]
            for end in ("min", "max")
        )
        known = isinstance(first, int) and isinstance(last, int)
        return Interval(first, last) if known else None

    def messages(self, topic: str, within: Interval | None) -> Iterator[Message]:
        """Messages of a topic in the order in which they were received."""
        numbers = [number for number, each in self.topics.items() if each.name == topic]
        marks = ", ".join("?" for _ in numbers)
        query = f"SELECT topic_id, timestamp, data FROM messages WHERE topic_id IN ({marks})"
        if within is None:
            self._steps = 0
        else:
            query += " AND timestamp BETWEEN ? AND ?"
            numbers += within
        read = 0
        try:
            for number, received, data in self.connection.execute(
                f"{query} ORDER BY timestamp, id", numbers
            ):
                if not isinstance(received, int) or not isinstance(data, bytes):
                    raise damaged(
                        self.path, _WHAT, "a message that is no bytes with a time", _DAMAGED
                    )
                read += _LEAST_MESSAGE + len(data)
                self.bytes_read += len(data)
                check_unpacked(self.path, read, self._size, always=MOST_UNPACKED)
                yield Message(received, None, number, data)
        except (sqlite3.Error, ValueError, OverflowError) as error:
            raise damaged(self.path, _WHAT, error, _DAMAGED) from None

    def decoder(self, number: int) -> Decoder:
        """Decoder of the messages of a topic."""
        kind = self.topics[number].type
        form, definition = self.definitions.get(kind, ("", ""))
        return cdr_decoder(types_of(self.path, kind, form, definition, ros1=False), kind)

    def _check_tables(self) -> None:
        """Accept plain tables only: a view or a column that is computed is a program of the
        file.
        """
        kinds = dict(
            self.connection.execute(
                "SELECT name, type FROM sqlite_master WHERE sql NOT LIKE 'CREATE VIRTUAL%' ORDER BY"
                " name"
            )
        )
        for name in _TABLES:
            if kinds.get(name) != "table":
                raise InputError(
                    f"{self.path}: expected a bag of ROS 2 with the tables"
                    f" {' and '.join(sorted(_TABLES))}, found"
                    f" {listed(name for name, kind in kinds.items() if kind == 'table')}; check the"
                    " file"
                )
        if kinds.get("message_definitions", "table") != "table":
            raise damaged(self.path, _WHAT, "definitions that are no table", _DAMAGED)

    def _columns(self, table: str) -> list[str]:
        """Columns of a table."""
        columns = []
        for _, name, *_, hidden in self.connection.execute(f"PRAGMA table_xinfo({table})"):
            if hidden:
                raise damaged(self.path, _WHAT, f"a computed column in '{table}'", _DAMAGED)
            columns.append(str(name))
        return columns
