"""Clocks that are set while they run: sound recordings show none, and one that was set is named with its
time and size."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm
from simulated import sound, studied

from steelyard.identification.solve.joint_motion import fit_jointly
from steelyard.identification.solve.settings import FitSettings
from steelyard.identification.verdict import clock_changes
from steelyard.identification.verdict.clock_changes import (
    ClockChange,
    _step_of_delay,
    delay_changes,
    set_clocks,
)
from steelyard.identification.verdict.settings import VERDICT
from steelyard.inertia import TEN
from steelyard.inspection.identify import identify

pytestmark = pytest.mark.integration

SEEDS = range(8)
AT = 6.0  # [s], half of simulated recordings


def set_later(experiment, name, size):
    """The same recording; the clock of an instrument is set at half of it."""
    run = experiment.runs[0]
    stream = run.streams[name]
    half = np.mean([stream.time[0], stream.time[-1]])
    moved = replace(stream, time=stream.time + np.where(stream.time > half, size, 0.0))
    return replace(experiment, runs=(replace(run, streams={**run.streams, name: moved}),))


@pytest.mark.slow
@pytest.mark.long
def test_changes_of_delays_in_sound_recordings_are_standard_normal():
    z = np.array([[test.z for test in delay_changes(studied(seed))] for seed in SEEDS])
    # Neighbouring bounds go together, and so do the clocks: some ten independent numbers a recording.
    assert abs(z.mean()) < 0.4
    assert 0.6 < z.std() < 1.3
    assert np.abs(z).max() < norm.isf(VERDICT.family / z.shape[1] / 2)
    assert not any(list(set_clocks(studied(seed))) for seed in SEEDS)


def test_every_bound_between_stretches_is_asked_about_but_near_the_ends():
    found = studied(0)
    times = {test.time for test in delay_changes(found)}
    start, end = (
        edge(segment.span[i] for segment in found.fit.state.segments)
        for i, edge in enumerate((min, max))
    )
    far = [time for time in found.blocks.since if start + 2 <= time <= end - 2]
    assert times == set(far)
    assert len(far) > 5


@pytest.mark.parametrize("size", [0.004, -0.004])
def test_a_clock_that_was_set_a_little_is_found_with_its_size(size):
    # Nothing is to be taken up that would explain a part of it.
    found = fit_jointly(set_later(sound(2), "imu", size), settings=FitSettings(suspicions=0))
    of_imu = [test for test in delay_changes(found) if test.owners == ("imu",)]
    test = max(of_imu, key=lambda each: abs(each.z))
    assert abs(test.z) > 5
    assert test.size == pytest.approx(size, abs=max(4 * test.sigma, 0.3 * abs(size)))
    assert test.time == pytest.approx(AT, abs=4.0)
    (named,) = set_clocks(found)
    # What is told is how two clocks have moved against each other.
    assert named.owners in {("imu",), ("tracker",)}


@pytest.mark.slow
@pytest.mark.long
def test_an_estimate_across_it_is_rejected_and_two_runs_are_accepted():
    late = set_later(sound(3), "tracker", 0.05)
    verdict = identify(late, ["maximum-likelihood"]).estimate.verdict
    assert not verdict.accepted
    assert any("time stamps of tracker seem to shift" in reason for reason in verdict.reasons)
    run = late.runs[0]
    parts = (
        replace(run, name="before", window=(0.0, AT - 0.2)),
        replace(run, name="after", window=(AT + 0.2, 2 * AT)),
    )
    verdict = identify(replace(late, runs=parts), ["maximum-likelihood"]).estimate.verdict
    assert verdict.accepted, verdict.reasons


def with_delays(found, name, sizes):
    """What stretches say where an instrument is late in each of them by as much [s]; the estimate
    follows."""
    parameters = found.calibration.calibration_parameters
    (place,) = (
        place
        for place, each, _ in parameters.components()
        if (each.owner, each.key) == (name, "delay")
    )
    blocks, solution = found.blocks, found.solution
    further = sizes[:, None] * blocks.normal[:, :, TEN + place]
    step = solution.projection @ further.sum(axis=0)
    scores = solution.scores + further.sum(axis=0) - blocks.normal.sum(axis=0) @ step
    return replace(
        found,
        blocks=replace(blocks, right=blocks.right + further),
        solution=replace(solution, value=solution.value + step, scores=scores),
    )


@pytest.mark.parametrize("size", [0.01, -0.05])
def test_a_sensor_that_slips_is_no_clock_that_was_set(size):
    found = studied(0)
    middle = len(found.blocks.since) // 2
    sizes = np.zeros(len(found.blocks.since))
    sizes[middle:] = size
    (named,) = set_clocks(with_delays(found, "tracker", sizes))
    assert "tracker" in named.owners
    assert named.time == pytest.approx(found.blocks.since[middle])
    # Coloured noise that follows a shift too late is late for the moment, and too early before.
    sizes = np.zeros(len(found.blocks.since))
    sizes[middle - 1 : middle + 1] = -5 * size, 5 * size
    late = with_delays(found, "tracker", sizes)
    assert any(abs(test.z) > 5 for test in delay_changes(late))
    assert list(set_clocks(late)) == []


def swinging(time):
    """Places along a motion, shape (n, 3)."""
    return np.column_stack([np.sin(2 * np.pi * f * time + f) / f for f in (0.31, 0.47, 0.83)])


@pytest.mark.parametrize("size", [0.03, -0.015])
def test_readings_that_depart_by_a_delay_from_some_time_on_are_late(size):
    time = np.sort(np.random.default_rng(1).uniform(0, 20, 1500))
    late = swinging(time - size * (time > 11.4)) - swinging(time)
    at, found, z = _step_of_delay(
        time, swinging(time), late + np.array([0.1, 0.0, -0.2]), 2.0, VERDICT
    )
    assert at == pytest.approx(11.4, abs=0.3)
    assert found == pytest.approx(size, rel=0.05)
    assert z > 5


def test_coloured_noise_is_no_delay():
    time = np.arange(0, 20, 0.05)
    rng = np.random.default_rng(2)
    for _ in range(300):
        kept, noise = np.exp(-0.05 / 2.0), rng.standard_normal((len(time), 3))
        for i in range(1, len(time)):
            noise[i] = kept * noise[i - 1] + np.sqrt(1 - kept**2) * noise[i]
        assert _step_of_delay(time, swinging(time), 0.01 * noise, 2.0, VERDICT) is None


@pytest.mark.parametrize(
    ("size", "within_clock", "shift", "counts"),
    [
        (0.007, True, 0.7, False),
        (0.007, False, 0.7, True),
        (0.025, True, 0.7, True),
        (0.007, True, 1.2, True),
        (0.004, False, 0.7, False),
    ],
)
def test_within_a_clock_a_few_milliseconds_are_friction(
    monkeypatch, size, within_clock, shift, counts
):
    change = ClockChange("run", ("cables",), 17.2, 5.1, size, size / 5.1, shift, within_clock)
    monkeypatch.setattr(clock_changes, "delay_changes", lambda posterior, settings: [change])
    monkeypatch.setattr(clock_changes, "disturbing_changes", lambda posterior, settings: [])
    monkeypatch.setattr(clock_changes, "_lasts", lambda posterior, run, limit, settings: True)
    assert list(set_clocks(None)) == [change] * counts


def test_what_to_do_depends_on_whether_the_clock_is_shared():
    found = fit_jointly(set_later(sound(2), "imu", 0.004), settings=FitSettings(suspicions=0))
    said = {test.owners: str(test) for test in delay_changes(found)}
    assert "give imu a 'clock' of its own" in said["imu",]
    assert "of its own" not in said["tracker",]
