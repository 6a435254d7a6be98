"""Clocks from the data: readings written down by hand from one motion, each on a clock of its own,
and whole simulations."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from simulated import PAPER, ROBOT, sound

from steelyard.clocks.clock_signals import (
    FORCE,
    POSITION,
    RATE,
    ROTATION,
    SPECIFIC_FORCE,
    LogClock,
    Signal,
    clocks_of,
)
from steelyard.clocks.offsets import Offset, chained, drift_of, joined
from steelyard.clocks.search import candidates
from steelyard.clocks.settings import OffsetSettings
from steelyard.clocks.shift import Shift, refined
from steelyard.errors import InputError
from steelyard.identification.identify import identify
from steelyard.identification.methods.two_step import TwoStep
from steelyard.identification.settings import SynchronisationSettings
from steelyard.identification.synchronisation import offsets_of, synchronise
from steelyard.simulation.recording import draw_errors

pytestmark = pytest.mark.integration

G = np.array([0, 0, -9.81])
STEP = 1e-4  # [s], of differences
LEVER = np.array([0.1, -0.2, 0.4])
MOUNTED = Rotation.from_euler("ZYX", [0.5, -0.3, 2.0])


class Motion:
    """Place and attitude as sums of sines that hardly repeat."""

    def __init__(self, seed=0, periods=None):
        rng = np.random.default_rng(seed)
        self.rates = (
            2
            * np.pi
            * (
                rng.uniform(0.1, 0.6, (6, 5))
                if periods is None
                else 1 / np.broadcast_to(periods, (6, 5))
            )
        )
        self.phases = rng.uniform(0, 2 * np.pi, (6, 5))
        self.sizes = rng.uniform(0.3, 1.0, (6, 5)) * np.array(
            [[0.3], [0.3], [0.2], [0.1], [0.1], [0.1]]
        )

    def coordinates(self, t):
        return np.sum(self.sizes * np.sin(self.rates * t[:, None, None] + self.phases), axis=2)

    def place(self, t):
        return self.coordinates(t)[:, :3]

    def attitude(self, t):
        return Rotation.from_euler("ZYX", self.coordinates(t)[:, 5:2:-1])

    def rate(self, t):
        """Angular velocity in the platform's axes, from the change of the attitude."""
        return (self.attitude(t - STEP).inv() * self.attitude(t + STEP)).as_rotvec() / (2 * STEP)

    def force_samples(self, t, lever=LEVER):
        """Specific force at a point of the platform, from the change of its place."""

        def point(s):
            return self.place(s) + self.attitude(s).apply(lever)

        acceleration = (point(t + STEP) - 2 * point(t) + point(t - STEP)) / STEP**2
        return self.attitude(t).inv().apply(acceleration - G)


def tracker(motion, rng, *, late=0.0, drift=0.0, duration=20.0, noise=5e-4, rate=100.0):
    t = np.arange(0, duration, 1 / rate) + rng.uniform(0, 0.9 / rate, int(np.ceil(rate * duration)))
    lever = np.array([0.2, 0.1, 0.9])
    seen = motion.place(t) + motion.attitude(t).apply(lever)
    # Its axes and unit are its own.
    seen = 1e3 * Rotation.from_euler("xyz", [0.3, 0.2, 1.0]).apply(seen) + rng.normal(
        0, 1e3 * noise, seen.shape
    )
    return LogClock(("tracker",), {POSITION: Signal(t * (1 + drift) + late, seen)})


def imu(motion, rng, *, late=0.0, duration=20.0, attitude=True, rate=50.0):
    t = np.arange(0, duration, 1 / rate)
    signals = {
        RATE: -MOUNTED.apply(motion.rate(t)) + 0.01 + rng.normal(0, 0.002, (len(t), 3)),
        SPECIFIC_FORCE: (
            MOUNTED.apply(motion.force_samples(t)) / 9.81 + 0.02 + rng.normal(0, 0.003, (len(t), 3))
        ),
    }
    if attitude:
        noisy = (
            motion.attitude(t)
            * MOUNTED.inv()
            * Rotation.from_rotvec(rng.normal(0, 0.003, (len(t), 3)))
        )
        quaternions = noisy.as_quat(scalar_first=True)
        signs = np.cumprod(
            np.concatenate(
                [[1], np.where(np.sum(quaternions[1:] * quaternions[:-1], axis=1) < 0, -1, 1)]
            )
        )
        signals[ROTATION] = quaternions * signs[:, None]
    return LogClock(("imu",), {name: Signal(t + late, values) for name, values in signals.items()})


@pytest.mark.parametrize("seed", range(4))
def test_tracker_and_imu_meet_whatever_their_axes_units_and_levers(seed):
    motion, rng = Motion(seed), np.random.default_rng(seed)
    late = 1234.567 + rng.uniform(-1, 1)
    first, second = imu(motion, rng), tracker(motion, rng, late=late)
    guess = candidates(first, second, 3)[0]
    assert abs(guess.shift - late) < 0.2
    found = refined(first, second, guess.shift, around=first.span)
    assert abs(found.value - late) < max(4 * found.sigma, 1e-4)
    assert found.sigma < 0.002


def test_stated_deviation_is_that_of_the_error():
    motion = Motion(1)
    scores = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        first, second = imu(motion, rng), tracker(motion, rng, rate=50.0)
        found = refined(first, second, 0.02, around=first.span)
        scores.append(found.value / found.sigma)
    # Twelve draws, and a bias of the filter that is not in it.
    assert 0.5 < np.sqrt(np.mean(np.square(scores))) < 1.7


def test_direction_of_a_shift():
    motion, rng = Motion(2), np.random.default_rng(0)
    first, second = imu(motion, rng, late=3.0), tracker(motion, rng, late=5.0)
    assert joined([first, second])[1].value == pytest.approx(2.0, abs=0.005)
    assert joined([second, first])[1].value == pytest.approx(-2.0, abs=0.005)


def test_part_of_a_recording_that_overlaps():
    motion, rng = Motion(3), np.random.default_rng(0)
    first = imu(motion, rng, duration=30.0)
    late = tracker(motion, rng, duration=30.0)
    signal = late.signals[POSITION].between(12.0, 30.0)
    second = LogClock(("tracker",), {POSITION: Signal(signal.time + 100.0, signal.values)})
    assert joined([first, second])[1].value == pytest.approx(100.0, abs=0.005)


def test_a_gap_is_no_motion():
    motion, rng = Motion(4), np.random.default_rng(0)
    whole = tracker(motion, rng).signals[POSITION]
    kept = (whole.time < 7.0) | (whole.time > 9.5)
    second = LogClock(("tracker",), {POSITION: Signal(whole.time[kept] + 7.0, whole.values[kept])})
    assert joined([imu(motion, rng), second])[1].value == pytest.approx(7.0, abs=0.005)


def test_motion_that_repeats_itself_tells_nothing():
    motion, rng = Motion(5, periods=np.array([2.0, 2.0, 1.0, 1.0, 4 / 2])), np.random.default_rng(0)
    offset = joined(
        [imu(motion, rng, duration=60.0), tracker(motion, rng, duration=60.0, late=0.7)]
    )[1]
    # It may be told by where the recordings end, but must not be claimed to be precise and wrong.
    assert not offset.known or abs(offset.value - 0.7) < 0.01


def test_rest_tells_nothing():
    still, rng = Motion(6), np.random.default_rng(0)
    still.sizes = still.sizes * 1e-6
    offset = joined([imu(still, rng), tracker(still, rng)])[1]
    assert not offset.known
    assert offset.reason


@pytest.mark.slow
@pytest.mark.parametrize("drift", [0.0, 40e-6, -100e-6])
def test_drift(drift):
    motion, rng = Motion(7), np.random.default_rng(0)
    first = imu(motion, rng, duration=200.0)
    second = tracker(motion, rng, duration=200.0, late=2.0, drift=drift)
    offset = joined([first, second])[1]
    assert abs(offset.drift - drift) < 3 * offset.drift_sigma
    assert offset.drift_sigma < 8e-6
    assert (offset.drift == 0) == (drift == 0)


def test_drift_from_parts():
    slope, sigma = drift_of(
        lambda middle, reach: Shift(1.0 + 3e-5 * middle, 1e-4, 0.0), (0.0, 1000.0)
    )
    assert slope == pytest.approx(3e-5, rel=1e-6)
    assert 0 < sigma < 1e-6
    assert drift_of(lambda middle, reach: Shift(1.0, 1e-4, 0.0), (0.0, 1000.0))[0] == 0.0
    assert drift_of(lambda middle, reach: None, (0.0, 1000.0)) == (0.0, 0.0)
    assert drift_of(lambda middle, reach: Shift(1.0, 1e-4, 0.0), (0.0, 20.0)) == (0.0, 0.0)


# Whole experiments


def without_clocks(experiment):
    """The same recording without a word of its clocks."""
    runs = tuple(replace(run, sync={}, unsynchronised=True) for run in experiment.runs)
    return replace(experiment, runs=runs)


def recorded(seed):
    """A recording, and by how much each of its clocks is ahead of that of the forces [s]."""
    experiment = sound(seed)
    errors = draw_errors(PAPER, ROBOT.m, ["run"], np.random.default_rng(seed))["run"]
    # As they were drawn when it was recorded.
    sync = experiment.runs[0].sync
    event = {name: sync[name] + errors[name].delay for name in sync}
    return experiment, {name: event[name] - event["cables"] for name in event}


@pytest.mark.slow
@pytest.mark.long
def test_clocks_of_an_experiment():
    experiment, ahead = recorded(0)
    auto = without_clocks(experiment)
    for found in offsets_of(auto, auto.runs[0]):
        assert found.known
        for name in found.instruments:
            assert abs(found.value - ahead[name]) < 0.004, name
    exact = synchronise(auto)
    for found in exact.offsets["run"][1:]:
        for name in found.instruments:
            if name != "command":
                assert abs(found.value - ahead[name]) < max(4 * found.sigma, 1e-4), name
                assert found.sigma < 0.003
    run = exact.experiment.runs[0]
    assert not run.unsynchronised
    assert run.sync["cables"] == pytest.approx(experiment.runs[0].streams["cables"].time[0])


@pytest.mark.slow
def test_when_a_clock_counts_as_found_can_be_set():
    experiment, _ = recorded(0)
    auto = without_clocks(experiment)
    forces_alone = SynchronisationSettings(least_gain=1e9)
    others = SynchronisationSettings(offset=OffsetSettings(least_gain=1e9))
    # The first motion clock needs the forces alone, the others need it too.
    for settings, known, reason in (
        (forces_alone, 0, "tells too little of where the cables pull"),
        (others, 1, "the motion that both recorded is too small"),
    ):
        first, *rest = offsets_of(auto, auto.runs[0], settings=settings)
        assert first.known
        assert sum(each.known for each in rest) == known
        assert any(reason in each.reason for each in rest)


def test_instruments_of_one_file_keep_their_clock():
    experiment, _ = recorded(0)
    run = experiment.runs[0]
    together = {
        name: replace(stream, clock="recorder.csv" if name != "tracker" else None)
        for name, stream in run.streams.items()
    }
    # Cables and IMU were recorded on clocks of different origin; in one file they have the same.
    moved = run.sync["cables"] - run.sync["imu"]
    together["imu"] = replace(together["imu"], time=together["imu"].time + moved)
    together.pop("command", None)
    auto = without_clocks(replace(experiment, runs=(replace(run, streams=together),)))
    clocks = clocks_of(auto, auto.runs[0])
    assert [c.instruments for c in clocks] == [("cables", "imu"), ("tracker",)]
    assert {SPECIFIC_FORCE, RATE, ROTATION, FORCE} == set(clocks[0].signals)
    found = synchronise(auto).experiment
    assert found.runs[0].sync["cables"] == found.runs[0].sync["imu"]
    assert found.instruments["cables"].clock == found.instruments["imu"].clock


@pytest.mark.slow
def test_estimate_is_no_worse_than_with_the_clocks_given():
    experiment, ahead = recorded(1)
    event = experiment.runs[0].sync["cables"]
    exact = {name: event + value for name, value in ahead.items()}
    true = TwoStep()(replace(experiment, runs=(replace(experiment.runs[0], sync=exact),)))
    auto = identify(without_clocks(experiment), [TwoStep()])
    sigma = true.standard_deviation
    assert np.all(np.abs(auto.estimates["two-step"].value - true.value) < 0.3 * sigma)
    for found in auto.clocks["run"][1:3]:
        for name in found.instruments:
            assert abs(found.value - ahead[name]) < 4 * found.sigma, name
    listed = auto.to_dict()["clocks"]["run"]
    assert listed[0]["instruments"] == ["cables"]
    assert all(each["told"] for each in listed)


def test_a_platform_at_rest_is_an_honest_failure():
    experiment, _ = recorded(0)
    run = experiment.runs[0]
    rng = np.random.default_rng(0)
    still = {
        name: replace(stream, values={q: _frozen(v, rng) for q, v in stream.values.items()})
        for name, stream in run.streams.items()
    }
    auto = without_clocks(replace(experiment, runs=(replace(run, streams=still),)))
    with pytest.raises(
        InputError,
        match=r"expected a motion that tells how far the clocks are apart, found .*'sync'",
    ):
        synchronise(auto)


def _frozen(values, rng):
    """The first reading again and again, with noise."""
    if values.ndim == 3:
        return (
            Rotation.from_matrix(values[0])
            * Rotation.from_rotvec(rng.normal(0, 0.003, (len(values), 3)))
        ).as_matrix()
    return values[0] + rng.normal(0, 1e-3 * np.abs(values[0]).max(), values.shape)


def test_offsets_along_two_steps_add_up():
    old = Offset(("imu",), 2.0, 0.03, True, drift=1e-5, drift_sigma=3e-6)
    step = Offset(("tracker",), 0.5, 0.04, False, "too slow", drift=2e-6, drift_sigma=4e-6)
    there = chained(old, step, ("tracker",))
    assert (there.value, there.known, there.reason) == (2.5, False, "too slow")
    assert (there.sigma, there.drift_sigma) == pytest.approx((0.05, 5e-6))
    back = chained(old, step, ("camera",), -1)
    assert (back.value, back.instruments) == (1.5, ("camera",))
    assert back.drift == pytest.approx(8e-6)
