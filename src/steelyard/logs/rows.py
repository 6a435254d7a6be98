"""Lines of a text file that are rows of its table."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError
from steelyard.logs.dialect import split

Lines = NDArray[np.int64]
"""Numbers of the lines that rows stand in, shape (n,)."""

_COMMENTS = (b"#", b"%", b"//")
_END = b"EOF"
"""What TwinCAT writes below the last row."""


@dataclass(frozen=True)
class RowForm:
    """What the rows of a table look like."""

    separator: bytes
    """Between cells."""
    width: int
    """Cells of a row."""
    most: int
    """Cells that a row may have: a header may announce a column that few rows have."""

    def are_regular(self, text: bytes) -> bool:
        """Whether all lines have as many cells as a row, if none is quoted."""
        row = self.separator * (self.width - 1) + b"\n"
        skeleton = text.translate(None, delete=bytes({*range(256)} - {*self.separator, *b"\n"}))
        return skeleton == row * (len(skeleton) // len(row))


def separated(text: bytes) -> bytes:
    """Lines of cells with any number of blanks between them, with single tabs instead."""
    if b'"' not in text:
        return b"\n".join(b"\t".join(line.split()) for line in text.split(b"\n"))
    lines = (split(line.decode("latin-1"), " ") for line in text.split(b"\n"))
    return b"\n".join("\t".join(cells).encode("latin-1") for cells in lines)


def unquoted(text: bytes, separator: bytes) -> bytes:
    """Lines without quotation marks, where these do nothing: around whole cells, without a separator in them; else as they are."""
    characters = np.frombuffer(text, dtype=np.uint8)
    marks = np.flatnonzero(characters == ord('"'))
    edge = (characters == ord(separator)) | (characters == ord("\n")) | (characters == ord("\r"))
    opening, closing = marks[: len(marks) // 2 * 2 : 2], marks[1::2]
    edges = np.cumsum(edge, dtype=np.int32)
    # The last character, which stands at -1 before the first, ends a line.
    idle = (
        len(marks) % 2 == 0
        and edge[opening - 1].all()
        and edge[closing + 1].all()
        and (edges[opening] == edges[closing]).all()
    )
    return text.replace(b'"', b"") if idle else text


def sound_rows(path: Path, text: bytes, line: int, form: RowForm) -> tuple[bytes, Lines]:
    """Lines that have cells: without empty ones, comments, and what ends the file.

    Args:
        path: Of the file, for messages.
        text: Lines below the header.
        line: Number of the first of them.
        form: Of the rows.

    Raises:
        InputError: A line has more cells than there are columns, less than those around it, or a single quotation mark.
    """
    nothing = b' \t\r"' + form.separator
    rows, lines, counts = [], [], []
    for number, row in enumerate(text.split(b"\n")[:-1], start=line):
        bare, cells = row.strip(nothing), _count(row, form.separator)
        if row.count(b'"') % 2:
            raise InputError(f"{path}:{number}: expected quotation marks in pairs, found one alone; remove it")
        comment = bare.startswith(_COMMENTS) and (cells != form.width or form.separator not in bare)
        if not bare or bare == _END or comment:
            continue
        if cells > form.most:
            raise InputError(
                f"{path}:{number}: expected {form.most} cells as in the header, found {cells}; correct the row (or a decimal comma)"
            )
        rows.append(row)
        lines.append(number)
        counts.append(cells)
    count = np.array([form.width, *counts, form.width])
    # Several rows in a row may leave empty cells at their end out; one alone has lost something.
    short = (count < form.width) & (count != np.roll(count, 1)) & (count != np.roll(count, -1))
    if short.any():
        i = int(np.flatnonzero(short)[0]) - 1
        raise InputError(
            f"{path}:{lines[i]}: expected {form.width} cells as in the rows around, found {counts[i]}; complete the row or remove it"
        )
    return b"".join(row + b"\n" for row in rows), np.array(lines, dtype=np.int64)


def _count(row: bytes, separator: bytes) -> int:
    if b'"' not in row:
        return 1 + row.count(separator)
    try:
        return len(next(csv.reader([row.decode("latin-1")], delimiter=separator.decode()), []))
    except csv.Error:
        return 1 + row.count(separator)
