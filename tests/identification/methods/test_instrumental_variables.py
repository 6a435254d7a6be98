"""Instrumental variables: where least squares is biased they are not, and the test between both
keeps its level."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import chi2, kstest
from simulated import PAPER, RECORDER, TRUTH, changed, sound, studied, without

from steelyard.identification.methods.instrumental_variables import (
    InstrumentalVariables,
    Products,
    difference_of,
    durbin_wu_hausman,
    independent_sources,
    solved,
)
from steelyard.identification.methods.least_squares import LeastSquares
from steelyard.identification.solve.border.normal_equations import (
    BorderEquations,
    BorderPrior,
    solve,
)
from steelyard.identification.solve.held_motion import fit_with_held_motion
from steelyard.inertia import TEN, Inertia

pytestmark = pytest.mark.integration

LIMIT = chi2.isf(1e-3, TEN)  # reached by one sound recording of a thousand
METHOD = InstrumentalVariables()


def chi_square(estimate):
    error = estimate.value - TRUTH
    return float(error @ np.linalg.solve(estimate.covariance, error))


# The test between the two, on rows of which everything is known


def as_posterior(rng, *, noise_in_regressor=0.0, n=100, errors=3):
    """What the test looks at, of rows whose own columns and whose instruments are both noisy."""
    k = TEN + errors
    true = rng.normal(size=(n, 6, k))
    body = BODY_OF_ROWS
    own, other = true.copy(), true[:, :, :TEN] + 0.5 * rng.normal(size=(n, 6, TEN))
    own[:, :, :TEN] += noise_in_regressor * rng.normal(size=(n, 6, TEN))
    # Errors have priors, from which they were drawn.
    truth = np.concatenate([body, 0.1 * rng.normal(size=errors)])
    target = true @ truth + rng.normal(size=(n, 6))
    prior = BorderPrior(
        np.diag(np.concatenate([np.zeros(TEN), np.full(errors, 100.0)])), np.zeros(k)
    )
    columns, instruments = own.reshape(-1, k), own.copy()
    instruments[:, :, :TEN] = other
    instruments = instruments.reshape(-1, k)
    nothing = np.zeros((TEN, TEN))
    total = BorderEquations(columns.T @ columns, columns.T @ target.ravel(), nothing, float(n))
    products = Products(
        instruments.T @ columns,
        instruments.T @ instruments,
        instruments.T @ target.ravel(),
        np.zeros(k),
    )
    plain = solve(total, prior, np.ones(k, dtype=bool), np.ones(TEN))
    found = SimpleNamespace(
        total=total,
        prior=prior,
        solution=plain,
        identifiable=np.ones(TEN, dtype=bool),
        parameters=body,
        size=1.0,
        noise_factor=1.0,
    )
    found.solution = solved(found, products)
    return found, difference_of(found, products, plain).of_body(np.eye(TEN, k))


BODY_OF_ROWS = Inertia(2.0, [0.1, 0.2, 0.3], np.diag([1.0, 1.2, 0.9])).parameters


def test_the_test_between_both_keeps_its_level(rng):
    found = [durbin_wu_hausman(*as_posterior(rng)) for _ in range(300)]
    assert {freedom for _, freedom in found} == {TEN}
    # Probabilities of a test that keeps its level are evenly spread; fixed seed, so that one of a
    # thousand may not fail.
    p = chi2.sf([chi for chi, _ in found], TEN)
    assert kstest(p, "uniform").pvalue > 1e-3


def test_the_test_between_both_sees_noise_in_the_regressor(rng):
    found = [durbin_wu_hausman(*as_posterior(rng, noise_in_regressor=0.5))[0] for _ in range(20)]
    assert np.median(chi2.sf(found, TEN)) < 1e-3


# Recordings


@pytest.fixture(scope="module")
def estimates():
    return {seed: METHOD(sound(seed)) for seed in (0, 1)}


def test_sound_recordings_are_met_within_their_uncertainty(estimates):
    for estimate in estimates.values():
        assert chi_square(estimate) < LIMIT
        assert estimate.verdict.accepted, estimate.verdict.reasons
        # The command knows nothing of the noise of any sensor.
        assert estimate.details["instruments"] == {
            "run": {"rotation": "command", "position": "command"}
        }
    z = [(e.value - TRUTH) / e.standard_deviation for e in estimates.values()]
    assert 0.6 < np.sqrt(np.mean(np.square(z))) < 1.35


def test_good_instruments_lose_little(estimates):
    for seed, estimate in estimates.items():
        ratio = estimate.standard_deviation / LeastSquares().of(studied(seed)).standard_deviation
        assert np.all((ratio > 0.85) & (ratio < 1.3))


@pytest.mark.slow
def test_a_noisy_gyro_biases_least_squares_and_is_told_by_the_test():
    noise = {"angular_velocity": 0.03, "specific_force": 0.03, "orientation": 0.0035}
    instruments = {**PAPER, "imu": changed(PAPER["imu"], noise=noise)}
    experiment = RECORDER(0, instruments=instruments)
    estimate = METHOD(experiment)
    assert chi_square(estimate) < LIMIT
    assert any(
        "biased beyond chance" in note and "is not biased" not in note for note in estimate.notes
    )
    assert estimate.details["durbin_wu_hausman"]["p"] < 1e-3
    # Least squares takes its bias off, and says where it is too large for that.
    plain = LeastSquares().of(fit_with_held_motion(experiment))
    assert chi_square(plain) < LIMIT


def test_tracker_and_attitude_stand_in_where_there_is_no_command():
    experiment = without(sound(1), "command")
    sources = independent_sources(experiment, experiment.runs[0])
    assert (sources.rotation, sources.position) == (("imu", "orientation"), ("tracker", "position"))
    estimate = METHOD(experiment)
    assert chi_square(estimate) < LIMIT
    assert estimate.details["instruments"]["run"] == {"rotation": "imu", "position": "tracker"}


def test_without_independent_kinematics_nothing_is_told():
    # Where the command already says where the platform is, it is no longer independent.
    experiment = without(sound(0), "tracker")
    assert independent_sources(experiment, experiment.runs[0]) is None
    estimate = METHOD(experiment)
    assert np.isnan(estimate.value).all()
    assert not estimate.verdict.accepted
    assert "expected independent kinematics" in estimate.verdict.reasons[0]
