"""Natural frequencies against MuJoCo, a pendulum, and draws."""

from dataclasses import replace

import numpy as np
import pytest
from mujoco_swings import BODY, linear_frequencies, swinging_robot
from scipy.spatial.transform import Rotation

from steelyard.errors import InputError
from steelyard.estimates.estimate import Estimate, Verdict
from steelyard.estimates.per_mass import PerMass
from steelyard.inertia import Inertia
from steelyard.natural_frequencies.frequencies import frequencies
from steelyard.robot.file import read_robot
from steelyard.robot.model import Robot

POSE = [0.3, 0.1, 1.2, 0.0, 0.0, 0.0]


def hertz(found):
    return np.array([each.frequency for each in found.modes])


def as_qpos(found):
    quaternion = Rotation.from_matrix(found.place.rotation).as_quat(scalar_first=True)
    return np.concatenate([found.place.position, quaternion])


@pytest.mark.parametrize("m", [2, 3, 4])
def test_elastic_cables_swing_as_in_mujoco(m):
    robot = swinging_robot(m)
    found = frequencies(robot, BODY, pose=POSE, elastic=True)
    expected = linear_frequencies(robot, BODY, found.lengths, as_qpos(found))
    np.testing.assert_allclose(hertz(found), expected, rtol=1e-7)


@pytest.mark.parametrize("m", [1, 2, 3, 4])
def test_cables_of_constant_length_are_the_limit_of_stiff_ones(m):
    robot = swinging_robot(m, stiffness=1e10)
    rigid = frequencies(robot, BODY, pose=POSE)
    stiff = frequencies(robot, BODY, pose=POSE, elastic=True)
    assert len(rigid.modes) == 6 - m
    np.testing.assert_allclose(hertz(rigid), hertz(stiff)[: 6 - m], rtol=1e-6, atol=1e-4)
    # About a single cable nothing tells the yaw.
    np.testing.assert_allclose(rigid.pose, stiff.pose, atol=1e-6 if m > 1 else 1e-4)
    np.testing.assert_allclose(rigid.tension, stiff.tension, rtol=1e-4)


def test_a_small_weight_on_a_cable_is_a_pendulum():
    robot = Robot("pendulum", np.array([[0.0, 0, 3]]), np.zeros((1, 3)))
    weight = Inertia(2.0, np.zeros(3), 1e-9 * np.eye(3))
    found = frequencies(robot, weight, lengths=[1.5])
    expected = np.sqrt(9.81 / 1.5) / (2 * np.pi)
    assert np.sum(np.isclose(hertz(found), expected, rtol=1e-6)) == 2
    np.testing.assert_allclose(found.place.position, [0, 0, 1.5], atol=1e-6)
    np.testing.assert_allclose(found.tension, 2 * 9.81, rtol=1e-9)


def test_lengths_of_a_pose_lead_to_the_same_equilibrium():
    robot = swinging_robot(3)
    first = frequencies(robot, BODY, pose=POSE)
    again = frequencies(robot, BODY, lengths=first.lengths.tolist())
    np.testing.assert_allclose(hertz(again), hertz(first), rtol=1e-7)


def test_eight_cables_hold_a_pose_and_vibrate():
    robot = read_robot("cogiro")
    found = frequencies(robot, pose=[0, 0, 1.5, 0, 0, 0])
    assert found.elastic
    assert len(found.modes) == 6
    np.testing.assert_allclose(found.pose, [0, 0, 1.5, 0, 0, 0], atol=1e-7)
    assert (np.diff(hertz(found)) > 0).all()


def test_a_cable_that_is_too_long_is_slack():
    robot = swinging_robot(4)
    lengths = frequencies(robot, BODY, pose=POSE).lengths.copy()
    lengths[1] += 0.1
    found = frequencies(robot, BODY, lengths=lengths.tolist())
    assert found.tension[1] == 0
    assert len(found.modes) == 6 - np.sum(found.tension > 0)


def estimate_of(body, covariance, per_mass=None):
    verdict = Verdict(True, (), {})
    return Estimate("maximum-likelihood", body, covariance, verdict, per_mass=per_mass)


@pytest.mark.integration
def test_one_sigma_is_that_of_draws():
    robot, rng = swinging_robot(3), np.random.default_rng(0)
    root = np.tril(rng.normal(size=(10, 10))) * 1e-3
    covariance = root @ root.T
    value = BODY.body_parameters
    found = frequencies(robot, estimate_of(value, covariance), pose=POSE)
    drawn = [
        hertz(frequencies(robot, Inertia.from_body_parameters(draw), pose=POSE))
        for draw in rng.multivariate_normal(value, covariance, size=400)
    ]
    expected = np.std(drawn, axis=0)
    np.testing.assert_allclose([m.standard_deviation for m in found.modes], expected, rtol=0.15)


def test_inertia_per_mass_is_enough_where_cables_keep_their_length():
    robot = swinging_robot(4)
    value, covariance = BODY.body_parameters, 1e-6 * np.eye(10)
    covariance[0] = covariance[:, 0] = 0.0
    whole = frequencies(robot, estimate_of(value, covariance), pose=POSE)
    untold = np.where(np.isin(np.arange(10), (1, 2, 3)), value, np.nan)
    unweighed = estimate_of(untold, np.full((10, 10), np.nan), PerMass.of(value, covariance))
    found = frequencies(robot, unweighed, pose=POSE)
    np.testing.assert_allclose(hertz(found), hertz(whole), rtol=1e-9)
    for a, b in zip(found.modes, whole.modes, strict=True):
        assert a.standard_deviation == pytest.approx(b.standard_deviation, rel=1e-4)
    assert np.isnan(found.tension).all()
    with pytest.raises(InputError, match="with a mass"):
        frequencies(robot, unweighed, pose=POSE, elastic=True)


@pytest.mark.parametrize(
    ("changed", "expected"),
    [
        ({}, "either a pose or the lengths"),
        ({"pose": POSE, "lengths": [1.0] * 4}, "found both"),
        ({"pose": [0, 0, 1]}, "pose: expected x, y, z"),
        ({"pose": [0, 0, np.nan, 0, 0, 0]}, "pose: expected x, y, z"),
        ({"lengths": [1.0] * 3}, "lengths: expected 4 lengths"),
        ({"lengths": [1.0, 1.0, -1.0, 1.0]}, "lengths: expected 4 lengths above zero"),
        ({"lengths": [0.1] * 4}, "expected lengths on which the platform comes to rest"),
    ],
)
def test_what_cannot_be_is_said(changed, expected):
    with pytest.raises(InputError, match=expected):
        frequencies(swinging_robot(4), BODY, **changed)


def test_a_robot_without_what_is_needed_is_said():
    robot = swinging_robot(4)
    with pytest.raises(InputError, match="nominal 'platform'"):
        frequencies(robot, pose=POSE)
    soft = replace(robot, cable=replace(robot.cable, axial_stiffness=None))
    with pytest.raises(InputError, match="axial_stiffness"):
        frequencies(soft, BODY, pose=POSE, elastic=True)
    impossible = Inertia(1.0, np.zeros(3), np.diag([1.0, 0.1, 0.1]))
    with pytest.raises(InputError, match="a body that can exist"):
        frequencies(robot, estimate_of(impossible.body_parameters, np.eye(10)), pose=POSE)
