"""Blocks of a recording, unpacked to no more than they state."""

from __future__ import annotations

import bz2
from collections.abc import Callable

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
    import zstandard

    try:
        stated = zstandard.frame_content_size(data)
        if stated not in {-1, size}:
            raise ValueError(f"a block that states {stated} bytes instead of {size}")
        return zstandard.ZstdDecompressor().decompress(data, max_output_size=size)
    except zstandard.ZstdError as error:
        raise ValueError(f"a block that cannot be unpacked: {error}") from None


_UNPACK = {"lz4": _lz4, "bz2": _bz2, "zstd": _zstd}


class LastBlock:
    """The block that was unpacked last: a search looks at the same one again and again."""

    def __init__(self) -> None:
        self.bytes_read = 0
        """Unpacked so far."""
        self._place, self._data = -1, b""

    def read(self, place: int, unpack: Callable[[], bytes]) -> bytes:
        """The block at a place of the file."""
        if place != self._place:
            data = unpack()
            self.bytes_read += len(data)
            self._place, self._data = place, data
        return self._data
