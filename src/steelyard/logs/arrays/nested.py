"""Trees of arrays as tables: what HDF5, MATLAB, TDMS and NumPy files hold."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.errors import InputError
from steelyard.logs.log import Log, RowRange
from steelyard.logs.packages import MOST_LISTED, listed, shown
from steelyard.logs.size import check_unpacked

MOST_ELEMENTS = 1000
"""Numbers of one instant that one array may hold; what holds more is an image or a cloud of
points."""
_PIECE = 1 << 20
"""Numbers that are read at once."""

Key = tuple[str, ...]
"""Names of an array, from the outermost group to its own."""


class Sliceable(Protocol):
    """An array, or what reads one from a file: rows along its first axis."""

    def __getitem__(self, rows: slice, /) -> NDArray[Any]: ...


@dataclass(frozen=True, eq=False)
class Source:
    """An array of a file."""

    shape: tuple[int, ...]
    """Rows along its first axis."""
    dtype: np.dtype[Any]
    open: Callable[[], Sliceable]
    """The array, or what reads rows of it from the file."""
    unit: str | None = None
    """As the file states it."""

    @property
    def elements(self) -> int:
        """Numbers of one row."""
        return math.prod(self.shape[1:])

    @property
    def size(self) -> int:
        """Bytes, unpacked."""
        return math.prod(self.shape) * self.dtype.itemsize


def is_number(dtype: np.dtype[Any]) -> bool:
    """Whether values are real numbers, truth values, instants or durations."""
    return dtype.kind in "biuf" or (
        dtype.kind in "mM" and np.datetime_data(dtype)[0] not in {"generic", "Y", "M"}
    )


def fields_of(dtype: np.dtype[Any]) -> Iterator[tuple[Key, np.dtype[Any]]]:
    """Fields of a compound type with their names, or the type itself."""
    if dtype.names is None:
        yield (), dtype
        return
    for name in dtype.names:
        for inner, kind in fields_of(dtype[name]):
            yield (name, *inner), kind


def with_rows_first(
    shape: tuple[int, ...], dtype: np.dtype[Any], read: Callable[[], NDArray[Any]]
) -> Source:
    """An array in memory; a row vector, shape (1, n), is meant as a column."""
    if is_row(shape):
        return Source(shape[1:], dtype, lambda: read()[0])
    return Source(shape, dtype, read)


def is_row(shape: tuple[int, ...]) -> bool:
    """Whether an array is a row vector, shape (1, n)."""
    return len(shape) == 2 and shape[0] == 1 and shape[1] > 1


@dataclass(frozen=True, eq=False)
class Arrays:
    """The arrays of real numbers in a file, in groups within groups."""

    path: Path
    sources: Mapping[Key, Source]
    group: str = "group"
    """What the format calls a group."""
    joined: bool = False
    """Whether several groups make one table where no topic is named."""
    others: Sequence[str] = ()
    """What else there is and why it is left out, for the message where there is nothing to read."""

    def topics(self) -> list[str]:
        """Groups from which one has to be chosen; none: the arrays are one table.

        Raises:
            InputError: There are too many, or nothing to read.
        """
        _, inner = _outermost(self._narrow())
        if len(inner) > MOST_LISTED:
            raise self._several(inner)
        return [] if self.joined else inner

    def log(self, topic: str | None) -> Log:
        """A table of the arrays.

        Args:
            topic: Group that the table is made of; None: the only one that holds arrays.

        Raises:
            InputError: There is no such group, or several and none is named, or nothing to read.
        """
        sources = self._narrow()
        if topic is not None:
            group = _group(self.path, sources, topic, self.group)
        else:
            group, inner = _outermost(sources)
            if inner and not self.joined:
                raise self._several(inner)
        columns = {
            key[len(group) :]: source
            for key, source in sources.items()
            if key[: len(group)] == group
        }
        table = _Columns(self.path, dict(_elements(columns)))
        units = {name: source.unit for name, (source, _) in table.columns.items() if source.unit}
        return Log(self.path, tuple(table.columns), table.load, units)

    def _narrow(self) -> dict[Key, Source]:
        """The arrays that are no images or clouds of points, one at least."""
        wide, narrow = [], {}
        for key, source in self.sources.items():
            if source.elements > MOST_ELEMENTS:
                wide.append(f"{'.'.join(key)}: more than {MOST_ELEMENTS} numbers at an instant")
            else:
                narrow[key] = source
        if narrow:
            return narrow
        left_out = [*wide, *self.others]
        because = f" (left out: {listed(left_out)})" if left_out else ""
        raise InputError(
            f"{self.path}: expected arrays of numbers with an instant per row, found none{because};"
            " check the recording"
        )

    def _several(self, groups: Sequence[str]) -> InputError:
        return InputError(
            f"{self.path}: expected 'topic' to say which of its {self.group}s to read, found"
            f" {listed(groups)}; name one"
        )


def _groups(sources: Mapping[Key, Source]) -> dict[Key, None]:
    """Groups with an array anywhere below them, the file itself among them."""
    return dict.fromkeys(key[:depth] for key in sources for depth in range(len(key)))


def _outermost(sources: Mapping[Key, Source]) -> tuple[Key, list[str]]:
    """The outermost group with arrays of its own or with several groups, and names of the latter
    where it has no arrays.
    """
    group: Key = ()
    groups = _groups(sources)
    while not any(key[:-1] == group for key in sources):
        inner = [other for other in groups if len(other) == len(group) + 1 and other[:-1] == group]
        if len(inner) > 1:
            return group, [".".join(key) for key in inner]
        group = inner[0]
    return group, []


def _group(path: Path, sources: Mapping[Key, Source], topic: str, what: str) -> Key:
    groups = _groups(sources)
    wanted = topic.strip("/").replace("/", ".")
    for group in groups:
        if group and ".".join(group) in {topic, wanted}:
            return group
    there = listed(".".join(group) for group in groups if group)
    raise InputError(f"{path}: expected a {what} '{shown(topic)}', found {there}; correct 'topic'")


def _elements(
    sources: Mapping[Key, Source],
) -> Iterator[tuple[str, tuple[Source, tuple[int, ...]]]]:
    """Names of columns, the arrays they are in and where in a row they stand."""
    for key, source in sources.items():
        name = ".".join(key)
        if source.elements == 1:
            yield name, (source, (0,) * (len(source.shape) - 1))
            continue
        for index in product(*(range(n) for n in source.shape[1:])):
            yield name + "".join(f"[{i}]" for i in index), (source, index)


@dataclass(frozen=True, eq=False)
class _Columns:
    """Columns of arrays that may be larger than the memory."""

    path: Path
    columns: Mapping[str, tuple[Source, tuple[int, ...]]]

    def load(
        self, names: Sequence[str], part: RowRange | None, rows: int | None
    ) -> Mapping[str, Array]:
        """See :attr:`Log.load`."""
        wanted = list(dict.fromkeys([*names, *([part.column] if part else [])]))
        n = self._rows(wanted)
        packed = self.path.stat().st_size
        sources = {id(self.columns[name][0]): self.columns[name][0] for name in wanted}
        check_unpacked(
            self.path, sum(source.size for source in sources.values()) + 8 * n * len(wanted), packed
        )
        if part is None:
            return self._read(names, 0, n if rows is None else min(n, rows))
        by = self._read([part.column], 0, n)[part.column]
        inside = np.flatnonzero((by >= part.start) & (by <= part.end))[:rows]
        if not len(inside):
            return {name: np.empty(0) for name in names}
        first, last = int(inside[0]), int(inside[-1]) + 1
        return {
            name: values[inside - first] for name, values in self._read(names, first, last).items()
        }

    def _rows(self, names: Sequence[str]) -> int:
        """Rows of columns, which must all have as many."""
        lengths = {name: self.columns[name][0].shape[0] for name in names}
        if len(set(lengths.values())) > 1:
            found = ", ".join(f"'{shown(name)}' with {n}" for name, n in list(lengths.items())[:10])
            raise InputError(
                f"{self.path}: expected columns of one length, found {found} rows; name columns"
                " that belong together"
            )
        return next(iter(lengths.values()), 0)

    def _read(self, names: Sequence[str], start: int, stop: int) -> dict[str, Array]:
        """Rows from start to stop, array by array and piece by piece."""
        result = {name: np.empty(stop - start) for name in dict.fromkeys(names)}
        sources = {id(self.columns[name][0]): self.columns[name][0] for name in result}
        for key, source in sources.items():
            array = source.open()
            step = max(1, _PIECE // source.elements)
            for place in range(start, stop, step):
                piece: Any = np.asarray(array[place : min(place + step, stop)])
                for name, values in result.items():
                    if id(self.columns[name][0]) == key:
                        _, index = self.columns[name]
                        values[place - start : place - start + len(piece)] = _numbers(
                            piece[(slice(None), *index)]
                        )
        return result


def _numbers(values: NDArray[Any]) -> Array:
    """Values as float64: instants in seconds since 1970, durations in seconds, NaN where they are
    none, shape (n,).
    """
    if values.dtype.kind == "M":
        values = values - np.zeros((), values.dtype)
    if values.dtype.kind == "m":
        return np.asarray(values / np.timedelta64(1, "s"), dtype=np.float64)
    return values.astype(np.float64)
