"""Lines of a text file that are rows of its table."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError
from steelyard.logs.text.dialect import split

Lines = NDArray[np.int64]
"""Numbers of the lines that rows stand in, shape (n,)."""

_END = b"EOF"
"""What TwinCAT writes below the last row."""
_FEWEST_SHORT = 3
"""Rows with too few cells, one after the other, from which on a channel has ended; fewer are
damage."""
_NOTHING = b' \t\r\n"'
_IS_NOTHING = np.isin(np.arange(256), list(_NOTHING))


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
    """Lines without quotation marks, where these do nothing: around whole cells, without a
    separator in them; else as they are.
    """
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


class ShortRows:
    """Keeps watch over rows with less cells than there are columns, from piece to piece.

    Spreadsheets leave out empty cells at the end of many rows in a row, and so does TwinCAT where a
    channel has ended. One row alone, or the two halves of one, have lost something.
    """

    def __init__(self, path: Path, width: int) -> None:
        self.path, self.width = path, width
        self.cells, self.rows, self.line = width, 0, 0

    def watch(self, cells: Lines, lines: Lines) -> None:
        """See the rows that come next.

        Args:
            cells: Of each row.
            lines: That they stand in.

        Raises:
            InputError: A row has lost something.
        """
        changes = [0, *(np.flatnonzero(np.diff(cells)) + 1), len(cells)]
        for start, end in pairwise(changes):
            if start < end and cells[start] != self.cells:
                self.end()
                self.cells, self.rows, self.line = int(cells[start]), 0, int(lines[start])
            self.rows += end - start

    def end(self) -> None:
        """See that no other row like the last ones comes.

        Raises:
            InputError: They have lost something.
        """
        if self.cells < self.width and self.rows < _FEWEST_SHORT:
            raise InputError(
                f"{self.path}:{self.line}: expected {self.width} cells as in other rows, found"
                f" {self.cells}; complete the row or remove it"
            )


def sound_rows(path: Path, text: bytes, line: int, form: RowForm) -> tuple[bytes, Lines, Lines]:
    """Lines that have cells: without empty ones, comments, and what ends the file.

    Args:
        path: Of the file, for messages.
        text: Lines below the header.
        line: Number of the first of them.
        form: Of the rows.

    Returns:
        The rows, the lines that they stand in, and how many cells each has.

    Raises:
        InputError: A line has more cells than there are columns, or a single quotation mark.
    """
    if not text.strip(_NOTHING + form.separator):
        return b"", *(np.zeros(0, dtype=np.int64),) * 2
    characters = np.frombuffer(text, dtype=np.uint8)
    ends = np.flatnonzero(characters == ord("\n"))
    starts = np.concatenate([[0], ends + 1])[:-1]
    marks = _count(characters == ord('"'), starts)
    for i in np.flatnonzero(marks % 2)[:1]:
        raise InputError(
            f"{path}:{line + i}: expected quotation marks in pairs, found one alone; remove it"
        )
    cells = 1 + _count(characters == ord(form.separator), starts)
    for i in np.flatnonzero(marks):
        cells[i] = _cells_of(text[starts[i] : ends[i]].decode("latin-1"), form.separator.decode())
    kept = _are_written(characters, starts, ends, cells, form)
    for i in np.flatnonzero(kept & (cells > form.most))[:1]:
        raise InputError(
            f"{path}:{line + i}: expected {form.most} cells as in the header, found {cells[i]};"
            " correct the row (or a decimal comma)"
        )
    lines = np.flatnonzero(kept)
    return characters[np.repeat(kept, ends + 1 - starts)].tobytes(), line + lines, cells[lines]


def _are_written(
    characters: NDArray[np.uint8], starts: Lines, ends: Lines, cells: Lines, form: RowForm
) -> NDArray[np.bool_]:
    """Which lines have anything in their cells, and are no comments."""
    written = np.flatnonzero(~_IS_NOTHING[characters] & (characters != ord(form.separator)))
    first, behind = np.searchsorted(written, starts), np.searchsorted(written, ends)
    filled = behind > first
    written = np.append(written, 0)
    first, last = written[first], written[behind - 1]
    # No comment are rows like "#N/A,1,2".
    separators = np.cumsum(characters == ord(form.separator), dtype=np.int32)
    outside = (cells != form.width) | (separators[first] == separators[last])
    signs = [np.append(characters, [0, 0])[first + k] for k in range(3)]
    comment = (
        (signs[0] == ord("#"))
        | (signs[0] == ord("%"))
        | ((signs[0] == ord("/")) & (signs[1] == ord("/")))
    )
    end = (last - first == len(_END) - 1) & np.all([signs[k] == _END[k] for k in range(3)], axis=0)
    return np.asarray(filled & ~(outside & comment) & ~end)


def _count(mask: NDArray[np.bool_], starts: Lines) -> Lines:
    """How often something holds in each line."""
    return np.add.reduceat(mask, starts, dtype=np.int64) if len(starts) else starts


def _cells_of(row: str, separator: str) -> int:
    try:
        return len(next(csv.reader([row], delimiter=separator), []))
    except csv.Error:
        return 1 + row.count(separator)
