"""A vibration that forces and accelerometer measure and the motion does not follow, with a known
lag; and noise of the same size."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.interpolate import BSpline
from scipy.spatial.transform import Rotation
from simulated import EXACT, ROBOT

from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run, Stream
from steelyard.identification.model.calibration_parameters import CalibrationValues, gather
from steelyard.identification.model.motion_segment import Reading, Segment
from steelyard.identification.solve.misfits.coherence import coherence
from steelyard.instruments import Imu
from steelyard.smoothing import DEGREE, knots

LENGTH, MASS = 8.0, 120.0  # [s], [kg]
GRID = knots(0.0, LENGTH, 0.5)
FORCES = np.arange(0.5, LENGTH - 0.5, 1 / 50)  # [s]
MOTION = np.arange(0.5, LENGTH - 0.5, 1 / 200)  # [s]
RPY = (30.0, -20.0, 110.0)
MOUNTING = Rotation.from_euler("ZYX", np.radians(RPY)[::-1])


def vibration(time):
    """A change of the specific force [m/s^2] that has no period within the largest lag."""
    phase = 2 * np.pi * (3.1 * time + 0.4 * np.sin(0.9 * time))
    return np.outer(np.sin(phase), [0.3, -0.2, 0.5]) + np.outer(np.cos(1.7 * phase), [0, 0.2, 0.1])


def case(read, *, static=False):
    """An IMU, turned against the platform, on a platform that rests; ``read`` is added to it."""
    imu = Imu.model_validate({"kind": "imu", "rpy_deg": RPY})
    run = Run("run", {"imu": Stream(np.arange(3.0), {}, "imu")}, {"imu": 0.0})
    experiment = Experiment("vibration", ROBOT, {"imu": imu}, (run,), uncertainty=EXACT)
    parameters = gather(experiment)
    still = np.tile([0, 0, 2, 1, 0, 0, 0.0], (len(GRID) - DEGREE - 1, 1))
    gravity = MOUNTING.inv().apply(-ROBOT.gravity)
    reading = Reading(("imu", "specific_force"), MOTION, gravity + MOUNTING.inv().apply(read), 0.05)
    segment = Segment("run", GRID, (reading,), still)
    assert BSpline(GRID, still, DEGREE)(4.0)[2] == pytest.approx(2.0)
    return experiment, segment, CalibrationValues(parameters, parameters.mean)


def found(read, force):
    experiment, segment, calibration = case(read)
    wrench = np.hstack([MASS * force, np.zeros((len(FORCES), 3))])
    at = SimpleNamespace(time=FORCES, left_over=wrench)
    return coherence(experiment, segment, at, calibration, MASS)


@pytest.mark.parametrize("lag", [-0.03, 0.0, 0.02])
def test_a_shared_vibration_is_found_with_its_lag(lag):
    """The sign of the wrench that is left over is that of the accelerometer's residual."""
    sign = np.sign(found(vibration(MOTION), vibration(FORCES)).correlation) or -1.0
    result = found(vibration(MOTION - lag), sign * vibration(FORCES))
    assert result.instrument == "imu"
    assert result.correlation > 0.99
    assert result.lag == pytest.approx(lag, abs=0.005)


def test_noise_is_no_vibration():
    correlations = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        read = 0.3 * rng.standard_normal((len(MOTION), 3))
        force = 0.3 * rng.standard_normal((len(FORCES), 3))
        correlations.append(found(read, force).correlation)
    assert correlations == [0.0] * 20


def test_a_body_without_mass_has_no_vibration():
    experiment, segment, calibration = case(vibration(MOTION))
    at = SimpleNamespace(time=FORCES, left_over=np.ones((len(FORCES), 6)))
    assert coherence(experiment, segment, at, calibration, 0.0).correlation == 0.0
