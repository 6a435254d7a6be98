"""Of many samples those stay that a reader should see."""

import numpy as np

from steelyard.report.evidence.thinning import evenly, thinned


def test_thinning_keeps_what_stands_out(rng):
    size = rng.random((100_000, 3))
    out = 200 * rng.choice(500, 20, replace=False) + rng.integers(0, 200, 20)
    size[out, rng.integers(0, 3, 20)] += 5
    few = thinned(size, 1000)
    assert len(few) <= 1002
    assert np.all(np.diff(few) > 0)
    assert set(out) <= set(few)
    assert {0, 99_999} <= set(few)
    np.testing.assert_array_equal(thinned(size[:50], 100), np.arange(50))


def test_even_places_hold_both_ends():
    np.testing.assert_array_equal(evenly(11, 3), [0, 5, 10])
    np.testing.assert_array_equal(evenly(3, 10), [0, 1, 2])
