"""Filters of force amplifiers, against the solution of their equation: what they change of readings and of
motions, what correcting for them costs, and whether it is worth it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import make_lsq_spline
from scipy.signal import bilinear, lfilter
from simulated import PAPER, changed, moving, with_stream

from steelyard.identification.model.balance import Forces, unfiltered
from steelyard.identification.model.balance.amplifier_filter import ReadingChanges, uncorrected
from steelyard.identification.model.balance.filtered_motion import FilteredMotion
from steelyard.identification.model.motion_segment import Segment
from steelyard.identification.model.segment import POSE, motion_at
from steelyard.identification.solve.joint_motion import fit_jointly
from steelyard.smoothing import DEGREE, knots


def swinging(frequency):
    """A motion that swings along one axis, by a spline, its accelerations on a dense grid of times, and
    these."""
    dense = np.linspace(0.0, 4.0, 40001)
    grid = knots(0.0, 4.0, min(0.1, 1 / (8 * frequency)))
    size = 1 / (2 * np.pi * frequency) ** 2
    way = make_lsq_spline(dense, size * np.sin(2 * np.pi * frequency * dense), grid, k=DEGREE)
    coefficients = np.zeros((len(grid) - DEGREE - 1, POSE))
    coefficients[:, 0], coefficients[:, 3] = way.c, 1.0
    return Segment("run", grid, (), coefficients), dense, way(dense, nu=2)


def through_filter(dense, values, constant):
    """What a first-order filter leaves of values on a dense grid of times."""
    numerator, denominator = bilinear([1.0], [constant, 1.0], 1 / (dense[1] - dense[0]))
    return lfilter(numerator, denominator, values, zi=[values[0] * (1 - numerator[0])])[0]


@pytest.mark.parametrize("frequency", [1.0, 2.0, 3.0, 5.0, 8.0, 15.0, 27.0])
@pytest.mark.parametrize("constant", [0.005, 0.013, 0.03])
def test_filtered_readings_balance_the_filtered_motion(frequency, constant):
    """A mass of one kilogram and one cable: slow changes are put right in the readings, fast ones in
    the motion, and what lies between in both by as much as they overlap."""
    segment, dense, acceleration = swinging(frequency)
    read = through_filter(dense, acceleration, constant)
    time = np.arange(0.05, 3.95, 0.01)
    readings = np.interp(time, dense, read)[:, None]
    corrected = readings - ReadingChanges.of(time, readings).added(constant)
    before = time - constant
    late = np.interp(before, dense, acceleration)
    balancing = late + FilteredMotion.of(segment, before, time, constant).acceleration[:, 0]
    inside = slice(40, -40)
    off, alone = (x[inside] for x in (corrected[:, 0] - balancing, readings[:, 0] - late))
    assert np.abs(off).max() < max(0.03 * np.abs(alone).max(), 2e-3)


@pytest.mark.parametrize("constant", [0.005, 0.013, 0.03])
def test_what_a_filter_leaves_of_a_motion_changes_as_differences_show(constant):
    segment, _, _ = swinging(15.0)
    time = np.arange(0.5, 3.5, 0.01)

    def whole(later, constant):
        """With what the delay does, that the balance takes from the motion itself."""
        times = time + later - constant
        late = motion_at(segment.basis(times), segment.coefficients)[2]
        return (late + FilteredMotion.of(segment, times, time, constant).acceleration)[30:-30]

    found = FilteredMotion.of(segment, time - constant, time, constant)
    jerk = motion_at(segment.basis(time - constant), segment.coefficients)[3]
    step = 1e-5
    by_time = (whole(step, constant) - whole(-step, constant)) / (2 * step)
    by_constant = (whole(0.0, constant + step) - whole(0.0, constant - step)) / (2 * step)
    size = np.abs(by_time).max()
    np.testing.assert_allclose((jerk + found.by_time)[30:-30], by_time, atol=1e-3 * size)
    np.testing.assert_allclose((found.by_constant - jerk)[30:-30], by_constant, atol=1e-3 * size)


@pytest.mark.parametrize("frequency", [5.0, 10.0, 20.0])
@pytest.mark.parametrize("constant", [0.005, 0.013, 0.03])
def test_functions_behind_a_filter_follow_its_motion(frequency, constant):
    """Nearer than the delay alone, by which alone steps would go astray."""
    segment, _, _ = swinging(frequency)
    time = np.arange(0.5, 3.5, 0.01)
    times = time - constant
    found = FilteredMotion.of(segment, times, time, constant)
    local = segment.coefficients[:, 0][found.local.first[:, None] + np.arange(DEGREE + 1)]
    following = np.einsum("ni,ni->n", found.local.values[2], local)
    late = motion_at(segment.basis(times), segment.coefficients)[2][:, 0]
    whole = late + found.acceleration[:, 0]
    off, alone = (np.abs(each - whole)[30:-30].max() for each in (following, late))
    assert off < 0.5 * alone


@pytest.mark.parametrize("frequency", [0.3, 0.8, 1.3])
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
    left = whole.leaving_out(gone).changes.added(0.03)
    np.testing.assert_array_equal(left, never.changes.added(0.03))
    assert np.abs(left - whole.changes.added(0.03)).max() > 1.0
    assert whole.leaving_out(none.copy()).changes is whole.changes


@pytest.mark.parametrize("rate", [25.0, 100.0, 1000.0])
@pytest.mark.parametrize("constant", [0.002, 0.01, 0.03, 0.1])
def test_corrected_readings_are_as_noisy_as_is_said(rate, constant):
    """Against the scatter of corrected noise, but for its ends."""
    noise = np.random.default_rng(0).standard_normal((int(20 * rate), 60))
    changes = ReadingChanges.of(np.arange(len(noise)) / rate, noise)
    inside = slice(int(rate), -int(rate))
    corrected = (noise - changes.added(constant))[inside]
    assert changes.louder(constant) == pytest.approx(
        corrected.std() / noise[inside].std(), rel=1e-2
    )


def test_readings_of_one_instant_are_as_noisy_as_they_were():
    assert ReadingChanges.of(np.zeros(1), np.zeros((1, 8))).louder(0.03) == 1.0


@pytest.mark.integration
@pytest.mark.parametrize("seed", range(3))
def test_a_filter_is_found_in_a_slow_motion(seed):
    """Corrections of readings whose noise is stated cost more there than they explain, were they not
    taken as noisier."""
    constant, rate, noise = 0.012, 100.0, 12.0
    cables = changed(PAPER["cables"], rate=rate, noise=1e-6)
    quiet = moving([1, 1, 1, 1, 1, 1], duration=20.0, harmonics=3)(
        seed, instruments={**PAPER, "cables": cables}
    )
    rng = np.random.default_rng(seed)
    # Five times as many samples, along straight lines, through the filter and back.
    numerator, denominator = bilinear([1.0], [constant, 1.0], 5 * rate)

    def read(values):
        true = values["tension"]
        dense = np.linspace(0, len(true) - 1, 5 * (len(true) - 1) + 1)
        through = []
        for own in true.T:
            along = np.interp(dense, np.arange(len(own)), own)
            start = [own[0] * (1 - numerator[0])]
            through.append(lfilter(numerator, denominator, along, zi=start)[0][::5])
        return {"tension": np.column_stack(through) + noise * rng.standard_normal(true.shape)}

    filtered = with_stream(quiet, "cables", read)
    stated = changed(cables, noise=noise, calibration={"time_constant": {"sigma": 0.03}})
    found = fit_jointly(replace(filtered, instruments={**quiet.instruments, "cables": stated}))
    place = found.calibration.calibration_parameters.place("cables", "time_constant", "run")
    sigma = found.deviations[place]
    assert sigma < 0.4 * constant
    assert abs(found.calibration.values[place] - constant) < 3 * sigma


@pytest.mark.parametrize("constant", [0.01, 0.05])
def test_what_was_corrected_is_taken_back_as_a_linear_system_has_it(constant):
    rng = np.random.default_rng(3)
    time = np.sort(np.linspace(0.0, 4.0, 300) + rng.uniform(-2e-3, 2e-3, 300))
    series = rng.normal(size=(300, 3)).cumsum(axis=0)
    taken_off = ReadingChanges.of(time, np.eye(300)).added(constant)
    corrected = series - ReadingChanges.of(time, series).added(constant)
    by_solving = np.linalg.solve(np.eye(300) - taken_off, corrected)
    size = np.abs(series).max()
    np.testing.assert_allclose(uncorrected(time, corrected, constant), series, atol=1e-5 * size)
    np.testing.assert_allclose(by_solving, series, atol=1e-8 * size)


def test_filters_of_tenths_of_a_second_are_left_as_they_are():
    time = np.arange(300) / 100
    series = np.random.default_rng(3).normal(size=(300, 1))
    assert uncorrected(time, series, 0.3) is series
