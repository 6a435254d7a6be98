"""Cables that nobody reads and that hang slack for a while: found, named and left out."""

from types import SimpleNamespace

import numpy as np
import pytest

from steelyard.identification.methods.maximum_likelihood import MaximumLikelihood
from steelyard.identification.solve.joint_motion import fit_jointly
from steelyard.identification.solve.misfits.slack_cables import (
    SlackCables,
    around,
    slack_cables,
)


def pulling(tension, *, read=False):
    """Balance and forces of cables that pull so hard, [N], one sample each .01 s."""
    at = SimpleNamespace(carried=tension, time=0.01 * np.arange(len(tension)))
    return at, SimpleNamespace(guessed=np.full(tension.shape[1], not read))


def test_a_cable_that_would_have_to_push_is_slack(rng):
    tension = 40 + rng.standard_normal((500, 3))
    tension[200:240, 1] = -5.0
    at, forces = pulling(tension)
    slack = slack_cables(at, forces)
    assert slack[200:240, 1].all()
    assert slack.sum() == 40
    ((start, end),) = around(at.time, slack)
    assert start == pytest.approx(2.0 - 0.1)
    assert end == pytest.approx(2.39 + 0.1)
    said = SlackCables("a", slack.mean(axis=0), 0.12)
    assert "(cable 2 for 8 % of the time)" in str(said)
    assert said.to_dict() == {"run": "a", "cables": {"2": pytest.approx(0.08)}, "left_out": 0.12}


def test_a_single_moment_is_no_hundredth_of_the_time(rng):
    tension = 40 + rng.standard_normal((500, 3))
    tension[200, 1] = 0.0
    at, forces = pulling(tension)
    said = str(SlackCables("a", slack_cables(at, forces).mean(axis=0), 0.04))
    assert "(cable 2 for less than 1 % of the time)" in said


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.mujoco
def test_cables_that_pull_little_are_not_said_to_hang_slack():
    from mujoco_swings import swings

    # The example's four cables: in MuJoCo all are taut at every sample, down to 1.2 N of 145.
    recorded = swings(4, runs=4, seed=41, duration=8.0)
    (said,) = fit_jointly(recorded.experiment).slack
    assert said.run == "swing 0"
    assert (said.shares < 0.01).all()
    assert "pull next to nothing or hang slack (cable 1 for less than 1 %" in str(said)


def test_cables_that_pull_are_not_slack(rng):
    at, forces = pulling(40 + rng.standard_normal((500, 4)))
    assert not slack_cables(at, forces).any()


def test_where_forces_are_read_these_tell_it(rng):
    tension = 40 + rng.standard_normal((500, 3))
    tension[200:240, 1] = -5.0
    assert not slack_cables(*pulling(tension, read=True)).any()


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.mujoco
def test_a_platform_whose_cables_go_slack_is_told_with_a_true_sigma():
    from laboratory_swings import Laboratory, record

    from steelyard.estimates.per_mass import PerMass

    # Of MuJoCo, in which cables come taut again with a jerk: 2.8 sigma off in cog z where these
    # stretches count.
    recorded = record(Laboratory(cables=4, runs=4, push=1.3, slack=True), [77, 4, 0])
    found = MaximumLikelihood()(recorded.experiment)
    told = found.per_mass
    assert told is not None
    truth = PerMass.of(recorded.body.body_parameters, np.zeros((10, 10))).value
    z = (told.value - truth) / told.standard_deviation
    assert np.sqrt(np.nanmean(z**2)) < 1.6
    assert sum("next to nothing or hang slack" in note for note in found.notes) == 4
