"""Disturbances that are stated: intervals are true, and what is denied is not asked for."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2
from simulated import PAPER, RECORDER, TRUTH, changed, sound

from steelyard.experiment.surroundings import Surroundings
from steelyard.identification.methods.least_squares import LeastSquares
from steelyard.identification.methods.maximum_likelihood import MaximumLikelihood
from steelyard.identification.solve.joint_motion import fit_jointly

pytestmark = pytest.mark.integration

SEEDS = range(4)
STATED = {
    "cells that drift": {
        "cables": changed(PAPER["cables"], rate=100.0, noise=3.0, calibration={"drift": 1.0})
    },
    "cells with coloured noise": {
        "cables": changed(
            PAPER["cables"], rate=100.0, noise={"white": 1.0, "colored": 5.0, "time": 0.3}
        )
    },
    "gyro and accelerometer that drift": {
        "imu": changed(PAPER["imu"], calibration={"gyro_drift": 0.002, "accelerometer_drift": 0.01})
    },
    "an attitude that follows the accelerometer": {
        "imu": changed(PAPER["imu"], calibration={"filter": 1.0, "heading": 0.01})
    },
    "a tracker with coloured noise": {
        "tracker": changed(PAPER["tracker"], noise={"white": 0.0005, "colored": 0.002, "time": 0.5})
    },
    "a tracker whose stamps scatter": {
        "tracker": changed(PAPER["tracker"], calibration={"jitter": 0.01})
    },
}


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("which", STATED)
def test_intervals_are_true(which):
    total = 0.0
    for seed in SEEDS:
        found = MaximumLikelihood()(RECORDER(seed, instruments={**PAPER, **STATED[which]}))
        assert found.verdict.accepted, found.verdict.reasons
        error = found.value - TRUTH
        total += error @ np.linalg.solve(found.covariance, error)
    low, high = chi2.ppf([1e-3, 1 - 1e-3], 10 * len(SEEDS))
    assert low < total < high


@pytest.mark.slow
def test_what_is_stated_is_there_where_the_motion_is_held():
    own = {**PAPER, **STATED["an attitude that follows the accelerometer"]}
    found = LeastSquares()(RECORDER(1, instruments=own))
    assert found.verdict.accepted, found.verdict.reasons
    error = found.value - TRUTH
    assert error @ np.linalg.solve(found.covariance, error) < chi2.isf(1e-3, 10)


def test_what_is_stated_is_there_with_its_level():
    own = {**PAPER, **STATED["an attitude that follows the accelerometer"]}
    posterior = fit_jointly(RECORDER(1, instruments=own))
    processes = {each.cause: each for each in posterior.fit.state.segments[0].processes}
    assert set(processes) == {"drift", "filter"}
    assert processes["filter"].time == pytest.approx(1.0)
    # It leans by the acceleration of the platform over gravity.
    assert 0.003 < processes["filter"].level * processes["filter"].sizes[0] < 0.1
    walk, span = processes["drift"], np.ptp(posterior.fit.state.segments[0].span)
    assert walk.time == pytest.approx(2 * span)
    # About the vertical alone, by the stated square a second.
    assert walk.sizes[2] == pytest.approx(0.01 * np.sqrt(span), rel=0.1)
    assert walk.sizes[:2].max() < 0.5 * walk.sizes[2]


@pytest.mark.slow
def test_a_stated_unmodelled_wrench_widens_and_does_not_bias():
    experiment = sound(2)
    stated = Surroundings.model_validate({"unmodelled": {"force": 5.0, "torque": 2.0, "time": 0.5}})
    plain = MaximumLikelihood()(experiment)
    wide = MaximumLikelihood()(replace(experiment, surroundings=stated))
    assert wide.verdict.accepted
    assert np.all(wide.standard_deviation > 1.01 * plain.standard_deviation)
    error = wide.value - TRUTH
    assert error @ np.linalg.solve(wide.covariance, error) < chi2.ppf(1 - 1e-3, 10)
    (force, torque) = wide.details["disturbances"]
    assert (force["stated"], torque["stated"]) == (True, True)
    assert force["standard_deviation"] == pytest.approx([5.0] * 3)
    assert (torque["correlation_time"], torque["unit"]) == (0.5, "N m")
