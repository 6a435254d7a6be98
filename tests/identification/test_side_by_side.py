"""Methods in processes of their own tell the same as one after the other."""

import numpy as np
import pytest
from other_methods import Baseline, estimated
from recordings import simulated

from steelyard.errors import InputError
from steelyard.identification.identify import identify
from steelyard.identification.methods.least_squares import LeastSquares
from steelyard.identification.methods.maximum_likelihood import MaximumLikelihood
from steelyard.identification.methods.two_step import TwoStep
from steelyard.identification.side_by_side import _groups, elsewhere

pytestmark = pytest.mark.integration


@pytest.mark.slow
def test_estimates_are_the_same():
    methods = ("two-step", "least-squares", "consistent")
    one, two = (identify(simulated(), methods, jobs=jobs) for jobs in (1, 2))
    assert list(one.estimates) == list(two.estimates)
    for name in methods:
        # Processes of their own compute with one thread.
        a, b = one.estimates[name], two.estimates[name]
        sigma = np.where(a.standard_deviation > 0, a.standard_deviation, 1)
        np.testing.assert_allclose((b.value - a.value) / sigma, 0, atol=1e-6)
        assert a.verdict.accepted == b.verdict.accepted


def test_methods_of_one_fit_stay_together():
    chosen = [TwoStep(), LeastSquares(), MaximumLikelihood()]
    assert _groups(chosen) == [[0], [1]]
    assert _groups([LeastSquares()]) == []


@pytest.mark.slow
def test_errors_are_those_of_the_method():
    methods = [Baseline(InputError("not so")), MaximumLikelihood()]
    with elsewhere(methods, None, estimated, jobs=2) as others:
        assert list(others.methods) == [0]
        with pytest.raises(InputError, match=r"^not so$"):
            others.estimate(0)


def test_a_killed_process_is_said():
    methods = [Baseline(), MaximumLikelihood()]
    with (
        elsewhere(methods, None, estimated, jobs=2) as others,
        pytest.raises(InputError, match="found that one was killed"),
    ):
        others.estimate(0)


def test_what_no_process_can_be_given_stays_here():
    method = Baseline(InputError("x"))
    method.error = lambda: None
    with elsewhere([method, MaximumLikelihood()], None, estimated, jobs=2) as others:
        assert others.methods == {}


def test_a_number_below_one_is_refused():
    with pytest.raises(InputError, match="jobs: expected 1 or more, found 0"):
        identify(simulated(), "two-step", jobs=0)
