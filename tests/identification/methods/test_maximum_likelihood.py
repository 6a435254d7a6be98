"""Everything at once: simulated experiments of known truth, other sets of instruments, recordings
of another simulator, mistakes."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from scipy.stats import chi2
from simulated import IDEAL, PAPER, RECORDER, ROBOT, TRUTH, changed, pair, sound

from steelyard.experiment.read import read_experiment
from steelyard.experiment.recording import Stream
from steelyard.identification.identify import identify
from steelyard.identification.methods.maximum_likelihood import MaximumLikelihood
from steelyard.identification.methods.two_step import TwoStep
from steelyard.identification.model.settings import MOTION
from steelyard.identification.solve.beginning.motion_task import read_by
from steelyard.identification.solve.beginning.readings import read
from steelyard.identification.solve.bound import cramer_rao
from steelyard.identification.solve.joint_motion import fit_jointly
from steelyard.instruments import Attitude, Length, Pose

pytestmark = pytest.mark.integration

LIMIT = chi2.isf(1e-3, 10)
SEEDS = range(6)
METHOD = MaximumLikelihood()


def surprise(estimate, truth=TRUTH):
    """Chi-square of what is told, on its covariance."""
    error = estimate.value - truth
    told = np.isfinite(error)
    return error[told] @ np.linalg.solve(estimate.covariance[np.ix_(told, told)], error[told])


def with_values(experiment, instrument, change):
    """The experiment with other readings of an instrument; ``change`` takes times and values."""
    runs = []
    for run in experiment.runs:
        stream = run.streams[instrument]
        time, values = change(stream.time, dict(stream.values))
        runs.append(
            replace(run, streams={**run.streams, instrument: Stream(time, values, stream.source)})
        )
    return replace(experiment, runs=tuple(runs))


def keeping(experiment, *names):
    """The experiment with some of its instruments."""
    runs = tuple(
        replace(r, streams={n: s for n, s in r.streams.items() if n in names})
        for r in experiment.runs
    )
    return replace(experiment, runs=runs)


@pytest.fixture(scope="module")
def estimates():
    return {seed: METHOD(sound(seed)) for seed in SEEDS}


@pytest.fixture(scope="module")
def joint():
    return fit_jointly(sound(0))


def test_sound_recordings_are_accepted_and_settle(estimates):
    for estimate in estimates.values():
        assert estimate.verdict.accepted, estimate.verdict.reasons
        assert estimate.details["solver"]["converged"]
        assert set(estimate.verdict.parameters.values()) == {"data"}


def test_errors_are_within_their_covariance(estimates):
    total = sum(surprise(estimate) for estimate in estimates.values())
    low, high = chi2.ppf([5e-4, 1 - 5e-4], 10 * len(SEEDS))
    assert low < total < high


def test_it_is_better_than_the_two_steps(estimates):
    two_step = np.array([TwoStep()(sound(seed)).value for seed in SEEDS]) - TRUTH
    ours = np.array([estimate.value for estimate in estimates.values()]) - TRUTH
    for own in (slice(1, 4), slice(4, 7)):
        assert np.sqrt(np.mean(ours[:, own] ** 2)) < 0.6 * np.sqrt(np.mean(two_step[:, own] ** 2))


@pytest.mark.slow
@pytest.mark.long
def test_calibration_is_within_its_uncertainty():
    z = []
    for seed in SEEDS:
        experiment = RECORDER(seed)
        drawn = RECORDER.drawn["run"]
        found = METHOD(experiment).calibration
        for name, keys in (
            ("cables", ["offset"]),
            ("imu", ["gyro_bias", "accelerometer_bias", "misalignment"]),
        ):
            for key in keys:
                pair_ = found[name][key]
                z.append(
                    (pair_["value"] - drawn[name].calibration[key]) / pair_["standard_deviation"]
                )
        delay = found["tracker"]["delay"]["run"]
        z.append(
            np.atleast_1d((delay["value"] - drawn["tracker"].delay) / delay["standard_deviation"])
        )
    z = np.concatenate(z)
    low, high = chi2.ppf([5e-4, 1 - 5e-4], len(z))
    assert low < z @ z < high


def test_its_bound_is_that_of_cramer_and_rao_over_the_same_rows(joint):
    state = joint.fit.state
    bound = cramer_rao(
        joint.experiment,
        state.calibration,
        {"run": state.segments},
        {"run": joint.force_samples},
        state.parameters,
    )
    # One by a Schur complement of all, one of the active errors: rounding of a condition of many
    # orders.
    scale = np.outer(joint.bound.standard_deviation, joint.bound.standard_deviation)
    np.testing.assert_allclose(bound.covariance / scale, joint.bound.covariance / scale, atol=1e-4)


def test_its_information_is_about_that_of_the_classical_side(joint):
    from simulated import studied

    np.testing.assert_allclose(
        joint.bound.standard_deviation, studied(0).bound.standard_deviation, rtol=0.1
    )


def test_the_fitted_motion_is_within_its_sigma(joint):
    (motion,) = joint.motion
    inside = motion.time[(motion.time > 0) & (motion.time < RECORDER.response.duration)]
    use = np.isin(motion.time, inside)
    state = RECORDER.response.at(inside)
    for name, true in (
        ("position", state.position),
        ("angular_velocity", state.omega),
        ("angular_acceleration", state.alpha),
    ):
        z = (motion.values[name][use] - true) / motion.sigma[name][use]
        # Errors are one and the same for long: constants, and the spacing of the knots.
        assert np.sqrt(np.mean(z**2)) < 2
        assert np.sqrt(np.mean(z**2)) > 0.3


def test_noise_that_is_not_stated_is_found():
    bare = {
        "cables": changed(PAPER["cables"], noise=None),
        "imu": changed(PAPER["imu"], noise={}),
        "tracker": changed(PAPER["tracker"], noise=None),
        "command": PAPER["command"],
    }
    estimate = METHOD(RECORDER(3, stated=bare))
    assert surprise(estimate) < LIMIT
    found = estimate.details["noise"]
    stated = PAPER["imu"].noise
    for name, quantity, sigma in (
        ("cables", "tension", PAPER["cables"].noise),
        ("imu", "angular_velocity", stated.angular_velocity),
        ("imu", "specific_force", stated.specific_force),
        ("imu", "orientation", stated.orientation),
        ("tracker", "position", PAPER["tracker"].noise),
    ):
        each = found[name][quantity]
        assert each["stated"] is None
        # Three 1-sigma of a level from so many numbers, and some for the freedom of the motion.
        assert each["used"] == pytest.approx(sigma, rel=3 / np.sqrt(2 * each["numbers"]) + 0.03)


def test_a_noise_larger_than_stated_counts_as_it_is():
    timid = {**PAPER, "tracker": changed(PAPER["tracker"], noise=PAPER["tracker"].noise / 3)}
    estimate = METHOD(RECORDER(4, stated=timid))
    assert estimate.details["noise"]["tracker"]["position"]["used"] == pytest.approx(
        PAPER["tracker"].noise, rel=0.1
    )
    assert surprise(estimate) < LIMIT


@pytest.mark.slow
def test_an_accelerometer_in_another_unit_is_named():
    wrong = with_values(
        sound(1), "imu", lambda t, v: (t, {**v, "specific_force": v["specific_force"] / 9.80665})
    )
    verdict = METHOD(wrong).verdict
    assert not verdict.accepted
    assert any(
        "specific force of imu" in reason or "read in g" in reason for reason in verdict.reasons
    )


def spiked(time, values, share=0.01, seed=1):
    rng = np.random.default_rng(seed)
    tension = values["tension"].copy()
    hit = rng.random(len(time)) < share
    cable = rng.integers(0, tension.shape[1], len(time))
    size = rng.uniform(150, 600, len(time)) * rng.choice([-1, 1], len(time))
    tension[hit, cable[hit]] += size[hit]
    return time, {**values, "tension": tension}


def hole(time, values):
    keep = (time - time[0] < 4.0) | (time - time[0] > 5.7)
    return time[keep], {quantity: each[keep] for quantity, each in values.items()}


def test_spikes_and_a_hole_do_little_harm(estimates):
    rough = with_values(
        with_values(sound(1), "cables", lambda t, v: spiked(t, v, 0.02)), "tracker", hole
    )
    estimate, clean = METHOD(rough), estimates[1]
    assert estimate.verdict.accepted, estimate.verdict.reasons
    assert np.all(np.abs(estimate.value - clean.value) < clean.standard_deviation)
    np.testing.assert_array_less(estimate.standard_deviation, 1.25 * clean.standard_deviation)
    assert estimate.details["left_out"]["single_readings"]["run"] > 0
    assert any("tracker has no position from" in note for note in estimate.notes)


def test_a_stuck_cable_is_left_out(estimates):
    def stuck(time, values):
        tension = values["tension"].copy()
        tension[100:140, 3] = tension[99, 3]
        return time, {**values, "tension": tension}

    estimate = METHOD(with_values(sound(1), "cables", stuck))
    assert estimate.verdict.accepted
    assert any("tension 4 of cables is stuck" in note for note in estimate.notes)
    assert np.all(np.abs(estimate.value - estimates[1].value) < estimates[1].standard_deviation)


def test_a_tracker_that_holds_its_last_value_is_left_out(estimates):
    def held(time, values):
        position = values["position"].copy()
        position[300:420] = position[299]
        return time, {**values, "position": position}

    estimate = METHOD(with_values(sound(1), "tracker", held))
    assert any("position of tracker has lost the motion" in note for note in estimate.notes)
    assert np.all(
        np.abs(estimate.value - estimates[1].value) < 1.5 * estimates[1].standard_deviation
    )


def test_a_hand_on_the_platform_is_found_with_its_times():
    estimate = METHOD(RECORDER(2, touched=True))
    (contacts,) = estimate.details["left_out"]["contacts"].values()
    start, end = min(c[0] for c in contacts), max(c[1] for c in contacts)
    assert start == pytest.approx(5.0, abs=0.4)
    assert end == pytest.approx(7.0, abs=0.4)
    assert surprise(estimate) < LIMIT


SETS = {
    "a pose alone": (("cables", "pose"), {}),
    "attitude and tracker": (("cables", "attitude", "tracker"), {}),
    "imu and command": (("cables", "imu", "command"), {}),
    "imu and lengths": (("cables", "imu", "lengths"), {}),
    "tracker and command": (("cables", "tracker", "command"), {}),
    "lengths alone": (("cables", "lengths"), {}),
    "lengths and tracker": (("cables", "lengths", "tracker"), {}),
}
MORE = {
    **PAPER,
    "pose": Pose.model_validate(
        {
            "kind": "pose",
            "rate": 60,
            "position": (0.1, 0.0, 0.5),
            "noise": {"position": 0.0005, "rotation": 0.002},
        }
    ),
    "attitude": Attitude.model_validate({"kind": "attitude", "rate": 60, "noise": 0.002}),
    "lengths": Length.model_validate(
        {"kind": "length", "rate": 50, "noise": 0.0005, "calibration": {"offset": 0.3}}
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("names", [names for names, _ in SETS.values()], ids=SETS)
def test_other_sets_of_instruments_are_honest(names):
    estimate = METHOD(keeping(RECORDER(5, instruments=MORE), *names))
    assert np.isfinite(estimate.value).sum() >= 7
    assert surprise(estimate) < LIMIT
    assert estimate.verdict.accepted, estimate.verdict.reasons


def test_encoders_that_stand_still_tell_neither_their_noise_nor_their_time():
    standing = with_values(
        keeping(RECORDER(5, instruments=MORE), "cables", "imu", "tracker", "lengths"),
        "lengths",
        lambda time, values: (time, {"length": np.tile(values["length"][:1], (len(time), 1))}),
    )
    lengths = changed(standing.instruments["lengths"], noise=None)
    standing = replace(standing, instruments={**standing.instruments, "lengths": lengths})
    readings = read(standing, None, lambda *_: None)
    (own,) = (r for r in readings.segments[0].readings if r.source == ("lengths", "length"))
    # Else it would be that of rounding, and everything else would have to give way.
    assert own.sigma == pytest.approx(MOTION.place_at_rest)
    parameters = readings.calibration.calibration_parameters
    moving = read_by(standing, parameters, readings.segments)
    run = standing.runs[0].name
    assert not moving[parameters.place("lengths", "delay", run)].any()
    assert moving[parameters.place("tracker", "delay", run)].all()


@pytest.mark.slow
def test_several_runs_share_the_body():
    both = METHOD(pair())
    alone = METHOD(replace(pair(), runs=pair().runs[:1]))
    assert surprise(both) < LIMIT
    assert both.verdict.accepted
    assert np.all(both.standard_deviation < alone.standard_deviation)


def test_a_mass_that_is_known_is_used(estimates):
    known = replace(sound(0), known={"mass": (float(TRUTH[0]), 0.01)})
    estimate = METHOD(known)
    assert estimate.standard_deviation[0] == pytest.approx(0.01, rel=0.05)
    assert estimate.verdict.parameters["mass"] == "prior"
    assert estimate.standard_deviation[3] <= estimates[0].standard_deviation[3]


@pytest.mark.parametrize(
    "mistake",
    [
        lambda e: replace(
            e,
            runs=tuple(
                replace(r, sync={**r.sync, "tracker": r.sync["tracker"] + 0.3}) for r in e.runs
            ),
        ),
        lambda e: replace(
            e,
            instruments={
                **e.instruments,
                "imu": changed(e.instruments["imu"], rpy_deg=(20.0, 0.0, 0.0)),
            },
        ),
    ],
    ids=["tracker late by .3 s", "imu turned by 20 degrees"],
)
def test_a_description_that_is_far_off_ends_well_or_is_rejected(mistake):
    estimate = METHOD(mistake(sound(0)))
    assert not estimate.verdict.accepted or surprise(estimate) < LIMIT


def test_a_mass_that_is_said_wrong_by_three_changes_nothing(estimates):
    heavy = replace(ROBOT.platform, mass=3 * ROBOT.platform.mass)
    estimate = METHOD(replace(sound(0), robot=replace(ROBOT, platform=heavy)))
    np.testing.assert_allclose(
        estimate.value, estimates[0].value, atol=1e-3 * estimates[0].standard_deviation.min()
    )


@pytest.mark.slow
@pytest.mark.long
def test_kuka_baseline(examples):
    kuka = read_experiment(examples / "kuka-tool" / "experiment.yaml")
    accelerometer = changed(kuka.instruments["accelerometer"], calibration={"delay": 0.05})
    runs = tuple(run for run in kuka.runs if run.name == "baseline")
    estimate = METHOD(
        replace(kuka, runs=runs, instruments={**kuka.instruments, "accelerometer": accelerometer})
    )
    assert estimate.value[0] == pytest.approx(0.932, rel=0.012)
    assert np.abs(estimate.value[1:4] - [0.0003, 0, 0.0439]).max() < 1.5e-3
    assert 0.005 < estimate.calibration["accelerometer"]["delay"]["baseline"]["value"] < 0.009
    assert estimate.verdict.accepted, estimate.verdict.reasons


@pytest.mark.slow
def test_it_is_the_default_and_writes_the_motion(run, recordings, tmp_path):
    assert (
        run(
            "identify",
            recordings / "points-02" / "experiment.yaml",
            "--out",
            tmp_path / "o",
            "--quiet",
        )[0]
        == 0
    )
    table = pl.read_parquet(tmp_path / "o" / "motion.parquet")
    assert {
        "run",
        "t",
        "x",
        "qw",
        "vx",
        "wx",
        "ax",
        "alpha_x",
        "sigma_x",
        "sigma_rx",
        "sigma_alpha_z",
    } <= set(table.columns)
    assert table.null_count().sum_horizontal().item() == 0
    norm = table.select(
        (pl.col("qw") ** 2 + pl.col("qx") ** 2 + pl.col("qy") ** 2 + pl.col("qz") ** 2).alias("n")
    )["n"]
    assert norm.to_numpy() == pytest.approx(1.0)


def test_the_default_has_two_step_beside_it():
    found = identify(sound(0))
    assert list(found.estimates) == ["two-step", "maximum-likelihood"]
    assert found.result == "maximum-likelihood"
    assert found.bound is not None


def test_what_the_two_steps_cannot_do_does_not_stop_the_others():
    found = identify(keeping(sound(0), "cables", "tracker", "command"))
    assert not found.estimates["two-step"].verdict.accepted
    assert "expected an orientation" in found.estimates["two-step"].verdict.reasons[0]
    assert np.isfinite(found.estimates["maximum-likelihood"].value[0])


@pytest.mark.slow
def test_ideal_sensors_are_told_exactly():
    estimate = METHOD(
        RECORDER(0, instruments={k: changed(v, rate=100.0) for k, v in IDEAL.items()})
    )
    assert abs(estimate.value[0] / TRUTH[0] - 1) < 1e-3
    assert np.abs(estimate.value[1:4] - TRUTH[1:4]).max() < 1e-3
