"""Steps whose length is wrong by a constant factor: shorter or longer ones arrive at once."""

from types import SimpleNamespace

import numpy as np
import pytest

from steelyard.identification.solve.joint_fit import _pace
from steelyard.identification.solve.settings import FIT


def turns_until_arrived(overshot, most=12):
    """Turns in which steps that are so many times what would arrive come within .05 1-sigma."""
    off, share, last = np.array([0.9, 0.0]), 1.0, None
    for turn in range(most):
        step = SimpleNamespace(border=-overshot * off, covariance=np.eye(2))
        share = 1.0 if last is None else _pace(last, step, share, FIT)
        if np.abs(step.border).max() < 0.05:
            return turn
        off, last = off + share * step.border, step
    return None


@pytest.mark.parametrize("overshot", [0.5, 1.0, 1.8, 4.0, 6.3, 12.0])
def test_steps_that_are_too_long_or_too_short_arrive(overshot):
    # A friction that builds up over a length which nothing else tells has a curvature six times what
    # Gauss-Newton takes it for.
    found = turns_until_arrived(overshot)
    assert found is not None
    assert found <= 6
