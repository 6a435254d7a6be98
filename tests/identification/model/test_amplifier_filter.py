"""Filters of force amplifiers, against the solution of their equation on a dense grid of times: what they
leave of something smooth, and the balance behind them, which nothing approximates."""

from dataclasses import replace

import numpy as np
import pytest
from balanced import Case, assert_derivatives
from scipy.signal import bilinear, lfilter
from simulated import PAPER, changed, moving, with_stream

from steelyard.identification.model.balance.amplifier_filter import (
    MEMORY,
    Panels,
    beginning,
    rates_by_motion,
    times_before,
)
from steelyard.identification.model.balance.linearised import point_of
from steelyard.identification.model.balance.linearised_in_time import by_moving, delays
from steelyard.identification.model.calibration_parameters import CalibrationValues
from steelyard.identification.model.force_residuals import whitened_balance
from steelyard.identification.solve.joint_motion import fit_jointly
from steelyard.instruments.base import TIME_CONSTANT

DENSE = 1e-4  # [s], of the grid on which the filter's equation is solved
SAME = 1e-3  # of a size of one; of a bilinear transform of 10 kHz
CHANGES_SLOWLY = 0.03  # relative: how derivatives by the motion change while the filter looks back


def through_filter(values, constant, step=DENSE):
    """What a first-order filter leaves of values on a dense grid of times, as if they had been at rest
    before, shape (n, k)."""
    numerator, denominator = bilinear([1.0], [constant, 1.0], 1 / step)
    start = values[:1] * (1 - numerator[0])
    return lfilter(numerator, denominator, values, axis=0, zi=start)[0]


def sampled(rng, *, even):
    """Which of a dense grid of 4 s are sampled about every 10 ms."""
    own = np.arange(5000, 40000, 100)
    return own if even else own + rng.integers(-40, 41, size=len(own))


@pytest.mark.parametrize("even", [True, False])
@pytest.mark.parametrize("constant", [0.002, 0.012, 0.05, 0.3])
@pytest.mark.parametrize("frequency", [0.5, 3.0, 12.0, 27.0])
def test_what_a_filter_leaves_is_what_its_equation_says(rng, even, constant, frequency):
    dense = np.arange(0.0, 4.0, DENSE)
    along = np.sin(2 * np.pi * frequency * dense)[:, None] + [[3.0]]
    once = through_filter(along, constant)
    twice = through_filter(once, constant)
    own = sampled(rng, even=even)
    panels = Panels.of(dense[own], constant, 1 / (8 * frequency))
    nodes = np.sin(2 * np.pi * frequency * panels.nodes)[:, :, None] + 3.0
    first = np.stack([once[own[0]], twice[own[0]]])
    found, again = panels.filtered(nodes, first)
    # Of what is so long ago a filter remembers a three-thousandth, and of what it remembers more.
    gone = 0.0 if np.diff(dense[own]).max() < MEMORY * constant else 1.0
    np.testing.assert_allclose(found, once[own], atol=SAME + 5e-3 * gone)
    np.testing.assert_allclose(again, twice[own], atol=SAME + 2e-2 * gone)


@pytest.mark.parametrize("constant", [0.002, 0.05])
def test_what_is_constant_between_readings_is_filtered_as_it_is(rng, constant):
    dense, own = np.arange(0.0, 4.0, DENSE), np.arange(5000, 40000, 100)
    rates = rng.normal(size=(len(own), 2))
    # Each from the reading before to its own.
    steps = rates[np.clip(np.searchsorted(own, np.arange(len(dense))), 0, len(own) - 1)]
    once = through_filter(steps, constant)
    first = np.stack([once[own[0]], through_filter(once, constant)[own[0]]])
    found, again = Panels.of(dense[own], constant, 1.0).filtered_changes(rates, first)
    np.testing.assert_allclose(found, once[own], atol=0.05 * DENSE / constant + 1e-2)
    np.testing.assert_allclose(again, through_filter(once, constant)[own], atol=1e-2)


def test_a_gap_is_looked_into_as_far_as_a_filter_remembers():
    constant, times = 0.02, np.array([0.0, 0.01, 0.02, 60.0, 60.01])
    panels = Panels.of(times, constant, 0.1)
    assert panels.nodes.shape[1] < 20
    found, again = panels.filtered(panels.nodes[:, :, None], np.zeros((2, 1)))
    # Of a ramp a filter is its time constant behind, and twice.
    np.testing.assert_allclose(found[3:, 0], times[3:] - constant, atol=2e-4)
    np.testing.assert_allclose(again[3:, 0], times[3:] - 2 * constant, atol=1e-3)


def test_what_does_not_change_is_left_as_it_is(rng):
    times = np.sort(rng.uniform(0, 3, 200))
    panels = Panels.of(times, 0.03, 0.1)
    still = np.full((*panels.nodes.shape, 1), 7.0)
    for found in panels.filtered(still, np.full((2, 1), 7.0)):
        np.testing.assert_allclose(found, 7.0, rtol=1e-13)


def test_a_filter_begins_as_what_it_filters_goes_on():
    times, constant = np.array([0.0, 0.01, 0.02]), 0.03
    once, twice = beginning(times, (2.0 + 3 * times)[:, None], constant)
    assert once == pytest.approx(2 - 3 * constant)
    assert twice == pytest.approx(2 - 6 * constant)
    assert beginning(times[:1], np.ones((1, 1)), constant) == pytest.approx(np.ones((2, 1)))


def test_times_before_end_where_the_motion_begins():
    times = np.arange(1.0, 2.0, 0.01)
    found = times_before(times, 0.9, 0.05)
    assert found[0] == pytest.approx(0.9)
    assert found[-1] == pytest.approx(0.9875)
    assert times_before(times, 1.0, 0.05).size == 0
    assert times_before(times, -9.0, 0.05)[0] == pytest.approx(0.6)


def test_readings_that_change_at_rest_turn_no_wrench(rng):
    times, by_reading = np.arange(50) / 100, rng.normal(size=(6, 8))
    readings = 500 + rng.normal(size=(50, 8)).cumsum(axis=0)
    every = np.broadcast_to(by_reading, (50, 6, 8))
    found = rates_by_motion(times, readings @ by_reading.T, every, readings)
    np.testing.assert_allclose(found, 0, atol=1e-8)


class Filtered:
    """A body that swings on cables, or on a wrench sensor, whose forces a filter has passed."""

    def __init__(self, force, constant, frequency):
        self.case = found = Case(force, n=2)
        dense = np.arange(0.45, 2.8, DENSE)
        coefficients = found.segment.coefficients
        along = np.linspace(0, 3.0, len(coefficients))[:, None]
        rng = np.random.default_rng(5)
        size = np.array([0.1, 0.1, 0.1, 0.0, 0.05, 0.05, 0.05]) * min(1.0, 0.5 / frequency**2)
        at = np.array([0.3, -0.2, 2.0, 1.0, 0.05, -0.05, 0.1])
        swing = np.sin(2 * np.pi * frequency * along + rng.uniform(0, 6, 7))
        found.segment = replace(found.segment, coefficients=at + size * swing)
        found.time = dense
        guess = found.forces.readings
        inner = 700 + 100 * np.sin(5 * dense[:, None] + np.arange(8))
        found.forces = found.force_samples(
            {q: inner[:, : v.shape[1]] for q, v in guess.items()}, found.forces.sigma
        )
        found.balanced()
        late = found.calibration.values.copy()
        late[found.calibration_parameters.places["forces", TIME_CONSTANT, None]] = constant
        found.calibration = CalibrationValues(found.calibration_parameters, late)
        read = {q: through_filter(v, constant) for q, v in found.forces.readings.items()}
        # Rollers remember from the first reading on; the grid's filter was at rest before.
        skipped = 4000
        own = np.arange(0 if force == "winch end" else skipped, len(dense), 100)
        self.told = slice(int(np.searchsorted(own, skipped)), None)
        found.time = dense[own]
        found.forces = found.force_samples({q: v[own] for q, v in read.items()}, found.forces.sigma)

    @property
    def place(self):
        return self.case.calibration_parameters.places["forces", TIME_CONSTANT, None]

    def left_over(self, **changed):
        return self.case.balance(**changed).left_over[self.told]

    def by_values(self, place, step=1e-4):
        ends = []
        for sign in (1, -1):
            values = self.case.calibration.values.copy()
            values[place] += sign * step
            ends.append(self.left_over(values=values))
        return (ends[0] - ends[1]) / (2 * step)


@pytest.fixture(
    scope="module",
    params=[
        ("platform end", 0.031, 1.0),
        ("winch end", 0.05, 0.7),
        ("wrench", 0.031, 1.5),
        ("platform end", 0.012, 6.0),
    ],
    ids=str,
)
def filtered(request):
    return Filtered(*request.param)


@pytest.mark.integration
def test_the_balance_behind_a_filter_leaves_nothing(filtered):
    """What a delay alone leaves is a hundred to a thousand times as much."""
    at = filtered.case.balance()
    left, alone = (each[filtered.told] for each in (at.left_over, at.left_over - at.off))
    assert np.all(np.abs(left).max(axis=0) < 0.01 * np.abs(alone).max(axis=0) + 1e-4)


def test_its_noise_is_that_of_the_readings(filtered):
    """No correction makes it louder, and none meets itself: what the filter remembers of noise is
    little beside it."""
    case, rng = filtered.case, np.random.default_rng(3)
    clean, at = filtered.left_over(), case.balance()
    noise = rng.normal(size=case.forces.left_out.shape) * case.forces.sigma
    noisy = filtered.left_over(forces=replace(case.forces, readings=case.changed(noise)))
    expected = np.einsum("nkr,nr->nk", at.by_reading, noise)[filtered.told]
    off = (noisy - clean - expected).std(axis=0)
    assert np.all(off < 0.05 * expected.std(axis=0))


def test_it_follows_the_body_as_differences_show(filtered):
    case = filtered.case
    point = point_of(
        case.experiment, case.segment, case.forces, case.calibration, case.parameters, {}
    )
    found = point.by_body(case.parameters)
    for i in range(10):
        way = np.eye(10)[i] * 1e-3
        ends = [filtered.left_over(parameters=case.parameters + s * way) for s in (1, -1)]
        assert_derivatives(found[filtered.told, :, i], (ends[0] - ends[1]) / 2e-3, 1e-7)


def test_it_follows_its_time_constant_and_delays_as_differences_show(filtered):
    case = filtered.case
    point = point_of(
        case.experiment, case.segment, case.forces, case.calibration, case.parameters, {}
    )
    found = {
        place.start: each[filtered.told] for place, each in by_moving(point, point.by_motion())
    }
    own, (delay, _), *_ = filtered.place, *delays(point)
    assert_derivatives(found[own.start][:, :, 0], filtered.by_values(own), 2e-3)
    # How fast readings change while cables turn is of no account.
    assert_derivatives(found[delay.start][:, :, 0], filtered.by_values(delay), CHANGES_SLOWLY)


@pytest.mark.parametrize("constant", [-5e-3, -1e-3, 1e-3])
def test_a_fit_goes_over_zero_as_if_nothing_were_there(filtered, constant):
    """Below it forces are early, and less smooth by what a filter of that size smooths."""
    case = filtered.case
    values = case.calibration.values.copy()
    values[filtered.place] = constant
    calibration = CalibrationValues(case.calibration_parameters, values)
    point = point_of(case.experiment, case.segment, case.forces, calibration, case.parameters, {})
    found = {
        place.start: each[filtered.told] for place, each in by_moving(point, point.by_motion())
    }[filtered.place.start]
    ends = []
    for step in (1e-5, -1e-5):
        values[filtered.place] = constant + step
        ends.append(filtered.left_over(values=values))
    # How fast readings change while cables turn is of no account.
    known = CHANGES_SLOWLY if case.balance().rolled is None else 3 * CHANGES_SLOWLY
    assert_derivatives(found[5:, :, 0], (ends[0] - ends[1])[5:] / 2e-5, known)


@pytest.mark.parametrize("wide", [True, False])
def test_it_follows_the_motion_nearly_as_differences_show(filtered, wide):
    """Steps that are a little off end where those end that are not; rows of six functions do not know
    what was before."""
    case = filtered.case
    columns = np.full(len(case.calibration_parameters), -1)
    rows = whitened_balance(
        case.experiment,
        case.segment,
        case.forces,
        case.calibration,
        columns,
        case.parameters,
        {},
        None,
        wide=wide,
    ).rows[0]
    x, whitener, told = case.segment.coefficients, case.balance().whitener, filtered.told
    rng = np.random.default_rng(1)
    along = np.linspace(0, 3.0, len(x))[:, None]
    for frequency in (0.5, 1.0, 2.0):
        way = rng.normal(size=7) * np.sin(2 * np.pi * frequency * along + rng.uniform(0, 6, 7))
        ends = [filtered.left_over(coefficients=x + s * 1e-5 * way) for s in (1, -1)]
        expected = np.einsum("nij,nj->ni", whitener[told], ends[0] - ends[1]) / 2e-5
        own = rows.first[:, None] + np.arange(rows.by_motion.shape[2] // 7)
        found = np.einsum("nki,ni->nk", rows.by_motion, way[own].reshape(len(own), -1))
        off = np.linalg.norm((found[told] - expected)[20:]) / np.linalg.norm(expected[20:])
        # How what rollers remember follows the motion is of no account.
        known = CHANGES_SLOWLY if case.balance().rolled is None else 3 * CHANGES_SLOWLY
        assert off < (known if wide else 4 * known)


@pytest.mark.integration
@pytest.mark.parametrize("seed", range(3))
def test_a_filter_is_found_in_a_slow_motion(seed):
    """Where readings that are put right cost more than they explain."""
    constant, rate, noise = 0.012, 100.0, 12.0
    cables = changed(PAPER["cables"], rate=rate, noise=1e-6)
    quiet = moving([1, 1, 1, 1, 1, 1], duration=20.0, harmonics=3)(
        seed, instruments={**PAPER, "cables": cables}
    )
    rng = np.random.default_rng(seed)

    def read(values):
        true = values["tension"]
        # Five times as many samples, along straight lines.
        dense = np.linspace(0, len(true) - 1, 5 * (len(true) - 1) + 1)
        along = np.column_stack([np.interp(dense, np.arange(len(true)), own) for own in true.T])
        filtered = through_filter(along, constant, 1 / (5 * rate))[::5]
        return {"tension": filtered + noise * rng.standard_normal(true.shape)}

    filtered = with_stream(quiet, "cables", read)
    stated = changed(cables, noise=noise, calibration={"time_constant": {"sigma": 0.03}})
    found = fit_jointly(replace(filtered, instruments={**quiet.instruments, "cables": stated}))
    place = found.calibration.calibration_parameters.place("cables", "time_constant", "run")
    sigma = found.deviations[place]
    assert sigma < 0.4 * constant
    assert abs(found.calibration.values[place] - constant) < 3 * sigma
