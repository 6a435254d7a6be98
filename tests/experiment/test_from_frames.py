"""An experiment of frames and arrays is the one that the same files make, and what is wrong is said
in one sentence of Python."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cache

import numpy as np
import pandas as pd
import polars as pl
import pytest
from recordings import RUN, simulated, write_small

import steelyard
from steelyard.clocks.clock_signals import clocks_of
from steelyard.errors import InputError, SteelyardError
from steelyard.experiment.model import Experiment
from steelyard.experiment.read import read_experiment
from steelyard.identification.synchronisation import synchronised

NAMES = ("cables", "imu", "tracker")


def instruments():
    own = simulated().instruments
    return {
        "cables": steelyard.Tension(
            noise=np.float64(5.0), calibration={"offset": 5, "gain": 0, "common_gain": 0}
        ),
        "imu": steelyard.Imu(
            position=np.array(own["imu"].position),
            noise={"angular_velocity": 0.0017, "specific_force": 0.03, "orientation": 0.0035},
        ),
        "tracker": {"kind": "position", "target": list(own["tracker"].target), "noise": 0.0005},
    }


@cache
def frames():
    return {name: simulated().to_polars(RUN, name) for name in NAMES}


def made(streams=None, **keys):
    run = simulated().runs[0]
    keys = {"sync": {name: run.sync[name] for name in NAMES}, "name": "small", **keys}
    described = keys.pop("instruments", None) or instruments()
    runs = keys.pop("runs", {RUN: streams or frames()})
    return Experiment.from_frames(simulated().robot, described, runs, **keys)


def as_arrays(name):
    stream = simulated().runs[0].streams[name]
    return {"t": stream.time, **stream.values}


def stamped(name):
    """Times as instants, which pandas has."""
    start = pd.Timestamp("2026-03-01T10:00:00")
    return (
        simulated()
        .to_pandas(RUN, name)
        .assign(t=lambda f: start + pd.to_timedelta(f["t"], unit="s"))
    )


FORMS = {
    "polars": lambda name: frames()[name],
    "lazy": lambda name: frames()[name].lazy(),
    "pandas": lambda name: simulated().to_pandas(RUN, name),
    "structured": lambda name: frames()[name].to_numpy(structured=True),
    "lists": lambda name: frames()[name].to_dict(as_series=False),
    "quantities": as_arrays,
    "stream": lambda name: simulated().runs[0].streams[name],
    "other names": lambda name: steelyard.RecordedFrame(
        frames()[name].rename({"t": "ms"}).with_columns(pl.col("ms") * 1e3),
        columns={"t": "ms"},
        units={"ms": "ms"},
    ),
}


@pytest.mark.parametrize("form", FORMS)
def test_every_form_is_the_experiment_of_the_files(form, tmp_path):
    found = made({name: FORMS[form](name) for name in NAMES})
    files = read_experiment(write_small(tmp_path))
    assert found.name == files.name
    assert found.runs[0].sync == files.runs[0].sync
    for name in NAMES:
        stream, wanted = found.runs[0].streams[name], files.runs[0].streams[name]
        np.testing.assert_allclose(stream.time, wanted.time, rtol=0, atol=1e-9)
        assert stream.values.keys() == wanted.values.keys()
        for key, values in wanted.values.items():
            np.testing.assert_allclose(stream.values[key], values, rtol=0, atol=1e-11)


def test_instants_are_seconds():
    found = made({name: stamped(name) for name in NAMES}, sync=None)
    for name in NAMES:
        time = found.runs[0].streams[name].time
        own = simulated().runs[0].streams[name].time
        # Of seconds since 1970 a float has a quarter of a microsecond.
        np.testing.assert_allclose(time - time[0], own - own[0], atol=1e-6)


def test_poses_at_rest_need_no_time():
    rows = {name: frame.drop("t").head(12) for name, frame in frames().items()}
    found = made(runs={"poses": {**rows, "static": True}})
    assert found.runs[0].static
    assert len(found.runs[0].streams["imu"]) == 12


def test_keys_of_a_run_and_of_the_experiment_are_those_of_the_file():
    found = made(
        runs={RUN: {**frames(), "window": [0.5, 3], "load": "b"}, "first": frames()},
        loads={"a": {}, "b": {"known": {"mass": {"value": 180, "sigma": 1}}}},
        uncertainty={"anchor": 0, "attachment": 0.001},
    )
    assert found.runs[0].window == (0.5, 3.0)
    assert found.loads[1].known == {"mass": (180.0, 1.0)}
    assert found.uncertainty["attachment"] == 0.001


# Clocks


def clock_groups(experiment):
    return {clock.instruments for clock in clocks_of(experiment, experiment.runs[0])}


def test_a_clock_is_said_and_not_guessed():
    assert clock_groups(made(sync="auto")) == {("cables",), ("imu",), ("tracker",)}
    one = made(sync="auto", clocks={"cables": "recorder", "imu": "recorder"})
    assert clock_groups(one) == {("cables", "imu"), ("tracker",)}
    assert [one.instruments[name].clock for name in NAMES] == ["recorder", "recorder", None]


def test_one_frame_for_two_instruments_is_one_clock():
    both = pl.concat([frames()["cables"], frames()["imu"].drop("t")], how="horizontal")
    found = made({"cables": both, "imu": both, "tracker": frames()["tracker"]}, sync="auto")
    assert clock_groups(found) == {("cables", "imu"), ("tracker",)}
    # A copy is another recording.
    other = made({"cables": both, "imu": both.clone(), "tracker": frames()["tracker"]}, sync="auto")
    assert len(clock_groups(other)) == 3


def test_streams_of_one_source_have_clocks_of_their_own():
    run = simulated().runs[0]
    streams = {name: replace(run.streams[name], source="memory") for name in NAMES}
    made_by_hand = replace(
        simulated(), runs=(replace(run, streams=streams, sync={}, unsynchronised=True),)
    )
    assert clock_groups(made_by_hand) == {("cables",), ("imu",), ("tracker",)}


def test_files_share_their_clock_as_before(tmp_path):
    path = write_small(tmp_path)
    whole = pl.concat([frames()["cables"], frames()["imu"].drop("t")], how="horizontal")
    whole.write_csv(path.parent / RUN / "all.csv")
    text = path.read_text().replace("moving/cables.csv", "moving/all.csv")
    text = text.replace("moving/imu.csv", "moving/all.csv")
    path.write_text(text[: text.index("    sync:")] + "    sync: auto\n")
    assert clock_groups(read_experiment(path)) == {("cables", "imu"), ("tracker",)}


@pytest.mark.integration
def test_clocks_that_were_said_are_found():
    run = simulated().runs[0]
    keys = {"sync": "auto", "clocks": {"cables": "recorder", "imu": "recorder"}}
    found = synchronised(made(**keys)).runs[0].sync
    assert found["imu"] == found["cables"]
    wanted = run.sync["tracker"] - run.sync["cables"]
    assert found["tracker"] - found["cables"] == pytest.approx(wanted, abs=0.04)


# What is wrong


def wrong(name, **changes):
    return {**frames(), name: frames()[name].with_columns(**changes)}


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"streams": {**frames(), "cables": frames()["cables"].drop("f3")}}, "run 'moving', cables: expected columns f1, .* found no f3"),
        ({"streams": {**frames(), "cables": 3}}, "run 'moving', cables: expected a frame .* found int"),
        ({"streams": {**frames(), "cables": {"t": [1.0, 2.0], "f1": [1.0]}}}, "expected columns of one length, found 2 rows of 't' and 1 of 'f1'"),
        ({"streams": wrong("imu", wx=pl.lit("fast"))}, "imu: column 'wx': expected numbers, found String"),
        ({"streams": {**frames(), "imu": {"t": [0.0, 1.0], "wx": ["a", "b"]}}}, "column 'wx': expected numbers, found 'a'"),
        ({"streams": {**frames(), "imu": {"t": 0.0}}}, "column 't': expected one number for each sample"),
        ({"streams": wrong("tracker", t=-pl.col("t"))}, "tracker: row 2: column 't': expected time that never decreases"),
        ({"streams": wrong("tracker", x=pl.lit(float("inf")))}, "column 'x': expected a finite number, found infinity"),
        ({"streams": {**frames(), "tracker": steelyard.RecordedFrame(frames()["tracker"], units={"x": "furlong"})}}, "unit of column 'x': expected one of .*found 'furlong'"),
        ({"streams": {"cable": frames()["cables"]}}, "'runs.moving': expected the name of an instrument, found 'cable'; known here: cables, imu, tracker"),
        ({"runs": 3}, "'runs': expected a mapping of names to values, found int"),
        ({"runs": {"a": 3}}, "'runs.a': expected a mapping"),
        ({"instruments": {"cables": steelyard.Imu()}}, "'runs.moving': expected the name of an instrument, found 'imu'"),
        ({"instruments": {"cables": {"kind": "scale"}}}, "'instruments.cables': expected one of 'tension'"),
        ({"instruments": {"cables": 3}}, "'instruments.cables': expected a mapping of keys to values, found 3"),
        ({"sync": "never"}, "sync': expected"),
        ({"sync": {"cables": 1}}, "sync': expected a time for every instrument, found none for 'imu'"),
        ({"clocks": {"eye": "a"}}, "'clocks': expected one of cables, imu, tracker, found 'eye'"),
        ({"known": {"mas": 1}}, "'known.mas': expected a known key, found 'mas'; did you mean 'mass'"),
        ({"runs": {RUN: {**frames(), "window": [3, 1]}}}, "window'.*expected start below end"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_said(keys, message):
    with pytest.raises(InputError, match=message) as caught:
        made(keys.pop("streams", None), **keys)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: steelyard.Imu(posit=[0, 0, 0]), "Imu: 'posit': expected a known key, found 'posit'; did you mean 'position'?"),
        (lambda: steelyard.Imu(position=[0, 0]), "Imu: 'position': expected at least 3 values, found 2"),
        (lambda: steelyard.Tension(noise=-1), "Tension: 'noise': expected a number at least 0, found -1"),
        (lambda: steelyard.Tension([1]), "Tension: expected keys by name"),
        (lambda: steelyard.Weight(), "Weight: 'of': expected this key, found it missing"),
        (lambda: steelyard.Tension(calibration={"friction": 0.1}), "expected no key 'friction' under 'calibration'"),
        (lambda: steelyard.Inertia(1, [0, 0], np.eye(3)), r"center_of_gravity: expected shape 3, found \(2,\)"),
        (lambda: steelyard.Inertia(1, [0, 0, 0], [[1, 2, 0], [0, 1, 0], [0, 0, 1]]), "inertia: expected a symmetric matrix"),
        (lambda: steelyard.Inertia("heavy", [0, 0, 0], np.eye(3)), "mass: expected numbers in rows of one length, found 'heavy'"),
        (lambda: steelyard.Box([0, 0, 0], [1, 1]), r"upper: expected shape 3"),
        (lambda: steelyard.Box([0, 0, 0], [1, 1, -1]), "expected lower < upper"),
        (lambda: steelyard.Ellipsoid([0, 0, 0], [1, 1, 0]), "expected positive semi-axes"),
        (lambda: steelyard.Robot("r", [[0, 0, 1]], [[0, 0]]), r"attachments: expected shape n x 3, found \(1, 2\)"),
        (lambda: steelyard.Robot("r", [[0, 0, 1]], [[0, 0, 0], [1, 0, 0]]), r"attachments: expected shape 1 x 3"),
        (lambda: steelyard.Robot("r", [[0, 0, 1]], [[0, 0, 0]], pulley_radius=-0.1), "pulley_radius: expected radii of 0 or more"),
        (lambda: steelyard.Robot("r", [[0, 0, 1]], [[0, 0, 0]], pulley_radius=0.1, pulley_axis=[0, 0, 0]), "found a vector of length 0"),
        (lambda: steelyard.Robot("r", [[0, 0, 1]], [[0, 0, 0]], tension_limits=(9, 1)), "expected the lowest and the highest tension"),
        (lambda: steelyard.Robot("r", [[2.6e6, 1.2e6, 400]], [[0, 0, 0]]), "anchors: expected coordinates of at most 100000 m, found 2600000"),
        (lambda: steelyard.Robot("r", [[0, 0, 1]], [[0, 0, 0]], cable={"diameter": 1}), r"cable: expected steelyard.CableProperties\(…\), found dict"),
        (lambda: steelyard.CableProperties(linear_density=-1), "'linear_density': expected a number at least 0"),
        (lambda: steelyard.Limits(position=[[0, 0, 0], [1, 1, 0]]), "expected the lowest corner first"),
        (lambda: steelyard.Limits(speed=0), "'speed': expected a number above 0"),
        (lambda: steelyard.platform_wrench(np.ones(9), np.ones((2, 3)), np.ones((2, 3)), np.ones((2, 3))), r"parameters: expected shape \(n, 10\) or \(10,\), found \(9,\)"),
        (lambda: steelyard.platform_regressor(np.ones((2, 3)), np.ones((3, 3)), np.ones((2, 3))), "omega: expected 2 samples as in what comes before it, found 3"),
        (lambda: steelyard.identify(42), "experiment: expected an Experiment or the path of its file, found int"),
        (lambda: steelyard.identify("nowhere.yaml"), "nowhere.yaml: expected a file"),
        (lambda: steelyard.inspect(None), "experiment: expected an Experiment"),
        (lambda: steelyard.calibrate([]), "experiment: expected an Experiment"),
        (lambda: steelyard.identify(simulated(), 42), "methods: expected names of methods or estimators, found int"),
        (lambda: steelyard.identify(simulated(), "best"), "^methods: expected one of two-step"),
        (lambda: steelyard.identify(simulated(), holdout="x"), "^holdout: expected one of moving, found 'x'"),
        (lambda: steelyard.predict_held_out(simulated(), "x"), "run: expected one of moving, found 'x'"),
        (lambda: steelyard.frequencies("cogiro", pose=[0, 0, 1]), "^pose: expected x, y, z"),
        (lambda: next(steelyard.watch(simulated(), "tcp://x")), "^source: expected replay:RUN"),
    ],
)  # fmt: skip
def test_the_face_speaks_python(call, message):
    with pytest.raises(SteelyardError, match=message) as caught:
        call()
    assert "--" not in str(caught.value)
    assert "\n" not in str(caught.value)


def test_wrong_values_are_value_errors_too():
    with pytest.raises(ValueError, match="mass"):
        steelyard.Inertia(np.nan, [0, 0, 0], np.eye(3))


def test_lists_are_as_good_as_tuples():
    assert steelyard.Imu(position=[1, 2, 3]) == steelyard.Imu(position=(1.0, 2.0, 3.0))
    assert steelyard.Tension(without=[2, 3]).without == (2, 3)
    assert steelyard.Position(target=np.arange(3)).kind == "position"
    robot = steelyard.Robot("r", [[0, 0, 1], [1, 0, 1]], [[0, 0, 0], [0, 1, 0]], pulley_radius=0.1)
    assert robot.pulley_radius.tolist() == [0.1, 0.1]
    assert robot.pulley_axis.tolist() == [[0, 0, 1], [0, 0, 1]]
    limits = steelyard.Limits(position=[[0, 0, 0], [1, 1, 1]])
    assert hash(limits) == hash(steelyard.Limits(position=((0, 0, 0), (1, 1, 1))))


def test_what_is_made_in_python_is_written_and_read(tmp_path):
    found = made(clocks={"cables": "recorder", "imu": "recorder"})
    steelyard.write_experiment(found, tmp_path)
    read = read_experiment(tmp_path / "experiment.yaml")
    assert dict(read.instruments) == dict(found.instruments)
    np.testing.assert_array_equal(
        read.runs[0].streams["cables"].values["tension"],
        found.runs[0].streams["cables"].values["tension"],
    )


# Other verbs


def test_a_first_file_and_a_tidy_folder(tmp_path):
    path = write_small(tmp_path / "logs")
    drafted = steelyard.init(path.parent / RUN, path.parent / "robot.yaml", tmp_path / "first.yaml")
    assert "tracker" in drafted.instruments
    assert read_experiment(tmp_path / "first.yaml").runs
    with pytest.raises(InputError, match=r"first.yaml: expected a new file.*force=True"):
        steelyard.init([path.parent / RUN], path.parent / "robot.yaml", tmp_path / "first.yaml")
    written = steelyard.convert(path, tmp_path / "tidy", tables="csv")
    assert read_experiment(written.path).runs[0].sync == dict.fromkeys(NAMES, 0.0)
    memory = steelyard.convert(made(), tmp_path / "memory")
    assert repr(memory).startswith(f"{tmp_path / 'memory' / 'experiment.yaml'}: 5 files")
    with pytest.raises(InputError, match="expected a folder apart from the recordings"):
        steelyard.convert(path, path.parent, force=True)


@pytest.mark.slow
@pytest.mark.integration
def test_threads_may_identify_at_the_same_time(tmp_path):
    path = write_small(tmp_path)
    # Of one value, and of values of their own.
    shared = read_experiment(path)
    alone = steelyard.identify(shared, "least-squares").estimate
    with ThreadPoolExecutor(2) as pool:
        given = [shared, path]
        found = list(pool.map(lambda each: steelyard.identify(each, "least-squares"), given))
    for each in found:
        np.testing.assert_array_equal(each.estimate.value, alone.value)
        np.testing.assert_array_equal(each.estimate.covariance, alone.covariance)


@pytest.mark.integration
def test_results_of_arrays_are_written(tmp_path):
    found = steelyard.identify(made(), steelyard.TwoStep())
    assert steelyard.write_results(found, tmp_path / "result").is_file()
