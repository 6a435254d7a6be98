"""The fitted motion as a table that other programs read."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path

from steelyard.identification.fitted_motion import FittedMotion

FILE_NAME = "motion.parquet"


def write_motion(motions: Sequence[FittedMotion], path: Path) -> None:
    """Write Parquet: one row per instant, the run in the first column, SI units.

    Args:
        motions: Of each stretch of the runs, at least one.
        path: Of the file.
    """
    import polars as pl

    frames = [pl.DataFrame(motion.columns()).select(pl.lit(motion.run).alias("run"), pl.all()) for motion in motions]
    # Into memory first: names of files are bytes, which the library would have as text.
    buffer = io.BytesIO()
    pl.concat(frames).write_parquet(buffer)
    path.write_bytes(buffer.getvalue())
