"""Regular files and their text; pipes, folders and what is no text are refused before anything is
opened.
"""

from __future__ import annotations

from pathlib import Path

from steelyard.errors import InputError

_LARGEST_FILE = 2**19
"""Bytes: reading line numbers along takes seconds beyond it."""


def require_file(path: Path, what: str = "file") -> None:
    """Raise InputError unless a path is a regular file."""
    try:
        if path.is_file():
            return
        found = "something that is no regular file" if path.exists() else "nothing there"
        found = "a folder" if path.is_dir() else found
    except OSError as error:
        found = f"'{error.strerror}'"
    except ValueError as error:
        found = f"'{error}'"
    raise InputError(f"{path}: expected a {what}, found {found}; check the path")


def read_text(path: Path) -> str:
    """Read a small text file.

    Raises:
        InputError: It is not there, not a regular file, too large, or not UTF-8.
    """
    require_file(path)
    if path.stat().st_size > _LARGEST_FILE:
        raise InputError(
            f"{path}: expected at most {_LARGEST_FILE >> 10} KiB of YAML, found"
            f" {path.stat().st_size >> 10} KiB"
        )
    if not path.stat().st_size:
        return ""  # never opened: pipes of the kernel say so of themselves, and wait
    try:
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(
            f"{path}: expected UTF-8 text, found a byte that is not at {error.start}; save it as"
            " UTF-8"
        ) from None
