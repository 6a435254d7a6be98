"""An experiment in one tidy form: the same numbers, on one clock, in one place."""

import json
from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from recordings import simulated, write_small
from scipy.spatial.transform import Rotation

from steelyard.experiment.equivalent.tidy import tidied
from steelyard.experiment.read import read_experiment
from steelyard.experiment.recording import Stream
from steelyard.experiment.write import write_experiment
from steelyard.identification.methods.least_squares import LeastSquares
from steelyard.identification.methods.two_step import TwoStep
from steelyard.instruments import Attitude

pytestmark = pytest.mark.integration

SAME = 1e-9
"""Relative: times are shifted once, rotations go through quaternions."""


def files(folder):
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


def converted(run, place, out, *options):
    status, printed, sentence = run("convert", place, "--out", out, "--json", *options)
    assert status == 0, sentence
    return json.loads(printed)


def assert_same_estimates(one, other):
    for method in (TwoStep(), LeastSquares()):
        here, there = method(one), method(other)
        scale = np.nanmax(np.abs(here.value))
        np.testing.assert_allclose(there.value, here.value, rtol=SAME, atol=SAME * scale)
        np.testing.assert_allclose(there.standard_deviation, here.standard_deviation, rtol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("form", ["parquet", "csv"])
def test_the_estimate_stays_the_same(tmp_path, run, form):
    small = write_small(tmp_path / "small")
    told = converted(run, small, tmp_path / "tidy", "--format", form)
    assert told["samples"]["moving"]["cables"] > 50
    assert set(files(tmp_path / "tidy")) == {
        "experiment.yaml",
        "robot.yaml",
        "provenance.json",
        *(f"moving/{n}.{form}" for n in ("cables", "imu", "tracker")),
    }
    assert_same_estimates(
        read_experiment(small), read_experiment(tmp_path / "tidy" / "experiment.yaml")
    )


@pytest.mark.slow
def test_a_window_is_kept(tmp_path, run):
    small = write_small(tmp_path / "small")
    small.write_text(small.read_text() + "    window: [0.3, 3.2]\n")
    converted(run, small, tmp_path / "tidy")
    tidy = read_experiment(tmp_path / "tidy" / "experiment.yaml")
    assert tidy.runs[0].window == (0.3, 3.2)
    assert set(tidy.runs[0].sync.values()) == {0.0}
    assert_same_estimates(read_experiment(small), tidy)


def test_clocks_that_agree_begin_with_the_forces(tmp_path, run):
    small = write_small(tmp_path / "small")
    experiment = read_experiment(small)
    sync = experiment.runs[0].sync
    streams = {
        n: Stream(s.time - sync[n] + 1e4, s.values, s.source)
        for n, s in experiment.runs[0].streams.items()
    }
    agreeing = replace(
        experiment, runs=(replace(experiment.runs[0], streams=streams, sync={}, window=(0.3, 3.2)),)
    )
    tidy = tidied(agreeing)
    assert tidy.runs[0].streams["cables"].time[0] == 0
    for name in streams:
        np.testing.assert_array_equal(
            tidy.common_time(tidy.runs[0], name), agreeing.common_time(agreeing.runs[0], name)
        )


def test_a_real_recording_with_poses_at_rest(tmp_path, run, examples):
    place = examples / "kuka-tool" / "experiment.yaml"
    converted(run, place, tmp_path / "tidy")
    original, tidy = read_experiment(place), read_experiment(tmp_path / "tidy" / "experiment.yaml")
    for one, other in zip(original.runs, tidy.runs, strict=True):
        for name, stream in one.streams.items():
            np.testing.assert_array_equal(
                original.common_time(one, name), tidy.common_time(other, name)
            )
            for quantity, values in stream.values.items():
                np.testing.assert_allclose(other.streams[name].values[quantity], values, atol=1e-14)
    assert {n: i.model_dump() for n, i in tidy.instruments.items()} == {
        n: i.model_dump() for n, i in original.instruments.items()
    }


def test_clocks_that_are_to_be_found_are_found(tmp_path, run, monkeypatch):
    small = write_small(tmp_path / "small")
    known = read_experiment(small)
    text = small.read_text()
    small.write_text(text[: text.index("    sync:")] + "    sync: auto\n")

    def found(experiment, progress):
        assert experiment.runs[0].unsynchronised
        return replace(
            experiment,
            runs=(replace(experiment.runs[0], sync=known.runs[0].sync, unsynchronised=False),),
        )

    monkeypatch.setattr("steelyard.identification.conversion.synchronised", found)
    converted(run, small, tmp_path / "tidy")
    tidy = read_experiment(tmp_path / "tidy" / "experiment.yaml")
    for name in ("cables", "imu", "tracker"):
        np.testing.assert_array_equal(
            tidy.common_time(tidy.runs[0], name), known.common_time(known.runs[0], name)
        )


def test_columns_units_and_where_they_came_from(tmp_path, run):
    small = write_small(tmp_path / "small")
    converted(run, small, tmp_path / "tidy")
    path = tmp_path / "tidy" / "moving" / "imu.parquet"
    about = json.loads(pl.read_parquet_metadata(path)["steelyard"])
    assert about["kind"] == "imu"
    assert about["source"] == "moving/imu.csv"
    assert about["units"]["ax"] == "m/s^2"
    assert (
        list(about["units"])
        == pl.read_parquet(path).columns
        == ["t", "wx", "wy", "wz", "ax", "ay", "az", "qw", "qx", "qy", "qz"]
    )
    q = pl.read_parquet(path).select("qw", "qx", "qy", "qz").to_numpy()
    np.testing.assert_allclose(np.linalg.norm(q, axis=1), 1, atol=1e-15)
    first = pl.read_parquet(tmp_path / "tidy" / "moving" / "cables.parquet")["t"]
    sync = read_experiment(small).runs[0].sync["cables"]
    assert first[0] == read_experiment(small).runs[0].streams["cables"].time[0] - sync


def test_twice_gives_the_same_bytes(tmp_path, run):
    small = write_small(tmp_path / "small")
    (small.parent / "truth.json").write_text('{"mass": 161.058}\n')
    converted(run, small, tmp_path / "one")
    converted(run, small, tmp_path / "two")
    one = files(tmp_path / "one")
    assert one == files(tmp_path / "two")
    assert one["truth.json"] == b'{"mass": 161.058}\n'
    # And what is tidy already stays as it is, but for where it came from.
    converted(run, tmp_path / "one" / "experiment.yaml", tmp_path / "three")
    three = files(tmp_path / "three")
    assert one["experiment.yaml"] == three["experiment.yaml"]
    for name in ("cables", "imu", "tracker"):
        tables = [
            pl.read_parquet(tmp_path / folder / "moving" / f"{name}.parquet")
            for folder in ("one", "three")
        ]
        np.testing.assert_allclose(tables[0].to_numpy(), tables[1].to_numpy(), atol=1e-15)


def test_quaternions_do_not_jump_and_gaps_are_null(tmp_path):
    experiment = simulated()
    turning = Rotation.from_rotvec(np.outer(np.linspace(0, 9, 200), [0, 0, 1])).as_matrix()
    turning[50] = np.nan
    tension = experiment.runs[0].streams["cables"]
    tension = Stream(
        tension.time,
        {"tension": np.where(np.arange(8) == 2, np.nan, tension.values["tension"])},
        "f",
    )
    streams = {
        "cables": tension,
        "arm": Stream(np.arange(200) * 0.01, {"orientation": turning}, "a"),
    }
    instruments = {"cables": experiment.instruments["cables"], "arm": Attitude(kind="attitude")}
    run = replace(experiment.runs[0], streams=streams, sync={})
    write_experiment(
        tidied(replace(experiment, instruments=instruments, runs=(run,))),
        tmp_path,
        tables="parquet",
    )
    table = pl.read_parquet(tmp_path / "moving" / "arm.parquet").select("qw", "qx", "qy", "qz")
    assert table.null_count().row(0) == (1, 1, 1, 1)
    q = table.drop_nulls().to_numpy()
    assert (np.sum(q[1:] * q[:-1], axis=1) > 0.9).all()
    assert q[0, 0] > 0
    assert pl.read_parquet(tmp_path / "moving" / "cables.parquet")["f3"].null_count() == len(
        tension
    )


def test_names_of_runs_that_cannot_be_folders(tmp_path):
    experiment = simulated()
    names = ["experiment.yaml", "a/b", "Same", "same", "..", "run-2"]
    runs = tuple(replace(experiment.runs[0], name=name) for name in names)
    write_experiment(
        tidied(replace(experiment, runs=runs)), tmp_path, tables="parquet", with_robot=True
    )
    back = read_experiment(tmp_path / "experiment.yaml")
    assert [each.name for each in back.runs] == names
    assert all(path.resolve().is_relative_to(tmp_path) for path in tmp_path.rglob("*"))
    assert len({path.name.casefold() for path in tmp_path.iterdir()}) == len(names) + 2


def test_what_is_read_is_not_written_over(tmp_path, run):
    small = write_small(tmp_path / "small")
    before = files(small.parent)
    for out in (small.parent, tmp_path, small.parent / "moving"):
        status, _, sentence = run("convert", small, "--out", out, "--force")
        assert status == 2
        assert "expected a folder apart from the recordings" in sentence
    assert files(small.parent) == before
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "mine.txt").write_text("mine")
    assert run("convert", small, "--out", tmp_path / "full")[0] == 2
    assert run("convert", tmp_path / "none.yaml", "--out", tmp_path / "new")[0] == 2
    assert not (tmp_path / "new").exists()
