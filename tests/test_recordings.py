"""Recordings of another simulator than ours, and of a real robot: the figures that the README
states."""

import json

import numpy as np
import pytest

from steelyard.experiment.read import read_experiment
from steelyard.identification.identify import identify
from steelyard.identification.methods.two_step import TwoStep

pytestmark = pytest.mark.integration


def errors(recordings, recorded_truth, name, method):
    estimate = method(read_experiment(recordings / name / "experiment.yaml"))
    return estimate, estimate.value - recorded_truth[name].body_parameters


@pytest.mark.parametrize("acceleration", ["imu", "tracker"])
def test_ideal_sensors(recordings, recorded_truth, acceleration):
    _, error = errors(
        recordings, recorded_truth, "ideal-points", TwoStep(acceleration=acceleration)
    )
    truth = recorded_truth["ideal-points"].body_parameters
    assert abs(error[0]) < 5e-4 * truth[0]
    assert np.abs(error[1:4]).max() < 1e-3
    assert np.all(np.abs(error[4:7]) < 0.01 * truth[4:7])


@pytest.mark.parametrize("acceleration", ["imu", "tracker"])
@pytest.mark.parametrize("name", ["points-00", "points-01", "points-02", "points-03"])
def test_the_sensors_of_the_paper(recordings, recorded_truth, name, acceleration):
    estimate, error = errors(recordings, recorded_truth, name, TwoStep(acceleration=acceleration))
    truth = recorded_truth[name].body_parameters
    assert abs(error[0]) < 0.02 * truth[0]
    assert np.all(np.abs(error[4:7]) < 0.25 * truth[4:7])
    assert estimate.verdict.accepted is None


@pytest.fixture(scope="module")
def kuka(examples):
    return read_experiment(examples / "kuka-tool" / "experiment.yaml")


def only(experiment, *names):
    from dataclasses import replace

    return replace(experiment, runs=tuple(run for run in experiment.runs if run.name in names))


def test_kuka_static_poses(kuka):
    estimate = TwoStep()(only(kuka, "poses"))
    assert abs(estimate.value[0] - 0.932) < 0.004
    assert np.abs(estimate.value[1:4] - [0.0003, 0, 0.0439]).max() < 0.5e-3
    assert np.isnan(estimate.value[4:]).all()


@pytest.mark.parametrize("runs", [("baseline",), ("vibrations",), ("baseline", "vibrations")])
def test_kuka_moving_runs(kuka, runs):
    estimate = TwoStep()(only(kuka, *runs))
    assert abs(estimate.value[0] / 0.932 - 1) < 0.015
    # They turn about y: where the centre of gravity is along it, they cannot tell.
    assert np.isnan(estimate.value[2])


def test_kuka_all_runs(kuka):
    estimate = identify(kuka, [TwoStep()]).estimates["two-step"]
    assert abs(estimate.value[0] - 0.932) < 0.004
    assert np.abs(estimate.value[1:4] - [0.0003, 0, 0.0439]).max() < 0.5e-3
    untold = [
        name for name, label in estimate.verdict.parameters.items() if label == "unidentifiable"
    ]
    assert {"Jxx", "Jzz", "Jxz"} <= set(untold)
    assert any(
        "not identifiable from these data" in note and "Jxx" in note for note in estimate.notes
    )
    offset = estimate.calibration["wrench"]["offset"]
    # The sign of the stored reading is that of the sensor: its own offset is the data set's with
    # the sign turned.
    np.testing.assert_allclose(offset["force"]["value"], [9.077, -1.018, 9.985], atol=0.1)


def test_table_iii_is_shown_to_be_no_body(examples, capsys):
    import runpy

    runpy.run_path(str(examples / "table-iii" / "show.py"))
    out = capsys.readouterr().out
    assert "estimated: 170.740 kg, principal moments 40.48, 58.58, 103.26" in out
    assert "4.20 kg m^2 less" in out
    values = json.loads((examples / "table-iii" / "estimate.json").read_text())
    assert values["format"] == "steelyard-estimate/1"
