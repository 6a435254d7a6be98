"""Bodies from natural frequencies that MuJoCo's linearised model has, alone and beside swings."""

from dataclasses import replace

import numpy as np
import pytest
from mujoco_swings import BODY, linear_frequencies, swinging_robot, swings
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from steelyard.estimates.per_mass import PerMass
from steelyard.experiment.model import Experiment
from steelyard.experiment.observations import SeenFrequencies
from steelyard.experiment.read import read_experiment
from steelyard.experiment.unread import with_unread_cables
from steelyard.experiment.write import write_experiment
from steelyard.identification.identify import identify
from steelyard.identification.methods.maximum_likelihood import MaximumLikelihood
from steelyard.natural_frequencies.frequencies import frequencies

NOISE = 1e-3  # relative
EXACT = {"anchor": 0.0, "attachment": 0.0, "gravity": 0.0}


def stopwatch(m, rows, seed, robot=None, by="lengths"):
    """Frequencies of MuJoCo's elastic model, whose cables are stiff, at poses drawn by a seed."""
    rng = np.random.default_rng(seed)
    robot, found = robot or swinging_robot(m, stiffness=1e8), []
    while len(found) < rows:
        pose = [*rng.uniform([-0.6, -0.4, 0.8], [0.6, 0.4, 1.6]), 0, 0, 0]
        rest = frequencies(robot, BODY, pose=pose)
        if len(rest.modes) != 6 - m:
            continue
        turned = Rotation.from_matrix(rest.place.rotation).as_quat(scalar_first=True)
        place = np.concatenate([rest.place.position, turned])
        true = linear_frequencies(robot, BODY, rest.lengths, place)[: 6 - m]
        sigma = NOISE * true
        found.append(
            SeenFrequencies(
                run="by hand",
                instrument="watch",
                row=len(found) + 1,
                pose=rest.pose if by == "pose" else None,
                lengths=rest.lengths if by == "lengths" else None,
                frequency=np.sort(true + sigma * rng.normal(size=len(true))),
                sigma=sigma,
                noise=None,
            )
        )
    return tuple(found)


def experiment_of(m, seen, uncertainty=EXACT):
    robot = swinging_robot(m)
    found = Experiment("watch", robot, {}, (), uncertainty=uncertainty, frequencies=seen)
    return with_unread_cables(found)


TRUTH = PerMass.of(BODY.body_parameters, np.zeros((10, 10))).value


def chi_square(found):
    sigma = found.standard_deviation
    z = (found.value - TRUTH) / sigma
    use = np.isfinite(z)
    correlation = (found.covariance / np.outer(sigma, sigma))[np.ix_(use, use)]
    return z[use] @ np.linalg.solve(correlation, z[use]), use.sum()


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("by", ["lengths", "pose"])
def test_a_stop_watch_tells_the_body(by):
    chi, freedom = 0.0, 0
    for seed in range(3):
        found = identify(experiment_of(3, stopwatch(3, 10, seed, by=by))).estimate
        assert found.method == "maximum-likelihood"
        assert found.verdict.accepted, found.verdict.reasons
        assert found.verdict.parameters["mass"] == "unidentifiable"
        own, count = chi_square(found.per_mass)
        chi, freedom = chi + own, freedom + count
    assert freedom == 27
    assert chi2.ppf(1e-3, freedom) < chi < chi2.isf(1e-3, freedom)


@pytest.mark.integration
def test_what_frequencies_do_not_tell_is_null():
    found = identify(experiment_of(4, stopwatch(4, 1, 0))).estimate
    assert np.isnan(found.per_mass.value).sum() >= 5


@pytest.mark.slow
@pytest.mark.long
def test_a_wrong_row_is_rejected_by_name():
    seen = list(stopwatch(3, 10, 1))
    seen[4] = replace(seen[4], frequency=seen[4].frequency * 1.1)
    found = identify(experiment_of(3, tuple(seen))).estimate
    assert not found.verdict.accepted
    assert "row 5" in found.verdict.reasons[0]


@pytest.mark.slow
@pytest.mark.long
def test_a_mode_that_was_not_seen_is_left_out():
    seen = stopwatch(3, 12, 2)
    fewer = tuple(
        replace(each, frequency=each.frequency[[0, 2]], sigma=each.sigma[[0, 2]]) for each in seen
    )
    found = identify(experiment_of(3, fewer)).estimate
    own, count = chi_square(found.per_mass)
    # Where modes may be these or those, it is said.
    assert own < chi2.isf(1e-4, count) or not found.verdict.accepted


@pytest.mark.slow
def test_errors_of_the_geometry_are_in_the_covariance():
    exact = identify(experiment_of(3, stopwatch(3, 10, 1))).estimate.per_mass
    uncertain = {"anchor": 0.002, "attachment": 0.002, "gravity": 0.0}
    found = identify(experiment_of(3, stopwatch(3, 10, 1), uncertain)).estimate.per_mass
    assert (found.standard_deviation > exact.standard_deviation).all()


def test_files_give_the_same_back(tmp_path):
    experiment = replace(experiment_of(3, stopwatch(3, 6, 1, by="pose")), known={})
    write_experiment(replace(experiment, mass_assumed=False), tmp_path, with_robot=True)
    again = read_experiment(tmp_path / "experiment.yaml")
    assert not again.runs
    assert again.mass_assumed
    for one, other in zip(again.frequencies, experiment.frequencies, strict=True):
        np.testing.assert_allclose(one.pose, other.pose)
        np.testing.assert_allclose(one.frequency, other.frequency)
        np.testing.assert_allclose(one.sigma, 0.01 * other.frequency)
        assert one.lengths is None


@pytest.mark.slow
@pytest.mark.long
def test_beside_swings_they_tell_more():
    recorded = swings(3, runs=3, seed=4)
    robot = recorded.true
    both = replace(recorded.experiment, frequencies=stopwatch(3, 10, 3, robot=robot, by="pose"))
    alone, found = (MaximumLikelihood()(each) for each in (recorded.experiment, both))
    assert found.verdict.accepted, found.verdict.reasons
    ratio = found.per_mass.standard_deviation / alone.per_mass.standard_deviation
    assert (ratio < 1.02).all()
    assert ratio[3:].min() < 0.9
    own, count = chi_square(found.per_mass)
    assert own < chi2.isf(1e-4, count)
