"""The fitted motion as a table that other programs read."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from steelyard.identification.model.fitted_motion import FittedMotion
from steelyard.output import write_table

FILE_NAME = "motion.parquet"


def write_motion(motions: Sequence[FittedMotion], path: Path) -> None:
    """Write Parquet: one row per instant, the run in the first column, SI units.

    Args:
        motions: Of each stretch of the runs, at least one.
        path: Of the file.
    """
    write_table([(motion.run, motion.columns()) for motion in motions], path)
