"""Settings of the methods: every number says what it is, and another value has its effect."""

import ast
from dataclasses import FrozenInstanceError, replace
from pathlib import Path

import numpy as np
import pytest

import steelyard
from steelyard.bodies.settings import BodySettings
from steelyard.excitation.limits.rest_poses import workspace_grid
from steelyard.excitation.settings import DesignSettings
from steelyard.inertia import Inertia
from steelyard.motion.limits import CheckSettings, check_times
from steelyard.motion.trajectory import RestToRest
from steelyard.robot.file import read_robot
from steelyard.simulation.forward_dynamics import CablePlatform, ForwardDynamicsSettings
from steelyard.simulation.trajectories import (
    MultisineSettings,
    WorkspaceSettings,
    feasible_multisine,
    workspace_of,
)

PACKAGE = Path(steelyard.__file__).parent
ROBOT = read_robot("cogiro")


def settings_classes():
    for path in sorted(PACKAGE.rglob("*.py")):
        text = path.read_text()
        for node in ast.parse(text).body if "Settings" in text else ():
            if isinstance(node, ast.ClassDef) and node.name.endswith("Settings"):
                yield node


@pytest.mark.parametrize("node", list(settings_classes()), ids=lambda node: node.name)
def test_every_setting_is_documented_under_itself(node):
    fields = [i for i, each in enumerate(node.body) if isinstance(each, ast.AnnAssign)]
    assert fields
    for i in fields:
        name = node.body[i].target.id
        assert node.body[i].value is not None, f"{name} has no default"
        following = node.body[i + 1] if i + 1 < len(node.body) else None
        documented = isinstance(following, ast.Expr) and isinstance(following.value, ast.Constant)
        assert documented, f"{name} is not documented"


def test_settings_do_not_change():
    with pytest.raises(FrozenInstanceError):
        DesignSettings().steps = 3


def test_two_solutions_count_as_one_up_to_the_agreement():
    impossible = Inertia(1.0, np.zeros(3), np.diag([1.0, 1.0, 5.0]))
    assert steelyard.nearest_body(impossible).solution.remark is None
    strict = steelyard.nearest_body(impossible, settings=BodySettings(agreement=-1.0))
    assert "less exactly than usual" in strict.solution.remark
    assert strict.solution.remark in str(strict)


def test_a_finer_tolerance_moves_the_platform_by_less_than_the_coarser_one():
    motion = RestToRest(np.array([0, 0, 1.5, 0, 0, 0]), np.array([0.1, 0, 1.5, 0, 0, 0]), 1.0)
    straight = ROBOT.with_straight_cables()
    times = np.linspace(0, 1, 20)

    def positions(tolerance):
        chosen = ForwardDynamicsSettings(tolerance=tolerance)
        platform = CablePlatform(straight, straight.platform, chosen)
        return platform.move(motion).at(times).position

    fine = positions(1e-8)
    off = [np.abs(positions(tolerance) - fine).max() for tolerance in (1e-4, 1e-6)]
    assert off[0] > off[1] > 0
    assert off[1] < 1e-6


def test_trajectories_are_checked_as_often_as_asked():
    motion = RestToRest(np.zeros(6), np.ones(6), 2.0)
    assert len(check_times(motion)) == 101
    assert len(check_times(motion, CheckSettings(per_second=10.0))) == 21
    assert len(check_times(motion, CheckSettings(most=5))) == 6


def test_a_workspace_without_limits_is_a_part_of_the_frame():
    free = replace(ROBOT, limits=type(ROBOT.limits)())
    middle, reach = workspace_of(free)
    wide, wider = workspace_of(free, WorkspaceSettings(frame_parts=3.0, tilt=30.0))
    np.testing.assert_allclose(wide, middle)
    np.testing.assert_allclose(wider, 2 * reach)


@pytest.mark.integration
def test_a_multisine_is_as_fast_as_asked():
    times = np.linspace(0, 20, 1001)
    frequency = np.fft.rfftfreq(1001, 0.02)

    def share_above(hertz, motion):
        power = np.abs(np.fft.rfft(motion.derivative(times, 2), axis=0)) ** 2
        return power[frequency > hertz].sum() / power.sum()

    usual = feasible_multisine(ROBOT, 20.0)
    slow = feasible_multisine(ROBOT, 20.0, MultisineSettings(highest_frequency=0.25))
    assert share_above(0.4, usual) > 0.6
    assert share_above(0.4, slow) < 0.2  # of the fading


def test_start_poses_lie_on_the_grid_that_is_asked_for():
    assert len(workspace_grid(ROBOT)) == 125
    grid = workspace_grid(ROBOT, DesignSettings(start_grid=(0.0, 0.5)))
    assert len(grid) == 8
    middle, reach = workspace_of(ROBOT)
    np.testing.assert_allclose(grid[0], middle)
    np.testing.assert_allclose(grid[-1][:3], middle[:3] + 0.5 * reach[:3])
