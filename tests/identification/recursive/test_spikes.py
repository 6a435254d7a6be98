"""Readings that stand alone while a motion is followed: left out, told, and of no weight."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from places import DATA
from simulated import loaded

from steelyard.experiment.read import read_experiment
from steelyard.identification.methods.loads import drawn
from steelyard.identification.methods.recursive import Recursive
from steelyard.identification.model.balance import Forces
from steelyard.identification.recursive.arriving.spikes import (
    far_from,
    few_or_none,
    left_out_of,
    usual,
)
from steelyard.identification.recursive.concluding import posterior_of
from steelyard.identification.recursive.follow import follow
from steelyard.identification.recursive.following import Following, NotFollowedError
from steelyard.identification.solve.beginning.begin import NoBalanceError
from steelyard.identification.solve.settings import FIT

CELLS = 8
SECONDS = 13.0


def quiet(count=40):
    """Forces that rise evenly."""
    values = 600.0 + np.arange(count)[:, None] + 10.0 * np.arange(CELLS)
    none = np.zeros(values.shape, dtype=bool)
    return Forces("cables", 0.01 * np.arange(count), {"tension": values}, np.ones(CELLS), none)


def left_out(single, whole=()):
    forces = quiet(len(single))
    off = np.zeros(len(single), dtype=bool)
    off[list(whole)] = True
    return left_out_of(forces, single, off, FIT).left_out


def nothing(count=40):
    return np.zeros((count, CELLS), dtype=bool)


def test_what_stands_alone_is_left_out_and_bridged():
    forces, single = quiet(), nothing()
    single[[3, 20, 39], [0, 5, 2]] = True
    forces.readings["tension"][single] = 0.0
    found = left_out_of(forces, single, np.zeros(40, dtype=bool), FIT)
    assert np.array_equal(found.left_out, single)
    expected = quiet().readings["tension"]
    expected[39, 2] = expected[38, 2]
    assert found.readings["tension"] == pytest.approx(expected)
    assert forces.readings["tension"][3, 0] == 0.0


def test_where_none_does_the_forces_are_the_very_same():
    forces = quiet()
    assert left_out_of(forces, nothing(), np.zeros(40, dtype=bool), FIT) is forces
    assert forces.bridged(nothing()).readings["tension"] == pytest.approx(
        forces.readings["tension"]
    )


def test_a_cell_may_be_wrong_for_some_samples_but_not_for_most():
    single = nothing()
    single[5:20, 3] = True
    assert np.array_equal(left_out(single), single)
    single[5:30, 3] = True
    assert not left_out(single).any()


def test_what_is_alike_until_the_end_may_be_another_load():
    single = nothing()
    single[30:, [2, 6]] = True
    assert not left_out(single).any()
    # Another cell in every sample is no load.
    single = nothing()
    single[[35, 36, 37, 38, 39], [1, 4, 0, 7, 2]] = True
    assert np.array_equal(left_out(single), single)


def test_a_hand_is_no_spike_however_long_it_pushes():
    single = nothing()
    single[10:18, [2, 6]] = True
    assert not left_out(single).any()
    assert not left_out(nothing(), range(10, 14)).any()


def test_a_sample_that_is_off_as_a_whole_is_left_out():
    found = left_out(nothing(), [7, 8, 39])
    assert np.flatnonzero(found.all(axis=1)).tolist() == [7, 8, 39]
    assert np.count_nonzero(found) == 3 * CELLS
    # A sample of which many cells are off is, too.
    single = nothing()
    single[12, :4] = True
    assert np.flatnonzero(left_out(single).all(axis=1)).tolist() == [12]


def test_what_many_numbers_are_off_by_is_no_spike():
    far = np.zeros((50, 3), dtype=bool)
    far[::4, 0] = True
    assert few_or_none(far) is far
    far[::2, 1] = True
    assert not few_or_none(far).any()
    # Of a few samples one may be off as a whole.
    far = np.zeros((5, 3), dtype=bool)
    far[2] = True
    assert few_or_none(far) is far


def rows_of(*residuals):
    """A chunk of some instruments about a motion that is known, and its rows."""
    return SimpleNamespace(readings=residuals), [SimpleNamespace(residual=r) for r in residuals]


def test_one_quantity_of_which_much_is_far_has_jumped():
    rng = np.random.default_rng(5)
    gyro, tracker = rng.normal(size=(2, 40, 3))
    tracker[10:25] += 30.0
    near, far = far_from(*rows_of(gyro, tracker), FIT)
    assert not near.any()
    assert np.flatnonzero(far.any(axis=1)).tolist() == list(range(10, 25))
    # Where two are off, nobody can tell which it was.
    assert not any(each.any() for each in far_from(*rows_of(tracker, tracker), FIT))


def test_a_sample_is_held_against_those_about_it():
    size = np.full(40, 2.3)
    heard = np.ones(40, dtype=bool)
    size[12] = 9.0
    assert usual(size, heard)[12] == pytest.approx(1.0, rel=0.02)
    # A spike of three samples stands alone, a stretch that is off does not.
    size[11:14] = 9.0
    assert usual(size, heard)[12] == pytest.approx(1.0, rel=0.02)
    size[8:17] = 9.0
    assert usual(size, heard)[12] == pytest.approx(9.0 / 2.3, rel=0.02)
    assert usual(np.zeros(3), np.zeros(3, dtype=bool)) == pytest.approx(1.0)


def spiked(experiment, instrument, quantity, share, size, seed=1):
    """Single numbers of a stream that are far off, and how many."""
    rng = np.random.default_rng(seed)
    (run,) = experiment.runs
    stream = run.streams[instrument]
    values = stream.values[quantity].copy()
    at = rng.random(values.shape) < share
    values[at] += rng.normal(0.0, size, int(at.sum()))
    stream = replace(stream, values={**stream.values, quantity: values})
    run = replace(run, streams={**run.streams, instrument: stream})
    return replace(experiment, runs=(run,)), at


@pytest.fixture(scope="module")
def points():
    found = read_experiment(DATA / "points-00" / "experiment.yaml")
    (run,) = found.runs
    return replace(found, runs=(replace(run, window=(0.0, SECONDS)),))


@pytest.fixture(scope="module")
def sound(points):
    *_, last = follow(points)
    return last


def farthest(found, sound, since=8.0):
    """Largest distance of what is known, over time, in the 1-sigma of the sound recording."""
    times = np.array([each.time for each in sound.instants])
    # Knots, and so chunks, may be others.
    pairs = [
        (each, sound.instants[int(np.argmin(np.abs(times - each.time)))])
        for each in found.instants
        if each.time > since
    ]
    return max(
        float(np.max(np.abs(one.value - other.value) / np.sqrt(np.diag(other.covariance))))
        for one, other in pairs
    )


@pytest.mark.integration
def test_of_a_sound_recording_nothing_is_left_out(sound):
    assert not sound.recursion.alone
    assert not any(part.force_samples.left_out.any() for part in sound.parts)


@pytest.mark.slow
@pytest.mark.integration
@pytest.mark.parametrize(("share", "most"), [(0.01, 0.5), (0.03, 2.0)])
def test_spikes_of_forces_move_nothing(points, sound, share, most):
    found, at = spiked(points, "cables", "tension", share, 300.0)
    *_, last = follow(found)
    assert farthest(last, sound) < most
    left = sum(np.count_nonzero(part.force_samples.left_out) for part in last.parts)
    # Of those that are within five 1-sigma nobody can tell.
    assert 0.8 * at.sum() * SECONDS / 20.0 < left < 1.4 * at.sum()
    ratio = last.instants[-1].covariance[0, 0] / sound.instants[-1].covariance[0, 0]
    assert ratio < 3.0


@pytest.mark.slow
@pytest.mark.integration
def test_spikes_are_counted_in_estimate_and_notes(points):
    found, _ = spiked(points, "cables", "tension", 0.01, 300.0)
    found, _ = spiked(found, "imu", "specific_force", 0.01, 5.0)
    *_, last = follow(found)
    estimate = drawn(Recursive().of, posterior_of(last))
    (count,) = estimate.details["left_out"]["single_readings"].values()
    assert count == sum(np.count_nonzero(p.force_samples.left_out) for p in last.parts)
    assert f"run 'sine-0': {count} force readings stand alone" in " ".join(estimate.notes)
    assert "numbers of imu, specific force, stand alone" in " ".join(estimate.notes)


def clipped(experiment, part):
    """With a gyro whose range ends at a part of what it would read."""
    (run,) = experiment.runs
    stream = run.streams["imu"]
    read = stream.values["angular_velocity"]
    end = part * np.abs(read).max()
    values = {**stream.values, "angular_velocity": np.clip(read, -end, end)}
    run = replace(run, streams={**run.streams, "imu": replace(stream, values=values)})
    return replace(experiment, runs=(run,)), np.abs(read) > end


@pytest.mark.slow
@pytest.mark.integration
def test_what_a_gyro_repeats_at_the_end_of_its_range_is_no_reading(points, sound):
    found, at = clipped(points, 0.6)
    (run,) = found.runs
    time = found.common_time(run, "imu")
    *_, last = follow(found)
    assert not last.recursion.unsettled
    # What is clipped for fewer samples than tell that may stand alone.
    assert sum(last.recursion.alone.values()) < 0.2 * at[time < SECONDS].sum()
    assert farthest(last, sound) < 1.0
    later = at & (time > 6.0)[:, None] & (time < SECONDS)[:, None]
    (channels,) = last.stuck.values()
    for channel in np.flatnonzero(later.sum(axis=0) > 20):
        first, end = channels[("imu", "angular_velocity"), channel]
        own = time[later[:, channel]]
        assert own[0] - 0.5 < first < end < own[-1] + 0.1
    notes = drawn(Recursive().of, posterior_of(last)).notes
    assert any("of imu is stuck between" in note for note in notes)


@pytest.mark.slow
@pytest.mark.integration
@pytest.mark.parametrize(
    ("quantity", "size", "seed"), [("specific_force", 5.0, 4), ("angular_velocity", 0.5, 6)]
)
def test_spikes_of_an_imu_move_little(points, sound, quantity, size, seed):
    found, _ = spiked(points, "imu", quantity, 0.02, size, seed)
    *_, last = follow(found)
    assert not last.events
    assert not last.recursion.unsettled
    assert farthest(last, sound) < 1.0
    # Nobody blames the forces for it.
    assert {name for _, (name, _) in last.recursion.alone} == {"imu"}


@pytest.mark.slow
@pytest.mark.integration
def test_a_payload_is_noticed_among_spikes():
    recording = loaded(3, since=6.8)
    found, _ = spiked(recording, "cables", "tension", 0.01, 300.0)
    *_, last = follow(found)
    (event,) = last.events
    assert event.kind == "load"
    assert event.time == pytest.approx(6.8, abs=0.3)
    assert abs(event.mass - 3.2) < 4 * event.sigma


def jumped(experiment, *spans, by=(0.02, -0.015, 0.018)):
    """A tracker that has been off for some tenths of a second."""
    (run,) = experiment.runs
    stream = run.streams["tracker"]
    values = stream.values["position"].copy()
    time = experiment.common_time(run, "tracker")
    for start, end in spans:
        values[(time > start) & (time < end)] += by
    stream = replace(stream, values={**stream.values, "position": values})
    return replace(experiment, runs=(replace(run, streams={**run.streams, "tracker": stream}),))


@pytest.mark.slow
@pytest.mark.integration
def test_a_tracker_that_jumps_is_left_out_for_as_long(points, sound):
    # Across the end of a chunk, longer than one, and while the beginning is fitted.
    *_, last = follow(jumped(points, (2.1, 2.4), (7.1, 7.35), (9.0, 9.6)))
    assert not last.events
    assert not last.recursion.unsettled
    assert last.unfollowed == 0.0
    assert {quantity for _, (_, quantity) in last.recursion.alone} == {"position"}
    assert farthest(last, sound) < 1.0


def lost_once(monkeypatch, since):
    """One chunk that does not settle."""
    real, lost = Following.arrived, []

    def arrived(before, run):
        start, _ = before.window.grid.span(before.number)
        found = real(before, run)
        if start > since and not lost:
            lost.append(start)
            return replace(found, recursion=replace(found.recursion, unsettled=1))
        return found

    monkeypatch.setattr(Following, "arrived", arrived)


@pytest.mark.slow
@pytest.mark.integration
@pytest.mark.parametrize(
    ("since", "where"), [(7.0, " to "), (SECONDS - 0.8, " s on, ")], ids=["midway", "at the end"]
)
def test_a_motion_that_cannot_be_followed_ends_and_begins_again(points, monkeypatch, since, where):
    lost_once(monkeypatch, since)
    *_, last = follow(points)
    assert last.unfollowed == pytest.approx(0.4, abs=0.1)
    estimate = drawn(Recursive().of, posterior_of(last))
    assert np.isfinite(estimate.value).all()
    (note,) = (each for each in estimate.notes if "where the motion could not be followed" in each)
    assert where in note


@pytest.mark.slow
@pytest.mark.integration
def test_where_little_can_be_followed_it_is_said(points, monkeypatch):
    def arrived(before, run):
        raise NotFollowedError

    monkeypatch.setattr(Following, "arrived", arrived)
    with pytest.raises(NoBalanceError, match="does not go on from before; use maximum-likelihood"):
        list(follow(points))
