"""Forces of runs that were held out, by the library and from the command line."""

import json
from dataclasses import replace

import numpy as np
import pytest
from simulated import BODY, RECORDER, TRUTH, Recorder, pair, with_stream

from steelyard.errors import InputError
from steelyard.experiment.write import write_experiment
from steelyard.identification.identify import identify
from steelyard.identification.methods.least_squares import LeastSquares
from steelyard.identification.solve.held_motion import fit_with_held_motion
from steelyard.identification.verdict.prediction import AXES, predict_held_out
from steelyard.inertia import Inertia

pytestmark = pytest.mark.integration

HELD = frozenset({"b"})


@pytest.fixture(scope="module")
def experiment():
    return pair()


@pytest.fixture(scope="module")
def prediction(experiment):
    (found,) = predict_held_out(experiment, HELD)
    return found


@pytest.fixture(scope="module")
def loaded(experiment):
    """The same with 20 kg more on the platform in the run that is held out; the sensors have the
    same errors."""
    both = Inertia.from_parameters(BODY.parameters + np.array([20.0, 6.0, -4.0, 2.0, *np.zeros(6)]))
    other = Recorder(RECORDER.command.trajectory, body=both, following=True)
    again = other(7, runs=("a", "b"))
    return replace(experiment, runs=(experiment.runs[0], again.runs[1]))


def test_a_sound_run_is_predicted_nearly_to_the_noise(prediction):
    assert prediction.run == "b"
    ratio = prediction.error / prediction.noise
    # The noise of the motion and the uncertainty of the offsets come on top of that of the forces.
    assert np.all((ratio > 0.8) & (ratio < 2.5)), ratio
    assert np.all(
        np.sqrt(np.maximum(prediction.error**2 - prediction.noise**2, 0)) < 0.1 * prediction.spread
    )
    # White noise of 5 N in eight cables, of which the filter lets a part through.
    assert 1.0 < prediction.noise[2] < 15.0


def test_another_payload_is_not_predicted(prediction, loaded):
    (other,) = predict_held_out(loaded, HELD)
    # 20 kg are 196 N upwards.
    upward = np.linalg.norm(other.error[:3])
    assert upward == pytest.approx(196.2, rel=0.1)
    assert upward > 10 * np.linalg.norm(prediction.error[:3])


@pytest.mark.slow
def test_forces_that_are_held_out_are_not_looked_at(experiment):
    runs = experiment.runs
    stream = runs[1].streams["cables"]
    nonsense = replace(stream, values={"tension": stream.values["tension"][::-1] * 1.7 + 100})
    changed = replace(
        experiment,
        runs=(runs[0], replace(runs[1], streams={**runs[1].streams, "cables": nonsense})),
    )
    one, other = (fit_with_held_motion(each, held_out=HELD) for each in (experiment, changed))
    np.testing.assert_allclose(other.parameters, one.parameters, rtol=1e-9)
    np.testing.assert_allclose(
        other.calibration.values, one.calibration.values, rtol=1e-9, atol=1e-12
    )
    assert LeastSquares().of(other).verdict == LeastSquares().of(one).verdict


@pytest.mark.slow
def test_the_estimate_beside_it_is_that_of_the_other_runs(experiment):
    held = identify(experiment, [LeastSquares()], holdout=["b"])
    alone = identify(replace(experiment, runs=experiment.runs[:1]), [LeastSquares()])
    np.testing.assert_array_equal(
        held.estimates["least-squares"].value, alone.estimates["least-squares"].value
    )
    assert [p.run for p in held.predictions] == ["b"]
    assert alone.predictions == ()
    error = held.estimates["least-squares"].value - TRUTH
    assert np.all(np.abs(error) < 4.5 * held.estimates["least-squares"].standard_deviation)


def test_values_are_plain_and_consistent(prediction):
    values = json.loads(json.dumps(prediction.to_dict(), allow_nan=False))
    for axis in AXES:
        assert values["rmse_over_noise"][axis] == pytest.approx(
            values["rmse"][axis] / values["noise"][axis]
        )
        assert values["rmse_over_spread"][axis] == pytest.approx(
            values["rmse"][axis] / values["spread_of_measured"][axis]
        )
    assert "run 'b', held out: rmse of the predicted wrench (means over" in str(prediction)


def test_unknown_runs_are_named(experiment):
    with pytest.raises(
        InputError, match="holdout: expected one of a, b, found 'c'; choose one of these"
    ):
        identify(experiment, holdout=["c"])


def test_something_must_be_left_to_estimate_from(experiment):
    with pytest.raises(InputError, match="found all of them held out; hold out fewer"):
        predict_held_out(experiment, frozenset({"a", "b"}))


def test_what_cannot_be_balanced_predicts_nothing(experiment):
    dead = with_stream(experiment, "cables", lambda v: {"tension": np.zeros_like(v["tension"])})
    with pytest.raises(InputError, match="holdout: "):
        predict_held_out(dead, HELD)


# The command line


@pytest.fixture
def written(experiment, tmp_path):
    folder = tmp_path / "experiment"
    folder.mkdir()
    write_experiment(experiment, folder)
    return folder / "experiment.yaml"


@pytest.mark.slow
def test_holdout_from_the_command_line(run, written, prediction, tmp_path):
    out = tmp_path / "results"
    status, text, err = run(
        "identify", written, "--method", "least-squares", "--holdout", "b", "--out", out
    )
    assert (status, err) == (0, "")
    assert "run 'b', held out" in " ".join(text.split())
    values = json.loads((out / "estimate.json").read_text())
    assert set(values["holdout"]) == {"b"}
    for axis, error in zip(AXES, prediction.error, strict=True):
        # Files have fewer digits than memory.
        assert values["holdout"]["b"]["rmse"][axis] == pytest.approx(error, rel=1e-3)
    assert values["estimates"]["least-squares"]["mass"] == pytest.approx(BODY.mass, abs=2.0)
    assert "held out" in (out / "report.md").read_text()


@pytest.mark.parametrize(
    ("holdout", "message"),
    [
        (["--holdout", "c"], "--holdout: expected one of a, b, found 'c'"),
        (["--holdout", "a", "--holdout", "b"], "found all of them held out"),
    ],
)
def test_wrong_use_ends_with_a_sentence(run, written, holdout, message):
    status, out, err = run("identify", written, *holdout)
    assert (status, out) == (2, "")
    assert message in err
    assert err.count("\n") == 1
