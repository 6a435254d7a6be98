"""Streams with more samples than a motion asks for: their means say what all samples say."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from simulated import PAPER, Recorder, changed, sound

from steelyard.experiment.recording import Stream
from steelyard.identification.methods.maximum_likelihood import MaximumLikelihood
from steelyard.identification.model.settings import MOTION
from steelyard.identification.samples.dense_streams import average_dense, averaged
from steelyard.identification.solve.joint_motion import fit_jointly
from steelyard.identification.solve.settings import FIT
from steelyard.motion.trajectory import multisine

TIME = 5.0 + np.arange(20_000) / 10_000.0
WITHOUT = replace(FIT, motion=replace(MOTION, averaged_over=0.0))
"""Every sample is looked at."""


def stream(values, time=TIME):
    return Stream(time, {"x": np.asarray(values, dtype=float)}, "test", "clock")


def moved(time):
    return np.column_stack([np.sin(7 * time), 0.3 * np.cos(5 * time)])


def test_what_is_not_dense_stays_the_very_same():
    experiment = sound(0)
    assert average_dense(experiment) is experiment
    for rate in (100.0, 999.0, 1000.0, 1900.0):
        own = stream(moved(np.arange(2000) / rate), np.arange(2000) / rate)
        assert averaged(own, MOTION.averaged_over) is own


def test_means_have_the_noise_of_means(rng):
    noisy = moved(TIME) + 0.01 * rng.standard_normal((len(TIME), 2))
    found = averaged(stream(noisy), 1e-3)
    assert found.mean_of == 10
    assert len(found) == 2000
    off = found.values["x"] - moved(found.time)
    # 4000 numbers tell it to 1.1 %.
    assert np.sqrt(np.mean(off**2)) == pytest.approx(0.01 / np.sqrt(10), rel=0.04)


def test_a_sample_that_stands_alone_spoils_no_mean(rng):
    noisy = moved(TIME) + 0.01 * rng.standard_normal((len(TIME), 2))
    sound_means = averaged(stream(noisy), 1e-3).values["x"]
    noisy[123, 0], noisy[456, 1] = 1e6, -3.0
    found = averaged(stream(noisy), 1e-3).values["x"]
    assert np.abs(found - sound_means).max() < 0.01
    assert np.isfinite(found).all()


def test_lost_samples_are_no_part_of_a_mean_and_many_are_none(rng):
    noisy = moved(TIME) + 0.01 * rng.standard_normal((len(TIME), 2))
    noisy[100:102, 0] = np.nan  # two of a group
    noisy[200:206, 1] = np.nan  # six of a group
    noisy[300:302] = np.nan  # rows that are not there at all
    found = averaged(stream(noisy), 1e-3)
    assert np.isfinite(found.values["x"][10]).all()
    assert np.isfinite(found.values["x"][20]).tolist() == [True, False]
    assert (
        np.abs(found.values["x"] - moved(found.time))[np.isfinite(found.values["x"])].max() < 0.02
    )


def test_no_mean_bridges_a_gap():
    there = (TIME < 5.5003) | (TIME > 5.8)
    found = averaged(stream(moved(TIME)[there], TIME[there]), 1e-3)
    assert not np.any((found.time > 5.5003) & (found.time < 5.8))
    assert np.abs(found.values["x"] - moved(found.time)).max() < 1e-4


def test_bursts_and_packets_are_left_as_they_are():
    bursts = np.sort(np.concatenate([np.arange(500) * 0.01 + i * 1e-4 for i in range(9)]))
    packets = np.repeat(np.arange(100) * 0.01, 100)
    for time in (bursts, packets):
        own = stream(moved(time), time)
        assert averaged(own, 1e-3) is own


def test_a_stuck_channel_keeps_its_value_and_a_coarse_one_its_mean(rng):
    coarse = np.round(moved(TIME)[:, 0] + 0.05 * rng.standard_normal(len(TIME)), 1)
    found = averaged(stream(np.column_stack([np.full(len(TIME), 0.1), coarse])), 1e-3).values["x"]
    assert np.all(found[:, 0] == 0.1)
    assert np.mean(found[:, 1]) == pytest.approx(np.mean(coarse), abs=1e-12)


def test_rotations_are_averaged_as_rotations(rng):
    angle = 0.3 * np.column_stack([np.sin(7 * TIME), np.cos(5 * TIME), TIME])
    error = Rotation.from_rotvec(3e-3 * rng.standard_normal((len(TIME), 3)))
    matrices = (Rotation.from_rotvec(angle) * error).as_matrix()
    matrices[1000] = Rotation.from_rotvec([2.0, 0, 0]).as_matrix()
    found = averaged(stream(matrices), 1e-3)
    own = found.values["x"]
    assert np.abs(own @ own.transpose(0, 2, 1) - np.eye(3)).max() < 1e-12
    assert np.linalg.det(own) == pytest.approx(1.0)
    true = Rotation.from_rotvec(
        0.3 * np.column_stack([np.sin(7 * found.time), np.cos(5 * found.time), found.time])
    )
    off = (true.inv() * Rotation.from_matrix(own)).as_rotvec()
    assert np.sqrt(np.mean(off**2)) == pytest.approx(3e-3 / np.sqrt(10), rel=0.04)


def recorded_fast():
    """Two and a half seconds with IMU, forces and tracker at some kilohertz."""
    instruments = {
        "cables": changed(PAPER["cables"], rate=2500.0),
        "imu": changed(PAPER["imu"], rate=4000.0),
        "tracker": changed(PAPER["tracker"], rate=2000.0),
    }
    centre, reach = [0, 0, 2, 0, 0, 0], [0.5, 0.5, 0.4, 0.35, 0.3, 0.5]
    return Recorder(multisine(centre, reach, 2.5, 3), following=True)(3, instruments=instruments)


@pytest.mark.slow
@pytest.mark.long
def test_a_fit_of_means_tells_what_a_fit_of_all_samples_tells():
    experiment = recorded_fast()
    method = MaximumLikelihood()
    means, samples = (fit_jointly(experiment, settings=each) for each in (FIT, WITHOUT))
    assert {each.mean_of for each in means.experiment.runs[0].streams.values()} == {2, 4}
    assert samples.experiment is experiment
    one, other = method.drawn(means), method.drawn(samples)
    sigma = np.sqrt(np.diag(other.covariance))
    assert np.abs((one.value - other.value) / sigma).max() < 0.05
    # How far the residuals are from their noise is told by as many numbers as there are.
    inflated = [each.solution.inflation.get("noise", 1.0) for each in (means, samples)]
    ratio = np.sqrt(np.diag(one.covariance) / inflated[0]) / (sigma / np.sqrt(inflated[1]))
    assert ratio == pytest.approx(1.0, abs=0.01)
    # What is said of the noise is said of samples.
    noise = [each.details["noise"]["imu"]["angular_velocity"] for each in (one, other)]
    assert noise[0]["stated"] == pytest.approx(noise[1]["stated"])
    assert noise[0]["found"] == pytest.approx(noise[1]["found"], rel=0.05)


def test_the_common_time_does_not_move():
    experiment = recorded_fast()
    (run,) = experiment.runs
    run = replace(run, sync={})
    experiment = replace(experiment, runs=(run,))
    dense = average_dense(experiment)
    before = experiment.common_time(run, "imu")
    after = dense.common_time(dense.runs[0], "imu")
    assert after[0] == pytest.approx(before[:4].mean(), abs=1e-12)


def test_an_encoder_that_stands_still_is_left_as_it_is(rng):
    flickering = 2.413 + 1e-4 * rng.integers(-1, 2, (len(TIME), 2))
    own = stream(flickering)
    assert averaged(own, 1e-3) is own
