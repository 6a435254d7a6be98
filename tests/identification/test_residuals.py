"""Readings beside what the fit says they should have been: by the motion that the fit tells, and by
chance."""

from dataclasses import replace

import numpy as np
import pytest
from recordings import write_small
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from steelyard.experiment.read import read_experiment
from steelyard.identification.identify import identify
from steelyard.identification.methods.least_squares import LeastSquares
from steelyard.identification.methods.maximum_likelihood import MaximumLikelihood
from steelyard.identification.residuals import PLATFORM, residuals
from steelyard.instruments import Length
from steelyard.robot.file import read_robot
from steelyard.robot.kinematics import cables_at
from steelyard.simulation.sensors import Sensors, paper_sensors
from steelyard.simulation.simulate import simulate
from steelyard.simulation.trajectories import feasible_multisine

pytestmark = pytest.mark.integration


@pytest.fixture(scope="module")
def experiment(tmp_path_factory):
    return read_experiment(write_small(tmp_path_factory.mktemp("small")))


@pytest.fixture(scope="module", params=[MaximumLikelihood, LeastSquares])
def found(request, experiment):
    identification = identify(experiment, [request.param()])
    estimate = identification.estimates[identification.result]
    readings = residuals(identification.posterior, estimate.body)
    return identification, {(each.instrument, each.quantity): each for each in readings}


def test_everything_that_was_read_is_explained(found):
    _, readings = found
    expected = {
        (PLATFORM, "force"), (PLATFORM, "torque"), ("imu", "angular_velocity"), ("imu", "specific_force"), ("imu", "orientation"), ("tracker", "position"), ("cables", "tension"),
    }  # fmt: skip
    assert set(readings) == expected
    for each in readings.values():
        n, k = len(each.time), len(each.channels)
        assert (
            each.measured.shape
            == each.predicted.shape
            == each.residual.shape
            == each.left_out.shape
            == (n, k)
        )
        assert np.all(np.diff(each.time) >= 0)
        assert each.sigma.shape == (k,)


def test_what_is_left_is_as_large_as_the_noise(found):
    identification, readings = found
    for (instrument, quantity), each in readings.items():
        ratio = np.sqrt(np.nanmean((each.residual / each.sigma) ** 2))
        # Six equations tell only a part of what eight readings err by; a spline follows a part of
        # the noise of the others. The wrench of filtered samples has noise of the motion in it too.
        least = 0.5 if instrument == "cables" else 0.75
        most = 1.5 if instrument == PLATFORM and identification.result == "least-squares" else 1.25
        assert least < ratio < most, (instrument, quantity, ratio)


def test_measured_is_what_was_read(found, experiment):
    _, readings = found
    run = experiment.runs[0]
    gyro = readings["imu", "angular_velocity"]
    read = run.streams["imu"].values["angular_velocity"]
    places = np.searchsorted(run.streams["imu"].time - run.sync["imu"], gyro.time - 1e-9)
    np.testing.assert_array_equal(gyro.measured, read[places])
    for key in (("imu", "angular_velocity"), ("tracker", "position"), (PLATFORM, "force")):
        each = readings[key]
        there = np.isfinite(each.residual)
        np.testing.assert_allclose(
            (each.measured - each.predicted)[there], each.residual[there], atol=1e-9
        )


def test_angles_go_with_their_residuals(found):
    _, readings = found
    each = readings["imu", "orientation"]
    measured, predicted = (
        Rotation.from_euler("ZYX", angles[:, ::-1]) for angles in (each.measured, each.predicted)
    )
    turned = (predicted.inv() * measured).as_rotvec()
    np.testing.assert_allclose(turned, each.residual, atol=1e-12)
    assert np.abs(np.diff(each.measured, axis=0)).max() < 1.0


def test_predicted_wrench_is_that_of_the_body_on_the_fitted_motion(experiment):
    identification = identify(experiment, [MaximumLikelihood()])
    motion, body = identification.motion[0], identification.estimates["maximum-likelihood"].body
    readings = {(e.instrument, e.quantity): e for e in residuals(identification.posterior, body)}
    force, torque = readings[PLATFORM, "force"], readings[PLATFORM, "torque"]
    inside = (force.time > motion.time[0]) & (force.time < motion.time[-1])

    def at(values):
        return CubicSpline(motion.time, values)(force.time[inside])

    # Newton and Euler about the centre of gravity, in the world.
    R = Rotation.from_quat(at(motion.rotation), scalar_first=True)
    omega, alpha = (
        R.apply(at(motion.values["angular_velocity"])),
        R.apply(at(motion.values["angular_acceleration"])),
    )
    c = R.apply(np.array(body.center_of_gravity))
    a = at(motion.values["acceleration"]) + np.cross(alpha, c) + np.cross(omega, np.cross(omega, c))
    pull = body.mass * (a - experiment.robot.gravity)
    J = np.einsum("nij,jk,nlk->nil", R.as_matrix(), body.inertia, R.as_matrix())
    moment = (
        np.einsum("nij,nj->ni", J, alpha)
        + np.cross(omega, np.einsum("nij,nj->ni", J, omega))
        + np.cross(c, pull)
    )
    np.testing.assert_allclose(R.inv().apply(pull), force.predicted[inside], atol=0.05)
    np.testing.assert_allclose(R.inv().apply(moment), torque.predicted[inside], atol=0.05)


def test_measured_wrench_is_that_of_the_cables(experiment):
    identification = identify(experiment, [MaximumLikelihood()])
    joint, robot = identification.posterior, experiment.robot
    readings = {(e.instrument, e.quantity): e for e in residuals(joint)}
    samples = joint.samples[0]
    offset = np.array(
        identification.estimates["maximum-likelihood"].calibration["cables"]["offset"]["value"]
    )
    tension = readings["cables", "tension"].measured - offset
    position = samples.position + samples.rotation @ joint.experiment.origin
    structure = cables_at(robot, position, samples.rotation, tension).structure
    wrench = np.hstack([readings[PLATFORM, name].measured for name in ("force", "torque")])
    np.testing.assert_allclose(np.einsum("nkm,nm->nk", structure, tension), wrench, atol=1e-6)


@pytest.mark.slow
@pytest.mark.long
def test_lengths_are_beside_what_ropes_that_damp_have_been_stretched_to():
    robot = read_robot("cogiro").with_straight_cables()
    rope = replace(robot.cable, axial_stiffness=1e5, damping_ratio=0.2)
    robot = replace(robot, cable=rope, pulley_radius=np.zeros(robot.m))
    own = dict(paper_sensors(robot).instruments)
    del own["command"]
    own["cables"] = own["cables"].model_copy(update={"noise": 0.5})
    own["lengths"] = Length.model_validate(
        {"kind": "length", "noise": 1e-4, "rate": 25.0, "clock": "recorder"}
    )
    motion = {"move": feasible_multisine(robot, 10.0)}
    experiment = simulate(robot, motion, Sensors(own), seed=11).experiment
    identification = identify(experiment, [MaximumLikelihood()])
    estimate = identification.estimates[identification.result]
    assert estimate.verdict.accepted
    damping = estimate.calibration["lengths"]["damping"]
    assert damping["value"][0] > 5 * damping["standard_deviation"][0]
    readings = residuals(identification.posterior, estimate.body)
    (lengths,) = (each for each in readings if each.instrument == "lengths")
    assert np.sqrt(np.nanmean((lengths.residual / lengths.sigma) ** 2)) < 1.5
