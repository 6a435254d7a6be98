"""MATLAB files: of versions 4 to 7.2 and, as HDF5, 7.3."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError
from steelyard.logs.arrays.hdf5 import sources_of
from steelyard.logs.arrays.nested import (
    MOST_ELEMENTS,
    Arrays,
    Key,
    Source,
    is_number,
    with_rows_first,
)
from steelyard.logs.packages import listed, require_package
from steelyard.logs.size import check_unpacked

WHAT = "a MATLAB file"
_INTEGERS = {f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)}
_NUMBERS = {"double", "single", "logical", *_INTEGERS}
"""Classes of MATLAB."""
_HEADER = 128
"""Bytes of the header of a file of version 5."""
_COMPRESSED = 15
"""Type of an element that is packed."""
_PIECE = 1 << 20
"""Bytes that are unpacked at once."""
_DEEPEST = 50
"""Structures within structures."""
_HDF5 = b"\x89HDF\r\n\x1a\n"
_USERBLOCK = 512
"""Bytes before the HDF5 part of a file of version 7.3."""


def require(path: Path) -> None:
    """Raise InputError unless the library that reads the file is installed."""
    if _is_hdf5(path):
        require_package(path, "h5py", "h5py", "MATLAB 7.3")


@contextmanager
def arrays_here(path: Path, topic: str | None) -> Iterator[Arrays]:
    """The arrays of a MATLAB file, or of one of its variables, read in this process; damaged ones
    may raise anything, or end it.
    """
    if not _is_hdf5(path):
        yield _arrays(path, *_variables(path, topic))
        return
    import h5py

    others: list[str] = []

    def accepted(member: Any) -> bool:
        """Whether a variable is a structure or an array of numbers."""
        name = member.name.rpartition("/")[2]
        kind = member.attrs.get("MATLAB_class", b"")
        kind = kind.decode("utf-8", "replace") if isinstance(kind, bytes) else str(kind)
        if name in {"#refs#", "#subsystem#"} or member.attrs.get("MATLAB_empty"):
            return False
        if isinstance(member, h5py.Group) or kind in _NUMBERS:
            return kind in {"", "struct", *_NUMBERS}
        others.append(f"{name}: {kind or 'without a class'}")
        return False

    with h5py.File(path, "r") as file:
        sources = dict(sources_of(path, file, others, accepted, rows_last=True))
        yield _arrays(path, sources, others)


def _arrays(path: Path, sources: dict[Key, Source], others: list[str]) -> Arrays:
    if not sources and others:
        raise InputError(
            f"{path}: expected arrays of numbers or structures of them, found {listed(others)};"
            " save numbers, such as [x.Time, x.Data]"
        )
    return Arrays(path, sources, group="structure", others=others)


def _is_hdf5(path: Path) -> bool:
    with path.open("rb") as file:
        beginning = file.read(_USERBLOCK + len(_HDF5))
    return beginning.startswith(_HDF5) or beginning[_USERBLOCK:] == _HDF5


def _variables(path: Path, topic: str | None) -> tuple[dict[Key, Source], list[str]]:
    """Arrays of numbers in the variables of a file up to version 7.2, and the other variables with
    their classes.
    """
    from scipy.io import loadmat, whosmat

    _check_size(path)
    sources: dict[Key, Source] = {}
    others = []
    variables = whosmat(path, appendmat=False)
    names = [name for name, _, _ in variables]
    wanted = {topic.strip("/").replace("/", ".").partition(".")[0]} if topic else set(names)
    for name, shape, kind in variables:
        if names.count(name) > 1:
            raise InputError(
                f"{path}: expected variables of different names, found '{name}' twice; save it"
                " again"
            )
        if kind not in _NUMBERS and kind != "struct":
            others.append(f"{name}: {kind}")
        elif name in wanted or wanted.isdisjoint(names):
            check_unpacked(path, int(np.prod(shape, dtype=object)), path.stat().st_size)
            value = loadmat(path, appendmat=False, variable_names=[name])[name]
            sources.update(_sources((name,), value))
    return sources, others


def _check_size(path: Path) -> None:
    """Refuse a file whose packed variables make far more than a recording of its size, or are cut
    off.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        header = file.read(_HEADER)
        if len(header) < _HEADER or 0 in header[:4]:
            return  # of version 4, which packs nothing
        order = "<" if header[126:128] == b"IM" else ">"
        found, place = 0, _HEADER
        while place < size:
            file.seek(place)
            kind, length = struct.unpack(order + "II", file.read(8))
            place += 8 + length
            if place > size:
                raise InputError(
                    f"{path}: expected a MATLAB file, found one whose last variable is cut off;"
                    " copy it again"
                )
            if kind == _COMPRESSED:
                length = _unpacked_size(path, file.read(length), found, size)
            found += length
            check_unpacked(path, found, size)


def _unpacked_size(path: Path, packed: bytes, before: int, size: int) -> int:
    decompressor = zlib.decompressobj()
    found = 0
    while packed and not decompressor.eof:
        found += len(decompressor.decompress(packed, _PIECE))
        packed = decompressor.unconsumed_tail
        check_unpacked(path, before + found, size)
    return found


def _sources(key: Key, value: Any) -> Iterator[tuple[Key, Source]]:
    """Arrays of numbers in a value as SciPy reads it."""
    if not isinstance(value, np.ndarray) or len(key) > _DEEPEST:
        return
    array: NDArray[Any] = value
    if array.dtype.names is not None:
        for i, element in enumerate(array.ravel(order="F")[:MOST_ELEMENTS]):
            # Of several structures in a row, each has its number.
            own = key if array.size == 1 else (*key[:-1], f"{key[-1]}[{i}]")
            for name in array.dtype.names:
                yield from _sources((*own, name), element[name])
    elif is_number(array.dtype) and array.ndim and array.size:
        yield key, with_rows_first(array.shape, array.dtype, lambda: array)
