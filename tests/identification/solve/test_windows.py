"""Motion and forces of a long recording, window by window, against all of it at once."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from other_methods import killed
from simulated import ROBOT, TRUTH, Loaded, Recorder, Touched, payload

from steelyard.errors import InputError
from steelyard.experiment.recording import BESIDE
from steelyard.identification.identify import identify
from steelyard.identification.methods.maximum_likelihood import MaximumLikelihood
from steelyard.identification.solve import joint_motion, shared_windows
from steelyard.identification.solve.beginning.motion_task import motion_task
from steelyard.identification.solve.beginning.readings import read
from steelyard.identification.solve.fitted import Fitted
from steelyard.identification.solve.held_motion import fit_with_held_motion
from steelyard.identification.solve.joint_motion import fit_jointly
from steelyard.identification.solve.long_recording import windows
from steelyard.identification.solve.settings import FIT
from steelyard.simulation.trajectories import feasible_multisine

pytestmark = pytest.mark.integration

LENGTH = 36.0  # [s]
WINDOWS = replace(FIT, long_jointly=20.0, part_jointly=15.0, window=12.0, long_block=2.0)
RECORDER = Recorder(feasible_multisine(ROBOT, LENGTH))


@pytest.fixture(scope="module")
def recorded():
    return RECORDER(3)


def test_windows_share_the_streams_of_the_recording(recorded):
    (run,) = recorded.runs
    first, _, last = windows(recorded, WINDOWS)
    for name, stream in run.streams.items():
        for window in (first, last):
            for key, values in stream.values.items():
                assert np.shares_memory(window.streams[name].values[key], values)
        ends = [recorded.common_time(each, name)[[0, -1]] for each in (first, last)]
        assert ends[0][0] == recorded.common_time(run, name)[0]
        assert ends[0][1] == pytest.approx(first.window[1] + BESIDE, abs=0.1)
        assert ends[1][0] == pytest.approx(last.window[0] - BESIDE, abs=0.1)
        assert ends[1][1] == recorded.common_time(run, name)[-1]


@pytest.mark.slow
def test_windows_tell_what_the_whole_tells(recorded):
    whole, by_windows = fit_jointly(recorded), fit_jointly(recorded, settings=WINDOWS)
    assert len(whole.fit.state.segments) == 1
    assert len(by_windows.fit.state.segments) == 3
    one, other = MaximumLikelihood().of(whole), MaximumLikelihood().of(by_windows)
    sigma = one.standard_deviation
    # The motion need not go on from one window to the next, and noise is what a part has shown.
    assert (np.abs(other.value - one.value) < 0.3 * sigma).all()
    assert other.standard_deviation == pytest.approx(sigma, rel=0.1)
    assert one.verdict.accepted
    assert other.verdict.accepted, other.verdict.reasons


@pytest.mark.slow
def test_the_motion_of_all_windows_is_there(recorded):
    whole, by_windows = fit_jointly(recorded), fit_jointly(recorded, settings=WINDOWS)
    (motion,) = whole.motion
    assert len(by_windows.motion) == 3
    time = np.concatenate([each.time for each in by_windows.motion])
    assert np.ptp(time) == pytest.approx(np.ptp(motion.time), abs=0.1)
    inside = (by_windows.motion[1].time > 14) & (by_windows.motion[1].time < 22)
    own = by_windows.motion[1]
    for name, values in own.values.items():
        others = np.stack(
            [np.interp(own.time[inside], motion.time, each) for each in motion.values[name].T],
            axis=1,
        )
        sigma = np.maximum(own.sigma[name][inside], 1e-9)
        # On other knots.
        assert np.median(np.abs(values[inside] - others) / sigma) < 1.0
    assert len(by_windows.samples[0]) == len(by_windows.weights["run"])


def test_a_hand_in_any_window_is_found(recorded):
    touched = replace(RECORDER)
    touched.__dict__["response"] = Touched(RECORDER.response)
    found = fit_jointly(touched(3), settings=replace(WINDOWS, part_jointly=12.0))
    (start, end), *_ = sorted(found.contacts["run"])
    assert start == pytest.approx(5.0, abs=0.2)
    assert max(until for _, until in found.contacts["run"]) == pytest.approx(7.0, abs=0.2)
    assert end > start


@pytest.mark.slow
def test_a_load_that_is_picked_up_after_the_part_is_in_the_verdict(recorded):
    loaded = replace(RECORDER)
    loaded.__dict__["response"] = Loaded(RECORDER.response, payload(8.0), since=26.0)
    experiment = loaded(3)
    settings = replace(WINDOWS, part_jointly=15.0)
    found = MaximumLikelihood(settings=settings)(experiment)
    assert not found.verdict.accepted


@pytest.mark.slow
@pytest.mark.parametrize(("small", "passes"), [(1e-3, 2), (WINDOWS.small_step, 1)])
def test_a_step_that_is_far_is_taken_again(recorded, small, passes):
    """Each pass is about what the one before has found; it ends where it hardly moves."""
    told = []
    fit_jointly(
        recorded,
        lambda what, fraction: told.append((what, fraction)),
        settings=replace(WINDOWS, small_step=small, most_passes=2),
    )
    assert sum(what.endswith("window by window") for what, _ in told) == passes * 3


def without(experiment, name, start, end):
    """The experiment with nothing of an instrument for a while [s]."""
    (run,) = experiment.runs
    stream = run.streams[name]
    since = stream.time - stream.time[0]
    stream = stream.at_rows((since < start) | (since > end))
    return replace(experiment, runs=(replace(run, streams={**run.streams, name: stream}),))


@pytest.mark.slow
@pytest.mark.parametrize("fitted", [fit_jointly, fit_with_held_motion])
@pytest.mark.parametrize("lost", ["tracker", "imu", "cables"])
def test_windows_that_tell_nothing_are_left_out_with_a_note(recorded, lost, fitted):
    """No stream has a reading within or about windows of the middle."""
    found = fitted(
        without(recorded, lost, 12.0, 28.0),
        settings=replace(WINDOWS, window=4.0, part_jointly=10.0, long=20.0, part=10.0),
    )
    assert any("12 to 28 s are left out" in note for note in found.notes)
    whole = fitted(recorded)
    off = found.parameters - whole.parameters
    assert (np.abs(off) < 2 * np.sqrt(np.diag(found.solution.covariance)[:10])).all()
    time = found.samples[0].time
    assert not np.any((time > 12.5) & (time < 27.5))


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("fitted", [fit_jointly, fit_with_held_motion])
def test_processes_tell_what_one_tells(recorded, fitted):
    """One of the windows tells nothing."""
    gone = without(recorded, "imu", 24.0, 30.0)
    settings = replace(WINDOWS, window=4.0, part_jointly=10.0, long=20.0, part=10.0)
    one, two = (fitted(gone, settings=replace(settings, jobs=jobs)) for jobs in (1, 2))
    sigma = np.sqrt(np.diag(one.solution.covariance)[:10])
    # They compute with one thread.
    assert (np.abs(two.parameters - one.parameters) < 1e-6 * sigma).all()
    np.testing.assert_allclose(two.solution.covariance, one.solution.covariance, rtol=1e-6)
    assert two.notes == one.notes
    assert any("are left out" in note for note in two.notes)
    assert [len(s.time) for s in two.experiment.runs[0].streams.values()] == [
        len(s.time) for s in one.experiment.runs[0].streams.values()
    ]
    for a, b in zip(one.motion, two.motion, strict=True):
        np.testing.assert_allclose(b.values["position"], a.values["position"], atol=1e-9)


@pytest.mark.slow
@pytest.mark.long
def test_identify_gives_its_processes_to_the_windows(recorded, monkeypatch):
    asked = []

    def attempts(about, part, experiment, runs, jobs):
        asked.append(jobs)
        return shared_windows.attempts(about, part, experiment, runs, 1)

    monkeypatch.setattr(joint_motion, "attempts", attempts)
    identify(recorded, MaximumLikelihood(settings=WINDOWS), jobs=3)
    identify(recorded, MaximumLikelihood(settings=replace(WINDOWS, jobs=2)))
    assert asked == [3, 2]


@pytest.mark.slow
def test_a_killed_process_is_no_window_that_tells_nothing(recorded):
    part = fit_jointly(recorded)
    task = motion_task(read(recorded, None, lambda what, done: None))
    fitted = Fitted(task, part.fit, part.fit, (), (), {}, {})
    runs = list(windows(recorded, replace(FIT, window=12.0)))
    with pytest.raises(InputError, match="found that one was killed"):
        list(shared_windows.attempts(killed, fitted, recorded, runs, 2))


@dataclass(frozen=True)
class Interrupted:
    """A motion, a pause, and the same motion again."""

    trajectory: object
    pause: float

    @property
    def duration(self):
        return 2 * self.trajectory.duration + self.pause

    def derivative(self, t, order):
        again = np.maximum(t - self.trajectory.duration - self.pause, 0.0)
        first = t <= self.trajectory.duration
        return self.trajectory.derivative(np.where(first, t, again), order)


@pytest.mark.slow
def test_a_platform_may_rest_for_a_while():
    """Its windows are left out with a note."""
    trajectory = Interrupted(feasible_multisine(ROBOT, 12.0), 16.0)
    experiment = Recorder(trajectory, following=True)(3)
    settings = replace(WINDOWS, window=4.0, part_jointly=8.0)
    found = MaximumLikelihood(settings=settings)(experiment)
    (note,) = (each for each in found.notes if "nothing moves" in each)
    assert "12 to 28 s are left out" in note
    off = (found.value - TRUTH) / found.standard_deviation
    assert np.mean(off**2) < 2.5
    assert found.verdict.accepted, found.verdict.reasons
