"""Text files as pieces of whole lines in UTF-8: unpacked and transcoded on the way, never in memory
as a whole.
"""

from __future__ import annotations

import codecs
import os
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from steelyard.errors import InputError
from steelyard.logs.packages import damaged
from steelyard.logs.size import check_unpacked

_PIECE = 1 << 23
"""Bytes that are in memory at once: few, but enough to keep several processors busy."""
_LONGEST_LINE = 1 << 22
"""Bytes of a line: ten thousand columns have a tenth of it."""
_PACKED = 1 << 14
"""Bytes that are unpacked at once: each may become a thousand."""
_MEMBERS = 100_000
"""Files in one; some programs write one for every 64 KiB."""
_ALWAYS = 1 << 26
"""Bytes that any packed text may become."""
_RATIO = 20
"""Bytes of text that a byte may become: that of recordings becomes three to ten."""
_GZIP = b"\x1f\x8b"
_UTF16 = {codecs.BOM_UTF16_LE: "utf-16-le", codecs.BOM_UTF16_BE: "utf-16-be"}


def pieces(path: Path) -> Iterator[tuple[bytes, float]]:
    """Read a text file, plain or packed by gzip, from its beginning.

    Yields:
        Lines that follow each other, a newline at the end of each, and the part of the file that
        has been read with them.

    Raises:
        InputError: It cannot be read, is damaged or no text, has a line without end, or unpacks to
            far more than a log of its size.
    """
    with readable(path), path.open("rb") as file:
        size = max(os.fstat(file.fileno()).st_size, 1)
        held = b""
        for block in _texts(path, file, size):
            end = block.rfind(b"\n") + 1
            text = b"".join((held, memoryview(block)[:end]))
            held = block[end:] if end else held + block
            if max(len(held), text.find(b"\n")) > _LONGEST_LINE:
                raise InputError(
                    f"{path}: expected lines of at most {_LONGEST_LINE >> 20} MiB, found one that"
                    " is longer; check that it is a table"
                )
            if end:
                yield text, min(file.tell() / size, 1.0)
        if held:
            yield held + b"\n", 1.0


@contextmanager
def readable(path: Path) -> Iterator[None]:
    """Turn errors of the system into one sentence.

    Raises:
        InputError: It cannot.
    """
    try:
        yield
    except OSError as error:
        raise InputError(
            f"{path}: expected a file that can be read, found '{error.strerror}'; check it"
        ) from None


def _texts(path: Path, file: IO[bytes], size: int) -> Iterator[bytes]:
    """The text in UTF-8 (or any superset of ASCII) with newlines."""
    packed = file.read(2) == _GZIP
    file.seek(0)
    blocks = _unpacked(path, file, size) if packed else iter(lambda: file.read(_PIECE), b"")
    block = next(blocks, b"")
    decode = _decoder(path, block)
    text = decode(block, False).removeprefix(codecs.BOM_UTF8)
    # Once upon a time, a carriage return ended a line.
    returns = b"\r" in text and b"\n" not in text
    while block:
        yield text.replace(b"\r", b"\n") if returns else text
        block = next(blocks, b"")
        text = decode(block, not block)


def _unpacked(path: Path, file: IO[bytes], size: int) -> Iterator[bytes]:
    """What a gzip file holds; it may be several, one behind the other."""
    held, total, members, ended = bytearray(), 0, 0, False
    decoder = zlib.decompressobj(wbits=31)
    try:
        while packed := file.read(_PACKED):
            # Some programs fill the rest of a block with zeros.
            while packed := packed.lstrip(b"\0") if ended else packed:
                block = decoder.decompress(packed, _PIECE)
                held += block
                total += len(block)
                check_unpacked(path, total, size, always=_ALWAYS, ratio=_RATIO)
                packed, ended = decoder.unconsumed_tail or decoder.unused_data, decoder.eof
                if ended:
                    decoder = zlib.decompressobj(wbits=31)
                    members += 1
                if members > _MEMBERS:
                    raise zlib.error(f"it is in more than {_MEMBERS} parts")
                if len(held) >= _PIECE:
                    yield bytes(held)
                    held.clear()
    except zlib.error as error:
        raise damaged(path, "a gzip file", error) from None
    if not ended:
        raise damaged(path, "a gzip file", "it is cut off")
    yield bytes(held)


def _decoder(path: Path, beginning: bytes) -> Callable[[bytes, bool], bytes]:
    """What turns blocks of a file into UTF-8."""
    encoding = _utf16(beginning[:4096])
    if encoding is None:
        if b"\0" in beginning[:4096]:
            raise InputError(
                f"{path}: expected text, found bytes that are none; correct its ending or convert"
                " it to CSV"
            )
        return lambda block, _: block
    decoder = codecs.getincrementaldecoder(encoding)()

    def decode(block: bytes, last: bool) -> bytes:
        try:
            return decoder.decode(block, last).encode()
        except UnicodeDecodeError as error:
            raise InputError(
                f"{path}: expected text in {encoding.upper()}, found characters that are none"
                f" ({error.reason}); save it as UTF-8"
            ) from None

    return decode


def _utf16(beginning: bytes) -> str | None:
    """Encoding of a text that takes two bytes for a character; None: it does not."""
    for mark, encoding in _UTF16.items():
        if beginning.startswith(mark):
            return encoding
    # Digits and separators are ASCII: every other byte is zero.
    even, odd = beginning[0::2].count(0), beginning[1::2].count(0)
    if odd > 0.4 * len(beginning) and even == 0:
        return "utf-16-le"
    return "utf-16-be" if even > 0.4 * len(beginning) and odd == 0 else None
