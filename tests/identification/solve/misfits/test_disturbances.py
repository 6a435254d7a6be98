"""What nothing explains: coloured noise of instruments, unmodelled wrenches."""

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation
from scipy.stats import chi2
from simulated import RECORDER, ROBOT, TRUTH, sound, with_stream

from steelyard.identification.methods.from_posterior.unstated import (
    found_errors,
    notes_on_unstated,
)
from steelyard.identification.methods.least_squares import LeastSquares
from steelyard.identification.methods.maximum_likelihood import MaximumLikelihood
from steelyard.identification.solve.held_motion import fit_with_held_motion
from steelyard.identification.solve.joint_motion import fit_jointly
from steelyard.identification.solve.settings import FitSettings
from steelyard.robot.kinematics import cables_at

pytestmark = pytest.mark.integration

SEEDS = range(6)


def coloured(time, level, correlation, width, rng):
    """A Gauss-Markov process at sample times, shape (n, width)."""
    kept = np.exp(-np.median(np.diff(time)) / correlation)
    white = rng.normal(size=(len(time), width)) * np.sqrt(1 - kept**2)
    white[0] /= np.sqrt(1 - kept**2)
    return level * lfilter([1.0], [1.0, -kept], white, axis=0)


def pushed(experiment, seed):
    """With a wrench on the platform that comes and goes within half a second."""
    rng = np.random.default_rng(seed)
    time = experiment.runs[0].streams["cables"].time
    wrench = coloured(time, 1.0, 0.5, 6, rng) * np.repeat([8.0, 4.0], 3)
    state = RECORDER.response.at(np.clip(time - time[0], 0.0, RECORDER.response.duration))
    W = cables_at(ROBOT, state.position, state.rotation, state.tension).structure
    more = np.einsum("nmk,nk->nm", np.linalg.pinv(W), wrench)
    return with_stream(experiment, "cables", lambda v: {"tension": v["tension"] - more})


def walking(experiment, seed):
    """With an attitude whose error walks."""
    rng = np.random.default_rng(seed)
    time = experiment.runs[0].streams["imu"].time
    turns = Rotation.from_rotvec(coloured(time, 0.01, 3.0, 3, rng)).as_matrix()
    return with_stream(experiment, "imu", lambda v: {"orientation": v["orientation"] @ turns})


def squared_error(found):
    """Of an accepted estimate, in its covariance: chi-square of ten."""
    assert found.verdict.accepted, found.verdict.reasons
    error = found.value - TRUTH
    return error @ np.linalg.solve(found.covariance, error)


def are_covered(estimates):
    """Whether the intervals of estimates of all seeds are true."""
    low, high = chi2.ppf([1e-3, 1 - 1e-3], 10 * len(SEEDS))
    return low < sum(map(squared_error, estimates)) < high


@pytest.mark.slow
def test_where_nothing_is_asked_for_nothing_is_tried():
    for seed in SEEDS[:3]:
        found = fit_jointly(sound(seed))
        assert not any(each.processes for each in found.fit.state.segments)


@pytest.mark.slow
@pytest.mark.parametrize("settings", [FitSettings(), FitSettings(long=10.0, window=10.0)])
def test_a_held_motion_takes_up_what_its_instruments_ask_for(settings):
    # Also where a long recording is looked at window by window.
    posterior = fit_with_held_motion(walking(sound(0), 0), settings=settings)
    for segment in posterior.fit.state.segments:
        assert ("imu", "orientation") in {each.source for each in segment.processes}
    found = LeastSquares().of(posterior)
    assert squared_error(found) < chi2.isf(1e-3, 10)


def test_a_held_motion_that_asks_for_nothing_has_nothing():
    found = fit_with_held_motion(sound(1))
    assert not any(each.processes for each in found.fit.state.segments)
    assert not found.fit.state.jitters
    assert not found_errors(found)


def filtered(experiment, constant):
    """With a first-order filter in the amplifier of the forces, by the trapezoidal rule."""
    half = np.median(np.diff(experiment.runs[0].streams["cables"].time)) / 2 / constant
    ahead, back = np.array([half, half]) / (1 + half), [1.0, (half - 1) / (half + 1)]
    return with_stream(
        experiment,
        "cables",
        lambda v: {
            "tension": v["tension"][0]
            + lfilter(ahead, back, v["tension"] - v["tension"][0], axis=0)
        },
    )


@pytest.mark.slow
def test_forces_over_a_held_motion_ask_for_what_good_devices_do_not_have():
    posterior = fit_with_held_motion(filtered(sound(2), 0.04))
    errors = found_errors(posterior)
    (name,) = errors
    assert name == "cables.time_constant"
    off = errors[name]["value"] - 0.04
    assert abs(off) < 4 * errors[name]["standard_deviation"]
    found = LeastSquares().of(posterior)
    assert squared_error(found) < chi2.isf(1e-3, 10)


def test_many_numbers_of_one_kind_are_said_in_one_sentence():
    errors = {
        f"cables.crosstalk of cable {i} from cable {j}": {
            "value": -0.001 * (10 * i + j), "standard_deviation": 0.002, "unit": "1"
        }
        for i in range(1, 5) for j in range(1, 5)
    }  # fmt: skip
    (said,) = notes_on_unstated([], errors)
    assert said.endswith("16 numbers, the largest -0.044 ± 0.002 (of cable 4 from cable 4)")


@pytest.mark.slow
@pytest.mark.long
def test_intervals_over_a_held_motion_stay_true():
    assert are_covered(LeastSquares()(walking(sound(seed), seed)) for seed in SEEDS)


@pytest.mark.parametrize("disturbed", [pushed, walking])
@pytest.mark.slow
@pytest.mark.long
def test_a_disturbance_is_found_and_intervals_stay_true(disturbed):
    source = ("robot", "unmodelled force") if disturbed is pushed else ("imu", "orientation")
    estimates = []
    for seed in SEEDS:
        posterior = fit_jointly(disturbed(sound(seed), seed))
        segment = posterior.fit.state.segments[0]
        assert source in {each.source for each in segment.processes}
        estimates.append(MaximumLikelihood().of(posterior))
    assert are_covered(estimates)


def in_colour(experiment, seed):
    """With force noise that goes on for a third of a second, beside the white one."""
    rng = np.random.default_rng(seed)
    time = experiment.runs[0].streams["cables"].time
    noise = coloured(time, 5.0, 0.3, ROBOT.m, rng)
    return with_stream(experiment, "cables", lambda v: {"tension": v["tension"] + noise})


@pytest.mark.slow
def test_coloured_noise_of_tensions_is_neither_a_wrench_nor_what_else_imitates_it():
    posterior = fit_jointly(in_colour(sound(3), 3))
    (segment,) = posterior.fit.state.segments
    (process,) = segment.processes
    assert process.source == ("cables", "tension")
    assert process.level * process.sizes[0] == pytest.approx(5.0, rel=0.3)
    assert process.time == pytest.approx(0.3, rel=0.5)
    assert not found_errors(posterior)
    found = MaximumLikelihood().of(posterior)
    assert squared_error(found) < chi2.isf(1e-3, 10)


@pytest.mark.slow
@pytest.mark.long
def test_intervals_beside_coloured_noise_of_tensions_stay_true():
    assert are_covered(MaximumLikelihood()(in_colour(sound(seed), seed)) for seed in SEEDS)
