"""Hoses and air, against forces at points and against the power that they take."""

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from steelyard.robot.file import read_robot
from steelyard.robot.surroundings import air_wrench, attached_wrench, middle_of

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
