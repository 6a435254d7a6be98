"""The covariance of a robot's geometry as a table: a square matrix with names in its header and in
its first column.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import InputError
from steelyard.output import write_file

POINTS = ("anchor", "attachment")
"""What is told of each cable, in this order."""
_MOST_ROWS = 1000
"""Of a table."""
_ROUNDED = 1e-6
"""Part of the largest eigenvalue that a negative one may have by the digits of a file."""


def names_of(m: int) -> list[str]:
    """Of the rows of the geometry of m cables, such as ``anchor.1.x``."""
    return [f"{key}.{i + 1}.{axis}" for key in POINTS for i in range(m) for axis in "xyz"]


def write_covariance(covariance: Array, m: int, path: Path) -> None:
    """Write a covariance [m^2].

    Args:
        covariance: Of anchors, then attachments, three coordinates a cable, shape (6 m, 6 m).
        m: Number of cables.
        path: Of the table.
    """
    import polars as pl

    names = names_of(m)
    columns = {"": names, **dict(zip(names, np.asarray(covariance).T.tolist(), strict=True))}
    write_file(path, pl.DataFrame(columns).write_csv())


def read_covariance(path: Path, m: int) -> Array:
    """Read the covariance of anchors and attachments [m^2], shape (6 m, 6 m).

    Further rows, of other things that were calibrated beside them, are passed over.

    Args:
        path: Of the table.
        m: Number of cables.

    Raises:
        InputError: It is not there, or is no such table, or no covariance.
    """
    import polars as pl

    try:
        table = pl.read_csv(path, n_rows=_MOST_ROWS)
    except (OSError, pl.exceptions.PolarsError) as error:
        what = "no file" if isinstance(error, FileNotFoundError) else "something else"
        raise InputError(
            f"{path}: expected a table of a covariance, as 'steelyard calibrate' writes it, found"
            f" {what}; check 'covariance' in the robot file"
        ) from None
    names = names_of(m)
    first = table.columns[0] if table.columns else ""
    rows = [str(name) for name in table[first].to_list()] if table.columns else []
    missing = [name for name in names if name not in rows or name not in table.columns]
    if missing:
        raise InputError(
            f"{path}: expected a row and a column of {missing[0]}, found none; let 'steelyard"
            " calibrate' write the table for this robot"
        )
    try:
        matrix = table.select(names).cast(pl.Float64).to_numpy()
    except pl.exceptions.PolarsError:
        raise InputError(
            f"{path}: expected numbers in all columns, found something else; let 'steelyard"
            " calibrate' write the table again"
        ) from None
    matrix = matrix[[rows.index(name) for name in names]]
    symmetric = matrix / 2 + matrix.T / 2
    if not np.isfinite(matrix).all() or not np.allclose(matrix, symmetric, atol=1e-9):
        raise InputError(
            f"{path}: expected a symmetric matrix of numbers, found another one; let 'steelyard"
            " calibrate' write the table again"
        )
    values = np.linalg.eigvalsh(symmetric)
    if values[0] < -_ROUNDED * max(float(values[-1]), 0.0) - 1e-18:
        raise InputError(
            f"{path}: expected a covariance, found a matrix with the eigenvalue {values[0]:.2g};"
            " let 'steelyard calibrate' write the table again"
        )
    return np.asarray(symmetric)
