"""Tables in text files as exporters write them: CSV and its relatives."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeVar

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import InputError
from steelyard.logs.frames import as_array
from steelyard.logs.log import MOST_COLUMNS, Log, RowRange
from steelyard.logs.size import check_unpacked
from steelyard.logs.table import Table
from steelyard.logs.text.cells import MISSING, as_instants, as_numbers, stripped
from steelyard.logs.text.dialect import dialect_of
from steelyard.logs.text.header import header_of
from steelyard.logs.text.plain import pieces, readable
from steelyard.logs.text.rows import Lines, RowForm, ShortRows, separated, sound_rows, unquoted

if TYPE_CHECKING:
    import polars as pl

_Way = Literal["numbers", "missing", "text"]
"""How to parse cells: as numbers, as those or one of :data:`MISSING`, or not yet."""
_Item = TypeVar("_Item")
_RATIO = 25
"""Bytes of numbers that a byte of a packed file may become: a short one is four of text, and text
packs to a tenth."""


@contextmanager
def opened(path: Path) -> Iterator[Log]:
    """Open a table in a text file, plain or packed by gzip.

    Raises:
        InputError: It is no text with a table.
    """
    table = _TextTable(path)
    yield Log(
        path, table.names, table.load, table.header.units, table.header.spellings, table.line_of
    )


class _TextTable:
    """The rows of a text file below its header."""

    def __init__(self, path: Path) -> None:
        """Find out from the beginning of the file how it writes its table."""
        self.path = path
        with readable(path):
            self.size = path.stat().st_size
        lines = _first_lines(path)
        self.dialect = dialect_of(lines)
        if self.dialect.width > MOST_COLUMNS:
            raise InputError(
                f"{path}: expected at most {MOST_COLUMNS} columns, found {self.dialect.width};"
                " check that rows are instants"
            )
        self.header = header_of(path, lines, self.dialect)
        self.names = self.header.names
        width = self.dialect.width or len(self.names)
        separator = "\t" if self.dialect.separator == " " else self.dialect.separator
        self.form = RowForm(separator.encode(), width, max(width, len(self.names)))
        # Names for Polars: those of the file may be quoted, padded, empty or there twice.
        self.places = [f"c{j}" for j in range(self.form.most)]

    def load(self, names: Sequence[str], part: RowRange | None, rows: int | None) -> Table:
        """See :attr:`Log.load`."""
        names = list(dict.fromkeys(names))
        wanted = list(
            dict.fromkeys([*names, *(self.header.clocks.get(name, name) for name in names)])
        )
        cells, n = np.empty((0, len(names))), 0
        for found, lines, share in _ahead(self._tables(wanted, part)):
            self._check_clocks(names, Table(wanted, found), lines)
            end = n + len(lines)
            check_unpacked(self.path, 8 * end * len(names), self.size, ratio=_RATIO)
            if end > len(cells):
                rows_ahead = self._room(end, share if part is None else 1.0, len(names))
                room = np.empty((rows_ahead, len(names)))
                room[:n] = cells[:n]
                cells = room
            cells[n:end] = found[:, : len(names)]
            n = end
            if rows is not None and n >= rows:
                n = rows
                break
        return Table(names, cells[:n])

    def _room(self, rows: int, share: float, columns: int) -> int:
        """Rows to make room for when some part of the file has so many; what is never written to
        takes no memory.
        """
        most = _RATIO * self.size // (8 * columns)
        return max(min(int(1.05 * rows / share), most), 3 * rows // 2)

    def line_of(self, row: int, part: RowRange | None) -> int:
        """See :attr:`Log.line_of`."""
        for _, lines, _ in self._tables([], part):
            if row < len(lines):
                return int(lines[row])
            row -= len(lines)
        raise InputError(f"{self.path}: expected the file as it was, found it changed; start again")

    def _tables(
        self, names: Sequence[str], part: RowRange | None
    ) -> Iterator[tuple[Array, Lines, float]]:
        """Columns of the rows of a part, shape (n, k), piece by piece, with their lines and how
        much of the file has been read.
        """
        line, short = 1, ShortRows(self.path, self.form.width)
        for piece, share in pieces(self.path):
            start = 0
            while line <= self.header.first and start < len(piece):
                start = piece.find(b"\n", start) + 1
                line += 1
            text = piece[start:]
            if self.dialect.separator == " ":
                text = separated(text)
            if b'"' in text:
                text = unquoted(text, self.form.separator)
            height = int(np.count_nonzero(np.frombuffer(text, dtype=np.uint8) == ord("\n")))
            found, lines = self._columns(
                text, line, height, names if part is None else [part.column], short
            )
            if part is not None:
                inside = (found[:, 0] >= part.start) & (found[:, 0] <= part.end)
                lines = lines[inside]
                found = (
                    self._columns(text, line, height, names)[0][inside] if len(lines) else found[:0]
                )
            line += height
            if len(lines):
                yield found, lines, share
        short.end()

    def _columns(
        self,
        text: bytes,
        line: int,
        height: int,
        names: Sequence[str],
        short: ShortRows | None = None,
    ) -> tuple[Array, Lines]:
        """Columns as numbers, NaN where there is no sample, shape (n, k), and the lines of their
        rows.

        Args:
            text: Lines below the header.
            line: Number of the first of them.
            height: How many there are.
            names: Of the columns.
            short: What keeps watch over the rows; None: it has seen them.

        Raises:
            InputError: A cell is no number, or a row has not as many as there are columns.
        """
        places = [self.names.index(name) for name in names]
        lines, frame = np.arange(line, line + height), None
        # Rows have a character for each cell at least; lines that have less are empty, as millions
        # of them may be.
        if places and height * self.form.width <= len(text) and b'"' not in text:
            frame = self._parsed(text, places, "numbers", "missing")
        if frame is None or not self._is_regular(text, frame) or _has_empty_row(frame):
            text, lines, cells = sound_rows(self.path, text, line, self.form)
            if short:
                short.watch(cells, lines)
            frame = self._parsed(text, places, "missing", "text")
        elif short:
            short.watch(np.array([self.form.width]), lines)
        if not places:
            return np.empty((len(lines), 0)), lines
        if frame is None or frame.height != len(lines):
            raise InputError(
                f"{self.path}: expected a table from line {line} on, found cells that cannot be"
                " separated; check the quotation marks"
            )
        if all(kind.is_numeric() for kind in frame.dtypes):
            return frame.to_numpy(order="c"), lines
        named = zip(names, frame.iter_columns(), strict=True)
        columns = [self._numbers(name, column, lines) for name, column in named]
        return np.column_stack(columns), lines

    def _is_regular(self, text: bytes, frame: pl.DataFrame) -> bool:
        """Whether every line has as many cells as there are columns, as in nearly all files."""
        if (
            frame.width == len(self.places) == self.form.width
            and not frame[self.places[-1]].null_count()
        ):
            # Polars sees cells that are too many, if only behind the last column that it reads.
            return True
        return self.form.are_regular(text)

    def _parsed(self, text: bytes, places: Collection[int], *ways: _Way) -> pl.DataFrame | None:
        """Columns of these places, in the first way that succeeds; None: none does."""
        import polars as pl

        # Polars takes points beside decimal commas, too; what they stand for has to be looked at.
        doubtful = self.dialect.decimal == "," and (self.form.separator == b"," or b"." in text)
        for way in ways:
            as_text = way == "text" or doubtful
            header = self.form.separator.join(place.encode() for place in self.places)
            kinds = {
                self.places[j]: pl.Float64()
                for j in places
                if not as_text and not self.dialect.is_dated(j)
            }
            body = text.replace(b",", b".") if self.dialect.decimal == "," and not as_text else text
            with suppress(pl.exceptions.PolarsError):
                frame = pl.read_csv(
                    b"".join((header, b"\n", body)),
                    columns=[self.places[j] for j in places],
                    schema={place: kinds.get(place, pl.String()) for place in self.places},
                    separator=self.form.separator.decode(),
                    quote_char='"' if b'"' in text else None,
                    null_values=None if way == "numbers" else MISSING,
                    encoding="utf8-lossy",
                )
                return frame.select([self.places[j] for j in places])
        return None

    def _numbers(self, name: str, column: pl.Series, lines: Lines) -> Array:
        """A column as numbers, whether it has been parsed as such or as text."""
        if column.dtype.is_numeric():
            return as_array(column)
        dated, cells = self.dialect.is_dated(self.names.index(name)), stripped(column)
        values = as_instants(cells) if dated else as_numbers(cells, self.dialect.decimal or ".")
        if values.null_count() > cells.null_count() and self.dialect.decimal is None and not dated:
            values = as_numbers(cells, ",")
        wrong = (cells.is_not_null() & values.is_null()).arg_true()
        if len(wrong):
            expected = "an instant such as 2024-01-31 12:00:00.5" if dated else "a number"
            raise InputError(
                f"{self.path}:{lines[wrong[0]]}: column '{name}': expected {expected}, found"
                f" '{column[wrong[0]][:40]}'; correct the cell or leave it empty"
            )
        return as_array(values)

    def _check_clocks(self, names: Sequence[str], found: Table, lines: Lines) -> None:
        """See that the times of columns are those that they are read with.

        Raises:
            InputError: A column has other times of its own.
        """
        clocks = self.header.clocks
        time = next((name for name in names if name in clocks.values()), None)
        for name in names:
            if time is None or name not in clocks:
                continue
            times, own = found[time], found[clocks[name]]
            differing = np.flatnonzero((own != times) & ~(np.isnan(own) & np.isnan(times)))
            if len(differing):
                i = int(differing[0])
                raise InputError(
                    f"{self.path}:{lines[i]}: column '{name}': expected a sample at the time"
                    f" {times[i]:.9g} of column '{time}', found one at {own[i]:.9g}; read it as a"
                    f" stream of its own with the column '{clocks[name]}' as t, or export all at"
                    " the same times"
                )


def _first_lines(path: Path) -> list[str]:
    """Lines at the beginning of a text file, without their ends."""
    text = next(pieces(path), (b"", 1.0))[0].removesuffix(b"\n")
    try:
        decoded = text.decode()
    except UnicodeDecodeError:
        decoded = text.decode("latin-1")
    return [line.rstrip("\r") for line in decoded.split("\n")]


def _ahead(items: Iterator[_Item]) -> Iterator[_Item]:
    """Items of an iterator, each made in another thread while the one before it is used."""
    with ThreadPoolExecutor(1) as pool:
        coming = pool.submit(next, items, None)
        while (item := coming.result()) is not None:
            coming = pool.submit(next, items, None)
            yield item


def _has_empty_row(frame: pl.DataFrame) -> bool:
    import polars as pl

    return min(frame.null_count().row(0)) > 0 and bool(
        frame.select(pl.all_horizontal(pl.all().is_null()).any()).item()
    )
