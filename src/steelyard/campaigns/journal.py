"""Rows on disk as they come: one line each, so that what was done survives whatever ends the
campaign; and one campaign in a folder at a time.
"""

from __future__ import annotations

import fcntl
import json
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

from steelyard.campaigns.rows import TABLE, frame, merged, read_table, write_rows
from steelyard.campaigns.tasks import Row
from steelyard.errors import InputError

if TYPE_CHECKING:
    import polars as pl

JOURNAL = "campaign.rows.jsonl"
"""Rows that are not in the table yet."""
LOCK = ".steelyard-campaign.lock"
"""Held while a campaign writes; stays."""
_AT_ONCE = 1000
"""Lines that become a table at a time: a line of JSON takes more memory than its row."""


@contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """Nobody else's campaign writes into a folder within the block.

    Raises:
        InputError: Another one does.
    """
    # The lock goes with its process, however that ends.
    with (folder / LOCK).open("w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise InputError(
                f"{folder}: expected a folder that no other campaign writes to, found one at work"
                " there; wait for its end, or choose another with --out"
            ) from error
        yield


class Journal:
    """Rows that grow line by line."""

    def __init__(self, folder: Path) -> None:
        """Of a folder that is there; rows of a campaign that was killed are kept."""
        self.folder = folder
        self._file = (folder / JOURNAL).open("ab")
        self._waiting: list[bytes] = []
        self._end_of_line()

    def _end_of_line(self) -> None:
        """Cut off the part of a line that a killed process, or a full disk, has left."""
        path = self.folder / JOURNAL
        with path.open("rb+") as file:
            size = file.seek(0, os.SEEK_END)
            back = 0
            while size - back > 0:
                step = min(1 << 16, size - back)
                file.seek(size - back - step)
                newline = file.read(step).rfind(b"\n")
                if newline >= 0:
                    file.truncate(size - back - step + newline + 1)
                    return
                back += step
            file.truncate(0)

    def add(self, rows: Sequence[Row]) -> None:
        """Write rows; where the disk is full they wait for the next ones."""
        self._waiting += [
            json.dumps(row, allow_nan=False, ensure_ascii=True).encode() + b"\n" for row in rows
        ]
        with suppress(OSError):
            self._write()

    def _write(self) -> None:
        """Write what waits, line by line; what the disk had room for of a line is cut off again."""
        while self._waiting:
            try:
                self._file.write(self._waiting[0])
                self._file.flush()
            except OSError:
                self._file.close()
                self._end_of_line()
                self._file = (self.folder / JOURNAL).open("ab")
                raise
            del self._waiting[0]

    def close(self) -> None:
        """Leave the rows for another time."""
        self._file.close()

    def join(self) -> pl.DataFrame:
        """Merge all rows into the table, which appears whole or not at all; the journal is empty
        then.

        Raises:
            OSError: The disk is full; the table that was there stays.
        """
        self._write()
        self.close()
        table = joined(self.folder)
        write_rows(table, self.folder / TABLE)
        (self.folder / JOURNAL).unlink()
        return table


def joined(folder: Path) -> pl.DataFrame:
    """All rows of a campaign: those of its table and those that are not there yet."""
    import polars as pl

    table = read_table(folder / TABLE)
    path = folder / JOURNAL
    if not path.is_file():
        return table
    parts = []
    with path.open("rb") as file:
        while lines := list(islice(file, _AT_ONCE)):
            whole = [line for line in lines if line.endswith(b"\n")]
            parts.append(_frame(whole, path))
    return merged(table, pl.concat(parts)) if parts else table


def _frame(lines: Sequence[bytes], path: Path) -> pl.DataFrame:
    """Rows of the journal as a table.

    Raises:
        InputError: A line is none.
    """
    import polars as pl

    try:
        rows = [json.loads(line) for line in lines]
        if not all(isinstance(row, dict) for row in rows):
            raise ValueError
        table = frame(rows)
    # Values of other kinds, numbers that are too large, lists that are too deep.
    except (ValueError, TypeError, OverflowError, RecursionError, pl.exceptions.PolarsError):
        table = None
    if table is None or table.select("experiment", "method").null_count().sum_horizontal()[0]:
        raise InputError(
            f"{path}: expected a row of a campaign in each line, found one that is none; remove"
            " that line"
        )
    return table
