"""Columns of Polars as arrays."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from steelyard.arrays import Array

if TYPE_CHECKING:
    import polars as pl


def as_array(column: pl.Series) -> Array:
    """A column of numbers, instants or durations as float64, NaN where a cell is empty; instants as seconds since 1970, shape (n,)."""
    if not column.dtype.is_temporal():
        return np.asarray(column.to_numpy(), dtype=np.float64)
    nanoseconds = _nanoseconds(column)
    # Exact before the last step: as one number, nanoseconds since 1970 would be rounded before they are divided.
    whole, rest = np.divmod(nanoseconds.fill_null(0).to_numpy(), 1_000_000_000)
    return np.where(nanoseconds.is_null().to_numpy(), np.nan, whole + rest / 1e9)


def _nanoseconds(column: pl.Series) -> pl.Series:
    import polars as pl

    if column.dtype == pl.Duration:
        return column.dt.total_nanoseconds()
    if column.dtype == pl.Time:
        return column.to_physical()
    return column.cast(pl.Datetime("ns")).to_physical()
