"""MCAP files: messages in JSON or of ROS.

Records are read here and not by ``mcap.reader``, which unpacks whatever a chunk states or holds: a
file of 9 KB takes 500 MB of memory there, and without an index it keeps all messages in memory. It
reads single schemas and channels.
"""

from __future__ import annotations

import io
import struct
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, NamedTuple

from steelyard.errors import InputError
from steelyard.logs.messages.blocks import LARGEST_BLOCK, MOST_UNPACKED, Block, BlockFile
from steelyard.logs.messages.json_message import decode_json
from steelyard.logs.messages.recording import Decoder, Interval, Message, Recording
from steelyard.logs.messages.ros_message import cdr_decoder, ros1_decoder
from steelyard.logs.messages.ros_types import types_of
from steelyard.logs.packages import damaged, require_package, shown
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


def require(path: Path) -> None:
    """Raise InputError unless the library that reads the file is installed."""
    require_package(path, "mcap", "mcap", "MCAP")


@contextmanager
def opened(path: Path) -> Iterator[Recording]:
    """Open an MCAP file.

    Raises:
        InputError: It is damaged or cut off.
    """
    with path.open("rb") as file:
        contents = _Contents(path, file)
        try:
            contents.look_through()
        except (ValueError, struct.error) as error:
            raise damaged(path, "an MCAP file", error) from None
        topics = {}
        for number, channel in contents.channels.items():
            schema = contents.schemas.get(channel.schema_id)
            kind = schema.name if schema and schema.name else channel.message_encoding
            topics[number] = channel.topic, kind
        yield contents.recording(topics, contents.messages_in, contents.decoder)


class _Head(NamedTuple):
    """A message outside of chunks."""

    received: int
    """[ns]."""
    start: int
    """Of its record in the file."""
    end: int


class _Contents(BlockFile):
    """What an MCAP file holds, as far as it has been looked through."""

    def __init__(self, path: Path, file: IO[bytes]) -> None:
        super().__init__(path, file)
        self.channels: dict[int, Channel] = {}
        self.schemas: dict[int, Schema] = {}

    def look_through(self) -> None:
        """Find chunks, channels and schemas; nothing is unpacked yet.

        Raises:
            InputError: The file is cut off, or unpacks to too much.
            ValueError: It is damaged.
            struct.error: It is damaged.
        """
        from mcap.opcode import Opcode

        region: list[_Head] = []
        ended = False
        for opcode, begin, length in self._heads():
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
                self.blocks[-1].channels.add(struct.unpack("<H", self.file.read(2))[0])
            ended = opcode == Opcode.FOOTER
        if not ended:
            raise ValueError("no footer at its end")
        check_unpacked(self.path, self.size, self.file_size, always=MOST_UNPACKED)
        known = set().union(*(block.channels for block in self.blocks)) <= self.channels.keys()
        if not known or not self.channels:
            self._define_by_chunks()

    def _heads(self) -> Iterator[tuple[int, int, int]]:
        """Records of the file: opcode, where the content begins, and its length; the file stands
        there.
        """
        size = self.file_size
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
            for opcode, record in _records(self.read(block)):
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

    def _chunk(self, begin: int, length: int) -> Block:
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
        return Block(Interval(start, end), place, packed, compression, size, crc)

    def messages_in(self, block: Block, channels: set[int]) -> list[Message]:
        """Messages of some channels in a block."""
        found = []
        try:
            for opcode, record in _records(self.read(block)):
                if opcode != _MESSAGE_OPCODE:
                    continue
                channel, _, received, published = _MESSAGE.unpack_from(record)
                if channel in channels:
                    data = bytes(record[_MESSAGE.size :])
                    found.append(Message(received, published, channel, data))
        except (ValueError, struct.error) as error:
            raise damaged(self.path, "an MCAP file", error) from None
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


def _region(messages: list[_Head]) -> Block:
    """Messages in a row."""
    times = [message.received for message in messages]
    begin, end = messages[0].start, messages[-1].end
    return Block(Interval(min(times), max(times)), begin, end - begin, size=end - begin)


def _records(data: bytes) -> Iterator[tuple[int, memoryview]]:
    """Records of a chunk: opcode and content."""
    view, place = memoryview(data), 0
    while place < len(view):
        opcode, length = _HEAD.unpack_from(view, place)
        place += _HEAD.size + length
        if place > len(view):
            raise ValueError("a record that runs over the end of its chunk")
        yield opcode, view[place - length : place]
