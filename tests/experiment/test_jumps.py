"""Stretches in which a tracker shows another place."""

import numpy as np
import pytest

from steelyard.experiment.faults.jumps import jumps

RATE = 200.0
TIME = np.arange(0.0, 20.0, 1 / RATE)


def course(noise=5e-4, seed=1):
    """A platform on its way: metres within seconds, and noise."""
    rng = np.random.default_rng(seed)
    phase = 2 * np.pi * np.outer(TIME, [0.2, 0.33, 0.45])
    return np.sin(phase) * [1.5, 1.0, 0.5] + noise * rng.normal(size=(len(TIME), 3))


@pytest.mark.parametrize("noise", [0.0, 1e-5, 5e-4, 2e-3])
@pytest.mark.parametrize("seed", range(3))
def test_a_motion_does_not_jump(noise, seed):
    assert jumps(TIME, course(noise, seed)) == []


@pytest.mark.parametrize("rate", [30.0, 100.0, 238.0])
@pytest.mark.parametrize("late", [0.0, 0.005, 0.012])
def test_stamps_that_scatter_are_no_jumps(rate, late):
    for seed in range(5):
        rng = np.random.default_rng(seed)
        time = np.arange(0.0, 20.0, 1 / rate)
        phase = 2 * np.pi * np.outer(time, rng.uniform(0.1, 0.6, 3)) + rng.uniform(0, 6, 3)
        values = np.sin(phase) * [1.5, 1.0, 0.5] + 5e-4 * rng.normal(size=(len(time), 3))
        assert jumps(*stamped(time, values, late, rng)) == []


def stamped(time, values, late, rng):
    """Readings in the order of stamps that are late by the absolute value of so much."""
    stamps = time + late * np.abs(rng.normal(size=len(time)))
    order = np.argsort(stamps, kind="stable")
    return stamps[order], values[order]


def test_small_jumps_are_found_where_stamps_scatter():
    """From one sample to the next such readings scatter by more than the jump."""
    rng = np.random.default_rng(5)
    time = np.arange(0.0, 20.0, 1 / 238.0)
    values = 0.08 * np.sin(2 * np.pi * np.outer(time, [0.2, 0.33, 0.45]))
    values += 5e-4 * rng.normal(size=values.shape)
    beginnings, length, off = [2.0, 6.5, 13.0], 0.3, np.array([6e-3, -5e-3, 4e-3])
    for start in beginnings:
        values[(time > start) & (time < start + length)] += off
    stamps, values = stamped(time, values, 0.005, rng)
    found = jumps(stamps, values)
    for start, each in zip(beginnings, found, strict=True):
        assert stamps[each.first] == pytest.approx(start, abs=0.02)
        assert stamps[each.end] == pytest.approx(start + length, abs=0.03)
        assert each.size == pytest.approx(np.linalg.norm(off), rel=0.3)


@pytest.mark.parametrize("rate", [30.0, 100.0, 240.0])
def test_a_move_that_begins_and_ends_suddenly_is_no_jump(rate):
    time = np.arange(0.0, 20.0, 1 / rate)
    speed = np.clip(1.4 - np.abs(time % 4.0 - 2.0), 0.0, 0.6) * (-1.0) ** (time // 4.0)
    values = np.cumsum(speed)[:, None] / rate * [1.0, 0.5, 0.2]
    assert jumps(time, values) == []


def test_a_stretch_elsewhere_is_found_to_the_sample():
    values = course()
    values[1000:1030] += [0.02, -0.01, 0.005]
    values[2400:2500] += [0.0, 0.03, 0.0]
    found = jumps(TIME, values)
    assert [(each.first, each.end) for each in found] == [(1000, 1030), (2400, 2500)]
    assert found[1].size == pytest.approx(0.03, abs=0.003)


def test_jumps_may_reach_into_each_other():
    values = course()
    values[1000:1050] += [0.02, -0.01, 0.005]
    values[1030:1090] += [0.0, 0.03, -0.01]
    (found,) = jumps(TIME, values)
    assert (found.first, found.end) == (1000, 1090)


def test_swinging_is_no_jump():
    values = course(1e-5) + 0.01 * np.sin(2 * np.pi * 7.0 * TIME)[:, None]
    assert jumps(TIME, values) == []


def test_another_place_from_there_on_is_none():
    """What does not come back is the target after it was lost: its readings tell the motion."""
    values = course()
    values[2000:] += [0.01, 0.0, 0.02]
    assert jumps(TIME, values) == []


def test_missing_samples_are_stepped_over():
    values = course()
    values[1000:1030] += [0.02, -0.01, 0.005]
    values[[5, 1010, 2000]] = np.nan
    (found,) = jumps(TIME, values)
    assert (found.first, found.end) == (1000, 1030)


def test_what_happened_in_a_gap_is_no_jump():
    values, there = course(), np.ones(len(TIME), dtype=bool)
    there[1000:1100] = there[1200:1240] = False
    moved = values.copy()
    moved[1100:1200] += 0.02
    assert jumps(TIME[there], moved[there]) == []


def test_a_stream_that_jumps_all_the_time_is_left_as_it_is():
    values = course()
    for start in range(100, 3900, 100):
        values[start : start + 50] += 0.05
    assert jumps(TIME, values) == []


def test_a_few_samples_tell_nothing():
    assert jumps(TIME[:10], course()[:10]) == []
