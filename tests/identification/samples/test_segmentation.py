"""What a motion begins with: noise of streams, splines through poses, attitudes from gravity."""

import numpy as np
import pytest
from scipy.interpolate import BSpline
from scipy.spatial.transform import Rotation

from steelyard.identification.samples.first_poses.spline_through_poses import started
from steelyard.identification.samples.motion_noise import least_noise, scatter, stands_still
from steelyard.smoothing import DEGREE, knots

START, END, SPACING = 0.0, 10.0, 0.25
GRID = knots(START, END, SPACING)
TIME = np.linspace(START, END, 2001)


def smooth(time):
    return np.column_stack([np.sin(1.3 * time), np.cos(0.7 * time) * time, 0.2 * time])


@pytest.mark.parametrize("sigma", [1e-3, 1e-2, 0.1])
def test_the_scatter_of_a_smooth_stream_is_its_noise(rng, sigma):
    values = smooth(TIME) + sigma * rng.standard_normal((len(TIME), 3))
    # 6003 numbers: their 1-sigma is known to a percent.
    assert scatter(TIME, values, START, END, SPACING) == pytest.approx(sigma, rel=0.05)


def test_the_scatter_of_rotations_is_that_of_the_rotation_vector(rng):
    turned = Rotation.from_rotvec(0.3 * smooth(TIME) / 10)
    errors = Rotation.from_rotvec(2e-3 * rng.standard_normal((len(TIME), 3)))
    matrices = (turned * errors).as_matrix()
    assert scatter(TIME, matrices, START, END, SPACING) == pytest.approx(2e-3, rel=0.05)


def test_gaps_longer_than_knots_leave_the_scatter_as_it_is(rng):
    values = smooth(TIME) + 1e-3 * rng.standard_normal((len(TIME), 3))
    there = np.all([abs(TIME - middle) > 1.0 for middle in (2.5, 7.0)], axis=0)
    found = scatter(TIME[there], values[there], START, END, SPACING)
    assert found == pytest.approx(1e-3, rel=0.05)


def test_two_samples_have_no_scatter():
    assert scatter(TIME[:2], smooth(TIME[:2]), START, END, SPACING) is None


def test_noise_is_never_less_than_rounding():
    values = np.zeros((50, 2))
    assert 0 < least_noise(values) < 1e-11
    varied = smooth(TIME)
    assert scatter(TIME, varied, START, END, SPACING) >= least_noise(varied)
    assert least_noise(1e3 * varied) == pytest.approx(1e3 * least_noise(varied), rel=1e-6)


def test_encoders_of_locked_winches_stand_still(rng):
    values = np.tile([2.413, 3.0817], (400, 1))
    assert stands_still(values)
    flickering = values + 1e-4 * rng.integers(-1, 2, values.shape)
    assert stands_still(flickering)
    flickering[7] = np.nan
    assert stands_still(flickering)


def test_what_moves_in_one_channel_does_not_stand_still(rng):
    values = np.tile([2.413, 3.0817], (400, 1))
    values[:, 1] += np.round(np.linspace(0.0, 2e-3, 400), 4)
    assert not stands_still(values)
    assert not stands_still(2.413 + 1e-6 * rng.standard_normal((400, 1)))


def test_a_spline_through_poses_goes_through_them():
    pose = np.hstack([smooth(TIME), Rotation.from_rotvec(smooth(TIME) / 20).as_quat()])
    coefficients = started(TIME, pose, GRID, START, END, SPACING)
    assert coefficients.shape == (len(GRID) - DEGREE - 1, 7)
    found = BSpline(GRID, coefficients, DEGREE)(TIME[100:-100])
    np.testing.assert_allclose(found, pose[100:-100], atol=1e-3)


def test_one_pose_is_no_motion():
    assert started(TIME[:1], np.zeros((1, 7)), GRID, START, END, SPACING) is None
