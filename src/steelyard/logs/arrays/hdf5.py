"""HDF5 files."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError
from steelyard.logs.arrays.nested import Arrays, Key, Source, fields_of, is_number, is_row
from steelyard.logs.packages import require_package
from steelyard.logs.size import check_unpacked
from steelyard.units import is_unit

WHAT = "an HDF5 file"
_MOST_OBJECTS = 20_000
"""Groups and datasets of one file: recordings have hundreds; each costs a millisecond."""
_DEEPEST = 50
"""Groups within groups."""
_FILTERS = {1, 2, 3, 4, 5, 6, 32000}
"""Deflate, shuffle, Fletcher's checksum, szip, n-bit, scale-offset, LZF: those that come with the
library; others are looked for as plugins in folders of the system."""
_LONGEST_UNIT = 64
"""Bytes of the name of a unit."""


def require(path: Path) -> None:
    """Raise InputError unless the library that reads the file is installed."""
    require_package(path, "h5py", "h5py", "HDF5")


@contextmanager
def arrays_here(path: Path, topic: str | None) -> Iterator[Arrays]:
    """The arrays of an HDF5 file, read in this process; damaged ones may raise anything, or end
    it.
    """
    import h5py

    with h5py.File(path, "r") as file:
        others: list[str] = []
        sources = dict(sources_of(path, file, others))
        yield Arrays(path, sources, others=others)


def sources_of(
    path: Path,
    file: Any,
    others: list[str],
    accepted: Callable[[Any], bool] = lambda _: True,
    *,
    rows_last: bool = False,
) -> Iterator[tuple[Key, Source]]:
    """The arrays of numbers in an open file.

    Args:
        path: Of the file.
        file: As h5py has opened it.
        others: Takes what else there is and why it is left out.
        accepted: Tells which groups and datasets to look at.
        rows_last: Whether axes are in the opposite order, as MATLAB writes them.

    Raises:
        InputError: There are far too many, or one unpacks to too much.
    """
    for key, dataset in _datasets(path, file, others, accepted):
        _check_chunks(path, dataset)
        shape = tuple(reversed(dataset.shape)) if rows_last else tuple(dataset.shape)
        unit = _unit(dataset)
        for fields, dtype in fields_of(dataset.dtype):
            base, inner = dtype.subdtype or (dtype, ())
            if is_number(base) and shape:
                reader = _Reader(dataset, fields, rows_last, is_row(shape))
                outer = shape[1:] if reader.row else shape
                yield (*key, *fields), Source((*outer, *inner), base, reader, unit)


def _datasets(
    path: Path, file: Any, others: list[str], accepted: Callable[[Any], bool]
) -> Iterator[tuple[Key, Any]]:
    """All datasets with their places. No link is followed but to objects of their own: others may
    lead out of the file, or in circles.
    """
    import h5py

    found, seen = 0, {h5py.h5o.get_info(file.id).addr}
    groups: list[tuple[Key, Any]] = [((), file)]
    while groups:
        above, group = groups.pop()
        inner = []
        for name in group:
            found += 1
            if found > _MOST_OBJECTS:
                raise InputError(
                    f"{path}: expected at most {_MOST_OBJECTS} objects, found more; check the"
                    " recording"
                )
            key = (*above, _text(name))
            if not isinstance(group.get(name, getlink=True), h5py.HardLink):
                others.append(f"{'.'.join(key)}: a link")
                continue
            member = group[name]
            if not accepted(member):
                continue
            if isinstance(member, h5py.Group):
                # A group may hold itself.
                address = h5py.h5o.get_info(member.id).addr
                if address not in seen and len(above) < _DEEPEST:
                    seen.add(address)
                    inner.append((key, member))
            elif isinstance(member, h5py.Dataset):
                reason = _elsewhere(member)
                if reason:
                    others.append(f"{'.'.join(key)}: {reason}")
                else:
                    yield key, member
        groups += reversed(inner)


def _text(name: str | bytes) -> str:
    return name.decode("utf-8", "replace") if isinstance(name, bytes) else name


def _elsewhere(dataset: Any) -> str | None:
    """Why numbers cannot be had from this file alone; virtual datasets and external storage name
    other files, which may be any at all.
    """
    import h5py

    about = dataset.id.get_create_plist()
    if about.get_layout() == h5py.h5d.VIRTUAL or about.get_external_count():
        return "in another file"
    for i in range(about.get_nfilters()):
        number = about.get_filter(i)[0]
        if number not in _FILTERS:
            return f"packed by filter {number}"
    return None


def _check_chunks(path: Path, dataset: Any) -> None:
    """Refuse a dataset of which a small part alone unpacks to too much."""
    if dataset.chunks:
        size = int(np.prod(dataset.chunks, dtype=object)) * dataset.dtype.itemsize
        check_unpacked(path, size, path.stat().st_size)


def _unit(dataset: Any) -> str | None:
    """Unit in the attribute that most writers give it."""
    for name in ("units", "unit"):
        if name in dataset.attrs and dataset.attrs.get_id(name).get_storage_size() <= _LONGEST_UNIT:
            unit = dataset.attrs[name]
            text = unit.decode("utf-8", "replace") if isinstance(unit, bytes) else unit
            if isinstance(text, str) and is_unit(text):
                return text
    return None


@dataclass(frozen=True, eq=False)
class _Reader:
    """Reads rows of a dataset, or of one of its fields."""

    dataset: Any
    fields: Key
    rows_last: bool
    """Whether axes are in the opposite order."""
    row: bool
    """Whether there is but one row, which is meant as a column."""

    def __call__(self) -> _Reader:
        return self

    def __getitem__(self, rows: slice, /) -> NDArray[Any]:
        axis = self.dataset.ndim - 1 if self.rows_last != self.row else 0
        place = (*(slice(None) for _ in range(axis)), rows)
        values = self.dataset.fields(self.fields[0])[place] if self.fields else self.dataset[place]
        for name in self.fields[1:]:
            values = values[name]
        if self.row:
            return np.asarray(values).reshape(rows.stop - rows.start, *np.shape(values)[2:])
        return np.asarray(values).T if self.rows_last else np.asarray(values)
