"""A real tool in three recordings: poses at rest, a quiet run, and one that shakes."""

import numpy as np
import pytest

from steelyard.experiment.read import read_experiment
from steelyard.identification.identify import identify
from steelyard.identification.methods.loads import drawn
from steelyard.identification.methods.recursive import Recursive
from steelyard.identification.recursive.concluding import posterior_of
from steelyard.identification.recursive.follow import begin, follow

pytestmark = [pytest.mark.slow, pytest.mark.integration]


@pytest.fixture(scope="module")
def kuka(examples):
    return read_experiment(examples / "kuka-tool" / "experiment.yaml")


@pytest.fixture(scope="module")
def followed(kuka):
    *_, last = follow(kuka)
    return last


def test_what_the_beginning_knows_is_not_taken_from_its_poses_alone(kuka):
    # Of readings that were fitted together, a part would have moved the calibration.
    found = begin(kuka)
    begun = found.begun.fit.state
    assert found.parts
    np.testing.assert_array_equal(
        found.recursion.state.calibration.values, begun.calibration.values
    )
    np.testing.assert_array_equal(found.recursion.state.parameters, begun.parameters)


def test_an_instrument_whose_calibration_a_run_tells_otherwise_has_not_jumped(followed):
    assert not followed.recursion.unsettled
    assert followed.unfollowed == 0.0
    alone = followed.recursion.alone
    assert sum(n for (_, (name, _)), n in alone.items() if name == "arm") < 20


def test_it_ends_where_all_at_once_does(kuka, followed):
    whole = identify(kuka, ["maximum-likelihood"]).estimate
    found = drawn(Recursive().of, posterior_of(followed))
    known = np.isfinite(whole.value[:4])
    assert known.all()
    off = found.value[:4] - whole.value[:4]
    # Levels of the noise at rest, which nobody has stated, are those of the beginning.
    assert np.abs(off / whole.standard_deviation[:4]).max() < 1.2
