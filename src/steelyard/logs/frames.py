"""Columns of Polars as arrays."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from steelyard.arrays import Array

if TYPE_CHECKING:
    import polars as pl

_TICKS = {"ms": 1_000, "us": 1_000_000, "ns": 1_000_000_000}
"""Of a second."""


def as_array(column: pl.Series) -> Array:
    """A column of numbers, instants or durations as float64, NaN where a cell is empty.

    Returns:
        Shape (n,); instants as seconds since 1970, times of day as seconds since midnight.
    """
    import polars as pl

    if not column.dtype.is_temporal():
        return np.asarray(column.to_numpy(), dtype=np.float64)
    physical = column.to_physical()
    if column.dtype == pl.Date:
        return np.asarray(physical.cast(pl.Float64).to_numpy() * 86_400.0)
    ticks = _TICKS[getattr(column.dtype, "time_unit", "ns")]
    # Exact up to the last step: as one number, nanoseconds since 1970 would be rounded before they
    # are divided.
    whole, rest = np.divmod(physical.fill_null(0).to_numpy(), ticks)
    return np.where(physical.is_null().to_numpy(), np.nan, whole + rest / ticks)
