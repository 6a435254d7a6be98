"""Errors that the residuals ask for: what few numbers of one cable explain is not explained by many."""

import numpy as np
import pytest
from simulated import with_stream

from steelyard.campaigns.study.draw import drawn
from steelyard.campaigns.study.setup import setup_of_robot
from steelyard.identification.identify import identify
from steelyard.identification.methods.from_posterior.unstated import found_errors
from steelyard.simulation.mistakes import MISTAKES

pytestmark = [pytest.mark.slow, pytest.mark.integration]


@pytest.fixture(scope="module")
def setup():
    return setup_of_robot("cogiro", "paper", "multisine", 20.0)


@pytest.fixture(scope="module")
def sound(setup):
    """A draw in which what 5 cm of an attachment do is small: crosstalk of all 56 pairs explained it, and
    the estimate was accepted with a chi-square of 7.3 per parameter."""
    return drawn(setup, 16)


@pytest.mark.parametrize("method", ["consistent", "maximum-likelihood"])
def test_a_misplaced_attachment_is_no_crosstalk(sound, method):
    wrong = MISTAKES["an attachment wrong by 5 cm"](sound, np.random.default_rng([16, 2]))
    estimate = identify(wrong, [method]).estimate
    assert not estimate.verdict.accepted
    assert "attachment 2 x" in estimate.verdict.reasons[0]


def test_crosstalk_is_crosstalk(setup):
    sound = drawn(setup, 1)
    m, rng = sound.robot.m, np.random.default_rng(4)
    mixed = np.eye(m) + 0.01 * (1 - np.eye(m)) * rng.standard_normal((m, m))
    felt = with_stream(sound, "cables", lambda v: {"tension": v["tension"] @ mixed.T})
    found = identify(felt, ["consistent"])
    assert found.estimate.verdict.accepted, found.estimate.verdict.reasons
    assert {name.split()[0] for name in found_errors(found.posterior)} == {"cables.crosstalk"}
