"""Quantiles against SciPy's distributions."""

import numpy as np
import pytest
from scipy import stats

from steelyard.estimates import quantiles as own

P = np.array([1e-9, 1e-4, 0.025, 0.5, 0.95, 0.9999])
X = np.array([-1.0, 0.0, 0.3, 2.0, 15.0, 80.0])


@pytest.mark.parametrize("k", [1, 3, 6, 250.0])
def test_chi_square(k):
    assert own.chi2_quantile(P, k) == pytest.approx(stats.chi2.ppf(P, k), rel=1e-9)
    assert own.chi2_exceeded(P, k) == pytest.approx(stats.chi2.isf(P, k), rel=1e-9)
    assert own.chi2_tail(X, k) == pytest.approx(stats.chi2.sf(X, k), rel=1e-9)
    assert own.chi2_below(X, k) == pytest.approx(stats.chi2.cdf(X, k), rel=1e-9)


def test_normal():
    assert own.normal_quantile(P) == pytest.approx(stats.norm.ppf(P), rel=1e-9)
    assert own.normal_exceeded(P) == pytest.approx(stats.norm.isf(P), rel=1e-9)
    assert own.normal_tail(X) == pytest.approx(stats.norm.sf(X), rel=1e-9)


@pytest.mark.parametrize("k", [2, 9, 1e9])
def test_student(k):
    assert own.student_quantile(P, k) == pytest.approx(stats.t.ppf(P, k), rel=1e-7)
    assert own.student_tail(X, k) == pytest.approx(stats.t.sf(X, k), rel=1e-7)


def test_fisher():
    x = X[1:]
    assert own.fisher_tail(x, 3, 40) == pytest.approx(stats.f.sf(x, 3, 40), rel=1e-9)


def test_poisson():
    counts = np.array([1, 2, 7])
    for mean in (0.01, 1.4, 5.0):
        expected = stats.poisson.sf(counts - 1, mean)
        assert own.poisson_tail(counts, mean) == pytest.approx(expected, rel=1e-9)
