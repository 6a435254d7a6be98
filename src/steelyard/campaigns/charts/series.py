"""The estimates of a campaign in the order in which they were recorded."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from steelyard.arrays import Array
from steelyard.campaigns.results import best_rows
from steelyard.campaigns.rows import DONE
from steelyard.estimates.estimate import BEST_FIRST
from steelyard.inertia import BODY_PARAMETERS

if TYPE_CHECKING:
    import polars as pl


@dataclass(frozen=True, eq=False)
class Series:
    """n estimates by one method, of those that were not rejected."""

    method: str
    names: tuple[str, ...]
    times: Array | None
    """When they were recorded, in seconds since 1970 UTC, shape (n,); None: not all of them tell
    it, and they are in the order of their names."""
    values: Array
    """NaN where there is no number, shape (n, 10)."""
    sigmas: Array
    """Shape (n, 10)."""
    rejected: int
    """Estimates by this method that are left out because their verdict is not "accepted"."""


def series_of(table: pl.DataFrame) -> Series | None:
    """The estimates that are comparable: by the method that is the best one of most experiments.

    A method that was not assessed, such as a baseline, is taken as it is. None: there is no
    estimate.
    """
    import polars as pl

    done = table.filter((pl.col("status") == DONE) & pl.col("mass").is_not_null())
    best = best_rows(done)["method"].to_list()
    methods = [name for name in BEST_FIRST if name in best]
    if not methods:
        return None
    method = max(methods, key=best.count)
    own = done.filter(pl.col("method") == method)
    kept = own.filter(pl.col("accepted").fill_null(True))
    if not len(kept):
        return None
    dated = not kept["recorded"].has_nulls()
    kept = kept.sort("recorded", "experiment") if dated else kept.sort("experiment")
    return Series(
        method,
        tuple(kept["experiment"]),
        kept["recorded"].to_numpy() if dated else None,
        _numbers(kept, BODY_PARAMETERS),
        _numbers(kept, [f"sigma_{name}" for name in BODY_PARAMETERS]),
        len(own) - len(kept),
    )


def _numbers(table: pl.DataFrame, names: Any) -> Array:
    """Columns as numbers, NaN where there is none."""
    import polars as pl

    return np.asarray(table.select(pl.col(names).fill_null(float("nan"))).to_numpy())
