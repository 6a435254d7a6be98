"""Bags of ROS 1, in version 2.0 of their format.

Records are read here and not by ``rosbags.rosbag1``, which unpacks whatever a chunk holds and keeps
the index of every message in memory.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from steelyard.errors import InputError
from steelyard.logs.messages.blocks import LARGEST_BLOCK, MOST_UNPACKED, Block, BlockFile
from steelyard.logs.messages.recording import Decoder, Interval, Message, Recording
from steelyard.logs.messages.ros_message import ros1_decoder
from steelyard.logs.messages.ros_types import full_name, types_of
from steelyard.logs.packages import damaged, require_package, shown
from steelyard.logs.size import check_unpacked

_MAGIC = b"#ROSBAG V2.0\n"
_MESSAGE, _HEADER, _CHUNK, _CHUNK_INFO, _CONNECTION = 2, 3, 5, 6, 7
_LENGTH = struct.Struct("<I")
_TIME = struct.Struct("<II")
_LONGEST_HEADER = 1 << 20
"""Bytes of the header of a record: it has a few names and numbers."""

Fields = dict[bytes, bytes]
"""Of the header of a record."""


def require(path: Path) -> None:
    """Raise InputError unless the library that reads the file is installed."""
    require_package(path, "rosbags", "rosbags", "ROS 1 bag")


@contextmanager
def opened(path: Path) -> Iterator[Recording]:
    """Open a bag of ROS 1.

    Raises:
        InputError: It is damaged or cut off.
    """
    with path.open("rb") as file:
        bag = _Bag(path, file)
        try:
            bag.look_through()
        except (ValueError, KeyError, struct.error) as error:
            raise _damaged(path, error) from None
        topics = {
            number: (each.topic, full_name(each.type)) for number, each in bag.connections.items()
        }
        yield bag.recording(topics, bag.messages_in, bag.decoder)


@dataclass(frozen=True)
class _Connection:
    topic: str
    type: str
    definition: str


class _Bag(BlockFile):
    """What a bag holds, as far as it has been looked through."""

    def __init__(self, path: Path, file: IO[bytes]) -> None:
        super().__init__(path, file)
        self.connections: dict[int, _Connection] = {}

    def look_through(self) -> None:
        """Find connections and chunks by the index at the end; nothing is unpacked yet.

        Raises:
            InputError: The bag is cut off, or unpacks to too much.
            KeyError: It is damaged.
            ValueError: It is damaged.
            struct.error: It is damaged.
        """
        if self.file.read(len(_MAGIC)) != _MAGIC:
            raise ValueError("another version than 2.0")
        header = self._fields(_HEADER)
        index = struct.unpack("<Q", header[b"index_pos"])[0]
        if not 0 < index <= self.file_size:
            raise self._cut_off()
        connections, chunks = (
            _LENGTH.unpack(header[key])[0] for key in (b"conn_count", b"chunk_count")
        )
        self.file.seek(index)
        try:
            for _ in range(connections):
                self._add_connection()
            places = dict(self._chunk_info() for _ in range(chunks))
        except struct.error:
            raise self._cut_off() from None
        end = len(_MAGIC)
        for place, (interval, held) in sorted(places.items()):
            # One after the other: overlapping ones would be read again and again.
            if not end <= place < index:
                raise ValueError("chunks that overlap")
            chunk = self._chunk(place, interval, held)
            self.blocks.append(chunk)
            end = chunk.place + chunk.length
        if end > index or len(places) != chunks:
            raise ValueError("chunks that overlap the index")
        check_unpacked(self.path, self.size, self.file_size, always=MOST_UNPACKED)

    def decoder(self, number: int) -> Decoder:
        """Decoder of the messages of a connection."""
        each = self.connections[number]
        return ros1_decoder(
            types_of(self.path, each.type, "msg", each.definition, ros1=True), each.type
        )

    def messages_in(self, block: Block, channels: set[int]) -> list[Message]:
        """Messages of some connections in a chunk."""
        found = []
        try:
            data = self.read(block)
            place = 0
            while place < len(data):
                fields, place = _header(data, place)
                length = _LENGTH.unpack_from(data, place)[0]
                place += 4 + length
                if place > len(data):
                    raise ValueError("a record that runs over the end of its chunk")
                if fields[b"op"][0] != _MESSAGE:
                    continue
                number = _LENGTH.unpack(fields[b"conn"])[0]
                if number in channels:
                    received = _nanoseconds(fields[b"time"])
                    found.append(Message(received, None, number, data[place - length : place]))
        except (ValueError, KeyError, IndexError, struct.error) as error:
            raise _damaged(self.path, error) from None
        return found

    def _fields(self, kind: int) -> Fields:
        """Header of the record of a kind that stands here; its data are next."""
        length = _LENGTH.unpack(self.file.read(4))[0]
        if length > _LONGEST_HEADER:
            raise ValueError(f"a header of {length} bytes")
        fields = _split(self.file.read(length))
        if fields[b"op"] != bytes([kind]):
            raise ValueError(f"a record of kind {fields[b'op'].hex()} instead of {kind:02x}")
        return fields

    def _data(self) -> bytes:
        length = _LENGTH.unpack(self.file.read(4))[0]
        if length > self.file_size - self.file.tell():
            raise self._cut_off()
        return self.file.read(length)

    def _add_connection(self) -> None:
        """Take note of the connection whose record stands here."""
        head = self._fields(_CONNECTION)
        about = _split(self._data())
        topic, kind, definition = (
            about.get(key, b"").decode() for key in (b"topic", b"type", b"message_definition")
        )
        self.connections[_LENGTH.unpack(head[b"conn"])[0]] = _Connection(
            head[b"topic"].decode() or topic, kind, definition
        )

    def _chunk_info(self) -> tuple[int, tuple[Interval, set[int]]]:
        """Place of a chunk, when its messages were received, and of which connections they are."""
        fields = self._fields(_CHUNK_INFO)
        pairs = self._data()
        place = struct.unpack("<Q", fields[b"chunk_pos"])[0]
        start = _nanoseconds(fields[b"start_time"])
        end = _nanoseconds(fields[b"end_time"])
        held = {number for number, _ in struct.iter_unpack("<II", pairs)}
        return place, (Interval(start, end), held)

    def _chunk(self, place: int, interval: Interval, held: set[int]) -> Block:
        """The chunk at a place, by its header."""
        self.file.seek(place)
        fields = self._fields(_CHUNK)
        length = _LENGTH.unpack(self.file.read(4))[0]
        size = _LENGTH.unpack(fields[b"size"])[0]
        if size > LARGEST_BLOCK or length > self.file_size:
            raise ValueError(f"a chunk of {size} bytes, packed into {length}")
        compression = fields[b"compression"].decode()
        return Block(interval, self.file.tell(), length, compression, size, channels=held)

    def _cut_off(self) -> InputError:
        return InputError(
            f"{self.path}: expected a bag with an index at its end, found one that is cut off; copy"
            " it again, or, where the recorder was stopped, repair it with: rosbag reindex"
            f" {shown(self.path.name)}"
        )


def _header(block: bytes, place: int) -> tuple[Fields, int]:
    end = place + 4 + _LENGTH.unpack_from(block, place)[0]
    if end > len(block):
        raise ValueError("a header that runs over the end of its chunk")
    return _split(block[place + 4 : end]), end


def _split(data: bytes) -> Fields:
    """Fields ``name=value`` with their lengths before them."""
    fields, place = {}, 0
    while place < len(data):
        end = place + 4 + _LENGTH.unpack_from(data, place)[0]
        name, found, value = data[place + 4 : end].partition(b"=")
        if end > len(data) or not found:
            raise ValueError("a header that cannot be read")
        fields[name] = value
        place = end
    return fields


def _nanoseconds(time: bytes) -> int:
    seconds, nanoseconds = _TIME.unpack(time)
    return int(seconds * 10**9 + nanoseconds)


def _damaged(path: Path, error: Exception) -> InputError:
    reason = f"no field {error}" if isinstance(error, KeyError) else error
    return damaged(path, "a bag of ROS 1", reason)
