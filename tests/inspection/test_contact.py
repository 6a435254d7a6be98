"""Contacts that a fit has found, with what the residuals of the forces show of them."""

import numpy as np
import pytest

from steelyard.inspection.contact import Contact, Residual, contacts_of_fit

TIME = np.arange(0.0, 10.0, 0.1)
NAMES = ("fx", "fy", "fz", "tx", "ty", "tz")


@pytest.fixture
def residual():
    """A force of 3 N along y and a torque of 1 N m about z from 4 to 5 s, next to a little noise."""
    left = np.full((len(TIME), 6), 1e-3)
    pushed = (TIME > 3.95) & (TIME < 5.05)
    left[pushed, 1], left[pushed, 5] = -3.0, 1.0
    return Residual("moving", "sensor", TIME, left, np.abs(left).max(axis=1), NAMES)


def test_a_contact_has_the_channels_in_which_it_shows_most(residual):
    (found,) = contacts_of_fit({"moving": [(4.0, 5.0)]}, [residual], [])
    assert (found.run, found.start, found.end) == ("moving", 4.0, 5.0)
    assert found.channels == ("fy", "tz")
    assert found.force == pytest.approx(3.0, abs=1e-5)
    assert found.torque == pytest.approx(1.0, abs=1e-5)


def test_what_is_known_is_not_found_again(residual):
    known = Contact("moving", 4.5, 6.0, "sensor", ("fy",), 3.0, 1.0)
    assert contacts_of_fit({"moving": [(4.0, 5.0)]}, [residual], [known]) == []
    assert contacts_of_fit({"other": [(4.0, 5.0)]}, [residual], []) == []


def test_a_stretch_without_residuals_is_a_contact_of_no_size(residual):
    (found,) = contacts_of_fit({"moving": [(11.0, 12.0)]}, [residual], [])
    assert found.channels == ("fx", "tx")
    assert (found.force, found.torque) == (0.0, 0.0)
