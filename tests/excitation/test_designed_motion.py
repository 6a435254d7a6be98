"""A designed motion on elastic cables in MuJoCo: it does what the design promised, seen by another
simulator."""

from functools import cache

import numpy as np
import pytest
from mujoco_cables import LAWS, chi_square, hung, point_robot, recorded
from places import DATA

from steelyard.dynamics import platform_wrench
from steelyard.identification.methods.maximum_likelihood import MaximumLikelihood
from steelyard.motion.limits import motion_extremes
from steelyard.motion.trajectory import Sampled
from steelyard.simulation.trajectories import from_file

COMMANDS = (
    "designed-points",
    "designed-file",
)  # as `python benchmarks/designed_motion.py store` writes them
PAST = 1.02  # part of a limit that the motion on elastic cables may reach
LEVEL = 600.0  # [N], at which the winches hold the cables
LARGEST = 29.6  # of the chi-square of ten parameters: one in a thousand is larger

robot = point_robot()
both_laws = pytest.mark.parametrize("law", LAWS)
pytestmark = [pytest.mark.mujoco, pytest.mark.parametrize("name", COMMANDS)]


@cache
def command(name):
    return from_file(DATA / f"{name}.csv", robot)


@cache
def hanging(name, law):
    return hung(robot, command(name), LEVEL, law)


def test_the_stored_command_is_a_smooth_motion_from_rest_to_rest_within_the_limits(name):
    trajectory = command(name)
    assert trajectory.duration == pytest.approx(20.0)
    ends = np.array([0.0, trajectory.duration])
    for order, most in ((1, 1e-4), (2, 1e-3), (3, 1e-1)):  # what is left of the digits of the file
        assert np.abs(trajectory.derivative(ends, order)).max() < most
    assert motion_extremes(robot, trajectory).fraction < 1
    # Every other row tells the same motion, so that what lies between the rows of the file is no
    # matter of the interpolation.
    rows = np.arange(0.0, trajectory.duration + 0.025, 0.05)
    coarse = Sampled.through(rows[::2], trajectory.derivative(rows[::2], 0))
    between = np.arange(0.0, trajectory.duration, 0.01)
    assert np.abs(coarse.derivative(between, 0) - trajectory.derivative(between, 0)).max() < 1e-5


@pytest.mark.slow
@both_laws
def test_the_oracle_obeys_newton_and_euler_between_its_recorded_states_and_hardly_depends_on_its_step(
    name, law
):
    found = hanging(name, law)
    state = found.at(np.linspace(0.0, found.duration, 997))
    wrench = platform_wrench(
        robot.platform.parameters, state.specific_force, state.omega, state.alpha
    )
    assert (
        np.abs(wrench - state.wrench).max() < 0.01
    )  # [N], [N m]; a five hundredth of the noise of a force sensor
    finer = hung(robot, command(name), LEVEL, law, step=2.5e-4)
    assert np.abs(finer.tension - found.tension).max() < 0.2
    assert np.abs(finer.seen[:, :3] - found.seen[:, :3]).max() < 1e-5


@both_laws
def test_a_designed_motion_leaves_no_cable_slack_on_elastic_cables(name, law):
    assert hanging(name, law).tension.min() > 0


@both_laws
def test_a_designed_motion_keeps_every_limit_on_elastic_cables(name, law):
    found = hanging(name, law)
    assert {name: use for name, use in found.uses().items() if use > PAST} == {}
    low, high = robot.tension_limits
    assert found.tension.min() > low / PAST
    assert found.tension.max() < high * PAST
    # It went somewhere: a motion that hardly uses the robot would keep all of this.
    assert max(found.uses().values()) > 0.7


@pytest.mark.slow
@both_laws
def test_the_body_is_identified_from_a_designed_motion_on_elastic_cables_within_what_is_stated(
    name, law
):
    estimate = MaximumLikelihood()(recorded(hanging(name, law), command(name), seed=20))
    assert estimate.verdict.accepted
    assert chi_square(estimate, robot.platform) < LARGEST
