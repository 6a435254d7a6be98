"""Percentiles of the readings around each."""

import numpy as np
import pytest
from scipy.ndimage import percentile_filter

from steelyard.experiment.faults.running import running_percentile


@pytest.mark.parametrize("percentile", [0.0, 50.0, 75.0, 80.0, 99.0])
@pytest.mark.parametrize("around", [5, 41])
@pytest.mark.parametrize("n", [3, 41, 5000])
def test_equals_scipy(n, around, percentile):
    values = np.random.default_rng(n).normal(size=(n, 3))
    expected = percentile_filter(values, percentile, size=(around, 1), mode="nearest")
    np.testing.assert_array_equal(running_percentile(values, around, percentile), expected)


def test_only_where_it_is_asked_for():
    values, at = np.random.default_rng(1).normal(size=300), np.array([0, 7, 150, 299])
    whole = running_percentile(values, 41, 75.0)
    np.testing.assert_array_equal(running_percentile(values, 41, 75.0, at), whole[at])
    assert running_percentile(values, 41, 75.0, at[:0]).shape == (0,)


def test_leaves_its_input_alone():
    values = np.arange(50.0)
    running_percentile(values, 5, 50.0)
    np.testing.assert_array_equal(values, np.arange(50.0))
