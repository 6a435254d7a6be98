"""What nothing explains: coloured noise of instruments, unmodelled wrenches."""

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation
from scipy.stats import chi2
from simulated import RECORDER, ROBOT, TRUTH, sound, with_stream

from steelyard.identification.methods.maximum_likelihood import MaximumLikelihood
from steelyard.identification.solve.joint_motion import fit_jointly
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


def test_where_nothing_is_asked_for_nothing_is_tried():
    for seed in SEEDS[:3]:
        found = fit_jointly(sound(seed))
        assert not any(each.processes for each in found.fit.state.segments)


@pytest.mark.parametrize("disturbed", [pushed, walking])
@pytest.mark.slow
def test_a_disturbance_is_found_and_intervals_stay_true(disturbed):
    source = ("robot", "unmodelled force") if disturbed is pushed else ("imu", "orientation")
    total = 0.0
    for seed in SEEDS:
        posterior = fit_jointly(disturbed(sound(seed), seed))
        segment = posterior.fit.state.segments[0]
        assert source in {each.source for each in segment.processes}
        found = MaximumLikelihood().of(posterior)
        assert found.verdict.accepted, found.verdict.reasons
        error = found.value - TRUTH
        total += error @ np.linalg.solve(found.covariance, error)
    low, high = chi2.ppf([1e-3, 1 - 1e-3], 10 * len(SEEDS))
    assert low < total < high
