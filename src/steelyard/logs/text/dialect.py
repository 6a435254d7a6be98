"""How a text file writes its table: what separates cells, the decimal sign, where the rows begin.

Nothing is declared in such files. Numbers show where the table begins;
:mod:`steelyard.logs.header` reads what stands above it.
"""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from steelyard.logs.text.cells import Decimal, is_instant, is_missing, is_number

SEPARATORS = (",", ";", "\t", "|", " ")
_DECLARED = re.compile(r"sep=([^\w\s\"]|\t)\s*", re.IGNORECASE | re.ASCII)
"""First line for spreadsheet programs."""
_FEW, _MANY = 200, 2_000
"""Lines that are looked at; no header is longer than the latter."""
_CHARACTERS = 1 << 19
"""That are looked at, where few lines have many of them."""
_SHOWN = 20
"""Rows that a dialect keeps, from which a header is judged."""


@dataclass(frozen=True)
class Dialect:
    """How a text file writes its table."""

    separator: str = ","
    """A blank stands for any number of blanks and tabs."""
    decimal: Decimal | None = "."
    """None: the first rows leave it open."""
    blank: int = 0
    """Empty lines at the beginning."""
    first: int = 0
    """Lines above the first row that is sound."""
    width: int = 0
    """Cells of a row, empty ones counted; 0: there are no rows of numbers."""
    rows: tuple[tuple[str, ...], ...] = ()
    """Cells of some rows."""
    score: int = 0
    """Cells that are numbers rather than text."""

    def cells(self, line: str) -> list[str]:
        """Cells of a line without blanks and quotation marks around them."""
        return split(line, self.separator)

    def is_value(self, cell: str) -> bool:
        """Whether a cell holds a number or an instant."""
        return _is_value(cell, self.decimal or ".")

    def is_dated(self, column: int) -> bool:
        """Whether a column holds instants."""
        cells = [
            row[column] for row in self.rows if column < len(row) and not is_missing(row[column])
        ]
        return bool(cells) and all(map(is_instant, cells))


def dialect_of(lines: Sequence[str]) -> Dialect:
    """Tell the dialect from the beginning of a text.

    Args:
        lines: As many as there are; the first hundreds are looked at, more only if there are no
            rows among them.
    """
    declared = _DECLARED.fullmatch(lines[0]) if lines else None
    separators = (declared[1],) if declared else SEPARATORS
    best = Dialect()
    blank = next((i for i, line in enumerate(lines) if line.strip()), len(lines))
    written = lines[blank : blank + _MANY]
    length = sum(map(len, written[:_FEW])) // _FEW + 1
    for most in (max(_SHOWN, min(_FEW, _CHARACTERS // length)), _MANY):
        found = [_reading(written[:most], separator) for separator in separators]
        best = max(found, key=lambda dialect: dialect.score)
        if best.width or len(written) <= most:
            break
    if not best.width and written:
        # What the first line, which must be the header, is separated by.
        return Dialect(max(separators, key=written[0].count), blank=blank, first=blank + 1)
    return replace(best, blank=blank, first=blank + best.first)


def split(line: str, separator: str) -> list[str]:
    """Cells of a line without blanks and quotation marks around them."""
    if separator == " " and '"' not in line:
        return line.split()
    if '"' not in line:
        return [cell.strip() for cell in line.split(separator)]
    whole = " ".join(line.split()) if separator == " " else line
    try:
        cells = next(csv.reader([whole], delimiter=separator, skipinitialspace=True), [])
    except csv.Error:
        cells = line.split(separator)
    return [cell.strip().strip('"').strip() for cell in cells]


def _reading(lines: Sequence[str], separator: str) -> Dialect:
    """The rows of numbers that there are, if cells are separated in one way."""
    rows = [split(line, separator) for line in lines]
    point = _rows_of(rows, separator, ".")
    if separator == "," and not any('"' in line for line in lines):
        return point
    comma = _rows_of(rows, separator, ",")
    if point.score == comma.score:
        return replace(point, decimal="." if separator == "," else None)
    return max(point, comma, key=lambda dialect: dialect.score)


def _rows_of(rows: Sequence[Sequence[str]], separator: str, decimal: Decimal) -> Dialect:
    """The dialect that rows have with a separator and a decimal mark, scored by how many cells are
    values.
    """
    value = [[_is_value(cell, decimal) for cell in row] for row in rows]
    text = [
        [not v and not is_missing(cell) for v, cell in zip(value[i], row, strict=True)]
        for i, row in enumerate(rows)
    ]
    likely = [i for i in range(len(rows)) if sum(value[i]) and sum(value[i]) >= sum(text[i])]
    if not likely:
        return Dialect(separator, decimal)
    last = _last_run(likely, lambda i: not any(rows[i]))
    counts = Counter(len(rows[i]) for i in last)
    width = max(counts, key=lambda w: (counts[w] * w, w))
    likely = [i for i in likely if len(rows[i]) == width]
    body = _last_run(likely, lambda _: False)
    # Where the last rows have numbers or nothing, the first row that is sound has no text.
    worded = [2 * sum(text[i][j] for i in body) > len(body) for j in range(width)]
    first = next(
        (i for i in likely if not any(t and not worded[j] for j, t in enumerate(text[i]))), body[0]
    )
    score = sum(sum(value[i]) - sum(text[i]) for i in likely if i >= first)
    shown = tuple(tuple(rows[i]) for i in body[:_SHOWN])
    return Dialect(separator, decimal, 0, first, width, shown, max(score, 0))


def _last_run(lines: Sequence[int], between: Callable[[int], bool]) -> list[int]:
    """The last of some lines that follow each other, with no others than some kind of lines between
    them.
    """
    start = len(lines) - 1
    while start and all(between(i) for i in range(lines[start - 1] + 1, lines[start])):
        start -= 1
    return list(lines[start:])


def _is_value(cell: str, decimal: Decimal) -> bool:
    return is_number(cell, decimal) or is_instant(cell)
