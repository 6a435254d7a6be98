"""How much a log may hold: files come from anyone, and some are made to fill the memory."""

from __future__ import annotations

from pathlib import Path

from steelyard.errors import InputError

_ALWAYS = 1 << 28
"""Bytes that any log may unpack to."""
_RATIO = 60
"""Bytes that a byte of a packed log may become beyond that: recordings of sensors shrink to a tenth
at best."""


def check_unpacked(
    path: Path, size: int, packed: int, *, always: int = _ALWAYS, ratio: int = _RATIO
) -> None:
    """Refuse what unpacks to far more than a recording of its size.

    Args:
        path: Of the log.
        size: Bytes of what it holds, unpacked.
        packed: Bytes of the file.
        always: Bytes that any file of the format may unpack to.
        ratio: Bytes that a byte may become beyond that.

    Raises:
        InputError: It is far more.
    """
    if size > always and size > ratio * packed:
        raise InputError(
            f"{path}: expected a recording, found {packed >> 10} KiB that unpack to more than"
            f" {size >> 20} MiB; check where it comes from"
        )
