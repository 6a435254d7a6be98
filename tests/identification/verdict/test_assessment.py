"""Verdicts: sound recordings pass, wrong descriptions and disturbed recordings do not, and the
reason says what to do."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2, norm
from simulated import (
    BODY,
    PAPER,
    RECORDER,
    ROBOT,
    TRUTH,
    Recorder,
    at_rest,
    changed,
    moving,
    sound,
    studied,
    with_stream,
)

from steelyard.identification.methods.from_posterior.unstated import found_errors
from steelyard.identification.methods.least_squares import LeastSquares
from steelyard.identification.solve.held_motion import fit_with_held_motion
from steelyard.identification.solve.joint_motion import fit_jointly
from steelyard.identification.solve.settings import FitSettings
from steelyard.identification.verdict.assessment import reasons
from steelyard.identification.verdict.directed_tests import Finding, directed_tests, of_description
from steelyard.identification.verdict.information_shares import label_mask, priors_share
from steelyard.identification.verdict.settings import VERDICT
from steelyard.inertia import Inertia
from steelyard.instruments.base import TIME_CONSTANT
from steelyard.simulation.trajectories import feasible_multisine

pytestmark = pytest.mark.integration

SEEDS = range(8)
METHOD = LeastSquares()
BRIEF = Recorder(feasible_multisine(ROBOT, 8.0))  # what does not settle takes its time


def verdict(experiment):
    estimate = METHOD(experiment)
    return estimate.verdict, " | ".join(estimate.verdict.reasons)


def by_name(found):
    return {test.name: test for test in directed_tests(found)}


# Sound recordings


@pytest.fixture(scope="module")
def scores():
    """Score of every directed test of every sound recording, shape (seeds, tests)."""
    return np.array(
        [
            [test.z for test in sorted(directed_tests(studied(s)), key=lambda t: t.name)]
            for s in SEEDS
        ]
    )


def test_scores_of_sound_recordings_are_standard_normal(scores):
    # Tests of one recording go together: 8 x 90 numbers are worth some hundred, which tell the
    # spread to a tenth.
    assert abs(scores.mean()) < 0.2
    assert 0.8 < scores.std() < 1.2
    assert np.abs(scores).max() < norm.isf(VERDICT.family / scores.shape[1] / 2)


def test_every_number_of_the_description_that_acts_is_asked_about():
    names = set(by_name(studied(0)))
    for i in range(8):
        for axis in "xyz":
            assert {f"anchor {i + 1} {axis}", f"attachment {i + 1} {axis}"} <= names
        assert f"cables.gain of cable {i + 1}" in names
    assert any(name.startswith(f"cables.{TIME_CONSTANT}") for name in names)
    # Offsets were estimated, and say whether they are where they were expected.
    assert any(name.startswith("cables.offset") for name in names)


def test_sound_recordings_have_no_reasons_against_them():
    for seed in SEEDS:
        assert reasons(studied(seed)) == []


@pytest.mark.slow
def test_sound_recordings_of_several_runs_and_poses_have_none_either():
    experiment = RECORDER(7, runs=("a", "b"))
    poses = RECORDER.command.trajectory.derivative(np.linspace(3, 9, 10), 0)
    both = replace(experiment, runs=(*experiment.runs, at_rest(poses, RECORDER.drawn["a"])))
    found = METHOD(both)
    assert found.verdict.accepted, found.verdict.reasons


# Errors of the description, one at a time, as the directed tests see them


def moved(experiment, key, cable, axis, size):
    points = np.array(getattr(experiment.robot, key))
    points[cable, axis] += size
    return replace(experiment, robot=replace(experiment.robot, **{key: points}))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("key", "cable", "axis"), [("attachments", 2, 0), ("attachments", 6, 2), ("anchors", 4, 2)]
)
def test_a_cable_that_is_fixed_elsewhere_is_found_with_its_size(key, cable, axis):
    size = 0.03 if key == "attachments" else 0.06
    found = fit_with_held_motion(moved(sound(1), key, cable, axis, size))
    test = by_name(found)[f"{key.removesuffix('s')} {cable + 1} {'xyz'[axis]}"]
    # The score says by how much the stated value is to be corrected: back to where it was.
    assert test.size == pytest.approx(-size, abs=4 * test.sigma)
    assert test.z < -3
    assert test.unit == "m"
    assert "measure this" in test.proposal


@pytest.mark.slow
@pytest.mark.parametrize("late", [0.01, -0.01])
def test_forces_that_are_late_by_themselves_are_found_with_their_size(late):
    experiment = sound(2)
    run = experiment.runs[0]
    stream = run.streams["cables"]
    shifted = replace(
        run, streams={**run.streams, "cables": replace(stream, time=stream.time + late)}
    )
    # Late ones would be estimated as if an amplifier filtered them.
    settings = FitSettings(suspicions=0)
    found = fit_with_held_motion(replace(experiment, runs=(shifted,)), settings=settings)
    test = next(t for t in directed_tests(found) if f".{TIME_CONSTANT}" in t.name)
    # Some of it looks like errors that were estimated.
    assert test.size == pytest.approx(late, abs=max(4 * test.sigma, 0.2 * abs(late)))
    assert abs(test.z) > 5
    assert "'sync' and 'clock'" in test.proposal


@pytest.mark.slow
def test_a_gain_that_was_stated_exactly_and_is_not_is_found():
    experiment = with_stream(
        sound(3),
        "cables",
        lambda v: {"tension": v["tension"] * np.where(np.arange(8) == 4, 1.05, 1)},
    )
    test = by_name(fit_with_held_motion(experiment))["cables.gain of cable 5"]
    assert test.size == pytest.approx(0.05, abs=4 * test.sigma)
    assert test.z > 5
    assert "gain and unit" in test.proposal


@pytest.mark.slow
def test_an_error_far_outside_its_prior_is_found():
    strict = {**PAPER, "imu": changed(PAPER["imu"], calibration={"accelerometer_bias": 0.01})}
    off = with_stream(
        sound(0), "imu", lambda v: {"specific_force": v["specific_force"] + [0.3, 0, 0]}
    )
    found = by_name(fit_with_held_motion(replace(off, instruments=strict)))
    test = found["imu.accelerometer_bias x"]
    assert test.z > 5
    assert "imu" in str(test)


# Wrong descriptions and disturbed recordings, as a whole


def swapped(experiment, i, j):
    order = np.arange(8)
    order[[i, j]] = j, i
    return with_stream(experiment, "cables", lambda v: {"tension": v["tension"][:, order]})


def scaled(experiment, factor):
    return with_stream(experiment, "cables", lambda v: {"tension": v["tension"] * factor})


def late(experiment, seconds):
    runs = []
    for run in experiment.runs:
        stream = run.streams["cables"]
        runs.append(
            replace(
                run, streams={**run.streams, "cables": replace(stream, time=stream.time + seconds)}
            )
        )
    return replace(experiment, runs=tuple(runs))


def turned(experiment, signs):
    return with_stream(
        experiment, "imu", lambda v: {"angular_velocity": v["angular_velocity"] * np.array(signs)}
    )


# Name -> what is done to a sound recording, and what the reasons must say.
WRONG = {
    "gravity upside down": (
        lambda e: replace(e, robot=replace(e.robot, gravity=-e.robot.gravity)),
        r"feels gravity upside down; check the sign of 'gravity'",
    ),
    "two cables swapped": (lambda e: swapped(e, 1, 6), r"columns of cables 2 and 7 exchanged.*check the order of the force sensors"),
    "neighbours swapped": (lambda e: swapped(e, 4, 5), r"columns of cables 5 and 6 exchanged"),
    "an attachment wrong by 5 cm": (lambda e: moved(e, "attachments", 3, 0, 0.05), r"attachment \d [xyz] seems to be off.*measure this attachment"),
    "forces in daN": (lambda e: scaled(e, 0.1), r"check the unit of the forces"),
    "one force in kgf": (
        lambda e: with_stream(e, "cables", lambda v: {"tension": v["tension"] * np.where(np.arange(8) == 2, 1 / 9.80665, 1)}),
        r"the unit of the force sensors|gain and unit",
    ),
    "gyro with the wrong sign": (lambda e: turned(e, [1, -1, 1]), r"of imu departs from the motion.*check its axes, signs"),
    "accelerometer in g": (
        lambda e: with_stream(e, "imu", lambda v: {"specific_force": v["specific_force"] / 9.80665}),
        r"the accelerometer seems to read in g; state 'units",
    ),
    "gravity taken out": (
        lambda e: with_stream(e, "imu", lambda v: {"specific_force": v["specific_force"] + v["orientation"].transpose(0, 2, 1) @ ROBOT.gravity}),
        r"gravity taken out; state 'gravity: removed'",
    ),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_is_rejected_and_the_reason_says_what_to_do(name):
    change, said = WRONG[name]
    found, text = verdict(change(BRIEF(5)))
    assert not found.accepted
    assert re.search(said, text), text
    assert ("exchanged" in text) == ("swapped" in name)


@pytest.mark.slow
def test_late_forces_are_taken_for_filtered_ones_and_estimates_stay_true():
    posterior = fit_with_held_motion(late(sound(4), 0.02))
    error = found_errors(posterior)[f"cables.{TIME_CONSTANT}"]
    assert error["value"] == pytest.approx(0.02, abs=4 * error["standard_deviation"])
    found = METHOD.of(posterior)
    assert found.verdict.accepted, found.verdict.reasons
    off = found.value - TRUTH
    assert off @ np.linalg.solve(found.covariance, off) < chi2.isf(1e-3, 10)


@pytest.mark.slow
def test_early_forces_are_no_filter_and_said_to_be_early():
    found, text = verdict(late(sound(4), -0.02))
    assert not found.accepted
    assert f"cables.{TIME_CONSTANT}" in text, text


@pytest.mark.slow
def test_a_hand_on_the_platform_is_noticed():
    found, text = verdict(RECORDER(5, touched=True))
    assert not found.accepted
    assert "whether anything touched the platform" in text


@pytest.mark.slow
def test_a_noise_far_smaller_than_stated_is_noticed():
    found, text = verdict(with_stated_noise(sound(0), 50.0))
    assert not found.accepted
    assert "better than the stated noise allows" in text


def test_a_noise_far_larger_than_stated_is_noticed():
    found, text = verdict(with_stated_noise(sound(0), 1.0))
    assert not found.accepted
    assert "forces and motion do not balance" in text


def with_stated_noise(experiment, noise):
    cables = experiment.instruments["cables"].model_copy(update={"noise": noise})
    return replace(experiment, instruments={**experiment.instruments, "cables": cables})


@pytest.mark.parametrize("nominal", [True, False])
def test_forces_in_decanewtons_with_no_noise_stated_need_a_nominal_body(nominal):
    experiment = with_stated_noise(scaled(sound(0), 0.1), None)
    if not nominal:
        experiment = replace(experiment, robot=replace(experiment.robot, platform=None))
    found, text = verdict(experiment)
    assert ("times the nominal one" in text) == nominal
    if nominal:
        assert not found.accepted
        assert "check the unit of the forces" in text


@pytest.mark.slow
def test_runs_with_another_payload_contradict_each_other():
    heavy = recorder_of(
        Inertia(BODY.mass + 15.0, BODY.center_of_gravity + 0.05 * np.eye(3)[2], BODY.inertia * 1.1)
    )
    light = recorder_of(BODY)
    one, other = light(0), heavy(0)
    both = replace(one, runs=(one.runs[0], replace(other.runs[0], name="again")))
    found, text = verdict(both)
    assert not found.accepted
    assert re.search(
        "the runs contradict each other|do not balance|stretches of the recording contradict", text
    ), text


def recorder_of(body):
    recorder = moving([1] * 6)
    recorder.body = body
    return recorder


def test_too_short_a_recording_is_not_accepted():
    run = replace(sound(0).runs[0], window=(5.0, 5.9))
    estimate = METHOD(replace(sound(0), runs=(run,)))
    assert not estimate.verdict.accepted or np.isnan(estimate.value[4:]).any()
    use = np.isfinite(estimate.value)
    assert (
        np.abs((estimate.value - TRUTH)[use] / estimate.standard_deviation[use]).max(initial=0.0)
        < 5
    )


# Shares


def test_the_share_of_priors_is_that_of_what_does_not_average_out():
    share = priors_share(studied(0))
    assert np.all((share >= 0) & (share <= 1))
    # Eight offsets of 5 N each stand against noise that averages out: most of the mass's variance
    # is theirs.
    assert share[0] > 0.3
    assert not label_mask(studied(0)).any()


def test_what_was_known_is_labelled_where_it_told_more_than_the_data():
    loose = fit_with_held_motion(replace(sound(0), known={"mass": (BODY.mass, 100.0)}))
    assert not label_mask(loose).any()
    tight = fit_with_held_motion(replace(sound(0), known={"mass": (BODY.mass, 0.01)}))
    assert list(np.flatnonzero(label_mask(tight))) == [0]


def test_an_error_that_no_device_has_is_a_reason_even_where_the_estimate_does_not_move():
    """A tracker whose clock was set had the accelerometer's scale at -.2: the fit had taken it up."""
    harmless = Finding("imu.accelerometer_scale x", -6.0, -0.12, 0.013, "1", 0.3, "look at it")
    assert not list(of_description([harmless], 3, VERDICT))
    (said,) = of_description([replace(harmless, implausible=True)], 3, VERDICT)
    assert said.startswith("imu.accelerometer_scale x seems to be off by -0.12")


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.02, 0.3])
def test_only_what_nobody_has_stated_can_be_implausible(share):
    experiment = sound(0)
    run, imu = experiment.runs[0], experiment.instruments["imu"]
    stream = run.streams["imu"]
    felt = stream.values["specific_force"] * np.array([1 - share, 1.0, 1.0])
    read = replace(stream, values={**stream.values, "specific_force": felt})
    scaled = replace(experiment, runs=(replace(run, streams={**run.streams, "imu": read}),))
    test = by_name(fit_jointly(scaled))["imu.accelerometer_scale x"]
    assert test.implausible == (share > 0.1)
    stated = changed(imu, calibration={"accelerometer_scale": 0.3})
    told = replace(scaled, instruments={**experiment.instruments, "imu": stated})
    assert not by_name(fit_jointly(told))["imu.accelerometer_scale x"].implausible
