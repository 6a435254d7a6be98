"""Lines through samples, and filtered readings without what their filter has smoothed, against the
solution of its equation."""

import numpy as np
import pytest
from scipy.signal import lfilter

from steelyard.identification.model.balance import Forces, unfiltered
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


@pytest.mark.parametrize("frequency", [0.3, 0.8, 1.3, 3.0])
@pytest.mark.parametrize("lost", [False, True])
def test_a_filtered_reading_is_a_late_one_without_what_was_smoothed(frequency, lost):
    """As a delay alone, 30 ms at 1.3 Hz leave 3 % of what changes."""
    time, omega, constant = np.arange(0.0, 6.0, 0.01), 2 * np.pi * frequency, 0.03
    # x' = (u - x) / T with u = sin: of size 1 / sqrt(1 + (w T)^2), behind by atan(w T).
    lag, size = np.arctan(omega * constant), 1 / np.hypot(1.0, omega * constant)
    read = 500.0 + 100.0 * size * np.sin(omega * time - lag)[:, None]
    gone = np.zeros(read.shape, dtype=bool)
    if lost:
        gone[300] = True
        read[300] = 9000.0
    forces = Forces("cables", time, {"tension": read}, np.ones(1), gone).with_changes()
    found = unfiltered(forces, constant).readings["tension"]
    expected = 500.0 + 100.0 * np.sin(omega * (time - constant))[:, None]
    inside = ((time > 0.4) & (time < 5.6))[:, None] & ~gone
    left = np.abs(found - expected)[inside].max()
    # Lines do not follow the fastest wholly.
    assert left < max(0.35 * np.abs(read - expected)[inside].max(), 0.1)


def test_a_cable_that_goes_slack_is_followed():
    """Within a tenth of a second from 60 N to nothing, and as fast to its pull again."""
    fine = np.arange(0.0, 3.0, 1e-4)
    pull = np.clip(60 - 600 * (fine - 1.0), 0, 60) + np.clip(600 * (fine - 1.6), 0, 60)
    constant = 0.014
    kept = np.exp(-1e-4 / constant)
    read = lfilter([1 - kept], [1.0, -kept], pull, zi=[kept * pull[0]])[0]
    time = np.arange(0.5, 2.5, 0.01)
    none = np.zeros((len(time), 1), dtype=bool)
    forces = Forces(
        "cables", time, {"tension": np.interp(time, fine, read)[:, None]}, np.ones(1), none
    ).with_changes()
    found = unfiltered(forces, constant).readings["tension"][:, 0]
    late = np.interp(time - constant, fine, pull)

    def rms(off):
        return float(np.sqrt(np.mean(off**2)))

    # Over lines of two tenths of a second, as long as it is slack, .9 of it was left.
    assert rms(found - late) < 0.65 * rms(forces.readings["tension"][:, 0] - late)


@pytest.mark.parametrize("step", [0.002, 0.01, 0.04])
@pytest.mark.parametrize("constant", [0.003, 0.01, 0.03])
def test_readings_without_their_filter_are_hardly_noisier(rng, step, constant):
    time = np.arange(4000) * step
    noise = rng.standard_normal((len(time), 8))
    none = np.zeros(noise.shape, dtype=bool)
    forces = Forces("cables", time, {"tension": noise}, np.ones(8), none).with_changes()
    found = unfiltered(forces, constant).readings["tension"]
    assert found.std() < 1.08


def test_poses_at_rest_have_no_filter():
    forces = Forces(
        "cables", np.arange(3.0), {"tension": np.ones((3, 1))}, np.ones(1), np.zeros((3, 1), bool)
    )
    assert unfiltered(forces, 0.03) is forces


def test_a_reading_that_is_left_out_later_is_bridged_as_one_that_was_never_there():
    time = np.arange(0.0, 3.0, 0.01)
    read = np.column_stack([500.0 + 50 * np.sin(3 * time), 400.0 + 20 * time])
    read[120, 0] = 9000.0
    none = np.zeros(read.shape, dtype=bool)
    gone = none.copy()
    gone[120, 0] = True
    whole = Forces("cables", time, {"tension": read}, np.ones(2), none).with_changes()
    never = Forces("cables", time, {"tension": read}, np.ones(2), gone).with_changes()
    np.testing.assert_array_equal(whole.leaving_out(gone).changes.values, never.changes.values)
    assert np.abs(whole.changes.values - never.changes.values).max() > 1e4
    assert whole.leaving_out(none.copy()).changes is whole.changes


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
