"""Time stamps that scatter."""

import numpy as np
import pytest
from scipy.stats import chi2
from simulated import PAPER, RECORDER, TRUTH, changed, sound

from steelyard.identification.methods.maximum_likelihood import MaximumLikelihood
from steelyard.identification.solve.joint_motion import fit_jointly
from steelyard.identification.solve.misfits.jitter import (
    _changes,
    _lag,
    _Scattering,
)
from steelyard.identification.solve.settings import FIT

pytestmark = pytest.mark.integration

JITTER = 0.01  # [s]


def unstated(seed):
    """A recording whose tracker's stamps scatter, which nobody says."""
    tracker = changed(PAPER["tracker"], calibration={"jitter": JITTER})
    whole = RECORDER(seed, instruments={**PAPER, "tracker": tracker})
    instruments = {**whole.instruments, "tracker": PAPER["tracker"]}
    return type(whole)(**{**vars(whole), "instruments": instruments})


@pytest.mark.slow
def test_it_is_found_and_intervals_stay_true():
    total, seeds = 0.0, range(3)
    for seed in seeds:
        posterior = fit_jointly(unstated(seed))
        assert posterior.fit.state.jitters == {"tracker": pytest.approx(JITTER, rel=0.15)}
        found = MaximumLikelihood().of(posterior)
        assert found.verdict.accepted, found.verdict.reasons
        assert any("time stamps of tracker scatter" in note for note in found.notes)
        error = found.value - TRUTH
        total += error @ np.linalg.solve(found.covariance, error)
    low, high = chi2.ppf([1e-3, 1 - 1e-3], 10 * len(seeds))
    assert low < total < high


@pytest.mark.slow
def test_stamps_that_do_not_scatter_are_not_taken_to():
    for seed in range(3):
        assert fit_jointly(sound(seed)).fit.state.jitters == {}


def scattering(residual, rate, time):
    """Score of residuals of one axis."""
    lag = _lag(time)
    square = rate**2
    return _Scattering(
        "imu",
        (residual[lag:] - residual[:-lag]) ** 2 / 2,
        (square[lag:] + square[:-lag]) / 2,
        0.0035,
    ).score


def test_an_error_that_grows_while_the_platform_turns_is_no_jitter():
    time = np.arange(0, 20, 0.01)
    rate = np.sin(0.6 * time)
    noise = 0.0035 * np.random.default_rng(1).standard_normal(len(time))
    assert scattering(noise + 0.02 * rate, rate, time) < FIT.jittering
    assert scattering(noise * np.hypot(1, 3 * rate), rate, time) > FIT.jittering


def test_stamps_of_a_logger_that_writes_in_order_scatter_anew_after_the_lag():
    rng = np.random.default_rng(2)
    true = np.arange(0, 20, 1 / 238)
    stamps = np.maximum.accumulate(true + 0.012 * np.abs(rng.standard_normal(len(true))))
    late, lag = stamps - true, _lag(stamps)
    assert np.corrcoef(late[1:], late[:-1])[0, 1] > 0.4
    assert abs(np.corrcoef(late[lag:], late[:-lag])[0, 1]) < 0.1


@pytest.mark.slow
@pytest.mark.long
def test_stamps_of_the_forces_widen_their_noise_where_they_change():
    cables = changed(PAPER["cables"], rate=100.0, noise=0.5, calibration={"jitter": JITTER})
    posterior = fit_jointly(RECORDER(1, instruments={**PAPER, "cables": cables}))
    (forces,) = posterior.force_samples
    assert forces.late.shape == forces.left_out.shape
    # A tension that changes by hundreds of newtons a second, some milliseconds late.
    assert np.quantile(forces.late, 0.9) > 0.5
    found = MaximumLikelihood().of(posterior)
    error = found.value - TRUTH
    assert error @ np.linalg.solve(found.covariance, error) < chi2.ppf(1 - 1e-3, 10)


@pytest.mark.parametrize("step", [0.005, 0.02, 0.125])
def test_an_encoder_of_a_winch_that_stands_still_is_never_late(step):
    """The platform swings, its cables stretch; the encoders read noise."""
    time = np.arange(0.0, 20.0, step)
    rng = np.random.default_rng(3)
    noise = 5e-4 * rng.standard_normal((len(time), 1))

    def changes(values):
        return _changes(values + noise, time, _lag(time), 0.09 * np.cos(9 * time)[:, None])

    assert not changes(0 * noise)
    assert changes(0.01 * np.sin(9 * time)[:, None])
    # Stamps that scatter by a tenth of a period hide no change.
    late = np.abs(0.07 * rng.standard_normal(len(time)))
    assert changes(0.01 * np.sin(9 * (time - late))[:, None])
