"""What happens while a motion is followed, on recordings in which it happens."""

from dataclasses import replace

import numpy as np
import pytest
from simulated import BODY, RECORDER, loaded, payload

from steelyard.experiment.model import Experiment, Load
from steelyard.identification.methods.loads import drawn
from steelyard.identification.methods.maximum_likelihood import MaximumLikelihood
from steelyard.identification.methods.recursive import Recursive
from steelyard.identification.recursive.changes import FREEDOM, changes
from steelyard.identification.recursive.concluding import posterior_of
from steelyard.identification.recursive.follow import follow
from steelyard.inertia import Inertia

pytestmark = pytest.mark.integration


@pytest.fixture(scope="module")
def followed():
    *_, last = follow(loaded(3, since=6.8))
    return last


def test_a_payload_is_found_when_and_as_it_is(followed):
    (event,) = followed.events
    assert event.kind == "load"
    assert event.load == "load 2"
    assert event.time == pytest.approx(6.8, abs=0.3)
    assert abs(event.mass - 3.2) < 4 * event.sigma
    seen = next(each.time for each in followed.instants if each.run == event.run)
    assert seen - 6.8 < 1.0
    truth = Inertia.from_parameters(BODY.parameters + payload(3.2)).body_parameters
    last = followed.instants[-1]
    error = last.value - truth
    assert error @ np.linalg.solve(last.covariance, error) < 30.0


@pytest.mark.slow
def test_both_loads_are_what_the_recording_cut_in_two_tells(followed):
    found = drawn(Recursive().of, posterior_of(followed))
    whole = loaded(3, since=6.8)
    (run,) = whole.runs
    parts = [
        replace(run, name="before", load="one", window=(0.0, 6.7)),
        replace(run, name="after", load="two", window=(6.9, 60.0)),
    ]
    cut: Experiment = replace(whole, runs=tuple(parts), loads=(Load("one"), Load("two")))
    expected = MaximumLikelihood()(cut).loads.differences["two - one"]
    other = found.loads.differences["load 2 - load 1"]
    off = (other.value - expected.value)[:4] / expected.standard_deviation[:4]
    assert np.abs(off).max() < 0.7
    # The cut recording has forgotten nothing but .2 s, and knows its clocks twice.
    ratio = (other.standard_deviation / expected.standard_deviation)[:4]
    assert ratio.min() > 0.8
    assert ratio.max() < 1.2
    assert found.verdict.accepted


@pytest.mark.slow
def test_a_payload_that_is_put_down_slowly_is_one_event():
    *_, last = follow(loaded(4, since=6.0, within=1.2, mass=8.0))
    (event,) = last.events
    assert event.kind == "load"
    assert event.time == pytest.approx(6.6, abs=0.9)
    assert event.mass == pytest.approx(8.0, abs=5 * event.sigma)
    more, sigma = last.recursion.weighs_more("run", event.run)
    assert more == pytest.approx(8.0, abs=4 * sigma)
    assert sigma < 0.2


@pytest.mark.slow
def test_a_hand_is_no_load():
    *_, last = follow(RECORDER(5, touched=True))
    (event,) = last.events
    assert event.kind == "contact"
    assert event.time == pytest.approx(5.0, abs=0.3)
    assert not last.touched
    found = last.instants[-1]
    error = found.value - BODY.body_parameters
    assert error @ np.linalg.solve(found.covariance, error) < 30.0


@pytest.mark.slow
def test_where_nothing_happens_the_bodies_of_chunks_differ_as_noise_has_it():
    seen = []
    for found in follow(RECORDER(6)):
        assert not found.events
        if found.recursion.window is not None and not found.is_beginning:
            seen += [each.statistic for each in changes(found.recursion)[-1:]]
    # Neighbours share chunks: some twenty independent ones are left.
    assert np.mean(seen) == pytest.approx(FREEDOM, rel=0.35)
    assert max(seen) < 3 * FREEDOM
