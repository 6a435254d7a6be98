"""Least squares against truth: exact signals, another simulator, its own stated uncertainty, and
experiments that tell little."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2
from simulated import (
    BODY,
    CENTER,
    IDEAL,
    PAPER,
    REACH,
    RECORDER,
    TRUTH,
    at_rest,
    changed,
    moving,
    pair_studied,
    sound,
    studied,
    without,
)

from steelyard.experiment.read import read_experiment
from steelyard.identification.methods.least_squares import LeastSquares
from steelyard.identification.methods.two_step import TwoStep
from steelyard.identification.samples.force_noise import force_sigma, least_sigma
from steelyard.identification.solve.held_motion import fit_with_held_motion
from steelyard.identification.solve.long_recording import lively_parts
from steelyard.identification.solve.settings import FitSettings
from steelyard.inertia import BODY_PARAMETERS, Inertia

pytestmark = pytest.mark.integration

RARE = 1e-3  # of sound recordings whose chi-square of ten parameters is larger than LIMIT
LIMIT = chi2.isf(RARE, 10)
SEEDS = range(8)
MILLIMETRE = 1e-3
METHOD = LeastSquares()


def z(estimate, truth=TRUTH):
    return (estimate.value - truth) / estimate.standard_deviation


def chi_square(estimate, truth=TRUTH):
    error = estimate.value - truth
    return float(error @ np.linalg.solve(estimate.covariance, error))


def told(estimate):
    assert [np.isfinite(v) for v in estimate.value] == [
        label != "unidentifiable" for label in estimate.verdict.parameters.values()
    ]
    return {
        name for name, label in estimate.verdict.parameters.items() if label != "unidentifiable"
    }


def thinned(experiment, step):
    """Every so manieth sample of every stream."""

    def few(stream):
        return replace(
            stream,
            time=stream.time[::step],
            values={k: v[::step] for k, v in stream.values.items()},
        )

    runs = [
        replace(r, streams={name: few(s) for name, s in r.streams.items()}) for r in experiment.runs
    ]
    return replace(experiment, runs=tuple(runs))


# Exact signals


def test_exact_signals_give_the_body_back():
    estimate = METHOD(RECORDER(0, instruments={k: changed(v, rate=50.0) for k, v in IDEAL.items()}))
    # What splines of samples at 50 Hz leave of a motion of half a hertz, and of the ringing of
    # elastic cables.
    np.testing.assert_allclose(estimate.value[0], BODY.mass, rtol=2e-5)
    np.testing.assert_allclose(estimate.value[1:4], TRUTH[1:4], atol=0.01 * MILLIMETRE)
    np.testing.assert_allclose(estimate.value[4:], TRUTH[4:], atol=1e-4 * TRUTH[4:7].max())
    assert estimate.verdict.accepted
    assert estimate.physical


# Recordings of another simulator


@pytest.fixture(scope="module")
def of_the_paper(recordings, recorded_truth):
    """Name -> the estimates of least squares and of two steps, and the truth."""
    found = {}
    for name in ("points-00", "points-01", "points-02", "points-03"):
        experiment = read_experiment(recordings / name / "experiment.yaml")
        truth = recorded_truth[name].body_parameters
        found[name] = METHOD(experiment), TwoStep(combine="pooled")(experiment), truth
    return found


def test_recordings_of_another_simulator_are_met_within_their_uncertainty(of_the_paper):
    for estimate, _, truth in of_the_paper.values():
        assert estimate.verdict.accepted, estimate.verdict.reasons
        assert chi_square(estimate, truth) < LIMIT
        assert estimate.physical
    z_all = np.array([z(estimate, truth) for estimate, _, truth in of_the_paper.values()])
    # Forty numbers that partly go together.
    assert 0.6 < np.sqrt(np.mean(z_all**2)) < 1.35


def test_moments_of_inertia_are_better_than_those_of_two_steps(of_the_paper):
    own, other = (
        np.sqrt(np.mean([(each[i].value - each[2])[4:7] ** 2 for each in of_the_paper.values()]))
        for i in (0, 1)
    )
    assert own < 0.7 * other


def test_errors_that_were_drawn_are_found(recordings, of_the_paper):
    drawn = json.loads((recordings / "truth.json").read_text())
    for name, (estimate, _, _) in of_the_paper.items():
        for path, key in (
            (("cables", "offset"), "fb"),
            (("imu", "gyro_bias"), "gb"),
            (("imu", "accelerometer_bias"), "ab"),
        ):
            entry = estimate.calibration[path[0]][path[1]]
            off = (entry["value"] - np.array(drawn[name][key])) / entry["standard_deviation"]
            assert np.abs(off).max() < 4.5


@pytest.mark.slow
def test_ideal_sensors_of_another_simulator(recordings, recorded_truth):
    # Every eighth sample: 31 Hz are plenty for the motion, and quick. Two simulators differ by more
    # than no noise at all, and what nothing explains is not looked for.
    experiment = thinned(read_experiment(recordings / "ideal-points" / "experiment.yaml"), 8)
    posterior = fit_with_held_motion(experiment, settings=FitSettings(most_processes=0))
    estimate = METHOD.of(posterior)
    truth = recorded_truth["ideal-points"].body_parameters
    assert estimate.value[0] == pytest.approx(truth[0], rel=5e-4)
    assert np.abs(estimate.value - truth)[1:4].max() < 0.4 * MILLIMETRE
    assert np.abs(estimate.value - truth)[4:].max() < 4e-3 * truth[4:7].max()


# Stated uncertainty


@pytest.mark.slow
@pytest.mark.long
def test_errors_are_of_the_size_that_is_stated():
    errors = np.array([z(METHOD.of(studied(seed))) for seed in SEEDS])
    # Pooled rms of eight draws of ten parameters: 1 where the 1-sigma are true, with a sampling
    # error of about .1.
    assert 0.8 < np.sqrt(np.mean(errors**2)) < 1.25
    chi = [chi_square(METHOD.of(studied(seed))) for seed in SEEDS]
    assert chi2.ppf(RARE, 80) < sum(chi) < chi2.isf(RARE, 80)


@pytest.mark.slow
def test_sound_recordings_are_accepted_and_say_how_they_were_made():
    for seed in SEEDS:
        estimate = METHOD.of(studied(seed))
        assert estimate.verdict.accepted, estimate.verdict.reasons
        assert set(estimate.verdict.parameters.values()) == {"data"}
        assert estimate.details["noise_ratio"] == pytest.approx(1.0, abs=0.15)
        assert all(
            0.8 < r < 1.2
            for q in estimate.residuals["in_units_of_noise"].values()
            for r in q.values()
        )


@pytest.mark.parametrize(
    ("name", "quantity"),
    [("imu", "specific_force"), ("imu", "angular_velocity"), ("tracker", None)],
)
def test_gyro_accelerometer_or_tracker_may_be_missing(name, quantity):
    estimate = METHOD(without(sound(1), name, quantity))
    assert chi_square(estimate) < LIMIT
    # An attitude that is differentiated twice is so noisy that least squares may say so; nothing
    # else is wrong.
    assert all("noise in the motion biases" in reason for reason in estimate.verdict.reasons)
    assert quantity == "angular_velocity" or estimate.verdict.accepted
    if name == "tracker":
        assert any("commanded one" in note for note in estimate.notes)
    # What is missing is missed: most of the estimate is no surer than with it.
    ratio = estimate.standard_deviation / METHOD.of(studied(1)).standard_deviation
    assert np.sum(ratio > 0.95) >= 6


@pytest.mark.slow
def test_several_runs_tell_more_than_one():
    one, two = METHOD.of(studied(0)), METHOD.of(pair_studied())
    assert two.verdict.accepted, two.verdict.reasons
    assert chi_square(two) < LIMIT
    ratio = two.standard_deviation / one.standard_deviation
    # Noise goes with the root of the number of runs, but for the filter, which is chosen from the
    # data; offsets are the same in all.
    assert np.all(ratio < 0.95)
    assert np.all(ratio > 0.85 / np.sqrt(2))
    assert set(two.details["samples"]) == {"a", "b"}


# Gains, and what is known


ALL_GAINS = {**PAPER, "cables": changed(PAPER["cables"], calibration={"gain": 0.02})}


@pytest.fixture(scope="module")
def with_gains():
    """Gains that are off by two per cent each, with and without the mass known, and what was
    drawn."""
    found = []
    for seed in (0, 1):
        experiment = RECORDER(seed, instruments=ALL_GAINS)
        drawn = RECORDER.drawn["run"]["cables"].calibration["gain"]
        known = replace(experiment, known={"mass": (BODY.mass, 0.01)})
        found.append((METHOD(experiment), METHOD(known), drawn))
    return found


def test_a_known_mass_calibrates_the_gains(with_gains):
    off = []
    for free, known, drawn in with_gains:
        assert known.verdict.parameters["mass"] == "prior"
        assert known.verdict.parameters["cx"] == "data"
        assert known.value[0] == pytest.approx(BODY.mass, abs=0.04)
        assert known.standard_deviation[0] == pytest.approx(0.01, rel=0.1)
        gain, other = (e.calibration["cables"]["gain"] for e in (known, free))
        off.append((gain["value"] - drawn) / gain["standard_deviation"])
        assert np.all(gain["standard_deviation"] < 0.5 * 0.02)
        assert np.all(gain["standard_deviation"] <= other["standard_deviation"])
    # 16 numbers, of which those of a draw share the mass.
    assert 0.6 < np.sqrt(np.mean(np.square(off))) < 1.5
    assert np.abs(off).max() < 4


def test_gains_that_are_not_known_make_the_mass_uncertain(with_gains):
    for free, known, _ in with_gains:
        assert free.standard_deviation[0] > 2.5 * METHOD.of(studied(0)).standard_deviation[0]
        for estimate in (free, known):
            assert chi_square(estimate) < LIMIT
            assert estimate.verdict.accepted, estimate.verdict.reasons


def test_a_common_gain_leaves_the_mass_as_uncertain_as_itself():
    # The default of the contract: half a per cent in common, one per cent each.
    default = changed(PAPER["cables"], calibration={"gain": 0.01, "common_gain": 0.005})
    estimate = METHOD(RECORDER(1, instruments={**PAPER, "cables": default}))
    assert estimate.standard_deviation[0] > 0.005 * estimate.value[0]
    assert chi_square(estimate) < LIMIT


def test_everything_known_about_the_body_is_the_body():
    known = {
        name: (value, 1e-3 * abs(value)) for name, value in zip(BODY_PARAMETERS, TRUTH, strict=True)
    }
    estimate = METHOD(replace(sound(0), known=known))
    assert np.all(np.abs(estimate.value - TRUTH) < 5e-3 * np.abs(TRUTH))
    assert np.all(estimate.standard_deviation < 1.05e-3 * np.abs(TRUTH))
    assert set(estimate.verdict.parameters.values()) == {"prior"}


# Experiments that tell little


def test_translation_tells_nothing_of_the_inertia():
    estimate = METHOD(moving([1, 1, 1, 0, 0, 0])(0))
    assert told(estimate) == {"mass", "cx", "cy", "cz"}
    assert np.abs(z(estimate)[:4]).max() < 4
    assert any(
        "not identifiable from these data: Jxx, Jyy, Jzz, Jyz, Jxz, Jxy" in note
        for note in estimate.notes
    )
    assert estimate.physical is None


@pytest.mark.parametrize(
    ("axis", "coupled"),
    [(3, {"Jxx", "Jxz", "Jxy"}), (4, {"Jyy", "Jyz", "Jxy"}), (5, {"Jzz", "Jyz", "Jxz"})],
)
def test_turning_about_one_axis_tells_its_moment_and_the_products_with_it(axis, coupled):
    estimate = METHOD(moving(np.concatenate([[1, 1, 1], np.eye(6)[axis, 3:] * 1.2]))(0))
    assert told(estimate) == {"mass", "cx", "cy", "cz"} | coupled
    use = np.isfinite(estimate.value)
    assert np.abs(z(estimate)[use]).max() < 4
    assert estimate.verdict.accepted, estimate.verdict.reasons


def test_one_attitude_at_rest_tells_mass_and_horizontal_centre_of_gravity():
    for seed in range(3):
        # Noise of the attitude must not be taken for different poses.
        run = at_rest(np.tile(CENTER, (6, 1)), seed=seed)
        estimate = METHOD(replace(sound(0), runs=(run,)))
        assert told(estimate) == {"mass", "cx", "cy"}
        assert np.abs(z(estimate)[:3]).max() < 4


def various(count, seed=0):
    return CENTER + np.random.default_rng(seed).uniform(-1, 1, (count, 6)) * REACH


def test_attitudes_at_rest_tell_mass_and_centre_of_gravity():
    errors = []
    for seed in range(4):
        estimate = METHOD(replace(sound(0), runs=(at_rest(various(12, seed), seed=seed),)))
        assert told(estimate) == {"mass", "cx", "cy", "cz"}
        assert any("poses at rest say nothing about the inertia" in note for note in estimate.notes)
        errors.append(z(estimate)[:4])
    assert np.sqrt(np.mean(np.square(errors))) < 1.5


@pytest.mark.slow
def test_poses_at_rest_help_a_motion():
    recorder = moving([1, 1, 1, 0, 0, 1.2])
    motion = recorder(3)
    both = replace(motion, runs=(*motion.runs, at_rest(various(20), recorder.drawn["run"], seed=1)))
    alone, helped = METHOD(motion), METHOD(both)
    assert helped.verdict.accepted, helped.verdict.reasons
    assert told(helped) >= told(alone)
    use = np.isfinite(helped.value)
    assert np.abs(z(helped)[use]).max() < 4
    # Poses that differ in roll and pitch tell what a level motion tells worst.
    assert helped.standard_deviation[3] < 0.97 * alone.standard_deviation[3]


def test_a_slow_motion_says_how_little_it_tells():
    fast, slow = METHOD.of(studied(0)), METHOD(moving([1] * 6, scale=0.1)(0))
    use = np.isfinite(slow.value)
    assert np.abs(z(slow)[use]).max() < 4
    assert np.all(slow.standard_deviation[use][4:] > 3 * fast.standard_deviation[use][4:])


# A wrench sensor


@pytest.fixture(scope="module")
def kuka(examples):
    return read_experiment(examples / "kuka-tool" / "experiment.yaml")


def only(experiment, *names):
    return replace(experiment, runs=tuple(run for run in experiment.runs if run.name in names))


def test_a_tool_on_a_wrench_sensor_by_its_poses(kuka):
    estimate = METHOD(only(kuka, "poses"))
    # Nobody weighed the tool; the author of the data fitted these to the same poses.
    assert abs(estimate.value[0] - 0.932) < 0.004
    assert np.abs(estimate.value[1:4] - [0.0003, 0, 0.0439]).max() < 0.5 * MILLIMETRE
    assert told(estimate) == {"mass", "cx", "cy", "cz"}
    offset = estimate.calibration["wrench"]["offset"]["force"]["value"]
    np.testing.assert_allclose(offset, [9.077, -1.018, 9.985], atol=0.1)


@pytest.mark.slow
def test_a_tool_that_turns_about_one_axis_beside_its_poses(kuka):
    estimate = METHOD(only(kuka, "poses", "baseline"))
    assert abs(estimate.value[0] - 0.932) < 0.005
    assert np.abs(estimate.value[1:4] - [0.0003, 0, 0.0439]).max() < MILLIMETRE
    assert not told(estimate) & {"Jxx", "Jzz", "Jxz"}
    # A tool of its mass within a few centimetres has less than .001.
    deviation = estimate.standard_deviation[5]
    assert deviation < 0.005
    assert -3 * deviation < estimate.value[5] < 0.001 + 3 * deviation


# Long recordings


@pytest.mark.slow
@pytest.mark.long
def test_a_long_recording_window_by_window_is_nearly_as_good_as_at_once():
    recorder = moving([1] * 6, duration=36.0, harmonics=18)
    experiment = recorder(6)
    once = fit_with_held_motion(experiment)
    settings = FitSettings(long=20.0, part=12.0, window=9.0)
    part = fit_with_held_motion(lively_parts(experiment, settings.part, settings))
    long = fit_with_held_motion(experiment, settings=settings)
    assert len(long.fit.state.segments) == 4
    lively, whole, single = METHOD.of(part), METHOD.of(long), METHOD.of(once)
    assert len(long.samples[0]) == len(long.weights["run"])
    assert len(long.samples[0]) > 2 * len(part.samples[0])
    ratio = whole.standard_deviation / single.standard_deviation
    assert np.all((ratio > 0.95) & (ratio < 1.2)), ratio
    assert np.all(np.abs(whole.value - single.value) < single.standard_deviation)
    assert np.all(whole.standard_deviation < lively.standard_deviation)
    own, other = (e.calibration["cables"]["offset"] for e in (whole, single))
    np.testing.assert_allclose(own["standard_deviation"], other["standard_deviation"], rtol=0.1)
    assert np.all(np.abs(own["value"] - other["value"]) < other["standard_deviation"])
    assert chi_square(whole) < LIMIT
    assert whole.verdict.accepted, whole.verdict.reasons


# What cannot be


def test_without_an_attitude_the_cables_tell_it():
    # A command would stand in for it.
    experiment = without(without(sound(0), "imu", "orientation"), "command")
    estimate = METHOD(experiment)
    assert estimate.verdict.accepted
    error = estimate.value - TRUTH
    assert error @ np.linalg.solve(estimate.covariance, error) < LIMIT


def test_forces_of_zero_tell_no_mass():
    run = sound(0).runs[0]
    stream = run.streams["cables"]
    dead = replace(stream, values={"tension": np.zeros_like(stream.values["tension"])})
    estimate = METHOD(
        replace(sound(0), runs=(replace(run, streams={**run.streams, "cables": dead}),))
    )
    assert not estimate.verdict.accepted
    assert estimate.verdict.reasons


def test_another_body_than_the_nominal_one_is_found():
    body = Inertia(
        60.0, [0.05, -0.1, 0.3], [[20.0, 1.0, -2.0], [1.0, 25.0, 0.5], [-2.0, 0.5, 12.0]]
    )
    recorder = moving([1] * 6)
    recorder.body = body
    estimate = METHOD(recorder(0))
    assert chi_square(estimate, body.body_parameters) < LIMIT
    assert estimate.verdict.accepted, estimate.verdict.reasons


def test_stated_noise_is_used_as_stated_however_small_and_unstated_noise_has_a_floor():
    quiet = changed(PAPER["cables"], noise=0.01)
    experiment = replace(sound(0), instruments={**PAPER, "cables": quiet})
    run, samples = experiment.runs[0], studied(0).samples[0]
    sigma, stated = force_sigma(experiment, run, samples)
    assert stated
    np.testing.assert_array_equal(sigma, np.full(8, 0.01))
    silent = type(quiet).model_validate(
        {k: v for k, v in quiet.model_dump(exclude_unset=True).items() if k != "noise"}
    )
    experiment = replace(experiment, instruments={**PAPER, "cables": silent})
    sigma, stated = force_sigma(experiment, run, replace(samples, noise={"tension": 1e-9}))
    assert not stated
    np.testing.assert_array_equal(sigma, least_sigma(experiment, run))
