"""Forces that resolve more of a motion than its instruments ask for are followed on finer knots; noise
is not."""

from dataclasses import replace

import numpy as np
import pytest
from simulated import PAPER, RECORDER, TRUTH, changed

from steelyard.identification.methods.maximum_likelihood import MaximumLikelihood
from steelyard.identification.solve.settings import FIT
from steelyard.smoothing import DEGREE

pytestmark = pytest.mark.integration
PRECISE = {**PAPER, "cables": changed(PAPER["cables"], noise=PAPER["cables"].noise / 20)}
ON_ITS_KNOTS = MaximumLikelihood(settings=replace(FIT, finer_turns=0))


def fitted(experiment, method):
    posterior = method.fit(experiment)
    (segment,) = posterior.fit.state.segments
    spacing = float(segment.knots[DEGREE + 1] - segment.knots[DEGREE])
    return method.drawn(posterior), spacing


@pytest.mark.slow
@pytest.mark.long
def test_precise_forces_are_followed_on_finer_knots():
    experiment = RECORDER(3, instruments=PRECISE)
    before, wide = fitted(experiment, ON_ITS_KNOTS)
    estimate, spacing = fitted(experiment, MaximumLikelihood())
    # What the spline cannot do is noise on wide knots, or touches the platform: known less well.
    assert before.standard_deviation[0] > 1.5 * estimate.standard_deviation[0]
    assert estimate.verdict.accepted
    assert spacing == pytest.approx(wide / 2)
    off = estimate.value - TRUTH
    assert off @ np.linalg.solve(estimate.covariance, off) < 29.6  # 1 in 1000 of ten


def test_noise_that_is_larger_than_stated_asks_for_no_finer_knots():
    stated = {**PAPER, "cables": changed(PAPER["cables"], noise=PAPER["cables"].noise / 3)}
    experiment = RECORDER(3, stated=stated)
    before, wide = fitted(experiment, ON_ITS_KNOTS)
    estimate, spacing = fitted(experiment, MaximumLikelihood())
    assert spacing == wide
    assert not estimate.verdict.accepted
    assert np.array_equal(estimate.value, before.value)
