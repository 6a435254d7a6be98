"""A first experiment file from logs: what they hold, in which unit, and what belongs together."""

import json
import re

import numpy as np
import polars as pl
import pytest
from recordings import RUN, simulated, write_small
from scipy.spatial.transform import Rotation
from time_limits import bounded

from steelyard.drafts.columns import claims_of
from steelyard.drafts.scales import time_unit
from steelyard.drafts.text import scalar
from steelyard.experiment.read import read_experiment
from steelyard.files.yaml_file import read_yaml
from steelyard.robot.file import read_robot

AXES = "xyz"
EIGHT = range(1, 9)
EPOCH = 1.7e9  # [s]


def numbered(pattern, letter="f", first=1):
    return {f"{letter}{i}": pattern.format(i - 1 + first) for i in EIGHT}


def along(pattern, letter="", names=AXES):
    return {f"{letter}{axis}": pattern.format(name) for axis, name in zip(AXES, names, strict=True)}


VOCABULARY = {
    "contract": ("t {f}", numbered("f{}"), "tension"),
    "underscore": ("time {f}", numbered("F_{}"), "tension"),
    "behind": ("stamp {f}", numbered("force_cable_{}"), "tension"),
    "before": ("timestamp {f}", numbered("cable{}_force"), "tension"),
    "german": ("Zeit {f}", numbered("Kraft{}"), "tension"),
    "loadcells": ("t {f}", numbered("loadcell{}"), "tension"),
    "tension": ("t {f}", numbered("tension{}"), "tension"),
    "effort": ("header.stamp {f}", numbered("effort[{}]", first=0), "tension"),
    "plotjuggler": ("__time {f}", numbered("/load_cells/data[{}]", first=0), "tension"),
    "lengths": ("t {f}", numbered("length_{}", "l"), "length"),
    "winches": ("t {f}", numbered("winch_pos_{}", "l"), "length"),
    "positions": ("t {f}", numbered("position[{}]", "l", first=0), "length"),
    "gyro": ("t {f}", along("gyro_{}", "w"), "imu"),
    "gyr": ("t {f}", along("gyr_{}", "w"), "imu"),
    "omega": ("t {f}", along("omega_{}", "w"), "imu"),
    "words": ("t {f}", along("Gyro {}", "w", "XYZ"), "imu"),
    "message": ("t {f}", along("angular_velocity.{}", "w"), "imu"),
    "aircraft": ("t {f}", along("{}", "w", "pqr"), "imu"),
    "acc": ("t {f}", along("acc_{}", "a"), "imu"),
    "accel": ("t {f}", along("accel{}", "a", "XYZ"), "imu"),
    "linear": ("t {f}", along("/imu/linear_acceleration/{}", "a"), "imu"),
    "quaternion": ("t {f}", {f"q{a}": f"q{i}" for i, a in enumerate("wxyz")}, "attitude"),
    "quat": ("t {f}", {f"q{a}": f"quat_{a}" for a in "wxyz"}, "attitude"),
    "orientation": ("t {f}", {f"q{a}": f"orientation.{a}" for a in "wxyz"}, "attitude"),
    "angles": ("t {f}", {a: f"{a}_deg" for a in ("roll", "pitch", "yaw")}, "attitude"),
    "matrix": ("t {f}", {f"r{i}{j}": f"r{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3)}, "attitude"),
    "position": ("t {f}", along("{}", "", "XYZ"), "position"),
    "pos": ("t {f}", along("pos_{}"), "position"),
    "prism": ("t {f}", along("prism_{}"), "position"),
    "p": ("t {f}", along("p{}"), "position"),
    "point": ("header.stamp {f}", along("point.{}"), "position"),
    "tum": ("timestamp {f}", {**along("t{}"), **{f"q{a}": f"q{a}" for a in "wxyz"}}, "pose"),
    "command": (
        "t {f}",
        {**along("cmd_{}"), **{a: f"cmd_{a}" for a in ("roll", "pitch", "yaw")}},
        "command",
    ),
    "reference": (
        "t {f}",
        {**along("{}_ref"), **{a: f"{a}_ref" for a in ("roll", "pitch", "yaw")}},
        "command",
    ),
    "desired": (
        "t {f}",
        {**along("{}_des"), **{a: f"{a}_des" for a in ("roll", "pitch", "yaw")}},
        "command",
    ),
    "wrench": ("t {f}", {**along("force_{}", "f"), **along("torque_{}", "t")}, "wrench"),
    "moments": ("t {f}", {**along("F{}", "f"), **along("M{}", "t")}, "wrench"),
    "wrench message": (
        "t {f}",
        {**along("wrench.force.{}", "f"), **along("wrench.torque.{}", "t")},
        "wrench",
    ),
}


@pytest.mark.parametrize("case", VOCABULARY)
def test_columns_are_told_by_their_names(case):
    pattern, wanted, kind = VOCABULARY[case]
    names = pattern.split()[:1] + list(wanted.values())
    (claim,) = claims_of(names, 8, [])
    assert claim.kind == kind
    assert dict(claim.columns) == wanted
    assert claim.times == (names[0],)


def test_what_no_instrument_has_is_left():
    others = ["mag_x", "mag_y", "mag_z", "temperature", *(f"velocity[{i}]" for i in range(8))]
    others += [f"orientation_covariance[{i}]" for i in range(9)]
    assert claims_of(["t", *others], 8, []) == []


def test_two_of_a_kind_stay_apart():
    names = ["t", *(f"imu{i}_acc_{axis}" for i in (1, 2) for axis in AXES)]
    claims = claims_of(names, 8, [])
    assert [claim.columns["ax"] for claim in claims] == ["imu1_acc_x", "imu2_acc_x"]


@pytest.mark.parametrize(
    ("unit", "factor"),
    [("s", 1.0), ("ms", 1e3), ("us", 1e6), ("ns", 1e9)],
    ids=["s", "ms", "us", "ns"],
)
@pytest.mark.parametrize("start", [0.0, 12.5, EPOCH])
def test_units_of_time(unit, factor, start):
    time = np.round((start + np.arange(500) * 0.004) * factor, 6 if unit == "s" else 0)
    assert time_unit(time)[0] == unit


# A whole heap


@pytest.fixture
def streams():
    return simulated().runs[0].streams


def rpy(matrices):
    return np.degrees(Rotation.from_matrix(matrices).as_euler("ZYX")[:, ::-1])


def write(path, table):
    path.parent.mkdir(parents=True, exist_ok=True)
    pl.DataFrame(table).write_csv(path)


def write_heap(folder, streams, epoch=0.0):
    """Logs of the small experiment as devices and people write them."""
    cables, imu, tracker = (streams[name] for name in ("cables", "imu", "tracker"))
    forces = {f"cable{i + 1}_force_kN": f for i, f in enumerate(cables.values["tension"].T / 1e3)}
    write(folder / "day-1" / "loadcells.csv", {"Zeit": cables.time + epoch, **forces})
    write(
        folder / "day-1" / "xsens.csv",
        {
            "timestamp_us": np.round((imu.time + epoch) * 1e6).astype(np.int64),
            **{
                f"Gyro {a.upper()}": w
                for a, w in zip(AXES, np.degrees(imu.values["angular_velocity"]).T, strict=True)
            },
            **{
                f"Acc {a.upper()}": f
                for a, f in zip(AXES, imu.values["specific_force"].T / 9.80665, strict=True)
            },
            **dict(zip(("Roll", "Pitch", "Yaw"), rpy(imu.values["orientation"]).T, strict=True)),
            "temperature": np.full(len(imu), 21.0),
        },
    )
    write(
        folder / "day-1" / "leica.csv",
        {
            "ms": (tracker.time + epoch) * 1e3,
            **{
                f"prism_{a}": p
                for a, p in zip(AXES, tracker.values["position"].T * 1e3, strict=True)
            },
        },
    )
    (folder / "day-1" / "notes.md").write_text("by hand")
    return folder


def assert_same(experiment, run, streams, names=("cables", "imu", "tracker")):
    for name in names:
        for quantity, values in streams[name].values.items():
            found = experiment.runs[run].streams[name].values[quantity]
            np.testing.assert_allclose(
                found, values, rtol=1e-6, atol=1e-6, err_msg=f"{name} {quantity}"
            )


def test_a_heap_of_logs_becomes_the_experiment_it_was_recorded_in(tmp_path, run, streams):
    write_heap(tmp_path / "heap", streams)
    out = tmp_path / "plan" / "experiment.yaml"
    status, printed, _ = run("init", tmp_path / "heap", "--robot", "cogiro", "--out", out, "--json")
    assert status == 0
    told = json.loads(printed)
    assert told["runs"]["day-1"]["streams"]["cables"]["units"]["cable1_force_kN"] == "kN"
    assert [each for each in told["unused"] if "temperature" in each["what"]]
    experiment = read_experiment(out)
    assert experiment.runs[0].unsynchronised
    assert {n: i.kind for n, i in experiment.instruments.items()} == {
        "cables": "tension",
        "imu": "imu",
        "tracker": "position",
    }
    assert_same(experiment, 0, streams)
    assert experiment.instruments["cables"].rate == pytest.approx(25, rel=0.01)


def test_clocks_that_count_since_1970_agree(tmp_path, run, streams):
    start = {name: EPOCH - float(stream.time[0]) for name, stream in streams.items()}
    write_heap(tmp_path, {n: type(s)(s.time + start[n], s.values, n) for n, s in streams.items()})
    assert run("init", tmp_path, "--robot", "cogiro", "--out", tmp_path / "e.yaml")[0] == 0
    text = (tmp_path / "e.yaml").read_text()
    assert "check: that the clocks agree" in text
    assert not read_experiment(tmp_path / "e.yaml").runs[0].unsynchronised


def test_one_file_with_everything(tmp_path, run, streams):
    """All of it in one table, as people who resample write it: several instruments on one clock."""
    imu, cables = streams["imu"], streams["cables"]
    n = min(len(imu), len(cables))
    q = Rotation.from_matrix(imu.values["orientation"][:n]).as_quat(scalar_first=True)
    table = {
        "__time": EPOCH + imu.time[:n],
        **{f"/cables/effort[{i}]": f for i, f in enumerate(cables.values["tension"][:n].T)},
        **{
            f"/imu/angular_velocity/{a}": w
            for a, w in zip(AXES, imu.values["angular_velocity"][:n].T, strict=True)
        },
        **{
            f"/imu/linear_acceleration/{a}": f
            for a, f in zip(AXES, imu.values["specific_force"][:n].T, strict=True)
        },
        **{f"/imu/orientation/{a}": v for a, v in zip("wxyz", q.T, strict=True)},
        **{f"/vicon/pose/position/{a}": np.linspace(0, 1, n) for a in AXES},
        **{f"/vicon/pose/orientation/{a}": v for a, v in zip("wxyz", q.T, strict=True)},
    }
    write(tmp_path / "all.csv", table)
    assert (
        run("init", tmp_path / "all.csv", "--robot", "cogiro", "--out", tmp_path / "e.yaml")[0] == 0
    )
    experiment = read_experiment(tmp_path / "e.yaml")
    assert {n: (i.kind, i.clock) for n, i in experiment.instruments.items()} == {
        "cables": ("tension", "recorder"),
        "imu": ("imu", "recorder"),
        "pose": ("pose", "recorder"),
    }
    found = experiment.runs[0].streams["imu"].values
    np.testing.assert_allclose(found["orientation"], imu.values["orientation"][:n], atol=1e-6)
    np.testing.assert_allclose(
        experiment.runs[0].streams["cables"].values["tension"], cables.values["tension"][:n]
    )


@pytest.mark.slow
@pytest.mark.integration
def test_runs_by_folder_and_by_name(tmp_path, run):
    places = (
        ("a", "{}.csv"),
        ("b", "{}.csv"),
        (".", "run3_{}.csv"),
        (".", "{}-run4.csv"),
        ("c/same", "{}.csv"),
        ("d/same", "{}.csv"),
    )
    for place, names in places:
        folder = tmp_path / place
        write_small(tmp_path / "original")
        folder.mkdir(parents=True, exist_ok=True)
        for name in ("cables", "imu", "tracker"):
            (folder / names.format(name)).write_bytes(
                (tmp_path / "original" / RUN / f"{name}.csv").read_bytes()
            )
    logs = [*(tmp_path / place for place in "abcd"), *tmp_path.glob("*.csv")]
    assert run("init", *logs, "--robot", "cogiro", "--out", tmp_path / "e.yaml")[0] == 0
    experiment = read_experiment(tmp_path / "e.yaml")
    assert sorted(each.name for each in experiment.runs) == [
        "a",
        "b",
        "c-same",
        "d-same",
        "run3",
        "run4",
    ]
    assert all(set(each.streams) == {"cables", "imu", "tracker"} for each in experiment.runs)


@pytest.mark.integration
def test_a_real_recording_is_described_as_a_person_did(tmp_path, run, examples):
    """What is known of the tool on the wrist is found again: units, static poses, whose load is
    read, how the accelerometer is mounted."""
    tool = examples / "kuka-tool"
    assert run("init", tool, "--robot", tool / "robot.yaml", "--out", tmp_path / "e.yaml")[0] == 0
    found, known = read_experiment(tmp_path / "e.yaml"), read_experiment(tool / "experiment.yaml")
    assert found.instruments["wrench"].acts_on == known.instruments["wrench"].acts_on == "sensor"
    assert found.instruments["imu"].rpy_deg == known.instruments["accelerometer"].rpy_deg
    assert [each.static for each in found.runs] == [each.static for each in known.runs]
    names = {"wrench": "wrench", "accelerometer": "imu", "arm": "attitude"}
    for one, other in zip(found.runs, known.runs, strict=True):
        for theirs, ours in names.items():
            np.testing.assert_array_equal(one.streams[ours].time, other.streams[theirs].time)
            for quantity, values in other.streams[theirs].values.items():
                np.testing.assert_array_equal(one.streams[ours].values[quantity], values)


@pytest.mark.integration
def test_what_is_left_to_fill_in_is_there_as_a_comment(tmp_path, run, streams, examples):
    """Every key that stands in a comment fits the contract where it stands."""
    for out, arguments in (
        (tmp_path / "a.yaml", (write_heap(tmp_path / "heap", streams), "--robot", "cogiro")),
        (
            tmp_path / "b.yaml",
            (examples / "kuka-tool", "--robot", examples / "kuka-tool" / "robot.yaml"),
        ),
    ):
        assert run("init", *arguments, "--out", out)[0] == 0
        text = out.read_text()
        fillable = re.sub(r"^(\s*)# (?=(known|uncertainty|position|rpy_deg|target|frame|noise|calibration|end|acts_on|gravity|clock|window): )", r"\1", text, flags=re.M)  # fmt: skip
        fillable = fillable.replace("x: …", "x: 0").replace("xx: …", "xx: 1")
        assert fillable.count("calibration:") >= 3
        out.write_text(fillable)
        read_experiment(out)


def test_places_that_no_log_tells_are_wide(tmp_path, run, streams):
    """Until they are stated: what is not known is not five millimetres wrong."""
    write_heap(tmp_path / "heap", streams)
    out = tmp_path / "e.yaml"
    assert run("init", tmp_path / "heap", "--robot", "cogiro", "--out", out)[0] == 0
    experiment = read_experiment(out)
    size = read_robot("cogiro").size
    for instrument in experiment.instruments.values():
        key = {"imu": "position", "position": "target"}.get(instrument.kind)
        if key is not None:
            sigma = getattr(instrument.calibration, key).sigma
            assert 0.3 * size < sigma < 3 * size
    lines = [line for line in out.read_text().splitlines() if "is not known, anywhere" in line]
    assert len(lines) >= 2


def test_an_editor_finds_the_schema(tmp_path, run, streams):
    write_heap(tmp_path / "heap", streams)
    assert run("schema", "--out", tmp_path / "experiment.schema.json")[0] == 0
    assert run("init", tmp_path / "heap", "--robot", "cogiro", "--out", tmp_path / "e.yaml")[0] == 0
    first = (tmp_path / "e.yaml").read_text().splitlines()[0]
    assert first == "# yaml-language-server: $schema=experiment.schema.json"


@pytest.mark.integration
def test_a_bag_is_a_stream_per_topic(tmp_path, run, streams):
    writer = pytest.importorskip("mcap.writer")
    with (tmp_path / "bag.mcap").open("wb") as file:
        bag = writer.Writer(file)
        bag.start()
        schema = bag.register_schema("any", "jsonschema", b"{}")
        messages = {
            "/load_cells": ("cables", lambda v, i: {"data": v["tension"][i].tolist()}),
            "/imu": (
                "imu",
                lambda v, i: {
                    "angular_velocity": dict(
                        zip(AXES, v["angular_velocity"][i].tolist(), strict=True)
                    ),
                    "linear_acceleration": dict(
                        zip(AXES, v["specific_force"][i].tolist(), strict=True)
                    ),
                },
            ),
            "/leica": (
                "tracker",
                lambda v, i: {"point": dict(zip(AXES, v["position"][i].tolist(), strict=True))},
            ),
        }
        for topic, (name, message) in messages.items():
            channel = bag.register_channel(topic, "json", schema)
            for i, t in enumerate(streams[name].time - streams[name].time[0] + EPOCH):
                stamp = {"sec": int(t), "nanosec": int((t % 1) * 1e9)}
                data = json.dumps(
                    {"header": {"stamp": stamp}, **message(streams[name].values, i)}
                ).encode()
                bag.add_message(
                    channel, log_time=int(t * 1e9), publish_time=int(t * 1e9), data=data
                )
        bag.finish()
    assert (
        run("init", tmp_path / "bag.mcap", "--robot", "cogiro", "--out", tmp_path / "e.yaml")[0]
        == 0
    )
    experiment = read_experiment(tmp_path / "e.yaml")
    assert set(experiment.runs[0].streams) == {"cables", "imu", "tracker"}
    assert not experiment.runs[0].unsynchronised
    assert_same(
        experiment, 0, {n: s for n, s in streams.items() if n != "imu"}, ("cables", "tracker")
    )


@pytest.mark.integration
def test_groups_of_a_file_of_arrays(tmp_path, run, streams):
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "day.h5", "w") as file:
        for group, name, quantity in (
            ("load_cells", "cables", "tension"),
            ("leica", "tracker", "position"),
        ):
            file[f"{group}/time"] = streams[name].time
            file[f"{group}/{quantity}"] = streams[name].values[quantity]
    assert (
        run("init", tmp_path / "day.h5", "--robot", "cogiro", "--out", tmp_path / "e.yaml")[0] == 0
    )
    experiment = read_experiment(tmp_path / "e.yaml")
    assert_same(
        experiment, 0, {n: streams[n] for n in ("cables", "tracker")}, ("cables", "tracker")
    )


def test_a_table_of_all_instants_has_the_rate_of_each_instrument(tmp_path, run, streams):
    """Programs that plot write one table with a row for every sample of anything, and empty cells
    beside it."""
    frames = []
    for name, pattern in (("cables", "/lc/data[{}]"), ("tracker", "/leica/point/{}")):
        stream = streams[name]
        rows = next(iter(stream.values.values())).T
        names = range(8) if name == "cables" else AXES
        table = {pattern.format(k): row for k, row in zip(names, rows, strict=True)}
        frames.append(pl.DataFrame({"__time": stream.time - stream.time[0] + EPOCH, **table}))
    pl.concat(frames, how="diagonal").sort("__time").write_csv(tmp_path / "plot.csv")
    assert (
        run("init", tmp_path / "plot.csv", "--robot", "cogiro", "--out", tmp_path / "e.yaml")[0]
        == 0
    )
    experiment = read_experiment(tmp_path / "e.yaml")
    assert experiment.instruments["cables"].rate == pytest.approx(25, rel=0.01)
    assert experiment.instruments["tracker"].rate == pytest.approx(238, rel=0.01)


def test_columns_without_names():
    """As many as an instrument has, with a time in front; what three of them are, the name of the
    file says."""
    (cables,) = claims_of([f"[{i}]" for i in range(9)], 8, [])
    assert cables.times == ("[0]",)
    assert cables.columns["f8"] == "[8]"
    (tracker,) = claims_of([f"[{i}]" for i in range(4)], 8, ["leica"])
    assert (tracker.kind, dict(tracker.columns)) == (
        "position",
        {"x": "[1]", "y": "[2]", "z": "[3]"},
    )
    assert claims_of([f"[{i}]" for i in range(4)], 8, ["file"]) == []


@pytest.mark.integration
def test_logs_made_to_be_slow_are_bounded():
    names = [f"a{i}_{'1_' * 90}x{i}" for i in range(3000)]
    with bounded(3):
        claims_of(names, 8, [])


# What goes wrong


def test_names_from_anyone_do_not_steer_the_file(tmp_path, run, streams):
    cables, tracker = streams["cables"], streams["tracker"]
    evil = 'x: {} #\n"\x1b[31m\\'
    folder = tmp_path / 'a: "b" #\n- c'
    write(
        folder / "f.csv",
        {"t": cables.time, **{f"f{i + 1}": f for i, f in enumerate(cables.values["tension"].T)}},
    )
    table = {
        "t": tracker.time,
        **dict(zip(AXES, tracker.values["position"].T, strict=True)),
        evil: tracker.time,
    }
    pl.DataFrame(table).write_parquet(folder / "true.parquet")
    status, printed, _ = run("init", folder, "--robot", "cogiro", "--out", tmp_path / "e.yaml")
    assert status == 0
    assert "\x1b" not in printed
    experiment = read_experiment(tmp_path / "e.yaml")
    assert set(experiment.runs[0].streams) == {"cables", "tracker"}


@pytest.mark.parametrize(
    "text", ["plain", "1", "1e5", "true", "No", "~", "a: b", "#", "-", "'", '"', "\\", "\n", "\u2028", "\x85", "é", "𝄞", "", " a", "*a", "&a", "!t", "..", "0x1F", "2020-01-01", "[", "{", "%", "@", "`", "../a/b.csv"]
)  # fmt: skip
def test_any_text_is_read_back(tmp_path, text):
    (tmp_path / "t.yaml").write_text(f"key: {scalar(text)}\n", encoding="utf-8")
    assert read_yaml(tmp_path / "t.yaml").data == {"key": text}


@pytest.mark.parametrize(
    ("logs", "message"),
    [
        ("nowhere", "expected a log or a folder with logs, found nothing of that name"),
        ("empty", "expected logs in one of the formats"),
        ("notes.md", "expected logs in one of the formats"),
        ("small/moving/imu.csv", "expected logs of forces .* and of motion .* found imu"),
        ("strange.csv", "expected columns of an instrument, found none that is known"),
    ],
)
def test_nothing_usable(tmp_path, run, logs, message):
    write_small(tmp_path / "small")
    (tmp_path / "empty").mkdir()
    (tmp_path / "notes.md").write_text("none")
    (tmp_path / "strange.csv").write_text("apples,pears\n1,2\n3,4\n")
    status, printed, sentence = run(
        "init", tmp_path / logs, "--robot", "cogiro", "--out", tmp_path / "e.yaml"
    )
    assert (status, printed) == (2, "")
    assert re.search(message, sentence)
    assert sentence.count("\n") == 1
    assert not (tmp_path / "e.yaml").exists()


@pytest.mark.integration
def test_nothing_is_overwritten(tmp_path, run, streams):
    write_heap(tmp_path / "heap", streams)
    out = tmp_path / "e.yaml"
    out.write_text("mine")
    arguments = ("init", tmp_path / "heap", "--robot", "cogiro", "--out", out)
    assert run(*arguments)[0] == 2
    assert out.read_text() == "mine"
    assert run(*arguments, "--force")[0] == 0
    once = out.read_bytes()
    assert run(*arguments, "--force")[0] == 0
    assert out.read_bytes() == once
    assert not list(tmp_path.glob(".steelyard-*"))


def test_tensions_in_kilogram_force_and_of_the_wrong_sign(tmp_path, run, streams):
    cables, tracker = streams["cables"], streams["tracker"]
    # A heavy platform that hangs from slack cables: the sum of tensions is about its weight.
    weight = read_robot("cogiro").platform.mass
    forces = np.full((len(cables), 8), -weight / 6)
    write(
        tmp_path / "f.csv",
        {"t": cables.time, **{f"tension{i + 1}": f for i, f in enumerate(forces.T)}},
    )
    write(
        tmp_path / "p.csv",
        {"t": tracker.time, **dict(zip(AXES, tracker.values["position"].T, strict=True))},
    )
    assert run("init", tmp_path, "--robot", "cogiro", "--out", tmp_path / "e.yaml")[0] == 0
    experiment = read_experiment(tmp_path / "e.yaml")
    assert experiment.instruments["cables"].scale == -1
    assert experiment.runs[0].streams["cables"].values["tension"][0, 0] == pytest.approx(
        weight / 6 * 9.80665
    )
