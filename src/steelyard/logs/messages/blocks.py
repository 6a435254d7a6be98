"""Blocks of a recording, unpacked to no more than they state, and the messages in them."""

from __future__ import annotations

import bz2
import os
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import IO

from steelyard.logs.messages.recording import (
    Decoder,
    FileSection,
    Interval,
    Message,
    Recording,
    in_time_order,
    spanned,
)

LARGEST_BLOCK = 1 << 28
"""Bytes of a block, unpacked; recorders write a few millions."""
MOST_UNPACKED = 1 << 24
"""Bytes that messages of any file may unpack to: small ones take a while, each for itself."""
_METHODS = {"", "none", "lz4", "zstd", "bz2"}


def unpacked(data: bytes, method: str, size: int) -> bytes:
    """Unpack a block.

    Args:
        data: Packed bytes.
        method: How they are packed; empty or ``none``: they are not.
        size: Bytes that they unpack to, as the recording states.

    Raises:
        ValueError: They unpack to something else, or cannot be unpacked.
    """
    if method not in _METHODS:
        raise ValueError(f"compression '{method}'")
    try:
        block = data if method in {"", "none"} else _UNPACK[method](data, size)
    except (OSError, RuntimeError, EOFError, MemoryError) as error:
        raise ValueError(f"a block that cannot be unpacked: {error}") from None
    if len(block) != size:
        raise ValueError(f"a block that does not unpack to its {size} bytes")
    return block


def _lz4(data: bytes, size: int) -> bytes:
    from lz4.frame import LZ4FrameDecompressor

    block: bytes = LZ4FrameDecompressor().decompress(data, max_length=size + 1)
    return block


def _bz2(data: bytes, size: int) -> bytes:
    return bz2.BZ2Decompressor().decompress(data, max_length=size + 1)


def _zstd(data: bytes, size: int) -> bytes:
    """Unpack a frame of Zstandard, which may state its size too."""
    import zstandard

    try:
        stated = zstandard.frame_content_size(data)
        if stated not in {-1, size}:
            raise ValueError(f"a block that states {stated} bytes instead of {size}")
        return zstandard.ZstdDecompressor().decompress(data, max_output_size=size)
    except zstandard.ZstdError as error:
        raise ValueError(f"a block that cannot be unpacked: {error}") from None


_UNPACK = {"lz4": _lz4, "bz2": _bz2, "zstd": _zstd}


@dataclass(frozen=True)
class Block:
    """A packed part of a recording, or messages in a row outside of such parts."""

    interval: Interval
    """When its messages were received."""
    place: int
    """Of its records in the file, packed or not."""
    length: int
    """Bytes of them in the file."""
    compression: str = ""
    size: int = 0
    """Bytes, unpacked."""
    crc: int = 0
    """Of the bytes, unpacked; 0: none is stated."""
    channels: set[int] = field(default_factory=set)
    """Those with messages in it; none: the file does not say."""


class BlockFile:
    """Blocks of an open file. The last one that was unpacked is kept: a search looks at the same
    one again and again.
    """

    def __init__(self, path: Path, file: IO[bytes]) -> None:
        self.path, self.file = path, file
        self.file_size = os.fstat(file.fileno()).st_size
        self.blocks: list[Block] = []
        self.bytes_read = 0
        """Unpacked so far."""
        self._last_place, self._last = -1, b""

    @property
    def size(self) -> int:
        """Bytes of all blocks, unpacked."""
        return sum(block.size for block in self.blocks)

    def read(self, block: Block) -> bytes:
        """A block, unpacked.

        Raises:
            ValueError: It is damaged.
        """
        if block.place != self._last_place:
            self.file.seek(block.place)
            data = unpacked(self.file.read(block.length), block.compression, block.size)
            if block.crc and zlib.crc32(data) != block.crc:
                raise ValueError("a chunk whose checksum does not fit")
            self.bytes_read += len(data)
            self._last_place, self._last = block.place, data
        return self._last

    def recording(
        self,
        channels: Mapping[int, tuple[str, str]],
        messages_in: Callable[[Block, set[int]], Iterable[Message]],
        decoder: Callable[[int], Decoder],
    ) -> Recording:
        """The messages of the blocks.

        Args:
            channels: Channel -> its topic and the type of its messages.
            messages_in: Those of some channels in a block.
            decoder: Of a channel.
        """

        def messages(topic: str, within: Interval | None) -> Iterator[Message]:
            """See :attr:`.Recording.messages`."""
            wanted = {number for number, (name, _) in channels.items() if name == topic}
            sections = [
                FileSection(block.interval, partial(messages_in, block, wanted))
                for block in self.blocks
                if not block.channels or block.channels & wanted
            ]
            return in_time_order(sections, within)

        return Recording(
            self.path,
            dict(channels.values()),
            spanned(block.interval for block in self.blocks),
            messages,
            self.size,
            lambda: self.bytes_read,
            decoder,
        )
