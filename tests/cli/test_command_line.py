"""The verbs from outside: what they print, what they write, and how they end."""

import json
import os
import pty
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest
from recordings import save, table, write_small
from time_limits import finished

from steelyard.experiment.read import read_experiment
from steelyard.inertia import BODY_PARAMETERS, Inertia
from steelyard.report import write
from steelyard.robot.file import bundled_names, read_robot
from steelyard.simulation import simulate as simulation

pytestmark = pytest.mark.integration

VERBS = ("demo", "robots", "simulate", "identify", "design", "compare", "export")
PROCESS = [sys.executable, "-m", "steelyard"]
QUICK = ["--duration", "2"]


@pytest.fixture
def small(tmp_path):
    return write_small(tmp_path / "small")


def no_number(text):
    raise AssertionError(f"JSON has no {text}")


def parsed(text):
    return json.loads(text, parse_constant=no_number)


def files(folder):
    return {
        str(p.relative_to(folder)): p.read_bytes()
        for p in sorted(Path(folder).rglob("*"))
        if p.is_file()
    }


def change_cells(path, names, change):
    rows = table(path)
    for name in names:
        j = rows[0].index(name)
        for row in rows[1:]:
            row[j] = repr(change(float(row[j])))
    save(path, rows)


CABLES = [f"f{i}" for i in range(1, 9)]


# Help


@pytest.mark.parametrize("verb", ["", *VERBS])
@pytest.mark.parametrize("option", ["--help", "-h"])
def test_every_verb_helps(run, verb, option):
    status, out, err = run(*verb.split(), option)
    assert (status, err) == (0, "")
    assert out.startswith("Usage: ")
    assert f" {verb}" in out
    assert "--help" in out
    if verb:
        assert "--json" in out
        assert "--quiet" in out


def test_help_names_every_verb_and_the_exit_status(run):
    out = run("--help")[1]
    assert all(f"\n  {verb} " in out for verb in VERBS)
    assert all(f"{status} " in out.split("Exit status:")[1] for status in (0, 2, 3))


def test_version_is_that_of_the_package(run):
    status, out, err = run("--version")
    assert (status, err) == (0, "")
    assert out.strip().endswith(version("steelyard"))


LIGHT = """
import sys
from steelyard.cli import main
sys.argv = ["steelyard", "--help"]
try:
    main()
except SystemExit:
    pass
heavy = {"numpy", "scipy", "casadi", "polars", "pydantic", "ruamel.yaml", "clarabel", "llvmlite"} & set(sys.modules)
sys.exit(f"imported {heavy}" if heavy else 0)
"""


def test_help_waits_for_no_heavy_import():
    ended = finished([sys.executable, "-c", LIGHT], capture_output=True, text=True)
    assert (ended.returncode, ended.stderr) == (0, "")


# Robots


def test_robots_lists_what_is_bundled(run):
    status, out, err = run("robots")
    assert (status, err) == (0, "")
    assert [line.split()[0] for line in out.splitlines()] == bundled_names()
    assert "8 cables" in out
    assert "161.058 kg" in out


def test_robots_as_json(run):
    listed = parsed(run("robots", "--json")[1])["robots"]
    assert [robot["name"] for robot in listed] == bundled_names()
    assert listed[0] == {"name": "cogiro", "cables": 8, "mass": 161.058}


@pytest.mark.parametrize("name", bundled_names())
@pytest.mark.parametrize("option", [[], ["--json"]])
def test_a_printed_robot_is_a_robot_file(run, tmp_path, name, option):
    status, out, err = run("robots", name, *option)
    assert (status, err) == (0, "")
    (tmp_path / "copy.yaml").write_text(out)
    copy, original = read_robot(str(tmp_path / "copy.yaml")), read_robot(name)
    assert copy.name == original.name
    assert copy.cable == original.cable
    assert copy.tension_limits == original.tension_limits
    for field in ("anchors", "attachments", "gravity", "pulley_radius", "pulley_axis"):
        np.testing.assert_array_equal(getattr(copy, field), getattr(original, field))
    np.testing.assert_allclose(
        copy.platform.body_parameters, original.platform.body_parameters, rtol=1e-12
    )
    np.testing.assert_allclose(np.array(copy.limits.rpy), np.array(original.limits.rpy), rtol=1e-12)


# Simulate


def test_simulate_writes_an_experiment_and_its_truth(run, tmp_path):
    status, out, err = run("simulate", "cogiro", *QUICK, "--out", tmp_path / "out")
    assert (status, err) == (0, "")
    assert "experiment.yaml" in out
    assert set(files(tmp_path)) == {
        "out/experiment.yaml",
        "out/truth.json",
        *(f"out/multisine/{name}.csv" for name in ("cables", "imu", "tracker", "command")),
    }
    experiment = read_experiment(tmp_path / "out" / "experiment.yaml")
    assert experiment.robot.name == "cogiro"
    assert all(
        stream.time[-1] - stream.time[0] > 1.8 for stream in experiment.runs[0].streams.values()
    )
    truth = parsed((tmp_path / "out" / "truth.json").read_text())
    body = Inertia(truth["mass"], np.array(truth["center_of_gravity"]), np.array(truth["inertia"]))
    np.testing.assert_allclose(body.body_parameters, experiment.robot.platform.body_parameters)
    assert set(truth["calibration"]) == set(experiment.instruments)
    for name, instrument in experiment.instruments.items():
        for term in instrument.terms(8):
            value = truth["calibration"][name]
            for part in term.key.split("."):
                value = value[part]
            assert np.shape(value) == (term.size,)


def test_the_same_seed_gives_the_same_bytes(run, tmp_path):
    for folder, seed in (("one", 4), ("two", 4), ("other", 5)):
        run("simulate", "cogiro", *QUICK, "--seed", seed, "--out", tmp_path / folder)
    one, two, other = (files(tmp_path / name) for name in ("one", "two", "other"))
    assert one == two
    assert one.keys() == other.keys()
    assert all(
        one[name] != other[name] for name in one if name.endswith(("cables.csv", "truth.json"))
    )


def test_simulate_as_json(run, tmp_path):
    status, out, err = run("simulate", "cogiro", *QUICK, "--out", tmp_path / "out", "--json")
    assert (status, err) == (0, "")
    answer = parsed(out)
    assert Path(answer["experiment"]).is_file()
    assert Path(answer["truth"]).is_file()
    assert answer["samples"]["multisine"]["cables"] == 50


def test_a_robot_file_that_borrows_a_bundled_name_is_the_one_that_was_simulated(run, tmp_path):
    text = run("robots", "cogiro")[1].replace("mass: 161.058", "mass: 120.0")
    (tmp_path / "own.yaml").write_text(text)
    assert run("simulate", tmp_path / "own.yaml", *QUICK, "--out", tmp_path / "out")[0] == 0
    experiment = read_experiment(tmp_path / "out" / "experiment.yaml")
    assert parsed((tmp_path / "out" / "truth.json").read_text())["mass"] == 120.0
    assert experiment.robot.platform.mass == 120.0


SENSORS = """\
sync: 0.01
instruments:
  winches: {kind: tension, rate: 20, noise: 1, calibration: {offset: 2, gain: {sigma: 0.01, per: run}}}
  camera: {kind: pose, rate: 50, position: [0.1, 0, 0.2], noise: {position: 0.001, rotation: 0.001}}
  gyro: {kind: imu, rate: 100, calibration: {gyro_bias: {value: 0.1, sigma: 0}, position: 0}}
  encoders: {kind: length, rate: 10}
"""
COMMAND = "t,x,y,z,roll,pitch,yaw\n" + "".join(
    f"{10 + 0.5 * t},{0.02 * t},0,2,0,0,{0.01 * t}\n" for t in range(8)
)


def test_sensors_and_trajectory_from_files(run, tmp_path):
    (tmp_path / "sensors.yaml").write_text(SENSORS)
    (tmp_path / "drift.csv").write_text(COMMAND)
    options = ["--sensors", tmp_path / "sensors.yaml", "--trajectory", tmp_path / "drift.csv"]
    assert run("simulate", "cogiro", *options, "--out", tmp_path / "out")[0] == 0
    experiment = read_experiment(tmp_path / "out" / "experiment.yaml")
    truth = parsed((tmp_path / "out" / "truth.json").read_text())["calibration"]
    assert [r.name for r in experiment.runs] == ["drift"]
    rates = {name: len(stream) / 3.5 for name, stream in experiment.runs[0].streams.items()}
    for name, rate in {"winches": 20, "camera": 50, "gyro": 100, "encoders": 10}.items():
        assert rates[name] == pytest.approx(rate, rel=0.05)
    assert truth["gyro"]["gyro_bias"] == [0.1, 0.1, 0.1]
    assert truth["gyro"]["position"] == [0.0, 0.0, 0.0]
    assert len(truth["winches"]["gain"]["drift"]) == 8
    # The platform was told to end 14 cm from where it began.
    place = experiment.runs[0].streams["camera"].values["position"]
    assert np.linalg.norm(place[-5:].mean(axis=0) - place[:5].mean(axis=0)) > 0.1


BODY = """\
name: tool
cables: []
platform: {mass: 4.2, center_of_gravity: [0.02, -0.03, 0.08], inertia: {xx: 0.05, yy: 0.06, zz: 0.03, xy: 0.002}}
"""


@pytest.mark.slow
def test_a_body_on_a_wrench_sensor_from_simulation_to_estimate(run, tmp_path):
    (tmp_path / "tool.yaml").write_text(BODY)
    assert (
        run("simulate", tmp_path / "tool.yaml", "--sensors", "ideal", "--out", tmp_path / "out")[0]
        == 0
    )
    status, out, err = run("identify", tmp_path / "out" / "experiment.yaml", "--json")
    assert (status, err) == (0, "")
    estimate = parsed(out)["estimates"]["two-step"]
    assert estimate["mass"] == pytest.approx(4.2, rel=1e-3)
    np.testing.assert_allclose(estimate["center_of_gravity"], [0.02, -0.03, 0.08], atol=1e-3)
    np.testing.assert_allclose(np.diag(estimate["inertia"]), [0.05, 0.06, 0.03], atol=2e-3)


LOADS = """\
loads:
  empty: {}
  weight: {added: {mass: {value: 32.2, sigma: 0.01}, center_of_gravity: {x: 0, y: 0, z: 0.3}}}
order: [empty, weight, empty]
"""


@pytest.mark.slow
def test_loads_are_simulated_and_their_errors_printed(run, tmp_path):
    (tmp_path / "loads.yaml").write_text(LOADS)
    options = ["--duration", 6, "--loads", tmp_path / "loads.yaml"]
    status, out, err = run("simulate", "cogiro", *options, "--out", tmp_path / "out")
    assert (status, err) == (0, "")
    assert "3 runs of cogiro" in out
    assert "multisine empty 2:" in out
    truth = parsed((tmp_path / "out" / "truth.json").read_text())["loads"]
    experiment = tmp_path / "out" / "experiment.yaml"
    status, out, err = run("identify", experiment, "--method", "maximum-likelihood")
    assert err == ""
    printed = out[out.index("differences of loads") :].split("mass ")[1].splitlines()[0]
    # mass, unit, value ± 1-sigma, error; the first of these is the unit.
    value, error = float(printed.split()[1]), float(printed.split()[4])
    added = truth["weight"]["mass"] - truth["empty"]["mass"]
    assert value - error == pytest.approx(added, abs=2e-3)
    assert out[out.index("each load by") :].splitlines()[2].count("error") == 2


# Identify


@pytest.mark.slow
def test_identify_without_a_folder_writes_nothing(run, small, tmp_path, monkeypatch):
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    before = files(tmp_path)
    status, out, err = run("identify", small)
    assert (status, err) == (0, "")
    assert "two-step: baseline, not assessed" in out
    assert "two-step: accepted" not in out
    assert files(tmp_path) == before
    assert not any((tmp_path / "here").iterdir())


def is_number_or_null(value):
    return value is None or (isinstance(value, float) and bool(np.isfinite(value)))


def assert_has_the_shape_of_the_contract(estimate):
    for values in (estimate, estimate["standard_deviation"]):
        assert is_number_or_null(values["mass"])
        assert len(values["center_of_gravity"]) == 3
        assert np.shape(values["inertia"]) == (3, 3)
        assert all(
            is_number_or_null(v)
            for v in [*values["center_of_gravity"], *np.ravel(values["inertia"])]
        )
    assert estimate["covariance"]["parameters"] == list(BODY_PARAMETERS)
    assert np.shape(estimate["covariance"]["matrix"]) == (10, 10)
    assert isinstance(estimate["physical"], bool)
    assert isinstance(estimate["calibration"], dict)
    assert estimate["verdict"]["accepted"] in (True, False, None)
    assert isinstance(estimate["verdict"]["reasons"], list)
    assert estimate["verdict"]["parameters"].keys() == set(BODY_PARAMETERS)
    assert set(estimate["verdict"]["parameters"].values()) <= {"data", "prior", "unidentifiable"}


@pytest.mark.slow
def test_what_identify_writes_has_the_shape_of_the_contract(run, small, tmp_path):
    status, out, err = run("identify", small, "--out", tmp_path / "out")
    assert (status, err) == (0, "")
    assert "two-step" in out
    answer = parsed((tmp_path / "out" / "estimate.json").read_text())
    assert list(answer) == [
        "format",
        "experiment",
        "nominal",
        "result",
        "estimates",
        "recordings",
        "attainable",
        "provenance",
    ]
    assert answer["format"] == "steelyard-estimate/1"
    assert answer["experiment"] == "small"
    assert answer["nominal"]["mass"] == 161.058
    assert answer["nominal"]["center_of_gravity"] == [-0.001, -0.077, -0.118]
    assert answer["nominal"]["inertia"][0] == pytest.approx([94.955, -0.393, -0.085])
    assert answer["result"] in answer["estimates"]
    for estimate in answer["estimates"].values():
        assert_has_the_shape_of_the_contract(estimate)
    estimate = answer["estimates"]["two-step"]
    covariance = np.array(estimate["covariance"]["matrix"])
    sigma = estimate["standard_deviation"]
    assert np.sqrt(covariance[0, 0]) == pytest.approx(sigma["mass"])
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)[1:4]), sigma["center_of_gravity"])
    J = np.array(sigma["inertia"])
    np.testing.assert_allclose(
        np.sqrt(np.diag(covariance)[4:]), [J[0, 0], J[1, 1], J[2, 2], J[1, 2], J[0, 2], J[0, 1]]
    )
    np.testing.assert_array_equal(estimate["inertia"], np.transpose(estimate["inertia"]))
    report = (tmp_path / "out" / "report.md").read_text()
    assert report.startswith("# small\n")


@pytest.mark.slow
def test_identify_as_json_is_what_it_writes(run, small, tmp_path):
    status, out, err = run("identify", small, "--json", "--out", tmp_path / "out")
    assert (status, err) == (0, "")
    assert out == (tmp_path / "out" / "estimate.json").read_text()
    assert parsed(out)["estimates"]["two-step"]["verdict"]["accepted"] is None
    assert parsed(out)["estimates"]["maximum-likelihood"]["verdict"]["accepted"] is True


def test_a_baseline_alone_is_neither_accepted_nor_rejected(run, small, tmp_path):
    status, out, err = run("identify", small, "--method", "two-step", "--out", tmp_path / "out")
    assert (status, err) == (0, "")
    assert "Baseline, not assessed: " in out
    assert ": accepted" not in out
    report = (tmp_path / "out" / "report.md").read_text()
    assert "Baseline, not assessed" in report
    assert ": accepted" not in report
    status, _, err = run("export", tmp_path / "out", "--format", "yaml", "--out", tmp_path / "b")
    assert status == 2
    assert "found a baseline that was not assessed" in err


@pytest.mark.slow
def test_identify_twice_gives_the_same_bytes(run, small, tmp_path):
    for name in ("one", "two"):
        run("identify", small, "--out", tmp_path / name)
    one, two = files(tmp_path / "one"), files(tmp_path / "two")
    # What differs between runs, the time, has a file of its own.
    assert one.pop("provenance.json")
    assert two.pop("provenance.json")
    assert one == two


@pytest.mark.slow
def test_results_may_lie_beside_the_experiment(run, small):
    before = files(small.parent)
    assert run("identify", small, "--out", small.parent, "--force")[0] == 0
    after = files(small.parent)
    assert set(after) - set(before) == {
        "estimate.json", "report.html", "report.json", "report.md", "motion.parquet",
        "provenance.json",
    }  # fmt: skip
    assert {name: after[name] for name in before} == before


@pytest.mark.slow
@pytest.mark.parametrize(
    "options",
    [
        ["--method", "two-step", "--method", "maximum-likelihood"],
        ["--run", "moving"],
        ["--method", "two-step", "--method", "maximum-likelihood"] * 2,
    ],
)
def test_options_that_ask_for_what_is_done_anyway(run, small, options):
    assert run("identify", small, "--json", *options) == run("identify", small, "--json")


@pytest.mark.slow
def test_a_run_can_be_chosen(run, small):
    alone = parsed(run("identify", small, "--json")[1])
    text = small.read_text()
    second = text[text.index("  - name: moving") :].replace("name: moving", "name: again")
    small.write_text(text + second)
    chosen = parsed(run("identify", small, "--json", "--run", "again")[1])
    assert chosen["estimates"]["two-step"]["mass"] == alone["estimates"]["two-step"]["mass"]
    assert set(parsed(run("identify", small, "--json")[1])["estimates"]["two-step"]["runs"]) == {
        "moving",
        "again",
    }


@pytest.mark.slow
def test_the_acceleration_can_come_from_the_tracker(run, small):
    imu, tracker = (
        parsed(run("identify", small, "--json", "--acceleration", which)[1])["estimates"][
            "two-step"
        ]["mass"]
        for which in ("imu", "tracker")
    )
    assert imu != tracker
    assert tracker == pytest.approx(imu, rel=0.05)


@pytest.mark.slow
def test_the_truth_of_a_simulation_stands_beside_the_estimate(run, small):
    truth = Inertia(163.25, np.zeros(3), np.diag([95.0, 89.0, 32.0]))
    (small.parent / "truth.json").write_text(json.dumps(truth.to_dict()))
    out = run("identify", small)[1]
    assert "truth" in out
    assert "163.25" in out


@pytest.mark.slow
@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        "3",
        '{"mass": 1}',
        '{"mass": "a", "center_of_gravity": [0, 0], "inertia": 3}',
        (
            '{"mass": NaN, "center_of_gravity": [0, 0, 0], "inertia": [[1, 0, 0], [0, 1, 0], [0, 0,'
            " 1]]}"
        ),
        (
            f'{{"mass": 1{"0" * 400}, "center_of_gravity": [0, 0, 0], "inertia": [[1, 0, 0], [0, 1,'
            " 0], [0, 0, 1]]}"
        ),
        (
            '{"mass": 1, "center_of_gravity": [[0], [0, 0]], "inertia": [[1, 0, 0], [0, 1, 0], [0,'
            " 0, 1]]}"
        ),
        "[" * 100_000,
        b"\xff\xfe\x00",
    ],
)
def test_a_truth_that_makes_no_sense_is_none(run, small, text):
    (small.parent / "truth.json").write_bytes(text if isinstance(text, bytes) else text.encode())
    status, out, err = run("identify", small)
    assert (status, err) == (0, "")
    assert "truth" not in out


@pytest.mark.slow
def test_a_truth_that_never_ends_is_none(small):
    os.mkfifo(small.parent / "truth.json")
    ended = finished([*PROCESS, "identify", str(small)], capture_output=True, text=True)
    assert (ended.returncode, ended.stderr) == (0, "")


# Not accepted


def not_accepted(run, small, tmp_path, *options):
    """Ends with exit status 3, and what it wrote says the same."""
    status, out, err = run("identify", small, "--out", tmp_path / "out", *options)
    assert (status, err) == (3, "")
    assert "ot accepted: " in out
    answer = parsed((tmp_path / "out" / "estimate.json").read_text())
    assert "not accepted" in (tmp_path / "out" / "report.md").read_text()
    estimate = answer["estimates"][answer["result"]]
    assert_has_the_shape_of_the_contract({**estimate, "physical": bool(estimate["physical"])})
    assert estimate["verdict"]["accepted"] is False
    assert estimate["verdict"]["reasons"]
    return estimate


def test_pushing_cables_are_not_accepted(run, small, tmp_path):
    change_cells(small.parent / "moving" / "cables.csv", CABLES, lambda f: -f)
    estimate = not_accepted(run, small, tmp_path)
    assert estimate["mass"] < 0
    assert estimate["physical"] is False


@pytest.mark.slow
def test_an_inertia_that_no_body_has_is_not_accepted(run, small, tmp_path):
    # Turning about x told faster than it was makes the moment about it small, less than the others
    # differ.
    change_cells(small.parent / "moving" / "imu.csv", ["wx"], lambda w: 3 * w)
    estimate = not_accepted(run, small, tmp_path, "--method", "two-step")
    assert estimate["physical"] is False
    assert "no body has this inertia" in estimate["verdict"]["reasons"][0]


@pytest.mark.slow
def test_a_moment_below_zero_is_not_accepted_though_others_are_not_identifiable(
    run, small, tmp_path
):
    change_cells(small.parent / "moving" / "cables.csv", CABLES, lambda f: 600.0)
    estimate = parsed(run("identify", small, "--json")[1])["estimates"]["two-step"]
    moments = [J for J in np.diag(np.array(estimate["inertia"], dtype=float)) if np.isfinite(J)]
    assert min(moments) < 0
    assert estimate["physical"] is False
    assert estimate["verdict"]["accepted"] is False


def test_forces_of_zero_are_not_accepted(run, small, tmp_path):
    change_cells(small.parent / "moving" / "cables.csv", CABLES, lambda f: 0.0)
    not_accepted(run, small, tmp_path)


def test_not_accepted_without_a_folder_ends_in_the_same_way(run, small):
    change_cells(small.parent / "moving" / "cables.csv", CABLES, lambda f: -f)
    before = files(small.parent)
    status, out, err = run("identify", small, "--json")
    assert (status, err) == (3, "")
    assert parsed(out)["estimates"]["two-step"]["verdict"]["accepted"] is False
    assert files(small.parent) == before


# Force


@pytest.mark.slow
@pytest.mark.parametrize("verb", ["simulate", "identify"])
def test_force_replaces_files_of_the_same_names_alone(run, small, tmp_path, verb):
    arguments = ["simulate", "cogiro", *QUICK] if verb == "simulate" else ["identify", small]
    out = tmp_path / "out"
    assert run(*arguments, "--out", out)[0] == 0
    fresh = files(out)
    for name in fresh:
        (out / name).write_text("old")
    (out / "notes.txt").write_text("mine")
    (out / "plots").mkdir()
    (out / "plots" / "a.png").write_text("mine")
    status, _, err = run(*arguments, "--out", out)
    assert status == 2
    assert err.startswith("steelyard: ")
    assert "--force" in err
    assert files(out) == {
        **dict.fromkeys(fresh, b"old"),
        "notes.txt": b"mine",
        "plots/a.png": b"mine",
    }
    assert run(*arguments, "--out", out, "--force")[0] == 0
    assert files(out) == {**fresh, "notes.txt": b"mine", "plots/a.png": b"mine"}


# When it goes wrong on the way


@pytest.mark.parametrize("verb", ["simulate", "identify"])
def test_an_interrupt_leaves_nothing(run, small, tmp_path, monkeypatch, verb):
    def interrupt(*arguments, **options):
        raise KeyboardInterrupt

    monkeypatch.setattr(simulation if verb == "simulate" else write, "write_json", interrupt)
    arguments = ["simulate", "cogiro", *QUICK] if verb == "simulate" else ["identify", small]
    before = files(tmp_path)
    status, out, err = run(*arguments, "--out", tmp_path / "out")
    assert (status, out) == (130, "")
    assert err.strip() == "steelyard: interrupted; nothing was written"
    assert files(tmp_path) == before
    assert not (tmp_path / "out").exists()


def test_a_full_disk_is_said_in_one_sentence(run, small, tmp_path, monkeypatch):
    def fail(values, path):
        raise OSError(28, "No space left on device", str(path))

    monkeypatch.setattr(write, "write_json", fail)
    status, out, err = run("identify", small, "--out", tmp_path / "out")
    assert (status, out) == (2, "")
    assert err.count("\n") == 1
    assert "No space left on device" in err
    # The reader does not know the hidden folder that stands in for the one that was asked for.
    assert str(tmp_path / "out") in err
    assert not (tmp_path / "out").exists()


# Stdout and stderr


@pytest.mark.slow
def test_stderr_is_silent_where_nobody_looks(small, tmp_path):
    for arguments in (
        ["simulate", "cogiro", *QUICK, "--out", str(tmp_path / "out")],
        ["identify", str(small), "--out", str(tmp_path / "results")],
    ):
        ended = finished([*PROCESS, *arguments], capture_output=True, text=True)
        assert (ended.returncode, ended.stderr) == (0, "")
        assert ended.stdout


@pytest.mark.slow
@pytest.mark.parametrize("quiet", [False, True])
def test_progress_is_shown_to_a_person_only(tmp_path, quiet):
    ours, theirs = pty.openpty()
    arguments = [
        "simulate",
        "cogiro",
        *QUICK,
        "--json",
        "--out",
        str(tmp_path / "out"),
        *["--quiet"] * quiet,
    ]
    with subprocess.Popen([*PROCESS, *arguments], stdout=subprocess.PIPE, stderr=theirs) as process:
        os.close(theirs)
        shown = b""
        while True:
            try:
                part = os.read(ours, 4096)
            except OSError:
                break
            shown += part
        out = process.stdout.read()
    os.close(ours)
    assert process.returncode == 0
    assert parsed(out)["samples"]
    assert bool(shown) != quiet


def test_a_reader_that_has_gone_is_no_reason_to_complain():
    ours, theirs = os.pipe()
    os.close(ours)
    ended = finished(
        [*PROCESS, "robots", "cogiro"], stdout=theirs, stderr=subprocess.PIPE, text=True
    )
    os.close(theirs)
    assert ended.stderr == ""


@pytest.mark.slow
def test_names_in_any_bytes_are_no_trouble(small, tmp_path):
    # Names of files are bytes, and these are no UTF-8.
    folder = os.fsencode(tmp_path) + b"/\xff\xfe"
    os.rename(small.parent, folder)
    text = Path(os.fsdecode(folder), "experiment.yaml")
    text.write_text(text.read_text().replace("name: small\n", ""))
    for arguments in (
        [b"identify", folder + b"/experiment.yaml", b"--out", folder + b"/results"],
        [b"simulate", b"cogiro", b"--duration", b"2", b"--out", folder + b"/virtual"],
    ):
        ended = finished([*PROCESS, *arguments], capture_output=True)
        assert (ended.returncode, ended.stderr) == (0, b"")


@pytest.mark.slow
@pytest.mark.parametrize("encoding", ["ascii", "latin-1"])
@pytest.mark.parametrize("option", [[], ["--json"]])
def test_a_terminal_of_few_characters_is_no_trouble(small, encoding, option):
    small.write_text(small.read_text().replace("name: small", "name: Bücher → ☃"))
    environment = {**os.environ, "PYTHONIOENCODING": encoding, "PYTHONUTF8": "0"}
    command = [*PROCESS, "identify", str(small), *option]
    ended = finished(command, capture_output=True, env=environment)
    assert (ended.returncode, ended.stderr) == (0, b"")
    if option:
        parsed(ended.stdout.decode(encoding))


# The whole story


@pytest.mark.slow
@pytest.mark.long
def test_the_demo_tells_the_whole_story(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    status, out, err = run("demo")
    assert (status, err) == (0, "")
    assert "truth" in out
    assert ": accepted" in out
    assert "not accepted" not in out
    assert max(map(len, out.splitlines())) <= 80
    assert "161.058 kg" in out.splitlines()[0]  # before anything is computed
    folder = tmp_path / "steelyard-demo"
    assert {"experiment.yaml", "truth.json", "estimate.json", "report.md"} <= set(files(folder))
    estimate = parsed((folder / "estimate.json").read_text())["estimates"]["two-step"]
    assert_has_the_shape_of_the_contract(estimate)
    assert estimate["mass"] == pytest.approx(161.058, rel=0.03)
    before = files(tmp_path)
    # What it printed can be done next, and a second demo does not replace the first unasked.
    assert run("identify", folder / "paper-moves" / "experiment.yaml", "--acceleration", "tracker")[
        0
    ] in (0, 3)
    status, out, err = run("demo")
    assert (status, out) == (2, "")
    assert "--force" in err
    assert files(tmp_path) == before
