"""Archives of NumPy arrays."""

from __future__ import annotations

import math
import warnings
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import lru_cache, partial
from pathlib import Path
from tokenize import TokenError
from typing import IO, Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from steelyard.errors import InputError
from steelyard.logs.arrays.nested import (
    Arrays,
    Key,
    Source,
    fields_of,
    is_number,
    with_rows_first,
)
from steelyard.logs.log import MOST_COLUMNS, Log
from steelyard.logs.packages import damaged, shown
from steelyard.logs.size import check_unpacked

_WHAT = "an archive of NumPy arrays"
_ERRORS = (
    *(zipfile.BadZipFile, zlib.error, OSError, EOFError, ValueError, TypeError, SyntaxError),
    *(TokenError, RuntimeError, NotImplementedError, MemoryError, KeyError, AttributeError),
    OverflowError,
)
"""What the standard library and NumPy raise on damaged archives: RuntimeError for an encrypted
member, MemoryError for nested brackets in a header."""


@contextmanager
def opened(path: Path) -> Iterator[Log]:
    """Open an archive of NumPy arrays.

    Raises:
        InputError: It is damaged.
    """
    try:
        archive = zipfile.ZipFile(path)
    except _ERRORS as error:
        raise damaged(path, _WHAT, error, "one that is damaged or cut off") from None
    with archive:
        members = [member for member in archive.infolist() if member.filename.endswith(".npy")]
        if len(members) > MOST_COLUMNS:
            raise InputError(
                f"{path}: expected at most {MOST_COLUMNS} arrays, found {len(members)}; check the"
                " recording"
            )
        check_unpacked(path, sum(member.file_size for member in members), path.stat().st_size)
        sources: dict[Key, Source] = {}
        objects = []
        for member in members:
            name = member.filename.removesuffix(".npy")
            shape, dtype = _header(path, archive, member)
            if dtype.hasobject:
                objects.append(name)
                continue
            if len(shape):
                read = partial(lru_cache(maxsize=1)(_array), path, archive, member)
                for fields, kind in fields_of(dtype):
                    base, inner = kind.subdtype or (kind, ())
                    if is_number(base):
                        field = partial(_field, read, fields)
                        sources[name, *fields] = with_rows_first((*shape, *inner), base, field)
        if objects and not sources:
            raise InputError(
                f"{path}: expected arrays of numbers, found arrays of Python objects"
                f" ({shown(', '.join(objects))}), which are never read; save them with a number"
                " type, such as np.asarray(x, dtype=float)"
            )
        yield Arrays(path, sources, joined=True).log(None)


def _header(
    path: Path, archive: zipfile.ZipFile, member: zipfile.ZipInfo
) -> tuple[tuple[int, ...], np.dtype[Any]]:
    """Shape and type of an array, without its numbers.

    Raises:
        InputError: It is damaged, or states a shape that its bytes do not have.
    """
    try:
        with archive.open(member) as file, warnings.catch_warnings():
            # Of headers in the manner of Python 2, and of what is no header at all.
            warnings.simplefilter("ignore")
            shape, _, dtype = _read_header(file)
            size = math.prod(shape) * dtype.itemsize
            if min(shape, default=0) < 0 or (
                not dtype.hasobject and file.tell() + size != member.file_size
            ):
                raise ValueError(f"an array of shape {shape} in {member.file_size} bytes")
    except _ERRORS as error:
        raise damaged(path, _WHAT, error, "one that is damaged or cut off") from None
    return shape, dtype


def _read_header(file: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    version = npy.read_magic(file)
    if version == (1, 0):
        return npy.read_array_header_1_0(file)
    if version in {(2, 0), (3, 0)}:
        return npy.read_array_header_2_0(file)
    raise ValueError(f"version {version[0]}.{version[1]} of the format")


def _field(read: Callable[[], NDArray[Any]], fields: Key) -> NDArray[Any]:
    """A field of an array, or the array itself."""
    array = read()
    for name in fields:
        array = array[name]
    return array


def _array(path: Path, archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> NDArray[Any]:
    try:
        with archive.open(member) as file:
            array: NDArray[Any] = npy.read_array(file, allow_pickle=False)
    except _ERRORS as error:
        raise damaged(path, _WHAT, error, "one that is damaged or cut off") from None
    return array
