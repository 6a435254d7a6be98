"""Cells of text files, against what Python and its datetime make of them."""

from datetime import UTC, datetime, timedelta

import numpy as np
import polars as pl
import pytest

from steelyard.errors import InputError
from steelyard.logs.frames import as_array
from steelyard.logs.packages import listed, shown
from steelyard.logs.size import check_unpacked
from steelyard.logs.text.cells import (
    as_instants,
    as_numbers,
    is_instant,
    is_missing,
    is_number,
    stripped,
)


@pytest.mark.parametrize("cell", ["1", "-1.5", "+.5", "2.", "1e-3", "1E+05", "inf", "-Infinity"])
def test_numbers_are_those_of_python(cell):
    assert is_number(cell, ".")
    assert as_numbers(pl.Series([cell]), ".")[0] == float(cell)


@pytest.mark.parametrize("cell", ["", "-", "1,5", "0x10", "1_000", "1e", "1" * 65, "1 2"])
def test_no_numbers(cell):
    assert not is_number(cell, ".")


def test_a_comma_may_be_the_decimal_mark():
    assert is_number("-1,25", ",")
    assert not is_number("1.25", ",")
    assert as_numbers(pl.Series(["-1,25"]), ",")[0] == -1.25


def test_cells_without_a_sample():
    cells = pl.Series([' "NaN" ', "n/a", "", "7 ", '"8"'])
    assert stripped(cells).to_list() == [None, None, None, "7", "8"]
    assert is_missing("NULL")
    assert not is_missing("0")


@pytest.mark.parametrize(
    ("cell", "zone"),
    [
        ("2024-03-01 12:34:56.25", 0),
        ("2024-03-01T12:34:56.25Z", 0),
        ("01.03.2024 12:34:56,25", 0),
        ("2024/03/01 12:34:56.25 +01:30", 90),
        ("2024-03-01 12:34:56.25-0200", -120),
    ],
)
def test_instants_are_those_of_datetime(cell, zone):
    assert is_instant(cell)
    local = datetime(2024, 3, 1, 12, 34, 56, 250_000, tzinfo=UTC)
    expected = (local - timedelta(minutes=zone)).timestamp()
    assert as_instants(pl.Series([cell]))[0] == expected


def test_times_of_day_and_durations_are_seconds():
    assert as_instants(pl.Series(["01:00:00.5"]))[0] == 3600.5
    assert as_instants(pl.Series(["-2.5 sec"]))[0] == -2.5
    assert not is_instant("12.5")


def test_columns_of_instants_are_exact_to_the_nanosecond():
    whole = 1_700_000_000
    column = pl.Series([whole * 10**9 + 1, None]).cast(pl.Datetime("ns"))
    seconds = as_array(column)
    assert seconds[0] == whole + 1e-9
    assert np.isnan(seconds[1])
    assert as_array(pl.Series([datetime(1970, 1, 3).date()]))[0] == 2 * 86_400


def test_what_unpacks_to_far_too_much(tmp_path):
    check_unpacked(tmp_path, 1 << 28, 1)
    check_unpacked(tmp_path, 59 << 30, 1 << 30)
    with pytest.raises(InputError, match="found 1024 KiB that unpack to more than 1024 MiB"):
        check_unpacked(tmp_path, 1 << 30, 1 << 20)


def test_names_of_files_in_messages():
    assert shown("a\x1b[2J") == "a\ufffd[2J"
    assert shown("x" * 200) == "x" * 79 + "…"
    assert listed([]) == "none"
    assert listed(str(i) for i in range(100)) == ", ".join(map(str, range(20))) + ", …"
