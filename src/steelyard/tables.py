"""Columns as a frame of Polars or pandas, whichever a notebook uses."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, TypeAlias

from steelyard.arrays import Array
from steelyard.errors import SteelyardError
from steelyard.processes.forked import check_not_forked

if TYPE_CHECKING:
    import pandas as pd
    import polars as pl

Columns: TypeAlias = Mapping[str, Array | Sequence[str]]
"""Name -> numbers, NaN where there is none, or texts; all of one length."""


class Tabular(ABC):
    """What can show itself as columns, and hence as frames."""

    @abstractmethod
    def columns(self) -> Columns:
        """Name -> numbers, NaN where there is none, or texts; all of one length."""

    def to_polars(self) -> pl.DataFrame:
        """The columns as a frame of Polars; null where there is no number."""
        return to_polars(self.columns())

    def to_pandas(self) -> pd.DataFrame:
        """The columns as a frame of pandas; NaN where there is no number.

        Raises:
            SteelyardError: pandas is not installed.
        """
        return to_pandas(self.columns())


def to_polars(columns: Columns) -> pl.DataFrame:
    """Frame of Polars; null where there is no number."""
    import polars as pl

    check_not_forked()
    return pl.DataFrame(dict(columns)).fill_nan(None)


def to_pandas(columns: Columns) -> pd.DataFrame:
    """Frame of pandas; NaN where there is no number.

    Raises:
        SteelyardError: pandas is not installed.
    """
    try:
        import pandas as pd
    except ImportError as error:
        raise SteelyardError(
            "to_pandas: expected the package pandas, found none installed; "
            "pip install 'steelyard[pandas]', or take to_polars, which needs nothing more"
        ) from error
    return pd.DataFrame(dict(columns), copy=True)
