"""Several runs one after the other; the first of them a real tool: poses at rest, a quiet run, and one
that shakes."""

from dataclasses import replace

import numpy as np
import pytest
from places import DATA
from simulated import changed

from steelyard.experiment.read import read_experiment
from steelyard.identification.identify import identify
from steelyard.identification.methods.loads import drawn
from steelyard.identification.methods.recursive import Recursive
from steelyard.identification.recursive.concluding import posterior_of
from steelyard.identification.recursive.follow import begin, follow
from steelyard.identification.solve.long_recording import span_of

pytestmark = [pytest.mark.slow, pytest.mark.integration]


@pytest.fixture(scope="module")
def kuka(examples):
    return read_experiment(examples / "kuka-tool" / "experiment.yaml")


@pytest.fixture(scope="module")
def followed(kuka):
    *_, last = follow(kuka)
    return last


@pytest.mark.long
def test_what_the_beginning_knows_is_not_taken_from_its_poses_alone(kuka):
    # Of readings that were fitted together, a part would have moved the calibration.
    found = begin(kuka)
    begun = found.begun.fit.state
    assert found.parts
    np.testing.assert_array_equal(
        found.recursion.state.calibration.values, begun.calibration.values
    )
    np.testing.assert_array_equal(found.recursion.state.parameters, begun.parameters)


@pytest.mark.long
def test_an_instrument_whose_calibration_a_run_tells_otherwise_has_not_jumped(followed):
    assert not followed.recursion.unsettled
    assert followed.unfollowed == 0.0
    alone = followed.recursion.alone
    assert sum(n for (_, (name, _)), n in alone.items() if name == "arm") < 20


@pytest.mark.long
def test_it_ends_where_all_at_once_does(kuka, followed):
    whole = identify(kuka, ["maximum-likelihood"]).estimate
    found = drawn(Recursive().of, posterior_of(followed))
    known = np.isfinite(whole.value[:4])
    assert known.all()
    off = found.value[:4] - whole.value[:4]
    # Levels of the noise at rest, which nobody has stated, are those of the beginning.
    assert np.abs(off / whole.standard_deviation[:4]).max() < 1.2


@pytest.mark.long
def test_disturbances_go_on_in_a_further_run():
    # What is stated of a disturbance makes it part of the motion from the first fit on.
    one = read_experiment(DATA / "points-00" / "experiment.yaml")
    noise = {"white": 0.0005, "colored": 0.0005, "time": 0.5}
    tracker = changed(one.instruments["tracker"], noise=noise)
    (run,) = one.runs
    start, end = span_of(one, run)
    windows = (start, start + 6.2), (start + 6.6, end)
    runs = tuple(replace(run, name=f"run {i}", window=each) for i, each in enumerate(windows))
    two = replace(one, runs=runs, instruments={**one.instruments, "tracker": tracker})
    *_, last = follow(two)
    assert last.like.segment.processes
    assert not last.recursion.unsettled
    assert {part.segment.run for part in last.parts} == {"run 0", "run 1"}
    estimate = drawn(Recursive().of, posterior_of(last))
    whole = identify(two, ["maximum-likelihood"]).estimate
    assert np.abs((estimate.value - whole.value) / whole.standard_deviation).max() < 0.5
    assert np.abs(estimate.standard_deviation / whole.standard_deviation - 1).max() < 0.1
