"""Logs as tables of numbers: one reader per format, one table of formats."""

from __future__ import annotations

from collections.abc import Callable, Sequence
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
        infinite = np.flatnonzero(np.isinf(values))
        if len(infinite):
            raise InputError(
                f"{path}:{infinite[0] + 2}: column '{name}': expected a finite number, found infinity; correct it"
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
    """Names in the first line as they stand there."""
    # Bounded: the header of a log is never longer, and the file may be anything.
    with path.open("r", encoding="utf-8-sig", errors="replace", newline="") as file:
        header = file.readline(1 << 20).rstrip("\r\n")
    return header.split(",") if header.strip() else []


def _clean(name: str) -> str:
    return name.strip().strip('"').strip()


def _csv_names(path: Path) -> list[str]:
    return [_clean(name) for name in _csv_header(path)]


def _read_csv(path: Path, names: list[str]) -> pl.DataFrame:
    import polars as pl

    in_file = {_clean(raw): raw.strip('"') for raw in _csv_header(path)}
    raw_names = [in_file[name] for name in names]
    rename = dict(zip(raw_names, names, strict=True))
    try:
        frame = pl.read_csv(
            path,
            columns=raw_names,
            schema_overrides=dict.fromkeys(raw_names, pl.Float64),
            null_values=MISSING,
        )
    except pl.exceptions.PolarsError:
        frame = _read_csv_slowly(path, raw_names, rename)
    return frame.rename(rename)


def _read_csv_slowly(path: Path, raw_names: list[str], rename: dict[str, str]) -> pl.DataFrame:
    """Read cells as text, to accept blanks around numbers and to name the cell that is none."""
    import polars as pl

    try:
        text = pl.read_csv(path, columns=raw_names, infer_schema=False, null_values=MISSING)
    except pl.exceptions.PolarsError as error:
        reason = str(error).splitlines()[0].rstrip(".")
        raise InputError(
            f"{path}: expected a CSV table with a header, found something else ({reason}); check the file"
        ) from None
    stripped = text.select(pl.all().str.strip_chars())
    stripped = stripped.select(pl.when(pl.all().is_in(MISSING)).then(None).otherwise(pl.all()).name.keep())
    numbers = stripped.select(pl.all().cast(pl.Float64, strict=False))
    for raw in raw_names:
        wrong = (stripped[raw].is_not_null() & numbers[raw].is_null()).arg_true()
        if len(wrong):
            row = wrong[0]
            raise InputError(
                f"{path}:{row + 2}: column '{rename[raw]}': expected a number, found '{text[raw][row][:40]}'; correct the cell "
                "or leave it empty"
            )
    return numbers


def _parquet_names(path: Path) -> list[str]:
    import polars as pl

    try:
        return list(pl.read_parquet_schema(path))
    except pl.exceptions.PolarsError as error:
        raise InputError(f"{path}: expected a Parquet file, found something else ({error}); check the file") from None


def _read_parquet(path: Path, names: list[str]) -> pl.DataFrame:
    import polars as pl

    frame = pl.read_parquet(path, columns=names)
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
