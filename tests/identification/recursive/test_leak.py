"""Bodies that lose or gain mass while they are moved, with a walk of the mass that is stated."""

from dataclasses import replace

import numpy as np
import pytest
from simulated import BODY, leaking, loaded, sound, walking

from steelyard.errors import InputError
from steelyard.identification.chosen_methods import default_methods
from steelyard.identification.identify import identify
from steelyard.identification.methods.loads import drawn
from steelyard.identification.methods.recursive import Recursive
from steelyard.identification.recursive.concluding import posterior_of
from steelyard.identification.recursive.follow import follow
from steelyard.identification.recursive.outlook import seconds_until
from steelyard.identification.recursive.window.grid import KnotGrid
from steelyard.identification.recursive.window.window import Window
from steelyard.inertia import Inertia
from steelyard.live.message import Arrival
from steelyard.live.session import Session

pytestmark = pytest.mark.integration

WALK = 0.5  # [kg/sqrt(s)]
LENGTH = 12.0  # [s]


def body_with(mass):
    """The ten of the body when it weighs so much more."""
    whole = Inertia(BODY.mass + mass, BODY.center_of_gravity, BODY.inertia)
    return whole.body_parameters


def run_out(seed=5):
    """A recording of a body from which sand runs out from 4 to 10 s, 3 kg of it."""
    return leaking(seed, np.array([0.0, 4.0, 10.0, 20.0]), np.array([0.0, 0.0, -3.0, -3.0]))


@pytest.fixture(scope="module")
def followed():
    *_, last = follow(replace(run_out(), mass_walk=WALK))
    return last


def test_sand_that_runs_out_is_followed(followed):
    masses = np.array([each.value[0] for each in followed.instants])
    sigmas = np.sqrt([each.covariance[0, 0] for each in followed.instants])
    times = np.array([each.time for each in followed.instants])
    true = BODY.mass + np.interp(times, [4.0, 10.0], [0.0, -3.0])
    assert np.abs((masses - true) / sigmas).max() < 3.5
    assert sigmas.max() < 1.5
    assert not followed.events
    for each, more in zip(followed.instants, true - BODY.mass, strict=True):
        error = each.value - body_with(more)
        assert error @ np.linalg.solve(each.covariance, error) < 35.0  # chi-square of ten, .9999


@pytest.mark.slow
def test_the_estimate_is_that_of_the_end_and_accepted():
    found = identify(replace(run_out(), mass_walk=WALK))
    assert found.result == "recursive"
    estimate = found.estimate
    assert estimate.verdict.accepted, estimate.verdict.reasons
    error = estimate.value - body_with(-3.0)
    assert error @ np.linalg.solve(estimate.covariance, error) < 35.0
    assert any("walks at random by 0.5 kg/sqrt(s)" in note for note in estimate.notes)


@pytest.mark.slow
def test_without_the_walk_it_is_wrong():
    estimate = identify(run_out(), "recursive").estimate
    error = estimate.value[0] - body_with(-3.0)[0]
    assert abs(error) > 3 * estimate.standard_deviation[0]


@pytest.mark.slow
def test_a_walk_of_next_to_nothing_is_none():
    one, other = (
        identify(replace(sound(2), mass_walk=walk), "recursive").estimate for walk in (0.0, 1e-6)
    )
    moved = (other.value - one.value) / one.standard_deviation
    assert np.abs(moved).max() < 0.01
    np.testing.assert_allclose(other.standard_deviation, one.standard_deviation, rtol=1e-3)


@pytest.mark.slow
@pytest.mark.long
def test_a_mass_that_is_known_in_the_beginning_is_forgotten():
    known = {"mass": (BODY.mass, 0.05)}
    experiment = replace(run_out(), mass_walk=WALK, known=known)
    *_, last = follow(experiment)
    sigmas = np.sqrt([each.covariance[0, 0] for each in last.instants])
    assert sigmas[-1] > 2 * known["mass"][1]
    assert abs(last.instants[-1].value[0] - body_with(-3.0)[0]) < 3.5 * sigmas[-1]
    estimate = identify(experiment).estimate
    assert abs(estimate.value[0] - body_with(-3.0)[0]) < 3.5 * estimate.standard_deviation[0]
    assert estimate.verdict.accepted, estimate.verdict.reasons


@pytest.mark.slow
def test_it_does_not_become_as_sure_as_one_likes(followed):
    # At rest nothing of the window is at hand any more: the motion has ended.
    *_, before, last = follow(replace(run_out(), mass_walk=WALK))
    until = seconds_until(before, {"mass": 1e-3, "cx": 1.0})
    assert until == {"mass": None, "cx": 0.0}
    assert last.instants[-1].time == followed.instants[-1].time


def streamed(experiment, lost=(0.0, 0.0)):
    """What is said of a recording that arrives piece by piece, without what is lost."""
    (run,) = experiment.runs
    session = Session(replace(experiment, runs=()), run.name, run.sync)
    times = {name: experiment.common_time(run, name) for name in run.streams}
    records = []
    for start in np.arange(0.0, LENGTH, 0.5):
        if lost[0] <= start < lost[1]:
            continue
        arrivals = []
        for name, stream in run.streams.items():
            a, b = np.searchsorted(times[name], [start, start + 0.5])
            if b > a:
                arrivals.append(Arrival(name, stream.at_rows(slice(int(a), int(b)))))
        session, new = session.taken(arrivals).advanced()
        records += new
    return records, run.sync["cables"]


@pytest.mark.slow
def test_a_stream_says_the_same_as_the_recording(followed):
    records, origin = streamed(replace(run_out(), mass_walk=WALK))
    last = records[-1]
    # Its beginning was longer, so that chunks end elsewhere.
    at = [each.time + origin for each in followed.instants]
    mass = np.interp(last.time, at, [each.value[0] for each in followed.instants])
    sigma = np.interp(last.time, at, [each.covariance[0, 0] for each in followed.instants]) ** 0.5
    assert abs(last.value[0] - mass) < 0.5 * sigma
    assert last.deviation[0] == pytest.approx(sigma, rel=0.1)


@pytest.mark.slow
def test_after_a_gap_it_is_followed_again():
    records, origin = streamed(replace(run_out(), mass_walk=WALK), lost=(7.0, 8.5))
    times = np.array([each.time - origin for each in records])
    assert np.diff(times).max() > 1.5
    masses, sigmas = (
        np.array([getattr(each, what)[0] for each in records]) for what in ("value", "deviation")
    )
    true = BODY.mass + np.interp(times, [4.0, 10.0], [0.0, -3.0])
    assert np.abs((masses - true) / sigmas).max() < 3.5


@pytest.mark.slow
def test_a_payload_is_found_beside_a_walk():
    *_, last = follow(replace(loaded(3, since=6.8), mass_walk=0.05))
    (event,) = last.events
    assert event.time == pytest.approx(6.8, abs=0.3)
    assert abs(event.mass - 3.2) < 4 * event.sigma
    found = drawn(Recursive().of, posterior_of(last))
    assert found.verdict.accepted, found.verdict.reasons
    gained = found.loads.differences["load 2 - load 1"]
    assert abs(gained.value[0] - 3.2) < 4 * gained.standard_deviation[0]
    # What walks in some seconds is not known of it.
    assert gained.standard_deviation[0] > 0.05


def test_a_gap_is_walked_through(followed):
    recursion, like = followed.recursion, followed.like.segment
    use, since = recursion.use, 9.0
    window = Window(KnotGrid(20.0, 0.1, 4, like.block), like)
    (before, after) = (
        np.linalg.inv(each.window.past.equations.corner[np.ix_(use, use)])
        for each in (recursion.started(window), recursion.started(window, since))
    )
    cog = recursion.state.parameters[1:4] / recursion.state.parameters[0]
    assert (after - before)[0, 0] == pytest.approx(WALK**2 * since, rel=1e-4)
    np.testing.assert_allclose((after - before)[0, 1:4] / (WALK**2 * since), cog, rtol=1e-3)
    # Nothing else is forgotten.
    assert np.abs((after - before)[10:, 10:]).max() < 1e-6 * np.abs(before[10:, 10:]).max()


@pytest.mark.parametrize("method", ["maximum-likelihood", "two-step", "least-squares"])
def test_methods_for_which_a_mass_stays_are_refused(method):
    experiment = replace(sound(2), mass_walk=WALK)
    assert default_methods(experiment) == ("recursive",)
    with pytest.raises(InputError, match=f"recursive, which alone follows .* found {method}"):
        identify(experiment, ["recursive", method])


@pytest.mark.slow
def test_all_methods_are_those_that_can():
    assert list(identify(replace(run_out(), mass_walk=WALK), "all").estimates) == ["recursive"]


def test_nothing_tells_how_long_it_took_from_one_run_to_the_next():
    (run,) = sound(2).runs
    experiment = replace(sound(2), runs=(run, replace(run, name="again")), mass_walk=WALK)
    with pytest.raises(InputError, match=r"expected one run, in motion.*'run', 'again'"):
        identify(experiment)


@pytest.mark.slow
@pytest.mark.long
def test_errors_are_as_large_as_is_stated():
    """Over twenty masses that walk at random: 95 % intervals of mass and chi-square of all ten."""
    off, chi = [], []
    for seed in range(20):
        times, masses = walking(1000 + seed, WALK, LENGTH)
        *_, last = follow(replace(leaking(seed, times, masses), mass_walk=WALK))
        for each in last.instants[-12::4]:
            error = each.value - body_with(np.interp(each.time, times, masses))
            off.append(error[0] / np.sqrt(each.covariance[0, 0]))
            chi.append(error @ np.linalg.solve(each.covariance, error) / 10)
    covered = np.mean(np.abs(off) < 1.96)
    # Three instants of each, hardly independent: within three 1-sigma of twenty drawings.
    assert 0.8 < covered <= 1.0
    assert 0.7 < np.mean(chi) < 1.3
    assert 0.5 < np.sqrt(np.mean(np.square(off))) < 1.5
