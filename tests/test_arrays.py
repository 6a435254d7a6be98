from itertools import groupby

import numpy as np
import pytest

from steelyard.arrays import binned_means, readonly, stretches


def test_a_copy_that_nobody_can_change():
    original = np.arange(6.0).reshape(2, 3)
    copy = readonly(original, (2, None), "pose")
    original[0, 0] = 9
    assert copy[0, 0] == 0
    assert copy.dtype == np.float64
    with pytest.raises(ValueError, match="read-only"):
        copy[0, 0] = 1


@pytest.mark.parametrize(
    ("values", "shape", "message"),
    [
        ([1, 2], (3,), r"pose: expected shape 3, found \(2,\)"),
        ([1, 2], (None, 3), r"pose: expected shape n x 3, found \(2,\)"),
        ([1], (), "pose: expected shape scalar"),
        ([1, np.inf], (2,), "pose: expected finite numbers"),
    ],
)
def test_what_does_not_fit_is_named(values, shape, message):
    with pytest.raises(ValueError, match=message):
        readonly(values, shape, "pose")


@pytest.mark.parametrize("seed", range(20))
def test_stretches_are_the_groups_of_itertools(seed):
    mask = np.random.default_rng(seed).random(30) < 0.5
    expected = []
    place = 0
    for holds, group in groupby(mask):
        length = len(list(group))
        if holds:
            expected.append((place, place + length))
        place += length
    assert stretches(mask) == expected


def test_no_stretch_in_nothing():
    assert stretches(np.zeros(0, dtype=bool)) == []


def test_means_of_bins_are_those_of_their_samples(rng):
    bins = rng.integers(0, 5, 40)
    bins[bins == 3] = 2
    values = rng.normal(0, 1, (40, 2))
    means, samples = binned_means(bins, values, 7)
    assert samples.tolist() == [int(np.sum(bins == i)) for i in range(7)]
    for i in (0, 1, 2, 4):
        np.testing.assert_allclose(means[i], values[bins == i].mean(axis=0), atol=1e-14)
    assert not means[[3, 5, 6]].any()
