"""Bodies of platforms that swing on locked cables, without force sensors."""

from dataclasses import replace

import numpy as np
import pytest
from laboratory_swings import Laboratory, record
from mujoco_swings import swings
from simulated import sound

from steelyard.errors import InputError
from steelyard.estimates.per_mass import PerMass
from steelyard.experiment.recording import Stream
from steelyard.identification.identify import identify
from steelyard.identification.methods.force_free import ForceFree
from steelyard.identification.methods.maximum_likelihood import MaximumLikelihood
from steelyard.identification.methods.settings import TWO_STEP
from steelyard.identification.methods.two_step import TwoStep
from steelyard.inertia import BODY_PARAMETERS
from steelyard.instruments.length import Length

pytestmark = pytest.mark.integration


def truth_of(body):
    return PerMass.of(body.body_parameters, np.zeros((10, 10))).value


@pytest.fixture(scope="module")
def recorded():
    return swings(4, runs=2, seed=1, duration=5.0, noise=(1e-5, 1e-5), geometry=0.0)


def test_per_mass_follows_the_ten_as_differences_do():
    rng = np.random.default_rng(0)
    value, root = np.abs(rng.normal(size=10)) + 1, rng.normal(size=(10, 10))
    found = PerMass.of(value, root @ root.T)
    step = 1e-6
    jacobian = np.column_stack(
        [(truth(value + step * way) - truth(value - step * way)) / (2 * step) for way in np.eye(10)]
    )
    np.testing.assert_allclose(found.covariance, jacobian @ root @ root.T @ jacobian.T, rtol=1e-6)


def truth(value):
    return PerMass.of(value, np.zeros((10, 10))).value


@pytest.mark.slow
def test_regression_finds_the_body_where_the_motion_has_hardly_noise(recorded):
    found = ForceFree()(recorded.experiment)
    assert found.per_mass is not None
    off = found.per_mass.value - truth_of(recorded.body)
    assert np.abs(off[:3]).max() < 2e-3
    assert np.abs(off[3:]).max() < 0.05 * truth_of(recorded.body)[3:6].max()
    # Nothing has weighed it.
    untold = np.isin(BODY_PARAMETERS, ("cx", "cy", "cz"), invert=True)
    assert np.isnan(found.value[untold]).all()
    assert np.isfinite(found.value[~untold]).all()
    assert found.verdict.parameters["mass"] == "unidentifiable"
    # A baseline is not said to be accepted.
    assert found.verdict.accepted is None
    assert str(found.verdict).startswith("baseline, not assessed")
    assert found.to_dict()["verdict"]["accepted"] is None
    entry = found.to_dict()
    assert entry["mass"] is None
    assert np.shape(entry["inertia_per_mass"]) == (3, 3)
    assert np.shape(entry["standard_deviation"]["inertia_per_mass"]) == (3, 3)


@pytest.mark.slow
def test_a_mass_that_is_known_gives_the_inertia(recorded):
    known = {"mass": (recorded.body.mass, 0.009)}
    weighed = replace(recorded.experiment, known=known, mass_assumed=False)
    found, untold = ForceFree()(weighed), ForceFree()(recorded.experiment)
    assert found.value[0] == recorded.body.mass
    assert found.standard_deviation[0] == pytest.approx(0.009)
    np.testing.assert_allclose(found.value[4:] / found.mass, untold.per_mass.value[3:], rtol=1e-9)
    # All of the inertia follows the mass.
    relative = found.covariance[4:, 0] / found.value[4:] / found.covariance[0, 0] * found.mass
    np.testing.assert_allclose(relative, 1.0, rtol=1e-6)


@pytest.mark.slow
def test_methods_that_need_forces_say_so(recorded):
    assert "force of every cable" in TwoStep().lack(recorded.experiment)
    assert ForceFree().lack(recorded.experiment) == ""


@pytest.mark.slow
@pytest.mark.mujoco
def test_moments_at_which_cables_hang_slack_are_left_out():
    # Of MuJoCo, a geometry that is exact: what is left is what the jerks of the cables do.
    lab = Laboratory(cables=3, runs=4, push=2.5, slack=True, geometry=0.0)
    recorded = record(lab, [78, 3, 0])
    found = ForceFree()(recorded.experiment)
    everything = ForceFree(replace(TWO_STEP, slack_turns=0))(recorded.experiment)
    truth = truth_of(recorded.body)

    def worst(estimate):
        return np.abs((estimate.per_mass.value - truth) / estimate.per_mass.standard_deviation)

    assert np.sqrt(np.mean(worst(found) ** 2)) < 0.7 * np.sqrt(np.mean(worst(everything) ** 2))
    (said,) = [note for note in found.notes if note.startswith("left out")]
    assert [f"run 'swing {i}'" in said for i in range(4)] == list(recorded.slack > 0)


@pytest.mark.slow
def test_noise_alone_tells_no_moment_of_inertia():
    still = swings(4, runs=1, seed=1, duration=2.0, noise=(1e-3, 3e-3), geometry=0.0)
    per_mass = ForceFree()(still.experiment).per_mass
    assert np.isnan(per_mass.value).any()


def with_encoders(experiment, noise):
    """Beside encoders of the locked winches, which show the same number all along a run."""
    robot, runs = experiment.robot, []
    for run in experiment.runs:
        pose = run.streams["pose"]
        arms = np.einsum("nij,kj->nki", pose.values["orientation"], robot.attachments)
        way = robot.anchors - pose.values["position"][:, None] - arms
        fed = np.round(np.median(np.linalg.norm(way, axis=2), axis=0), 4)
        length = Stream(pose.time, {"length": np.tile(fed, (len(pose.time), 1))}, "made")
        runs.append(replace(run, streams={**run.streams, "encoders": length}))
    encoders = Length.model_validate({"kind": "length", "noise": noise})
    instruments = {**experiment.instruments, "encoders": encoders}
    return replace(experiment, instruments=instruments, runs=tuple(runs))


@pytest.mark.slow
def test_encoders_of_locked_winches_need_not_scatter_as_their_noise_says():
    swung = swings(3, runs=3, seed=5, duration=6.0)
    found = MaximumLikelihood()(with_encoders(swung.experiment, 0.002))
    assert found.verdict.accepted, found.verdict.reasons
    off = found.per_mass.value - truth_of(swung.body)
    assert np.abs(off / found.per_mass.standard_deviation).max() < 3.0


def test_with_forces_there_is_another_method():
    with pytest.raises(InputError, match="use another method"):
        ForceFree()(sound(0))


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("m", [3, 4])
def test_maximum_likelihood_of_swings_in_mujoco(m):
    found = identify(swings(m, runs=4, seed=m).experiment)
    assert list(found.estimates) == ["force-free", "maximum-likelihood"]
    per_mass = found.estimate.per_mass
    off = per_mass.value - truth_of(swings(m, runs=0, seed=m).body)
    scaled = off / per_mass.standard_deviation
    correlation = per_mass.covariance / np.outer(
        per_mass.standard_deviation, per_mass.standard_deviation
    )
    assert scaled @ np.linalg.solve(correlation, scaled) / 9 < 2.5
    assert np.abs(off[:3]).max() < 4e-3
    assert np.abs(off[3:6] / per_mass.value[3:6]).max() < 0.03


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize(
    "real",
    [
        {"swivel": 0.1},
        {"noise_stated": False, "lost": 2.0, "jumps": 1.0, "marker": (0.02, 0.03), "jitter": 5e-4},
        # The equations of motion hold what such a camera does not resolve.
        {"rate": 25.0},
        {"rate": 50.0, "jitter": 0.002},
    ],
)
def test_swings_as_a_laboratory_records_them(real):
    recorded = record(Laboratory(cables=3, runs=4, **real), [77, 3, 0])
    found = MaximumLikelihood()(recorded.experiment)
    assert found.verdict.accepted, found.verdict.reasons
    assert not any("nothing that forces and motion tell" in note for note in found.notes)
    scaled = found.per_mass.value - truth_of(recorded.body)
    covariance = found.per_mass.covariance
    sigma = np.sqrt(np.diag(covariance))
    chi = scaled / sigma @ np.linalg.solve(covariance / np.outer(sigma, sigma), scaled / sigma)
    assert chi / 9 < 2.5


@pytest.mark.slow
@pytest.mark.long
def test_short_swings_on_four_cables_do_not_contradict_each_other():
    # Where a run tells hardly anything, its scores are curvature of the model as much as readings.
    recorded = record(Laboratory(cables=4, runs=4, duration=4.0), [77, 4, 0])
    found = MaximumLikelihood()(recorded.experiment)
    assert found.verdict.accepted, found.verdict.reasons
    off = (found.per_mass.value - truth_of(recorded.body)) / found.per_mass.standard_deviation
    assert np.abs(off).max() < 4.0
