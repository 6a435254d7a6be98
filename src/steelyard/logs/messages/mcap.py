"""MCAP files: messages in JSON or of ROS.

Records are read here and not by ``mcap.reader``, which unpacks whatever a chunk states or holds: a
file of 9 KB takes 500 MB of memory there, and without an index it keeps all messages in memory. It
reads single schemas and channels.
"""

from __future__ import annotations

import io
import os
import struct
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, NamedTuple

from steelyard.errors import InputError
from steelyard.logs.log import Log
from steelyard.logs.messages.compressed import LARGEST_BLOCK, MOST_UNPACKED, LastBlock, unpacked
from steelyard.logs.messages.json_message import decode_json
from steelyard.logs.messages.recording import (
    Decoder,
    FileSection,
    Interval,
    Message,
    Recording,
    in_time_order,
    spanned,
)
from steelyard.logs.messages.ros_message import cdr_decoder, ros1_decoder
from steelyard.logs.messages.ros_types import types_of
from steelyard.logs.messages.topic_table import log_of_topic
from steelyard.logs.packages import require_package, shown
from steelyard.logs.size import check_unpacked

if TYPE_CHECKING:
    from mcap.records import Channel, Schema

MAGIC = b"\x89MCAP0\r\n"
_HEAD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")
_MESSAGE_OPCODE = 5
_CHUNK = struct.Struct("<QQQII")
_REGION = 1 << 22
"""Bytes of messages outside of chunks that are read at once."""
_FORMS = {"": "", "ros2msg": "msg", "ros1msg": "msg", "ros2idl": "idl", "omgidl": "idl"}


@contextmanager
def opened(path: Path, topic: str | None) -> Iterator[Log]:
    """Open a topic of an MCAP file.

    Raises:
        InputError: The file is damaged or cut off, or has no such topic, or messages that cannot be
            read.
    """
    with path.open("rb") as file:
        yield log_of_topic(recording_of(path, file), topic)


def topics(path: Path) -> list[str]:
    """Topics of an MCAP file.

    Raises:
        InputError: The file is damaged or cut off.
    """
    with path.open("rb") as file:
        return list(recording_of(path, file).topics)


def recording_of(path: Path, file: IO[bytes]) -> Recording:
    """The messages of an MCAP file that is open.

    Raises:
        InputError: It is damaged or cut off.
    """
    require_package(path, "mcap", "mcap", "MCAP")
    contents = _Contents(path, file)
    try:
        contents.look_through()
    except (ValueError, struct.error) as error:
        raise _damaged(path, error) from None
    topics = {}
    for channel in contents.channels.values():
        schema = contents.schemas.get(channel.schema_id)
        topics[channel.topic] = schema.name if schema and schema.name else channel.message_encoding
    whole = spanned(block.interval for block in contents.blocks)
    return Recording(
        path,
        topics,
        whole,
        contents.messages,
        sum(block.size for block in contents.blocks),
        lambda: contents.last.bytes_read,
        contents.decoder,
    )


class _Head(NamedTuple):
    """A message outside of chunks."""

    received: int
    """[ns]."""
    start: int
    """Of its record in the file."""
    end: int


@dataclass(frozen=True)
class _Block:
    """A chunk, or messages in a row outside of chunks."""

    interval: Interval
    """When its messages were received."""
    place: int
    """Of its records, packed or not."""
    length: int
    compression: str = ""
    size: int = 0
    """Bytes, unpacked."""
    crc: int = 0
    """Of the bytes, unpacked; 0: none is stated."""


@dataclass(eq=False)
class _Contents:
    """What an MCAP file holds, as far as it has been looked through."""

    path: Path
    file: IO[bytes]
    channels: dict[int, Channel] = field(default_factory=dict)
    schemas: dict[int, Schema] = field(default_factory=dict)
    blocks: list[_Block] = field(default_factory=list)
    held: dict[int, set[int]] = field(default_factory=dict)
    """Place of a chunk -> channels in it, where the file says so."""
    last: LastBlock = field(default_factory=LastBlock)

    def look_through(self) -> None:
        """Find chunks, channels and schemas; nothing is unpacked yet.

        Raises:
            InputError: The file is cut off, or unpacks to too much.
            ValueError: It is damaged.
            struct.error: It is damaged.
        """
        from mcap.opcode import Opcode

        size = os.fstat(self.file.fileno()).st_size
        region: list[_Head] = []
        ended = False
        for opcode, begin, length in self._heads(size):
            if opcode == Opcode.MESSAGE:
                received = _MESSAGE.unpack(self.file.read(_MESSAGE.size))[2]
                region.append(_Head(received, begin - _HEAD.size, begin + length))
            if region and (opcode != Opcode.MESSAGE or region[-1].end - region[0].start > _REGION):
                self.blocks.append(_region(region))
                region = []
            if opcode in {Opcode.SCHEMA, Opcode.CHANNEL}:
                self._define(opcode, self.file.read(length))
            elif opcode == Opcode.CHUNK:
                self.blocks.append(self._chunk(begin, length))
            elif opcode == Opcode.MESSAGE_INDEX and self.blocks:
                held = self.held.setdefault(self.blocks[-1].place, set())
                held.add(struct.unpack("<H", self.file.read(2))[0])
            ended = opcode == Opcode.FOOTER
        if not ended:
            raise ValueError("no footer at its end")
        unpacked_size = sum(block.size for block in self.blocks)
        check_unpacked(self.path, unpacked_size, size, always=MOST_UNPACKED)
        known = set().union(*self.held.values()) <= self.channels.keys()
        if not known or not self.channels:
            self._define_by_chunks()

    def _heads(self, size: int) -> Iterator[tuple[int, int, int]]:
        """Records of the file: opcode, where the content begins, and its length; the file stands
        there.
        """
        self.file.seek(0)
        if self.file.read(len(MAGIC)) != MAGIC:
            raise ValueError("another beginning")
        self.file.seek(max(size - len(MAGIC), 0))
        if size < 2 * len(MAGIC) or self.file.read(len(MAGIC)) != MAGIC:
            raise self._cut_off()
        place = len(MAGIC)
        while place < size - len(MAGIC):
            self.file.seek(place)
            opcode, length = _HEAD.unpack(self.file.read(_HEAD.size))
            begin = place + _HEAD.size
            place = begin + length
            if place > size - len(MAGIC):
                raise ValueError(f"a record of {length} bytes that runs over the end")
            yield opcode, begin, length

    def _define_by_chunks(self) -> None:
        """Find channels and schemas that are not repeated outside of the chunks."""
        from mcap.opcode import Opcode

        for block in self.blocks:
            for opcode, record in _records(self._read(block)):
                if opcode in {Opcode.SCHEMA, Opcode.CHANNEL}:
                    self._define(opcode, bytes(record))

    def _define(self, opcode: int, record: bytes) -> None:
        """Take note of a schema or a channel."""
        from mcap.data_stream import ReadDataStream
        from mcap.exceptions import McapError
        from mcap.opcode import Opcode
        from mcap.records import Channel, Schema

        stream = ReadDataStream(io.BytesIO(record))
        try:
            if opcode == Opcode.SCHEMA:
                schema = Schema.read(stream)
                self.schemas[schema.id] = schema
            else:
                channel = Channel.read(stream)
                self.channels[channel.id] = channel
        except McapError as error:
            raise ValueError(str(error) or "a record that is cut off") from None

    def _chunk(self, begin: int, length: int) -> _Block:
        """The chunk whose record begins at a place, by its head."""
        start, end, size, crc, text = _CHUNK.unpack(self.file.read(_CHUNK.size))
        if text > 32:
            raise ValueError("a chunk with a name of its compression that is too long")
        compression = self.file.read(text).decode()
        packed = struct.unpack("<Q", self.file.read(8))[0]
        if size > LARGEST_BLOCK or _CHUNK.size + text + 8 + packed != length:
            raise ValueError(
                f"a chunk of {size} bytes, packed into {packed}, in a record of {length}"
            )
        place = begin + _CHUNK.size + text + 8
        return _Block(Interval(start, end), place, packed, compression, size, crc)

    def _read(self, block: _Block) -> bytes:
        return self.last.read(block.place, lambda: self._unpacked(block))

    def _unpacked(self, block: _Block) -> bytes:
        self.file.seek(block.place)
        data = unpacked(self.file.read(block.length), block.compression, block.size)
        if block.crc and zlib.crc32(data) != block.crc:
            raise ValueError("a chunk whose checksum does not fit")
        return data

    def messages(self, topic: str, within: Interval | None) -> Iterator[Message]:
        """Messages of a topic in the order in which they were received."""
        channels = {number for number, channel in self.channels.items() if channel.topic == topic}
        pieces = [
            FileSection(block.interval, partial(self._messages, block, channels))
            for block in self.blocks
            if self.held.get(block.place, channels) & channels
        ]
        return in_time_order(pieces, within)

    def _messages(self, block: _Block, channels: set[int]) -> list[Message]:
        """Messages of some channels in a block."""
        found = []
        try:
            for opcode, record in _records(self._read(block)):
                if opcode != _MESSAGE_OPCODE:
                    continue
                channel, _, received, published = _MESSAGE.unpack_from(record)
                if channel in channels:
                    data = bytes(record[_MESSAGE.size :])
                    found.append(Message(received, published, channel, data))
        except (ValueError, struct.error) as error:
            raise _damaged(self.path, error) from None
        return found

    def decoder(self, number: int) -> Decoder:
        """Decoder of the messages of a channel."""
        channel = self.channels[number]
        schema = self.schemas.get(channel.schema_id)
        if channel.message_encoding == "json":
            return decode_json
        make = _DECODERS.get(channel.message_encoding)
        if make is None or schema is None or schema.encoding not in _FORMS:
            raise InputError(
                f"{self.path}: topic '{shown(channel.topic)}': expected messages in JSON or of ROS"
                f" (cdr, ros1), found '{shown(channel.message_encoding)}' with a schema in"
                f" '{shown(schema.encoding if schema else '')}'; convert them to JSON"
            )
        definition = schema.data.decode("utf-8", "replace")
        ros1 = channel.message_encoding == "ros1"
        return make(
            types_of(self.path, schema.name, _FORMS[schema.encoding], definition, ros1=ros1),
            schema.name,
        )

    def _cut_off(self) -> InputError:
        return InputError(
            f"{self.path}: expected an MCAP file with its end, found one that is cut off; copy it"
            " again, or, where the recorder was stopped, repair it with: mcap recover"
            f" {shown(self.path.name)} -o repaired.mcap"
        )


_DECODERS: dict[str, Callable[[Any, str], Decoder]] = {"cdr": cdr_decoder, "ros1": ros1_decoder}


def _region(messages: list[_Head]) -> _Block:
    """Messages in a row."""
    times = [message.received for message in messages]
    begin, end = messages[0].start, messages[-1].end
    return _Block(Interval(min(times), max(times)), begin, end - begin, size=end - begin)


def _records(data: bytes) -> Iterator[tuple[int, memoryview]]:
    """Records of a chunk: opcode and content."""
    view, place = memoryview(data), 0
    while place < len(view):
        opcode, length = _HEAD.unpack_from(view, place)
        place += _HEAD.size + length
        if place > len(view):
            raise ValueError("a record that runs over the end of its chunk")
        yield opcode, view[place - length : place]


def _damaged(path: Path, error: Exception) -> InputError:
    return InputError(
        f"{path}: expected an MCAP file, found one that is damaged ({shown(str(error), 120)}); copy"
        " it again"
    )
