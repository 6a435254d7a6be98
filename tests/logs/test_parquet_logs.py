"""Parquet files give the numbers that are in them, whatever they are nested in, or one sentence."""

import datetime as dt
import os
import random
from contextlib import suppress

import numpy as np
import polars as pl
import pytest

from steelyard.campaigns.rows import read_table
from steelyard.errors import InputError
from steelyard.logs.formats import open_log
from steelyard.logs.log import RowRange
from steelyard.logs.parquet import opened

NAN = float("nan")
NOON = dt.datetime(2024, 1, 31, 12, tzinfo=dt.UTC)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "log.parquet"


def read(path, name, part=None):
    with open_log(path) as log:
        return log.read([name], part)[name]


@pytest.mark.parametrize("unit", ["ms", "us", "ns"])
@pytest.mark.parametrize("zone", [None, "UTC", "Europe/Berlin"])
def test_instants_are_seconds(path, unit, zone):
    first = NOON.replace(tzinfo=None) if zone is None else NOON
    times = pl.Series(
        [first, first + dt.timedelta(seconds=0.25), None], dtype=pl.Datetime(unit, zone)
    )
    pl.DataFrame({"t": times, "f": [1.0, 2.0, 3.0]}).write_parquet(path)
    np.testing.assert_array_equal(read(path, "t"), [NOON.timestamp(), NOON.timestamp() + 0.25, NAN])
    with open_log(path) as log:
        part = log.read(["f"], RowRange("t", NOON.timestamp() + 0.1, NOON.timestamp() + 1))
    np.testing.assert_array_equal(part["f"], [2.0])


def test_durations_and_times_of_day_are_seconds(path):
    columns = {
        "ms": pl.Series([dt.timedelta(seconds=1.5), None], dtype=pl.Duration("ms")),
        "ns": pl.Series([dt.timedelta(seconds=-1.5), None], dtype=pl.Duration("ns")),
        "clock": pl.Series([dt.time(0, 1, 0, 500_000), None]),
        "day": pl.Series([dt.date(1970, 1, 3), None]),
    }
    pl.DataFrame(columns).write_parquet(path)
    for name, seconds in {"ms": 1.5, "ns": -1.5, "clock": 60.5, "day": 172_800.0}.items():
        np.testing.assert_array_equal(read(path, name), [seconds, NAN])


def test_an_instant_of_no_calendar_is_a_number(path):
    pl.DataFrame({"t": pl.Series([2**55]).cast(pl.Datetime("us"))}).write_parquet(path)
    np.testing.assert_allclose(read(path, "t"), [2**55 / 1e6])


def test_fields_and_elements_are_columns(path):
    frame = pl.DataFrame(
        {
            "imu": [
                {"acc": {"x": 1.5, "y": 2.5}, "seq": 7},
                {"acc": {"x": 3.5, "y": None}, "seq": 8},
                None,
            ],
            "q": pl.Series([[1.0, 2.0], [3.0, 4.0], None], dtype=pl.Array(pl.Float64, 2)),
            "r": pl.Series([[[1, 2], [3, 4]]] * 3, dtype=pl.Array(pl.Int64, (2, 2))),
        }
    )
    frame.write_parquet(path)
    with open_log(path) as log:
        assert log.names == (
            "imu.acc.x", "imu.acc.y", "imu.seq", "q[0]", "q[1]", "r[0][0]", "r[0][1]", "r[1][0]", "r[1][1]",
        )  # fmt: skip
        table = log.read(["imu.acc.y", "imu.seq", "q[1]", "r[1][0]"])
        np.testing.assert_array_equal(table["imu.acc.y"], [2.5, NAN, NAN])
        np.testing.assert_array_equal(table["imu.seq"], [7, 8, NAN])
        np.testing.assert_array_equal(table["q[1]"], [2, 4, NAN])
        np.testing.assert_array_equal(table["r[1][0]"], [3, 3, 3])
        np.testing.assert_array_equal(log.read(["q[0]"], RowRange("imu.seq", 8, 9))["q[0]"], [3.0])


@pytest.mark.parametrize("kind", [pl.Int8, pl.UInt64, pl.Float32, pl.Decimal(10, 2), pl.Int64])
def test_numbers_of_all_kinds(path, kind):
    pl.DataFrame({"f": pl.Series([1, None, 3]).cast(kind)}).write_parquet(path)
    np.testing.assert_array_equal(read(path, "f"), [1, NAN, 3])


@pytest.mark.parametrize("values", [["a"], [True], [[1.0]], [b"a"]])
def test_what_is_no_number_is_refused(path, values):
    pl.DataFrame({"f": values}).write_parquet(path)
    with pytest.raises(InputError, match=r"log\.parquet: column 'f': expected numbers, found "):
        read(path, "f")


def test_a_part_is_what_all_of_it_has_there(path):
    time = np.arange(100_000) * 1e-3
    values = np.random.default_rng(0).normal(size=len(time))
    pl.DataFrame({"t": time, "f": values}).write_parquet(path, row_group_size=4096)
    inside = (time >= 50) & (time <= 60)
    np.testing.assert_array_equal(read(path, "f", RowRange("t", 50, 60)), values[inside])


@pytest.mark.integration
def test_ever_the_same_number_does_not_fill_the_memory(path):
    pl.select(pl.repeat(0.0, 40_000_000).alias("f")).write_parquet(path)
    assert path.stat().st_size < 1_000_000
    with pytest.raises(
        InputError,
        match=r"log\.parquet: expected a recording, found \d+ KiB that unpack to more than 305 MiB",
    ):
        read(path, "f")


def test_too_many_columns_are_refused(path):
    pl.DataFrame(
        {"f": pl.Series([[0.0] * 20_000], dtype=pl.Array(pl.Float64, 20_000))}
    ).write_parquet(path)
    with pytest.raises(InputError, match="expected at most 10000 columns"):
        read(path, "f[0]")


@pytest.mark.parametrize("seed", range(20))
def test_a_damaged_file_gives_numbers_or_a_sentence(path, seed):
    pl.DataFrame(
        {"t": np.arange(500) * 1e-3, "f": np.random.default_rng(0).normal(size=500)}
    ).write_parquet(path)
    generator, content = random.Random(seed), bytearray(path.read_bytes())
    if seed % 2:
        del content[generator.randrange(len(content)) :]
    else:
        content[generator.randrange(len(content) - 800, len(content))] ^= generator.randrange(
            1, 256
        )
    path.write_bytes(content)
    with suppress(InputError), open_log(path) as log:
        for name in log.names:
            assert log.read([name])[name].dtype == np.float64


def test_what_polars_trips_over_is_one_sentence_and_nothing_else(tmp_path, capfd, monkeypatch):
    path = tmp_path / "a.parquet"
    pl.DataFrame({"t": [0.0, 1.0]}).write_parquet(path)

    def panics(*_arguments, **_options):
        os.write(2, b"thread 'main' panicked at many lines")
        raise pl.exceptions.PanicException("of what is within")

    monkeypatch.setattr(pl, "scan_parquet", panics)
    monkeypatch.setattr(pl, "read_parquet", panics)
    with pytest.raises(InputError, match="of what is within"), opened(path):
        pass
    with pytest.raises(InputError, match="expected the table of a campaign"):
        read_table(path)
    assert capfd.readouterr().err == ""
    os.write(2, b"heard")
    assert capfd.readouterr().err == "heard"
