"""What files of results hold: JSON and tables."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from steelyard.arrays import Array
from steelyard.output.disk import write_file
from steelyard.processes.forked import check_not_forked


def write_json(values: Mapping[str, Any], path: Path) -> None:
    """Write plain values as JSON."""
    write_file(path, to_json(values) + "\n")


def to_json(values: Mapping[str, Any], *, ascii_only: bool = False) -> str:
    """Plain values as JSON text; NaN is a mistake here, the contract has null.

    Args:
        values: What to write.
        ascii_only: Whether to escape all other characters, for terminals of any encoding.
    """
    return json.dumps(values, indent=1, allow_nan=False, ensure_ascii=ascii_only)


def write_table(runs: Sequence[tuple[str, Mapping[str, Array]]], path: Path, format_: str) -> None:
    """Write Parquet: one row per instant, the run in the first column.

    Args:
        runs: Run and its columns, the same for all.
        path: Of the file.
        format_: Its number, which stands in the footer under the key ``steelyard``.
    """
    import polars as pl

    check_not_forked()
    frames = [
        pl.DataFrame(columns).select(pl.lit(run).alias("run"), pl.all()) for run, columns in runs
    ]
    # Into memory first: names of files are bytes, which the library would have as text.
    buffer = io.BytesIO()
    about = {"steelyard": json.dumps({"format": format_})}
    pl.concat(frames).write_parquet(buffer, metadata=about)
    write_file(path, buffer.getvalue())
