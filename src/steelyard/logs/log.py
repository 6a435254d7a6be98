"""What every log is once it is open: named columns of numbers."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import InputError
from steelyard.logs.table import Table, table_of

MOST_COLUMNS = 10_000
"""Columns that a log may have."""
_LARGEST = 1e30
"""No reading in any unit is larger; beyond it squares overflow."""
_BLOCK = 1 << 14
"""Rows that are checked at once."""


class NoRowsError(InputError):
    """The part of a log that was asked for has no rows."""


@dataclass(frozen=True)
class RowRange:
    """Rows of a log whose value in one column lies within bounds; the rest need not pass through
    memory.
    """

    column: str
    """By which rows are chosen, in the log's own unit."""
    start: float
    end: float


@dataclass(frozen=True, eq=False)
class Log:
    """A table of one format, open for reading."""

    path: Path
    names: tuple[str, ...]
    """Of the columns; nested fields with dots, elements of arrays with brackets:
    ``linear_acceleration.x``, ``data[3]``."""
    load: Callable[[Sequence[str], RowRange | None, int | None], Mapping[str, Array]]
    """Columns of these names, of a part of the rows, of at most so many: shape (n,) each, NaN where
    there is no sample."""
    units: Mapping[str, str] = field(default_factory=dict)
    """Column -> unit, where the log itself states one."""
    spellings: Mapping[str, str] = field(default_factory=dict)
    """Name as the log writes it, with its unit -> name of the column."""
    line_of: Callable[[int, RowRange | None], int] | None = None
    """Line of a row of a part, in text files; None: rows have no lines."""

    def place(self, row: int, part: RowRange | None = None) -> str:
        """Where a row of a part (None: of all) stands, for messages."""
        if self.line_of is not None:
            return f"{self.path}:{self.line_of(row, part)}"
        return f"{self.path}" if part else f"{self.path}: row {row + 1}"

    def read(
        self, names: Sequence[str], part: RowRange | None = None, rows: int | None = None
    ) -> Table:
        """Read columns of numbers.

        Args:
            names: Columns to read; all must be there.
            part: Rows to read; None: all.
            rows: At most so many; None: all.

        Returns:
            Column -> values, NaN where there is no sample, shape (n,).

        Raises:
            InputError: There are no rows, a cell is no number that a sensor can read, or a column
                has not a single one.
        """
        for name in names:
            if self.names.count(name) > 1:
                raise InputError(
                    f"{self.path}: expected columns of different names, found '{name}' twice;"
                    " rename one, or name another column"
                )
        loaded = self.load(names, part, rows)
        table = loaded if isinstance(loaded, Table) else table_of(loaded)
        if table.cells.size == 0:
            if part:
                raise NoRowsError(
                    f"{self.path}: expected rows with '{part.column}' between {part.start:.9g} and"
                    f" {part.end:.9g}, found none; correct the window"
                )
            raise InputError(
                f"{self.path}: expected rows of numbers, found"
                f" none{' below the header' if self.line_of else ''}; check the recording"
            )
        self._check(table, part)
        return table

    def _check(self, table: Table, part: RowRange | None) -> None:
        """Refuse infinite and impossible numbers, and columns without a single one."""
        filled = np.zeros(len(table), dtype=bool)
        # A few rows at a time, without a copy of all of them.
        for first in range(0, len(table.cells), _BLOCK):
            block = table.cells[first : first + _BLOCK]
            if -_LARGEST <= block.min() <= block.max() <= _LARGEST:
                filled[:] = True
                continue
            largest = np.fmax(np.fmax.reduce(block), -np.fmin.reduce(block))
            filled |= ~np.isnan(largest)
            with np.errstate(invalid="ignore"):
                beyond = np.flatnonzero(largest > _LARGEST)
            if len(beyond):
                name, column = [*table][beyond[0]], block[:, beyond[0]]
                row = int(np.flatnonzero(np.abs(column) > _LARGEST)[0])
                sentence = (
                    "expected a finite number, found infinity"
                    if np.isinf(column[row])
                    else f"expected a number that a sensor can read, found {column[row]:g}"
                )
                raise InputError(
                    f"{self.place(first + row, part)}: column '{name}': {sentence}; correct it, or"
                    " leave the cell empty"
                )
        for name, has_one in zip(table, filled, strict=True):
            if not has_one:
                raise InputError(
                    f"{self.path}: column '{name}': expected numbers, found not a single one; leave"
                    " the instrument out or name another column"
                )
