"""Which modes pushes have excited, against sinusoids that are known and MuJoCo's linear model."""

from dataclasses import replace

import numpy as np
import pytest
from mujoco_swings import BODY, swinging_robot, swings
from places import ROOT
from scipy.spatial.transform import Rotation

from steelyard.experiment.model import Experiment
from steelyard.experiment.read import read_experiment
from steelyard.experiment.recording import Run, Stream
from steelyard.identification.identify import identify
from steelyard.identification.samples.preparation import prepare
from steelyard.identification.samples.turned_winches import turned_winches
from steelyard.inspection.inspect import inspect
from steelyard.inspection.swings import excited_modes, slack_cables
from steelyard.natural_frequencies.frequencies import frequencies
from steelyard.report.blocks.document import Grid
from steelyard.report.documents.identification import document_of
from steelyard.report.evidence.summary import summarise

NOISE = 3e-4
EXAMPLE = ROOT / "examples" / "free-swinging" / "three-cables" / "experiment.yaml"
FOUR_CABLES = EXAMPLE.parents[1] / "four-cables" / "experiment.yaml"


def recorded(modes, seed=0, duration=10.0):
    """A run with damped sinusoids of given frequency [Hz], decay [1/s] and amplitude [m]."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, duration, 0.01)
    position = np.zeros((len(time), 3))
    for frequency, decay, amplitude in modes:
        shape = rng.normal(size=3)
        shape *= amplitude / np.linalg.norm(shape)
        phase = 2 * np.pi * frequency * time + rng.uniform(0, 6)
        position += np.outer(np.exp(-decay * time) * np.sin(phase), shape)
    position += NOISE * rng.normal(size=position.shape)
    turned = np.tile(np.eye(3), (len(time), 1, 1))
    stream = Stream(time, {"position": position, "orientation": turned}, "made")
    run = Run("swing", {"pose": stream}, locked=True)
    like = swings(3, runs=0, seed=0).experiment
    return Experiment("made", swinging_robot(3), like.instruments, (run,)), run


@pytest.mark.integration
def test_sinusoids_are_found_within_their_sigma():
    true = [(0.9, 0.02, 0.05), (1.2, 0.05, 0.02), (1.7, 0.01, 0.01)]
    z = []
    for seed in range(20):
        found = list(excited_modes(*recorded(true, seed)))
        assert len(found) == 3
        for mode, (frequency, decay, _) in zip(found, true, strict=True):
            z.append((mode.frequency - frequency) / mode.sigma)
            assert mode.damping_ratio == pytest.approx(decay / (2 * np.pi * frequency), abs=2e-3)
    assert 0.7 < np.sqrt(np.mean(np.square(z))) < 1.4


def test_what_hangs_still_swings_in_no_mode():
    assert not list(excited_modes(*recorded([])))


def test_sums_of_frequencies_are_no_modes():
    found = list(excited_modes(*recorded([(0.8, 0, 0.1), (1.1, 0, 0.08), (1.9, 0, 0.008)])))
    np.testing.assert_allclose([m.frequency for m in found], [0.8, 1.1], atol=2e-3)


def test_modes_of_small_swings_are_natural_ones():
    experiment = read_experiment(EXAMPLE)
    run = experiment.run("swing 0")
    values = run.streams["pose"].values
    mean = Rotation.from_matrix(values["orientation"]).mean().as_euler("ZYX")[::-1]
    pose = np.concatenate([values["position"].mean(axis=0), mean])
    predicted = [m.frequency for m in frequencies(experiment.robot, BODY, pose=pose).modes]
    found = [m.frequency for m in excited_modes(experiment, run)]
    np.testing.assert_allclose(found, predicted, rtol=0.01)


@pytest.mark.slow
@pytest.mark.integration
def test_inspection_names_modes_and_no_mass():
    found = inspect(read_experiment(EXAMPLE))
    assert not found.mistakes
    assert {m.run for m in found.modes} == {f"swing {i}" for i in range(4)}
    told = {each.name: each.told for each in found.excitation.body}
    assert told["mass"] == "not at all"
    assert told["cx"] == "data"
    assert told["Jxx"] == "per mass"
    assert all(each.instrument == "pose" for each in found.streams)
    assert not any("locked" in remark for remark in found.remarks)
    assert not found.slack


@pytest.mark.slow
@pytest.mark.integration
def test_inspection_names_slack_cables_in_a_sentence_and_in_numbers():
    found = inspect(read_experiment(FOUR_CABLES))
    (said,) = found.to_dict()["slack"]
    assert said["run"] == "swing 0"
    assert set(said["cables"]) == {"1", "2", "4"}
    assert 0 < said["left_out"] < 0.2
    assert sum(remark == str(found.slack[0]) for remark in found.remarks) == 1


def test_runs_that_no_fit_has_looked_at_are_looked_at_by_a_regression():
    runs = [each.run for each in slack_cables(read_experiment(FOUR_CABLES), None)]
    assert "swing 0" in runs
    assert not slack_cables(read_experiment(EXAMPLE), None)


def test_a_winch_that_turned_is_named():
    experiment = read_experiment(EXAMPLE)
    run = experiment.run("swing 0")
    stream = run.streams["pose"]
    assert not list(turned_winches(experiment, prepare(experiment, run, straight=True)))
    moved = stream.values["position"].copy()
    moved[:, 2] -= 0.05 * np.clip((stream.time - stream.time[0] - 4) / 2, 0, 1)[:]
    other = replace(stream, values={**stream.values, "position": moved})
    turned = replace(run, streams={**run.streams, "pose": other})
    whole = replace(experiment, runs=(turned,))
    named = list(turned_winches(whole, prepare(whole, turned, straight=True)))
    assert named
    assert "are said to be locked" in named[0]


@pytest.mark.slow
@pytest.mark.integration
def test_the_report_shows_spectra_and_no_forces():
    found = identify(read_experiment(EXAMPLE))
    summary = summarise(found)
    assert {each.run for each in summary.evidence.swings} == {f"swing {i}" for i in range(4)}
    assert all(len(each.predicted) == 3 for each in summary.evidence.swings)
    assert all(each.instrument == "pose" for each in summary.evidence.traces)
    sections = {each.name: each for each in document_of(summary).sections}
    assert "swings" in sections
    assert "wrench" not in sections
    assert "inertia over the mass" in {
        block.caption for block in sections["result"].blocks if isinstance(block, Grid)
    }
