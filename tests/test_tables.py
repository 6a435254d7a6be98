import numpy as np
import pandas as pd
import polars as pl

from steelyard.tables import Tabular, to_pandas, to_polars

COLUMNS = {"run": ["a", "b"], "force": np.array([1.5, np.nan])}


class Two(Tabular):
    def columns(self):
        return COLUMNS


def test_no_number_is_null_in_polars():
    expected = pl.DataFrame({"run": ["a", "b"], "force": [1.5, None]})
    assert to_polars(COLUMNS).equals(expected)
    assert Two().to_polars().equals(expected)


def test_no_number_is_nan_in_pandas_and_the_frame_owns_its_numbers():
    frame = to_pandas(COLUMNS)
    pd.testing.assert_frame_equal(frame, Two().to_pandas())
    frame.loc[0, "force"] = 7.0
    assert COLUMNS["force"][0] == 1.5
