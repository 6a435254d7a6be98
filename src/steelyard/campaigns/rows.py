"""The table of a campaign: one row for each experiment and method."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from steelyard.campaigns.tasks import Row
from steelyard.errors import InputError
from steelyard.inertia import BODY_PARAMETERS
from steelyard.logs.parquet import unheard_panics
from steelyard.output import results_file, write_file

if TYPE_CHECKING:
    import polars as pl

TABLE = "campaign.parquet"
FORMAT = "steelyard-rows/1"
"""In the footer of the table."""
DONE = "done"
"""An estimate was made, accepted or not."""
REFUSED = "refused"
"""The experiment cannot be read or worked on; the same files will be refused again."""
LOST = "lost"
"""The machine failed: it may go well another time."""


def columns() -> dict[str, Any]:
    """Name -> type of Polars, in the order of the table."""
    import polars as pl

    numbers = (*BODY_PARAMETERS, *(f"sigma_{name}" for name in BODY_PARAMETERS))
    return {
        **dict.fromkeys(("experiment", "path", "sha256", "method", "status"), pl.String),
        **dict.fromkeys(numbers, pl.Float64),
        "covariance": pl.List(pl.Float64),
        "accepted": pl.Boolean,
        "reason": pl.String,
        "seconds": pl.Float64,
        "version": pl.String,
        "asked": pl.String,
        "recorded": pl.Float64,
    }


def frame(rows: Iterable[Row]) -> pl.DataFrame:
    """Rows as a table; what a row does not have is null."""
    import polars as pl

    schema = columns()
    return pl.DataFrame([[row.get(name) for name in schema] for row in rows], schema, orient="row")


def failed(task: Any, status: str, reason: str, **further: Any) -> Row:
    """The row of an experiment that gave no estimate.

    Args:
        task: With ``name`` and ``path``.
        status: :data:`REFUSED` or :data:`LOST`.
        reason: In words.
        further: Other columns.
    """
    return {
        "experiment": task.name,
        "path": task.path,
        "method": "",
        "status": status,
        "reason": reason,
        **further,
    }


def merged(old: pl.DataFrame, new: pl.DataFrame) -> pl.DataFrame:
    """Rows of two campaigns, in the order of experiment and method.

    A new row takes the place of the old one of the same experiment and method. Old rows of an
    experiment that has changed since (or was done by another version) are left out, and so are old
    failures of one that has new rows.
    """
    import polars as pl

    key = ["experiment", "method"]
    new = new.unique(key, keep="last", maintain_order=True)
    # Of new rows, those of the last state of the files count.
    state = new.group_by("experiment", maintain_order=True).agg(
        pl.col("sha256").last().alias("_sha256"), pl.col("version").last().alias("_version")
    )
    same = pl.col("sha256").eq_missing(pl.col("_sha256")) & pl.col("version").eq_missing(
        pl.col("_version")
    )
    untouched = old.join(state, on="experiment", how="anti")
    kept = (
        old.join(state, on="experiment", how="inner")
        .filter(same & (pl.col("method") != ""))
        .drop("_sha256", "_version")
        .join(new, on=key, how="anti")
    )
    return pl.concat([untouched, kept, new]).sort(key)


def read_table(path: Path) -> pl.DataFrame:
    """Rows of a campaign; none where there is no table yet.

    Raises:
        InputError: The file is none of a campaign.
    """
    import polars as pl

    if not path.exists():
        return frame([])
    try:
        with unheard_panics():
            table = pl.read_parquet(path)
        return table.select(pl.col(name).cast(kind) for name, kind in columns().items())
    except (pl.exceptions.PolarsError, OSError) as error:
        raise InputError(
            f"{path}: expected the table of a campaign, found a file that is none"
            f" ({str(error).splitlines()[0]}); choose another folder with --out"
        ) from error


def write_rows(table: pl.DataFrame, path: Path) -> None:
    """Write a table, which appears whole or not at all."""
    import io

    # Into memory first: names of files are bytes, which the library would have as text.
    buffer = io.BytesIO()
    table.write_parquet(buffer, metadata={"steelyard": json.dumps({"format": FORMAT})})
    with results_file(path, force=True) as fresh:
        write_file(fresh, buffer.getvalue())


def known_hashes(table: pl.DataFrame, asked: str, version: str) -> Mapping[str, str]:
    """Experiment -> hash of the inputs that its rows were made from; only those with all that is
    asked for, by this version, and that would not end otherwise another time.
    """
    import polars as pl

    there = table.filter(
        (pl.col("asked") == asked) & (pl.col("version") == version) & (pl.col("status") != LOST)
    ).filter(pl.col("sha256").is_not_null())
    return dict(there.select("experiment", "sha256").unique().iter_rows())
