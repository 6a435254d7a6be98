"""Hoses and air, against forces at points and against the power that they take."""

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from steelyard.robot.file import read_robot
from steelyard.robot.surroundings import (
    air_wrench,
    attached_wrench,
    hose_wrench,
    middle_of,
    swivel_wrench,
)

ROBOT = read_robot("cogiro")
POSITION, TURNED = np.array([0.4, -0.3, 1.7]), Rotation.from_rotvec([0.2, -0.1, 0.4])


def numbers(expression):
    return np.array(ca.DM(ca.evalf(ca.SX(expression)))).ravel()


def test_a_hose_pulls_at_its_point():
    force, stiffness, point = np.array([3.0, -2.0, -12.0]), 7.0, np.array([0.1, -0.5, 0.9])
    middle = np.array([0.1, 0.2, 2.0])
    found = numbers(
        attached_wrench(
            ca.DM(POSITION),
            ca.DM(TURNED.as_matrix()),
            middle,
            ca.DM(force),
            ca.DM(stiffness),
            ca.DM(np.outer(force, point).ravel()),
            ca.DM(stiffness * point),
        )
    )
    pull = TURNED.inv().apply(force - stiffness * (POSITION - middle))
    np.testing.assert_allclose(found[:3], pull, atol=1e-12)
    np.testing.assert_allclose(found[3:], np.cross(point, pull), atol=1e-12)


def hose(position, at, to, weight, stiffness, free):
    described = np.concatenate([at, to, [weight, stiffness, free]])
    gravity = ca.DM([0.0, 0.0, -9.81])
    return numbers(
        hose_wrench(ca.DM(position), ca.DM(TURNED.as_matrix()), gravity, ca.DM(described))
    )


def test_a_stated_hose_pulls_where_it_comes_from_once_it_is_taut():
    at, to = np.array([0.1, -0.5, 0.9]), np.array([0.0, 3.0, 5.4])
    point = POSITION + TURNED.apply(at)
    length = np.linalg.norm(to - point)
    pull = 12.0 * (length - 1.5) * (to - point) / length + [0, 0, -7.0]
    found = hose(POSITION, at, to, 7.0, 12.0, 1.5)
    np.testing.assert_allclose(found[:3], TURNED.inv().apply(pull), rtol=1e-4)
    np.testing.assert_allclose(found[3:], np.cross(at, found[:3]), atol=1e-12)
    slack = hose(POSITION, at, to, 7.0, 12.0, length + 1.0)
    np.testing.assert_allclose(slack[:3], TURNED.inv().apply([0, 0, -7.0]), atol=1e-3)


@pytest.mark.integration
def test_a_stated_hose_does_the_work_that_its_length_takes():
    at, to = np.array([0.1, -0.5, 0.9]), np.array([0.0, 3.0, 5.4])
    steps = np.linspace(0.0, 1.0, 2001)[:, None] * [0.5, -1.0, 0.3]
    along = np.array([TURNED.apply(hose(POSITION + s, at, to, 0.0, 12.0, 1.5)[:3]) for s in steps])
    work = np.sum((along[1:] + along[:-1]) / 2 * np.diff(steps, axis=0))
    stored = [
        6.0 * (np.linalg.norm(to - POSITION - s - TURNED.apply(at)) - 1.5) ** 2
        for s in steps[[0, -1]]
    ]
    assert work == pytest.approx(stored[0] - stored[1], rel=1e-4)


def air(velocity, omega):
    rotation = ca.DM(TURNED.as_matrix())
    return numbers(air_wrench(rotation, ca.DM(velocity), ca.DM(omega), ca.DM(3.0), ca.DM(0.7)))


def test_air_takes_power_as_the_cube_of_speed():
    velocity, omega = np.array([0.8, -0.5, 0.3]), np.array([0.2, 0.5, -0.4])
    found = air(velocity, omega)
    power = found[:3] @ TURNED.inv().apply(velocity) + found[3:] @ omega
    speed, spin = np.linalg.norm(velocity), np.linalg.norm(omega)
    assert power == pytest.approx(-0.6 * (3.0 * speed**3 + 0.7 * spin**3), rel=1e-4)
    faster = air(2 * velocity, 2 * omega)
    np.testing.assert_allclose(faster, 4 * found, rtol=1e-4)


def test_still_air_does_not_push():
    np.testing.assert_array_equal(air(np.zeros(3), np.zeros(3)), np.zeros(6))


def test_the_middle_is_below_the_anchors():
    middle = middle_of(ROBOT)
    assert middle[2] < ROBOT.anchors[:, 2].min()
    np.testing.assert_allclose(middle[:2], ROBOT.anchors[:, :2].mean(axis=0))


def rubbing(velocity, omega, friction):
    rotation = ca.DM(TURNED.as_matrix())
    state = (ca.DM(POSITION), rotation, ca.DM(velocity), ca.DM(omega))
    return numbers(swivel_wrench(ROBOT, *state, ca.DM(friction)))


def test_a_swivel_takes_power_as_its_cable_turns():
    friction = np.linspace(0.1, 0.8, ROBOT.m)
    velocity, omega = np.array([0.8, -0.5, 0.3]), np.array([0.2, 0.5, -0.4])
    found = rubbing(velocity, omega, friction)
    power = found[:3] @ TURNED.inv().apply(velocity) + found[3:] @ omega
    # How fast each cable turns, by differences of its direction.
    step = 1e-6

    def directions(time):
        turned = TURNED * Rotation.from_rotvec(time * omega)
        along = (
            ROBOT.anchors - POSITION - time * velocity - turned.apply(np.array(ROBOT.attachments))
        )
        return along / np.linalg.norm(along, axis=1)[:, None]

    rate = np.linalg.norm(directions(step) - directions(-step), axis=1) / (2 * step)
    assert power == pytest.approx(-friction @ rate, rel=1e-3)
    # Dry: no more at twice the speed.
    np.testing.assert_allclose(
        rubbing(2 * velocity, 2 * omega, friction), found, rtol=2e-3, atol=1e-4
    )


def test_a_swivel_at_rest_does_not_push():
    np.testing.assert_array_equal(rubbing(np.zeros(3), np.zeros(3), np.ones(ROBOT.m)), np.zeros(6))
