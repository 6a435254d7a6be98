"""How long it takes until something is known, against what is known then."""

import numpy as np
import pytest
from simulated import RECORDER

from steelyard.identification.recursive.follow import follow
from steelyard.identification.recursive.outlook import seconds_until
from steelyard.inertia import BODY_PARAMETERS

pytestmark = pytest.mark.integration


@pytest.fixture(scope="module")
def followed():
    return [each for each in follow(RECORDER(7)) if each.recursion.window is not None]


def test_what_is_known_later_is_foreseen(followed):
    early, late = followed[-15], followed[-1]
    now, then = early.instants[-1], late.instants[-1]
    wanted = dict(zip(BODY_PARAMETERS, np.sqrt(np.diag(then.covariance)), strict=True))
    found = seconds_until(early, wanted)
    waited = then.time - now.time
    told = [each / waited for each in found.values() if each is not None]
    # A motion does not tell the same in each second, and what is left to know is little.
    assert 0.4 < np.median(told) < 2.5


def test_what_is_known_already_takes_no_time_and_some_things_are_never_known(followed):
    last = followed[-1]
    sigma = float(np.sqrt(last.instants[-1].covariance[0, 0]))
    # Gains that are not calibrated stay in the mass.
    found = seconds_until(last, {"mass": 1.01 * sigma, "cx": 1e-9})
    assert found == {"mass": 0.0, "cx": None}


def test_a_motion_that_has_just_begun_tells_nothing_of_later(followed):
    assert seconds_until(followed[0], {"mass": 1.0}) == {"mass": None}
