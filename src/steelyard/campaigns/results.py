"""Of several methods the one that counts, and where its files are."""

from __future__ import annotations

from typing import TYPE_CHECKING
from urllib.parse import quote

from steelyard.estimates.estimate import BEST_FIRST

if TYPE_CHECKING:
    import polars as pl


def best_rows(table: pl.DataFrame) -> pl.DataFrame:
    """One row for each experiment: that of its best method, of those that have numbers where any
    has, as in ``estimate.json``; sorted by experiment.
    """
    import polars as pl

    rank = {name: i for i, name in enumerate(BEST_FIRST)}
    order = pl.col("method").replace_strict(rank, default=len(rank), return_dtype=pl.Int64)
    known = pl.any_horizontal(pl.col("mass", "cx").is_not_null())
    return (
        table.with_columns(order.alias("_rank"), known.not_().alias("_unknown"))
        .sort("experiment", "_unknown", "_rank")
        .unique("experiment", keep="first", maintain_order=True)
        .drop("_rank", "_unknown")
    )


def link(asked: str, experiment: str, file: str) -> str:
    """Address of a file of results, from the folder of the campaign."""
    return quote(f"{asked}/{experiment}/{file}")
