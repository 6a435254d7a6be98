"""Parquet files."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from itertools import islice
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING

from steelyard.arrays import Array
from steelyard.errors import InputError
from steelyard.logs.frames import as_array
from steelyard.logs.log import MOST_COLUMNS, Log, RowRange
from steelyard.logs.packages import damaged
from steelyard.logs.size import check_unpacked

if TYPE_CHECKING:
    import polars as pl
    from polars.datatypes import DataType, DataTypeClass

    _Kind = DataType | DataTypeClass


_ONE_AT_A_TIME = Lock()
"""The standard error is one for all threads."""


@contextmanager
def opened(path: Path) -> Iterator[Log]:
    """Open a Parquet file; fields of structures and elements of arrays are columns of their own.

    Raises:
        InputError: It is damaged, or has too many columns.
    """
    import polars as pl

    with _one_sentence(path):
        table = pl.scan_parquet(_source(path), glob=False)
        schema = table.collect_schema()
        rows_there = table.select(pl.len()).collect().item()
    nested = (leaf for name, kind in schema.items() for leaf in _leaves(name, pl.col(name), kind))
    leaves = list(islice(nested, MOST_COLUMNS + 1))
    column = {name: (expression, kind) for name, expression, kind in leaves}

    def load(names: Sequence[str], part: RowRange | None, rows: int | None) -> Mapping[str, Array]:
        """See :attr:`Log.load`."""
        for name in names:
            kind = column[name][1]
            if not (kind.is_numeric() or kind.is_temporal()):
                raise InputError(
                    f"{path}: column '{name}': expected numbers, found {kind}; name another column"
                )
        # Of what is nested, all is unpacked for any of it.
        roots = {
            expression.meta.root_names()[0] for expression, _ in (column[name] for name in names)
        }
        unpacked = sum(expression.meta.root_names()[0] in roots for _, expression, _ in leaves)
        check_unpacked(path, 8 * rows_there * unpacked, path.stat().st_size)
        chosen = table
        if part is not None:
            chosen = table.filter(
                _in_seconds(*column[part.column]).is_between(part.start, part.end)
            )
        chosen = chosen.select(column[name][0].alias(name) for name in dict.fromkeys(names))
        with _one_sentence(path):
            frame = (chosen if rows is None else chosen.head(rows)).collect(
                engine="streaming" if part else "auto"
            )
        # One at a time: a column may be copied.
        return {name: as_array(frame.drop_in_place(name)) for name in frame.columns}

    yield Log(path, tuple(name for name, _, _ in leaves), load)


def _leaves(name: str, column: pl.Expr, kind: _Kind) -> Iterator[tuple[str, pl.Expr, _Kind]]:
    """What is nested in a column: names with dots and brackets, how to get there, and what it
    is.
    """
    import polars as pl

    if isinstance(kind, pl.Struct):
        for inner in kind.fields:
            yield from _leaves(f"{name}.{inner.name}", column.struct.field(inner.name), inner.dtype)
    elif isinstance(kind, pl.Array):
        for i in range(kind.size):
            yield from _leaves(f"{name}[{i}]", column.arr.get(i), kind.inner)
    else:
        yield name, column, kind


def _in_seconds(column: pl.Expr, kind: _Kind) -> pl.Expr:
    """A column as :func:`as_array` gives it."""
    import polars as pl

    if not kind.is_temporal():
        return column
    return column.map_batches(
        lambda values: pl.Series(as_array(values)), return_dtype=pl.Float64(), is_elementwise=True
    )


@contextmanager
def _one_sentence(path: Path) -> Iterator[None]:
    import polars as pl

    try:
        with unheard_panics():
            yield
    except (pl.exceptions.PolarsError, OSError) as error:
        raise damaged(path, "a Parquet file", error, "something else") from None


@contextmanager
def unheard_panics() -> Iterator[None]:
    """Where Polars trips over a damaged file it says so on the standard error by itself, in many
    lines, and raises what is no :class:`Exception`: within the block an error of Polars like any
    other, and nothing said.
    """
    import polars as pl

    with _ONE_AT_A_TIME, ExitStack() as after:
        with suppress(OSError):  # there may be no standard error
            before = os.dup(2)
            after.callback(os.close, before)
            nowhere = os.open(os.devnull, os.O_WRONLY)
            after.callback(os.close, nowhere)
            os.dup2(nowhere, 2)
            after.callback(os.dup2, before, 2)
        try:
            yield
        except pl.exceptions.PanicException as error:
            raise pl.exceptions.ComputeError(str(error)) from None


def _source(path: Path) -> Path | bytes:
    """A path as Polars takes it: one whose bytes are no text has to be read for it."""
    try:
        str(path).encode()
    except UnicodeEncodeError:
        return path.read_bytes()
    return path
