"""What is asked of the operating system to write results; every byte of a result passes here.

Only functions of :mod:`os` and one call of the C library are used, so that tests can fail each.
"""

from __future__ import annotations

import ctypes
import errno
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

_AT_FDCWD = -100
_RENAME_EXCHANGE = 2
_PERMISSIONS = 0o666
"""Of a new file; the user's mask takes from it."""


def write_file(path: Path, content: str | bytes) -> None:
    """Write a file.

    Args:
        path: Of the file; one that is there is replaced.
        content: Text is written as UTF-8 with its ends of lines as they are.

    Raises:
        OSError: It cannot be written; the error has its path.
    """
    with growing_file(path) as write:
        write(content)


@contextmanager
def growing_file(path: Path) -> Iterator[Callable[[str | bytes], None]]:
    """A file that others can follow while it grows.

    Args:
        path: Of the file; one that is there is replaced.

    Yields:
        What appends text (as UTF-8, with its ends of lines as they are) or bytes.

    Raises:
        OSError: It cannot be written; the error has its path.
    """

    def write(content: str | bytes) -> None:
        left = memoryview(content.encode() if isinstance(content, str) else content)
        with _naming(path):
            while left:
                left = left[os.write(file, left) :]

    file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, _PERMISSIONS)
    try:
        yield write
    finally:
        os.close(file)


@contextmanager
def _naming(path: Path) -> Iterator[None]:
    """Name the file in errors: of an open one the system says only that something is wrong."""
    try:
        yield
    except OSError as error:
        error.filename = error.filename or str(path)
        raise


def synchronise(path: Path) -> None:
    """Force a file, or the names in a folder, to the disk.

    Raises:
        OSError: The disk did not take it; the error has its path.
    """
    file = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        with _naming(path):
            os.fsync(file)
    except OSError as error:
        # Some file systems of networks keep folders themselves.
        if error.errno != errno.EINVAL or not path.is_dir():
            raise
    finally:
        os.close(file)


def synchronise_tree(folder: Path) -> None:
    """Force all regular files below a folder to the disk, then the names of each folder."""
    for inner, _, names in os.walk(folder, topdown=False):
        for name in names:
            path = Path(inner, name)
            if path.is_file() and not path.is_symlink():
                synchronise(path)
        synchronise(Path(inner))


@cache
def _renameat2() -> Any:
    """The call of the C library that can exchange two names; None where there is none."""
    try:
        function = ctypes.CDLL(None, use_errno=True).renameat2
    except (AttributeError, OSError):
        return None
    function.argtypes = [
        ctypes.c_int,
        ctypes.c_char_p,
        ctypes.c_int,
        ctypes.c_char_p,
        ctypes.c_uint,
    ]
    return function


def can_exchange() -> bool:
    """Whether the system may be able to exchange two names."""
    return _renameat2() is not None


def exchange(one: Path, other: Path) -> None:
    """Exchange what two names stand for, in one step that nobody sees the inside of.

    Raises:
        OSError: The system or the file system cannot.
    """
    rename = _renameat2()
    if rename is None:
        raise OSError(errno.ENOSYS, os.strerror(errno.ENOSYS), str(one))
    names = os.fsencode(one), os.fsencode(other)
    if rename(_AT_FDCWD, names[0], _AT_FDCWD, names[1], _RENAME_EXCHANGE):
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number), str(one), None, str(other))
