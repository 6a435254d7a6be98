"""What motion instruments say about each other, against the truth, an independent solver and what
they cannot know."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2, norm

from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run, Stream
from steelyard.identification.model.calibration_parameters import (
    ROBOT,
    CalibrationValues,
    gather,
)
from steelyard.identification.samples.segmentation import recorded
from steelyard.identification.solve.beginning.motion_task import motion_task
from steelyard.identification.solve.beginning.readings import read
from steelyard.identification.solve.fit_state import FitState
from steelyard.identification.solve.joint_fit import fit as fit_motion
from steelyard.instruments import Attitude, Pose
from steelyard.robot.file import read_robot
from steelyard.simulation.forward_dynamics import CablePlatform
from steelyard.simulation.recording import draw_errors, record
from steelyard.simulation.response import ExactMotion
from steelyard.simulation.sensors import ideal_sensors, paper_sensors
from steelyard.simulation.trajectories import feasible_multisine
from steelyard.smoothing import DEGREE

pytestmark = pytest.mark.integration

SEEDS = 12
RARE = 1e-4  # of sound data that would fail; seeds are fixed, so that none of them does by chance
DURATION = 8.0  # [s]
EXACT = {"anchor": 0.0, "attachment": 0.0, "gravity": 0.0}

# Larger than those of the paper, so that every error has something to be told.
IMU = {
    "gyro_bias": 0.02,
    "accelerometer_bias": 0.1,
    "position": 0.005,
    "misalignment": 0.03,
    "reference": 0.01,
}
TRACKER = {"target": 0.01, "frame": {"position": 0.01, "rotation": 0.01}, "delay": 0.02}


def changed(instrument, **keys):
    """The same instrument with other keys."""
    return type(instrument).model_validate({**instrument.model_dump(exclude_unset=True), **keys})


class Recorder:
    """One motion, recorded as often as one likes."""

    def __init__(self):
        self.robot = read_robot("cogiro").with_straight_cables()
        trajectory = feasible_multisine(self.robot, DURATION)
        self.response = CablePlatform(self.robot, self.robot.platform).move(trajectory)
        self.command = ExactMotion(self.robot, self.robot.platform, trajectory)
        paper = paper_sensors(self.robot).instruments
        self.instruments = {
            "cables": paper["cables"],
            "imu": changed(paper["imu"], calibration={**IMU, "delay": 0.0}),
            "tracker": changed(paper["tracker"], calibration=TRACKER),
            "command": changed(paper["command"], rate=50.0, calibration={"delay": 0.0}),
        }

    def __call__(self, seed, instruments=None, stated=None, runs=("run",)):
        """An experiment and the errors drawn; ``stated`` is what the file says of the instruments,
        if not what they are."""
        instruments = instruments or self.instruments
        rng = np.random.default_rng(seed)
        drawn = draw_errors(instruments, self.robot.m, list(runs), rng)
        recorded = []
        for name in runs:
            streams, sync = record(
                self.response, instruments, drawn[name], self.robot, self.command, rng
            )
            recorded.append(Run(name, streams, sync))
        return (
            Experiment(
                "draw",
                self.robot,
                stated or instruments,
                tuple(recorded),
                uncertainty=dict(EXACT),
                source="",
            ),
            drawn,
        )


@pytest.fixture(scope="module")
def recorder():
    return Recorder()


@dataclass(frozen=True)
class MotionAlone:
    """What the motion instruments say, without any forces."""

    calibration: CalibrationValues
    covariance: np.ndarray  # of all calibration parameters, shape (u, u)
    ratios: dict  # rms of the residuals of each quantity in units of its stated noise
    converged: bool


def fitted(experiment, knots_of=None):
    """The errors of an experiment, what the motion instruments say about them, and the readings."""
    readings = read(experiment, None, lambda what, fraction: None)
    if knots_of is not None:
        (run,), (samples,), (other,) = readings.runs, readings.samples, knots_of.segments
        spacing = float(other.knots[DEGREE + 1] - other.knots[DEGREE])
        record = recorded(experiment, run, samples, readings.calibration, spacing)
        readings = replace(readings, records=(record,))
    task = motion_task(readings)
    parameters = task.calibration_parameters
    found = fit_motion(task, FitState(readings.segments, readings.calibration, None))
    covariance = np.diag(parameters.deviation**2)
    covariance[np.ix_(task.active, task.active)] = found.covariance
    ratios = {
        source: np.sqrt(ratio) * found.state.factors.get(source, 1.0)
        for source, ratio in found.ratios.items()
    }
    alone = MotionAlone(found.state.calibration, covariance, ratios, found.converged)
    return parameters, alone, readings


def truth(calibration_parameters, experiment, drawn):
    """The errors that were drawn, in the places of the unknowns."""
    values = calibration_parameters.mean.copy()
    for u in calibration_parameters.entries:
        if u.owner == ROBOT or u.suspected is not None:
            continue
        run = u.run or experiment.runs[0].name
        place = calibration_parameters.places[u.owner, u.key, u.run]
        if u.key == "delay":
            of_the_clock = (
                n for n, i in experiment.instruments.items() if (i.clock or n) == u.owner
            )
            values[place] = drawn[run][next(of_the_clock)].delay
        else:
            values[place] = drawn[run][u.owner].calibration[u.key]
    return values


def moving(calibration_parameters):
    """Places of the errors of the motion instruments that are not known exactly."""
    ours = [
        u.owner not in {ROBOT, "cables", "command"}
        for _, u, _ in calibration_parameters.components()
    ]
    return np.flatnonzero(np.array(ours) & (calibration_parameters.deviation > 0))


def sigma(fit, place):
    return np.sqrt(np.diag(fit.covariance)[place])


def without(experiment, instrument, quantity=None):
    """The experiment without an instrument, or without one quantity of it."""

    def less(streams):
        if quantity is None:
            return {name: stream for name, stream in streams.items() if name != instrument}
        stream = streams[instrument]
        values = {name: value for name, value in stream.values.items() if name != quantity}
        return {**streams, instrument: replace(stream, values=values)}

    return replace(
        experiment, runs=tuple(replace(r, streams=less(r.streams)) for r in experiment.runs)
    )


# Against the truth


@pytest.fixture(scope="module")
def draws(recorder):
    """Over the seeds: errors of the estimate, their covariance, and the fit."""
    found = []
    for seed in range(SEEDS):
        experiment, drawn = recorder(seed)
        calibration_parameters, fit, _ = fitted(experiment)
        own = moving(calibration_parameters)
        error = (fit.calibration.values - truth(calibration_parameters, experiment, drawn))[own]
        found.append((error, fit.covariance[np.ix_(own, own)], fit))
    return calibration_parameters, own, found


@pytest.mark.integration
def test_it_converges(draws):
    assert all(fit.converged for *_, fit in draws[2])


def test_estimates_are_within_their_covariance(draws):
    _, own, found = draws
    total = sum(error @ np.linalg.solve(covariance, error) for error, covariance, _ in found)
    low, high = chi2.ppf([RARE / 2, 1 - RARE / 2], SEEDS * len(own))
    assert low < total < high


def test_no_estimate_is_biased_or_too_sure(draws):
    _, own, found = draws
    z = np.array([error / np.sqrt(np.diag(covariance)) for error, covariance, _ in found])
    each = RARE / len(own)
    assert np.abs(z.mean(axis=0)).max() < norm.isf(each / 2) / np.sqrt(SEEDS)
    low, high = chi2.ppf([each / 2, 1 - each / 2], SEEDS)
    spread = np.sum(z**2, axis=0)
    assert low < spread.min()
    assert spread.max() < high


@pytest.mark.parametrize(
    ("key", "part"),
    [
        ("imu.gyro_bias x", 0.02),
        ("imu.gyro_bias y", 0.02),
        ("imu.gyro_bias z", 0.02),
        ("imu.accelerometer_bias x", 0.3),
        ("imu.accelerometer_bias y", 0.3),
        ("imu.accelerometer_bias z", 0.1),
        ("imu.misalignment x", 0.6),
        ("imu.misalignment y", 0.6),
        ("imu.reference x", 0.3),
        ("imu.reference y", 0.3),
        ("tracker.frame.rotation x", 0.4),
        ("tracker.frame.rotation y", 0.4),
        ("tracker.delay of run 'run'", 0.05),
    ],
)
def test_what_instruments_contradict_each_other_about_is_told(draws, key, part):
    calibration_parameters, _, found = draws
    place = calibration_parameters.names.index(key)
    assert all(
        sigma(fit, place) < part * calibration_parameters.deviation[place] for *_, fit in found
    )


def test_residuals_are_of_the_size_of_the_noise(draws):
    ratios = [np.array(list(fit.ratios.values())) for *_, fit in draws[2]]
    assert set(draws[2][0][2].ratios) == {
        ("imu", "angular_velocity"),
        ("imu", "specific_force"),
        ("imu", "orientation"),
        ("tracker", "position"),
    }
    # The motion takes up some of the noise, and the knots leave some of the motion.
    assert np.min(ratios) > 0.85
    assert np.max(ratios) < 1.25


# What cannot be told

KEPT = (
    1e-3  # relative: what is not told keeps its prior but for what holds the platform in its hall
)


def test_where_the_tracker_stands_is_not_told(draws):
    calibration_parameters, _, found = draws
    place = calibration_parameters.places["tracker", "frame.position", None]
    for *_, fit in found:
        np.testing.assert_allclose(
            sigma(fit, place), calibration_parameters.deviation[place], rtol=KEPT
        )
        assert (
            np.abs(fit.calibration.values[place]).max()
            < KEPT * calibration_parameters.deviation[place][0]
        )


def test_the_heading_of_the_world_is_not_told(draws):
    # Tracker and attitude turned alike about the vertical read the same: only their difference is
    # told.
    calibration_parameters, _, found = draws
    places = [
        calibration_parameters.names.index(name)
        for name in ("imu.reference z", "tracker.frame.rotation z")
    ]
    prior = calibration_parameters.deviation[places] ** 2
    for *_, fit in found:
        own = fit.covariance[np.ix_(places, places)]
        together, apart = np.array([1.0, 1.0]), np.array([1.0, -1.0])
        assert together @ own @ together == pytest.approx(prior.sum(), rel=0.01)
        assert apart @ own @ apart < 0.05 * prior.sum()
        assert together @ fit.calibration.values[places] == pytest.approx(
            0, abs=0.01 * np.sqrt(prior.sum())
        )


def test_one_target_without_an_accelerometer_tells_nothing_but_the_gyro_bias(recorder):
    experiment, _ = recorder(3)
    calibration_parameters, fit, _ = fitted(without(experiment, "imu", "specific_force"))
    assert fit.converged
    told = [calibration_parameters.places["imu", "gyro_bias", None]]
    # Knots that stay tell next to nothing about the lever that turns with the platform.
    kept = np.setdiff1d(
        moving(calibration_parameters),
        np.concatenate([np.arange(len(calibration_parameters))[place] for place in told]),
    )
    np.testing.assert_allclose(sigma(fit, kept), calibration_parameters.deviation[kept], rtol=0.03)
    assert np.all(
        np.abs(fit.calibration.values[kept]) < 0.4 * calibration_parameters.deviation[kept]
    )
    assert np.all(sigma(fit, told[0]) < 0.02 * 0.02)


def test_what_says_nothing_keeps_its_prior_exactly(recorder):
    experiment, _ = recorder(4)
    calibration_parameters, fit, _ = fitted(experiment)
    for key in ("offset", "gain", "common_gain"):
        place = calibration_parameters.places["cables", key, None]
        np.testing.assert_array_equal(
            fit.calibration.values[place], calibration_parameters.mean[place]
        )
        np.testing.assert_array_equal(
            fit.covariance[place, place], np.diag(calibration_parameters.deviation[place] ** 2)
        )


@pytest.mark.slow
@pytest.mark.integration
def test_all_clocks_together_tell_no_time(recorder):
    # Only differences of clocks are told; a motion that happens later looks the same.
    own = {
        **recorder.instruments,
        "imu": changed(
            recorder.instruments["imu"], clock="imu", calibration={**IMU, "delay": 0.02}
        ),
    }
    for seed in range(4):
        experiment, drawn = recorder(seed, own)
        calibration_parameters, fit, _ = fitted(experiment)
        assert fit.converged
        places = [
            calibration_parameters.places[clock, "delay", "run"].start
            for clock in ("imu", "tracker")
        ]
        covariance = fit.covariance[np.ix_(places, places)]
        error = (fit.calibration.values - truth(calibration_parameters, experiment, drawn))[places]
        together, apart = np.array([1.0, 1.0]), np.array([1.0, -1.0])
        assert together @ covariance @ together == pytest.approx(2 * 0.02**2, rel=KEPT)
        assert apart @ covariance @ apart < 0.001**2
        assert error @ np.linalg.solve(covariance, error) < chi2.isf(RARE, 2)


@pytest.mark.integration
def test_clocks_that_cannot_be_compared_keep_their_prior(recorder):
    own = {
        **recorder.instruments,
        "imu": changed(
            recorder.instruments["imu"], clock="imu", calibration={**IMU, "delay": 0.02}
        ),
    }
    experiment, _ = recorder(5, own)
    experiment = without(experiment, "imu", "specific_force")
    calibration_parameters, fit, _ = fitted(experiment)
    assert fit.converged
    places = [
        p.start
        for (_, key, _), p in calibration_parameters.places.items()
        if key == "delay" and calibration_parameters.deviation[p] > 0
    ]
    assert places
    np.testing.assert_allclose(sigma(fit, places), 0.02, rtol=1e-9)
    np.testing.assert_allclose(fit.calibration.values[places], 0, atol=1e-9)


# Against another solver

WINDOW = (1.0, 3.2)  # [s]; a small problem
CLOSE = 0.02  # in 1-sigma: steps end at a tenth, and converge quadratically
LENGTH_HELD = 0.01  # how loosely the other solver holds the quaternion's length


def stated_readings(pose, rate, acceleration, errors, robot, instruments):
    """Noise-free readings by the table of the contract, in NumPy."""
    q, dq, ddq = (x[:, 3:] for x in (pose, rate, acceleration))
    # With q = s u for a unit quaternion u, R and the vector part of q^-1 dq are those of u.
    inverse = Rotation.from_quat(q, scalar_first=True).inv()
    R = inverse.inv().as_matrix()
    square = np.sum(q**2, axis=1, keepdims=True)

    def vector_part(a, b):
        return a[:, :1] * b[:, 1:] - b[:, :1] * a[:, 1:] - np.cross(a[:, 1:], b[:, 1:])

    omega = 2 * vector_part(q, dq) / square
    alpha = (
        2 * vector_part(q, ddq) / square
        - 2 * np.sum(q * dq, axis=1, keepdims=True) / square * omega
    )
    force_samples = np.einsum("nji,nj->ni", R, acceleration[:, :3] - robot.gravity)
    imu, tracker = instruments["imu"], instruments["tracker"]
    R_imu = Rotation.from_rotvec(errors["imu.misalignment"]).as_matrix()
    place = np.array(imu.position) + errors["imu.position"]
    there = force_samples + np.cross(alpha, place) + np.cross(omega, np.cross(omega, place))
    reference = Rotation.from_rotvec(errors["imu.reference"]).as_matrix()
    frame = Rotation.from_rotvec(errors["tracker.frame.rotation"]).as_matrix()
    target = pose[:, :3] + R @ (np.array(tracker.target) + errors["tracker.target"])
    return {
        ("imu", "angular_velocity"): omega @ R_imu + errors["imu.gyro_bias"],
        ("imu", "specific_force"): there @ R_imu + errors["imu.accelerometer_bias"],
        ("imu", "orientation"): reference.T @ R @ R_imu,
        ("tracker", "position"): (target - errors["tracker.frame.position"]) @ frame,
    }


# Noise, spikes, ideal data


@pytest.mark.slow
@pytest.mark.integration
@pytest.mark.parametrize("quantity", ["angular_velocity", "specific_force", "orientation"])
def test_noise_of_twice_the_stated_size_is_noticed(recorder, quantity):
    imu = recorder.instruments["imu"]
    noise = imu.noise.model_dump()
    stated = {
        **recorder.instruments,
        "imu": changed(imu, noise={**noise, quantity: noise[quantity] / 2}),
    }
    experiment, drawn = recorder(6, stated=stated)
    calibration_parameters, fit, _ = fitted(experiment)
    assert fit.ratios["imu", quantity] == pytest.approx(2, abs=0.3)
    assert all(ratio < 1.3 for source, ratio in fit.ratios.items() if source != ("imu", quantity))
    # What is estimated does not count the readings as better than they are.
    own = moving(calibration_parameters)
    _, honest, _ = fitted(replace(experiment, instruments=recorder.instruments))
    np.testing.assert_allclose(sigma(fit, own), sigma(honest, own), rtol=0.1)
    error = (fit.calibration.values - truth(calibration_parameters, experiment, drawn))[own]
    assert error @ np.linalg.solve(fit.covariance[np.ix_(own, own)], error) < chi2.isf(
        RARE, len(own)
    )


def spiked(stream, size, rng):
    """One sample in a hundred stands far off."""
    values = {}
    for quantity, value in stream.values.items():
        value = value.copy()
        hit = rng.choice(len(value), len(value) // 100, replace=False)
        if value.ndim == 2:
            value[hit] += size[quantity] * rng.choice([-1, 1], (len(hit), 3))
        values[quantity] = value
    return Stream(stream.time, values, stream.source)


@pytest.mark.integration
def test_spikes_do_no_harm(recorder):
    experiment, _ = recorder(7)
    calibration_parameters, clean, readings = fitted(experiment)
    rng = np.random.default_rng(1)
    size = {"angular_velocity": 1.0, "specific_force": 20.0, "position": 0.5}  # hundreds of 1-sigma
    run = experiment.runs[0]
    streams = {
        name: spiked(stream, size, rng) if name in {"imu", "tracker"} else stream
        for name, stream in run.streams.items()
    }
    rough = replace(experiment, runs=(replace(run, streams=streams),))
    # On the knots of the clean data: choosing them is the business of segmentation.
    _, fit, _ = fitted(rough, knots_of=readings)
    own = moving(calibration_parameters)
    assert np.all(
        np.abs(fit.calibration.values - clean.calibration.values)[own] < 1.25 * sigma(clean, own)
    )
    np.testing.assert_allclose(sigma(fit, own), sigma(clean, own), rtol=0.15)
    for source, ratio in fit.ratios.items():
        assert ratio == pytest.approx(clean.ratios[source], rel=0.15)


@pytest.mark.integration
def test_ideal_data_show_no_errors(recorder):
    ideal = {
        name: changed(i, rate=250.0)
        for name, i in ideal_sensors(recorder.robot).instruments.items()
        if name != "command"
    }
    uncertain = {
        "cables": ideal["cables"],
        "imu": changed(ideal["imu"], calibration={**IMU, "delay": 0.0}),
        "tracker": changed(ideal["tracker"], calibration=TRACKER),
    }
    experiment, _ = recorder(0, ideal, stated=uncertain)
    run = replace(experiment.runs[0], window=(1.0, 4.0))
    calibration_parameters, fit, _ = fitted(replace(experiment, runs=(run,)))
    own = moving(calibration_parameters)
    error = np.abs(fit.calibration.values - calibration_parameters.mean)[own]
    assert fit.converged
    # None leaves its prior; what is told well is found to a millionth.
    assert np.all(error < 0.5 * calibration_parameters.deviation[own])
    for key, most in (("gyro_bias", 1e-6), ("accelerometer_bias", 1e-3), ("reference", 1e-4)):
        assert (
            np.abs(fit.calibration.values[calibration_parameters.places["imu", key, None]]).max()
            < most
        )
    assert (
        abs(fit.calibration.values[calibration_parameters.places["tracker", "delay", "run"]][0])
        < 1e-5
    )
    assert np.all(np.linalg.eigvalsh(fit.covariance) > -1e-15)


# Any set of instruments


def test_an_experiment_without_an_imu(recorder):
    own = {
        "cables": recorder.instruments["cables"],
        "compass": Attitude(
            kind="attitude", noise=0.003, rate=50.0, calibration={"misalignment": 0.0, "delay": 0.0}
        ),
        "tracker": recorder.instruments["tracker"],
    }
    calibration_parameters, fit, _ = fitted(recorder(2, own)[0])
    assert fit.converged
    assert set(fit.ratios) == {("compass", "orientation"), ("tracker", "position")}
    kept = moving(calibration_parameters)
    # Attitude and one target have nothing to say to each other.
    np.testing.assert_allclose(sigma(fit, kept), calibration_parameters.deviation[kept], rtol=0.05)


@pytest.mark.integration
def test_a_pose_and_a_gyro_tell_the_clock_between_them(recorder):
    calibration = {
        "target": 0.0,
        "frame": {"position": 0.0, "rotation": 0.0},
        "misalignment": 0.0,
        "delay": 0.05,
    }
    camera = Pose(
        kind="pose",
        noise={"position": 0.002, "rotation": 0.003},
        rate=60.0,
        calibration=calibration,
    )
    own = {
        "cables": recorder.instruments["cables"],
        "imu": recorder.instruments["imu"],
        "camera": camera,
    }
    experiment, drawn = recorder(2, own)
    for left in (experiment, without(experiment, "imu", "specific_force")):
        calibration_parameters, fit, _ = fitted(left)
        place = calibration_parameters.places["camera", "delay", "run"]
        assert fit.converged
        assert sigma(fit, place) < 0.002
        assert abs(fit.calibration.values[place] - drawn["run"]["camera"].delay) < 4 * sigma(
            fit, place
        )


@pytest.mark.slow
@pytest.mark.integration
def test_several_runs_share_what_is_constant_and_have_clocks_of_their_own(recorder):
    experiment, drawn = recorder(9, runs=("one", "two"))
    calibration_parameters, fit, _ = fitted(experiment)
    first = replace(experiment, runs=experiment.runs[:1])
    alone, single, _ = fitted(first)
    bias = "imu.gyro_bias x"
    both, one = (
        sigma(f, u.names.index(bias)) for f, u in ((fit, calibration_parameters), (single, alone))
    )
    assert both == pytest.approx(one / np.sqrt(2), rel=0.1)
    own = moving(calibration_parameters)
    assert sum("delay" in calibration_parameters.names[i] for i in own) == 2
    error = (fit.calibration.values - truth(calibration_parameters, experiment, drawn))[own]
    assert error @ np.linalg.solve(fit.covariance[np.ix_(own, own)], error) < chi2.isf(
        RARE, len(own)
    )


def test_inputs_stay_as_they_are(recorder):
    experiment, _ = recorder(2)
    calibration_parameters = gather(experiment)
    mean, deviation = calibration_parameters.mean.copy(), calibration_parameters.deviation.copy()
    before = {name: s.time.copy() for name, s in experiment.runs[0].streams.items()}
    fitted(experiment)
    np.testing.assert_array_equal(calibration_parameters.mean, mean)
    np.testing.assert_array_equal(calibration_parameters.deviation, deviation)
    for name, time in before.items():
        np.testing.assert_array_equal(experiment.runs[0].streams[name].time, time)
