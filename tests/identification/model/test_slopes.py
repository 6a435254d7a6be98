"""Lines through samples, against polynomials fitted to each."""

import numpy as np

from steelyard.identification.model.balance import Forces
from steelyard.identification.model.balance.slopes import AROUND, slopes, smoothed


def test_samples_of_one_instant_tell_no_rate():
    time = np.array([0.0, 0.04, 0.08, 0.12, 0.16, 1.2, 1.2])
    found = slopes(time, 5.0 + np.outer(time, [3.0, -2.0]))
    np.testing.assert_allclose(found[:5], np.tile([3.0, -2.0], (5, 1)), rtol=1e-9)
    assert np.isfinite(found).all()
    assert not slopes(np.zeros(1), np.ones((1, 2))).any()
    assert not slopes(np.zeros(2), np.array([[1.0], [4.0]])).any()


def test_smoothed_samples_are_on_the_lines_through_what_is_about_them():
    rng = np.random.default_rng(3)
    time = np.sort(rng.uniform(0.0, 2.0, 150))
    values = np.column_stack([40 + 5 * np.sin(9 * time), rng.normal(0, 1, 150)])
    expected = [
        [np.polyval(np.polyfit(time[near] - t, column[near], 1), 0.0) for column in values.T]
        for t in time
        for near in [np.abs(time - t) <= AROUND]
    ]
    np.testing.assert_allclose(smoothed(time, values), expected, atol=1e-9)
    np.testing.assert_array_equal(smoothed(time[:1], values[:1]), values[:1])


def test_means_of_samples_have_no_hum_at_another_frequency():
    """Every second sample of a hum near half the rate is a slow line."""
    time = np.delete(np.arange(0.0, 4.0, 0.01), np.arange(100, 140))
    read = 500.0 + 30.0 * np.sin(2 * np.pi * 49.3 * time)[:, None]
    gone = np.zeros(read.shape, dtype=bool)
    gone[31] = True
    forces = Forces("cables", time, {"tension": read}, np.ones(1), gone)
    found = forces.means(2)
    np.testing.assert_allclose(found.time[:5], [0.005, 0.025, 0.045, 0.065, 0.085])
    assert np.abs(found.readings["tension"] - 500.0).max() < 1.0
    assert np.flatnonzero(found.touched).tolist() == [15]
    assert np.ptp(forces.part(slice(0, None, 2)).readings["tension"]) > 50.0
    assert forces.means(1) is forces
    # Three at once meet the gap.
    assert forces.means(3).touched[33]
