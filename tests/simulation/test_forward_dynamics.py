from dataclasses import replace

import numpy as np
import pytest
from few_cables import few_cables
from mujoco_cables import moved, point_robot
from scipy.spatial.transform import Rotation

from steelyard.dynamics import platform_wrench
from steelyard.errors import InfeasibleError, InputError
from steelyard.instruments import Length
from steelyard.instruments.equations import means, predict
from steelyard.motion.trajectory import RestToRest, Sampled, multisine
from steelyard.robot.file import read_robot
from steelyard.simulation.forward_dynamics import CablePlatform
from steelyard.simulation.response import ExactMotion
from steelyard.simulation.trajectories import feasible_multisine

POSE_TOLERANCE = 1e-4  # [m], [rad]: what the issue asks of two simulators over 5 s; they agree to a few micrometres
DURATION = 5.0
SOLVED = 1e-9  # of lengths, relative: residuals of both solutions
FINE = 1e-9  # of the integrator, where differences divide its error by small times


def assert_as_in_mujoco(robot, response, reach, axes=(0, 1, 2)):
    """The same poses for five seconds, and along the axes as far as that at least [m]: the comparison means
    something only if the platform went somewhere."""
    start = response.at(np.zeros(1))
    quaternion = Rotation.from_matrix(start.rotation[0]).as_quat(scalar_first=True)
    found = moved(
        robot, response.feed, np.concatenate([start.position[0], quaternion]), DURATION, step=2.5e-4
    )
    ours = response.at(found.time)
    assert np.abs(ours.position - found.seen[:, :3]).max() < POSE_TOLERANCE
    turned = Rotation.from_quat(found.seen[:, 3:7], scalar_first=True).inv() * Rotation.from_matrix(
        ours.rotation
    )
    assert turned.magnitude().max() < POSE_TOLERANCE
    assert np.ptp(found.seen[:, axes], axis=0).min() > reach


@pytest.mark.mujoco
def test_pose_agrees_with_mujoco_over_five_seconds():
    robot = point_robot(damping_ratio=0.0)
    trajectory = multisine(
        [0, 0.1, 2, 0, 0, 0], [0.3, 0.3, 0.25, 0.2, 0.2, 0.2], 2 * DURATION, harmonics=4
    )
    platform = CablePlatform(robot, robot.platform)
    response = platform.move(trajectory)
    assert_as_in_mujoco(robot, response, reach=0.2)


@pytest.mark.mujoco
@pytest.mark.parametrize("count", [2, 3, 4])
def test_a_platform_that_swings_agrees_with_mujoco(count):
    robot = few_cables(count)
    trajectory = feasible_multisine(robot, DURATION)
    response = CablePlatform(robot, robot.platform).move(trajectory)
    # Two cables move it in their plane.
    assert_as_in_mujoco(robot, response, 0.1, (1, 2) if count == 2 else (0, 1, 2))


@pytest.mark.integration
@pytest.mark.parametrize("count", [3, 4])
def test_a_motion_that_was_made_on_few_cables_comes_out_again(count):
    robot = few_cables(count)
    platform = CablePlatform(robot, robot.platform)
    first = platform.move(feasible_multisine(robot, 8.0))
    # From the midst of a swing on.
    times = np.linspace(2.0, 7.0, 401)
    state = first.at(times)
    rpy = Rotation.from_matrix(state.rotation).as_euler("ZYX")[:, ::-1]
    again = platform.move(Sampled.through(times - times[0], np.hstack([state.position, rpy])))
    found = again.at(times - times[0])
    assert np.abs(found.position - state.position).max() < 2e-3
    turned = np.einsum("nji,njk->nik", found.rotation, state.rotation)
    assert Rotation.from_matrix(turned).magnitude().max() < 2e-2
    assert np.abs(state.omega[0]).max() > 0.01


@pytest.mark.parametrize("sagging", [False, True])
def test_winches_read_what_they_have_fed_however_ropes_damp(sagging):
    robot = read_robot("cogiro")
    soft = replace(robot.cable, axial_stiffness=1e5, damping_ratio=0.1)
    robot = replace(robot if sagging else robot.with_straight_cables(), cable=soft)
    response = CablePlatform(robot, robot.platform).move(
        multisine([0, 0, 2, 0, 0, 0], [0.2] * 3 + [0.05] * 3, 5.0, harmonics=2)
    )
    times = np.linspace(0.1, 4.9, 40)
    winches = Length.model_validate({"kind": "length"})
    state = response.at(times)
    read = predict(winches, robot, state, means(winches, robot.m))["length"]
    # The shape for a tension and that for a length are two solutions of one cable.
    np.testing.assert_allclose(read, response.feed(times), rtol=SOLVED)
    whole = predict(winches, robot, replace(state, stretching=None), means(winches, robot.m))
    assert np.abs(whole["length"] - read).max() > 1e-5


@pytest.mark.parametrize("sagging", [False, True])
def test_states_satisfy_newton_euler_and_their_own_derivatives(sagging):
    robot = read_robot("cogiro")
    robot = robot if sagging else robot.with_straight_cables()
    response = CablePlatform(robot, robot.platform).move(
        multisine([0, 0, 2, 0, 0, 0], [0.2] * 3 + [0.15] * 3, 5.0, harmonics=2), tolerance=FINE
    )
    times = np.linspace(0.2, 4.8, 50)
    state = response.at(times)
    wrench = platform_wrench(
        robot.platform.parameters, state.specific_force, state.omega, state.alpha
    )
    np.testing.assert_allclose(wrench, state.wrench, atol=1e-8)
    h = 2e-4
    before, after = response.at(times - h), response.at(times + h)
    acceleration = (after.position - 2 * state.position + before.position) / h**2
    force_samples = np.einsum("nji,nj->ni", state.rotation, acceleration - robot.gravity)
    np.testing.assert_allclose(force_samples, state.specific_force, atol=2e-3)
    np.testing.assert_allclose((after.omega - before.omega) / (2 * h), state.alpha, atol=1e-4)


def test_energy_is_lost_only_through_damping():
    # Released from a pose off its equilibrium with fixed lengths, the platform swings: without
    # damping its energy stays.
    robot = point_robot(0.0)
    hold = RestToRest(np.array([0, 0, 2.0, 0, 0, 0]), np.array([0, 0, 2.0, 0, 0, 0]), 2.0)

    def energy(damping_ratio):
        chosen = point_robot(damping_ratio)
        platform = CablePlatform(chosen, chosen.platform)
        response = platform.move(hold)
        kicked = response.solution(0.0)
        kicked[7:10] += [0.3, -0.2, 0.1]
        from scipy.integrate import solve_ivp

        still = np.zeros(8)
        feed = response.feed(0.0)
        run = solve_ivp(
            lambda t, x: platform._rate(x, feed, still),
            (0, 2),
            kicked,
            method="DOP853",
            rtol=1e-10,
            atol=1e-10,
        )
        values = []
        for x in (run.y[:, 0], run.y[:, -1]):
            R = Rotation.from_quat(x[3:7], scalar_first=True).as_matrix()
            body = chosen.platform
            velocity = x[7:10] + R @ np.cross(x[10:13], body.center_of_gravity)
            kinetic = body.mass / 2 * velocity @ velocity + x[10:13] @ body.inertia @ x[10:13] / 2
            height = (x[:3] + R @ body.center_of_gravity) @ -chosen.gravity * body.mass
            length = np.linalg.norm(x[:3] + chosen.attachments @ R.T - chosen.anchors, axis=1)
            elastic = np.sum(chosen.cable.axial_stiffness / feed * (length - feed) ** 2) / 2
            values.append(kinetic + height + elastic)
        return values[1] - values[0]

    assert abs(energy(0.0)) < 1e-5
    assert energy(0.02) < -0.1
    assert robot.cable.damping_ratio == 0.0


def test_starts_at_rest_in_equilibrium():
    robot = read_robot("cogiro")
    trajectory = RestToRest(
        np.array([0.5, 0.2, 2, 0.1, 0, 0.2]), np.array([0, 0, 2.2, 0, 0.1, 0]), 2.0, pause=0.5
    )
    state = (
        CablePlatform(robot, robot.platform)
        .move(trajectory, tolerance=FINE)
        .at(np.linspace(0, 0.45, 20))
    )
    np.testing.assert_allclose(
        state.specific_force, np.einsum("nji,j->ni", state.rotation, -robot.gravity), atol=1e-4
    )
    assert np.abs(state.omega).max() < 1e-6


def test_a_platform_without_cables_follows_exactly():
    robot = replace(
        read_robot("cogiro"),
        anchors=np.zeros((0, 3)),
        attachments=np.zeros((0, 3)),
        pulley_radius=[],
        pulley_axis=[],
    )
    trajectory = multisine([0, 0, 1, 0, 0, 0], [0.1] * 6, 3.0, harmonics=3)
    times = np.linspace(0, 3, 7)
    state = ExactMotion(robot, robot.platform, trajectory).at(times)
    np.testing.assert_array_equal(state.position, trajectory.derivative(times, 0)[:, :3])


def test_says_when_a_cable_goes_slack():
    robot = point_robot(0.02)
    # Thrown down faster than gravity pulls.
    drop = RestToRest(np.array([0, 0, 3.0, 0, 0, 0]), np.array([0, 0, 1.0, 0, 0, 0]), 0.6)
    with pytest.raises(InfeasibleError, match="slack"):
        CablePlatform(robot, robot.platform).move(drop).at(np.linspace(0, 0.6, 100))


def test_says_what_a_robot_file_lacks():
    robot = read_robot("cogiro")
    with pytest.raises(InputError, match="axial_stiffness"):
        CablePlatform(
            replace(robot, cable=replace(robot.cable, axial_stiffness=None)), robot.platform
        )
