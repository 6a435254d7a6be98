"""Logs as tables of numbers: one reader per format, one table of formats."""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import InputError
from steelyard.yaml_file import require_file

if TYPE_CHECKING:
    import polars as pl

MISSING = ["", "NaN", "nan", "NAN", "null"]
"""Texts of a cell that stand for no sample."""


_LARGEST = 1e30
"""No reading in any unit is larger; beyond it squares overflow."""


def read_columns(path: Path, names: Sequence[str]) -> dict[str, Array]:
    """Read columns of numbers.

    Args:
        path: Log file; its ending tells the format.
        names: Columns to read; all must be there.

    Returns:
        Column -> values, NaN where there is no sample, shape (n,).

    Raises:
        InputError: The file is not there or not in its format, or a cell is no number.
    """
    frame = _reader(path)[1](path, list(names))
    if frame.height == 0:
        raise InputError(f"{path}: expected rows of numbers, found none below the header; check the recording")
    columns = {name: frame[name].to_numpy().astype(np.float64) for name in names}
    for name, values in columns.items():
        infinite = np.flatnonzero(np.abs(values) > _LARGEST)
        if len(infinite):
            found = values[infinite[0]]
            sentence = (
                "expected a finite number, found infinity"
                if np.isinf(found)
                else f"expected a number that a sensor can read, found {found:g}"
            )
            raise InputError(
                f"{path}:{infinite[0] + 2}: column '{name}': {sentence}; correct it, or leave the cell empty"
            )
        if np.isnan(values).all():
            raise InputError(
                f"{path}: column '{name}': expected numbers, found not a single one; leave the instrument out or name another column"
            )
    return columns


def read_names(path: Path) -> list[str]:
    """Names of the columns of a log."""
    require_file(path, "log")
    return _reader(path)[0](path)


def _csv_header(path: Path) -> list[str]:
    """Names in the first line."""
    # Bounded: the header of a log is never longer, and the file may be anything.
    with path.open("r", encoding="utf-8-sig", errors="replace", newline="") as file:
        header = file.readline(1 << 20).rstrip("\r\n")
    try:
        return next(csv.reader([header], skipinitialspace=True), []) if header.strip() else []
    except csv.Error:
        return header.split(",")


def _clean(name: str) -> str:
    return name.strip().strip('"').strip()


def _csv_names(path: Path) -> list[str]:
    return [_clean(name) for name in _csv_header(path)]


def _read_csv(path: Path, names: list[str]) -> pl.DataFrame:
    import polars as pl

    header = [_clean(raw) for raw in _csv_header(path)]
    for name in names:
        if header.count(name) > 1:
            raise InputError(f"{path}:1: expected columns of different names, found '{name}' twice; rename one")
    place: dict[str, str] = dict(zip(names, names, strict=True))
    try:
        # By place, not by name: names may be quoted or padded in ways of their own, and Polars has its own way with them.
        raw = pl.read_csv(_source(path), n_rows=0, infer_schema=False, encoding="utf8-lossy", glob=False).columns
        if len(raw) != len(header):
            raise InputError(
                f"{path}:1: expected a header of names between commas, found one that cannot be read; correct it"
            )
        place = {raw[header.index(name)]: name for name in names}
        frame = pl.read_csv(
            _source(path),
            columns=list(place),
            schema_overrides=dict.fromkeys(place, pl.Float64),
            null_values=MISSING,
            encoding="utf8-lossy",
            glob=False,
        )
    except pl.exceptions.PolarsError:
        frame = _read_csv_slowly(path, place)
    if _has_quotes(path):
        # A quotation mark that is not closed makes one cell of many rows, without any complaint.
        _check_rows(path)
    # Empty lines at the end are no rows.
    filled = (~frame.select(pl.all_horizontal(pl.all().is_null())).to_series()).arg_true()
    return frame.head(filled[-1] + 1 if len(filled) else 0).rename(place)


def _read_csv_slowly(path: Path, place: Mapping[str, str]) -> pl.DataFrame:
    """Read cells as text, to accept blanks around numbers and to name the cell that is none."""
    import polars as pl

    _check_rows(path)
    try:
        text = pl.read_csv(
            _source(path),
            columns=list(place),
            infer_schema=False,
            null_values=MISSING,
            encoding="utf8-lossy",
            glob=False,
        )
    except pl.exceptions.PolarsError as error:
        reason = str(error).splitlines()[0].rstrip(".")
        raise InputError(
            f"{path}: expected a CSV table with a header, found something else ({reason}); check the file"
        ) from None
    stripped = text.select(pl.all().str.strip_chars().str.strip_chars('"').str.strip_chars())
    stripped = stripped.select(pl.when(pl.all().is_in(MISSING)).then(None).otherwise(pl.all()).name.keep())
    numbers = stripped.select(pl.all().cast(pl.Float64, strict=False))
    for column, name in place.items():
        wrong = (stripped[column].is_not_null() & numbers[column].is_null()).arg_true()
        if len(wrong):
            row = wrong[0]
            raise InputError(
                f"{path}:{row + 2}: column '{name}': expected a number, found '{text[column][row][:40]}'; correct the cell "
                "or leave it empty"
            )
    return numbers


def _source(path: Path) -> Path | bytes:
    """A path as Polars takes it: one whose bytes are no text has to be read for it."""
    try:
        str(path).encode()
    except UnicodeEncodeError:
        return path.read_bytes()
    return path


def _has_quotes(path: Path) -> bool:
    with path.open("rb") as file:
        return any(b'"' in block for block in iter(lambda: file.read(1 << 20), b""))


def _check_rows(path: Path) -> None:
    """Name the first row of a table whose cells do not match its header.

    Raises:
        InputError: A row is longer than the header, or quotation marks run over its end.
    """
    wanted = len(_csv_header(path))
    with path.open("r", encoding="utf-8", errors="replace", newline="") as file:
        for number, line in enumerate(file, start=1):
            if line.count('"') % 2:
                raise InputError(f"{path}:{number}: expected quotation marks in pairs, found one alone; remove it")
            cells = 1 + line.count(",") if '"' not in line else 1
            if cells > wanted:
                raise InputError(
                    f"{path}:{number}: expected {wanted} cells as in the header, found {cells}; correct the row (or a decimal comma)"
                )


def _parquet_names(path: Path) -> list[str]:
    import polars as pl

    try:
        return pl.scan_parquet(_source(path), glob=False).collect_schema().names()
    except pl.exceptions.PolarsError as error:
        raise InputError(f"{path}: expected a Parquet file, found something else ({error}); check the file") from None


def _read_parquet(path: Path, names: list[str]) -> pl.DataFrame:
    import polars as pl

    try:
        frame = pl.read_parquet(_source(path), columns=names, glob=False)
    except (pl.exceptions.PolarsError, OSError) as error:
        raise InputError(f"{path}: expected a Parquet file, found something else ({error}); copy it again") from None
    for name, kind in frame.schema.items():
        if not kind.is_numeric():
            raise InputError(f"{path}: column '{name}': expected numbers, found {kind}; name another column")
    return frame


Reader = tuple[Callable[[Path], list[str]], Callable[[Path, list[str]], "pl.DataFrame"]]

FORMATS: dict[str, Reader] = {
    ".csv": (_csv_names, _read_csv),
    ".txt": (_csv_names, _read_csv),
    ".parquet": (_parquet_names, _read_parquet),
}
"""Ending -> how to read the names of its columns, and some of its columns."""


def _reader(path: Path) -> Reader:
    reader = FORMATS.get(path.suffix.lower())
    if reader is None:
        raise InputError(
            f"{path}: expected a log in one of the formats {', '.join(FORMATS)}, found '{path.suffix}'; convert it to CSV"
        )
    return reader
