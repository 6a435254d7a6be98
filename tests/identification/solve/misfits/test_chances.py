"""How likely noise puts numbers so far from their priors, against draws."""

import numpy as np
import pytest

from steelyard.identification.solve.misfits.suspicions import _shares, _tail


@pytest.mark.parametrize("told", [50.0, 1.0, 0.05])
def test_chance_is_that_of_draws_however_little_is_told(told):
    """Twenty numbers that are zero, of which readings tell these parts of what is known: an estimate is
    the nearer to its prior the less is told, and is as likely to be far for that."""
    rng = np.random.default_rng(4)
    columns = rng.normal(size=(60, 20)) * np.sqrt(told / 60) * rng.uniform(0.2, 1.8, 20)
    known = np.linalg.inv(columns.T @ columns + np.eye(20))
    noise = rng.normal(size=(60, 20_000))
    found = known @ columns.T @ noise
    far = np.einsum("ij,ij->j", found, np.linalg.solve(known, found))
    shares = _shares(known, np.eye(20))
    chances = np.array([_tail(each, shares) for each in far])
    for level in (0.5, 0.1, 0.01):
        assert np.mean(chances < level) == pytest.approx(level, rel=0.25)


def test_what_nothing_is_told_of_tells_nothing():
    assert _tail(0.0, _shares(np.eye(3), np.eye(3))) == 1.0
