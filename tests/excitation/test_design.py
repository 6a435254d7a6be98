"""The verb `design` from outside: what it writes, that it is feasible, what it says beforehand, and
how it refuses."""

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from scipy.signal import find_peaks
from time_limits import HANGS

from steelyard.errors import InputError
from steelyard.excitation.design import design
from steelyard.excitation.evaluation import highest_frequency
from steelyard.excitation.limits.cable_vibration import dunkerley_sum_at, natural_frequencies
from steelyard.excitation.limits.motion_constraints import Margin
from steelyard.excitation.limits.verification import bodies_within, verify
from steelyard.excitation.search.design_problem import DesignProblem
from steelyard.experiment.model import Experiment
from steelyard.experiment.write import write_experiment, write_yaml
from steelyard.identification.methods.maximum_likelihood import MaximumLikelihood
from steelyard.inertia import BODY_PARAMETERS
from steelyard.instruments import Wrench
from steelyard.motion.limits import check_times, commanded_tensions, motion_extremes
from steelyard.motion.trajectory import RestToRest, multisine
from steelyard.report.documents.design import statements
from steelyard.robot.file import read_robot, robot_file
from steelyard.robot.model import Limits
from steelyard.simulation.forward_dynamics import CablePlatform
from steelyard.simulation.sensors import paper_sensors
from steelyard.simulation.simulate import simulate
from steelyard.simulation.trajectories import from_file, repeated_move, workspace_of

pytestmark = pytest.mark.integration

ROBOT = read_robot("cogiro")
EXACT = {"anchor": 0.0, "attachment": 0.0, "gravity": 0.0}
QUICK = ["--duration", "8", "--budget", "44", "--processes", "1"]
"""Short motions, one start."""
WITHOUT_HASTE = """
from steelyard.excitation.search.design_problem import DesignProblem
search = DesignProblem.search
DesignProblem.search = lambda self, start, *, seconds, **further: search(self, start, seconds=1e4, **further)
"""
"""Begins a process whose searches are never cut short, however busy the machine is."""
COMMAND_LINE = f"""{WITHOUT_HASTE}
import sys
from steelyard.cli import main
sys.argv[0] = "steelyard"
main()
"""


@pytest.fixture(autouse=True)
def without_haste(monkeypatch):
    """The same for the searches of this process: what they find depends on no clock."""
    search = DesignProblem.search

    def patient(self, start, *, seconds, **further):
        return search(self, start, seconds=1e4, **further)

    monkeypatch.setattr(DesignProblem, "search", patient)


def planned(robot=ROBOT, **keys):
    return Experiment(
        "plan", robot, paper_sensors(robot).instruments, (), **{"uncertainty": EXACT, **keys}
    )


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """One design as the command line writes it, and what it prints."""
    out = tmp_path_factory.mktemp("design") / "out"
    done = subprocess.run(
        [sys.executable, "-c", COMMAND_LINE, "design", "cogiro", "--out", str(out), *QUICK],
        check=False,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return out, done.stdout


@pytest.fixture(scope="module")
def told(written):
    return json.loads((written[0] / "design.json").read_text())


@pytest.fixture(scope="module")
def command(written):
    return from_file(written[0] / "command.csv", ROBOT)


# What it writes


def test_command_has_the_columns_of_its_kind_at_a_hundred_hertz(written):
    table = pl.read_csv(written[0] / "command.csv")
    assert table.columns == ["t", "x", "y", "z", "roll", "pitch", "yaw"]
    time = table["t"].to_numpy()
    assert time[0] == 0
    assert time[-1] == pytest.approx(8, abs=1e-12)
    assert np.diff(time).max() <= 0.01 + 1e-12


def test_command_begins_and_ends_at_rest_in_the_same_pose(written):
    table = pl.read_csv(written[0] / "command.csv").to_numpy()
    time, pose = table[:, 0], table[:, 1:]
    np.testing.assert_allclose(pose[0], pose[-1], atol=1e-12)
    step = time[1] - time[0]
    for end in (pose[:4], pose[:-5:-1]):
        # Velocity, acceleration and jerk vanish: what is left grows with the fourth power of time.
        assert np.abs(end[1] - end[0]).max() < step**3
        assert np.abs(end[2] - 2 * end[1] + end[0]).max() < step**3


def test_design_file_has_the_form_of_the_contract(told):
    assert told["format"] == "steelyard-design/1"
    assert told["duration"] == 8
    deviation = told["standard_deviation"]
    assert deviation["mass"] > 0
    assert np.shape(deviation["center_of_gravity"]) == (3,)
    assert np.shape(deviation["inertia"]) == (3, 3)
    limits = told["limits"]
    assert len(limits["tension"]) == 2
    for key in ("speed", "acceleration", "angular_speed", "angular_acceleration", "cable_speed"):
        assert limits[key] > 0
    assert np.shape(limits["position"]) == (2, 3)
    assert told["feasible"] is True
    assert told["violations"] == []


def test_each_second_tells_its_share_and_all_of_them_the_whole(told):
    part = told["commands"][0]["told"]
    step = part["t"][1] - part["t"][0]
    for name in BODY_PARAMETERS:
        # The rest is what priors tell, of the offsets mostly.
        assert 0.3 < np.sum(part[name]) * step < 1.01


def test_report_says_what_it_will_tell_and_what_it_takes(written):
    out, printed = written
    report = (out / "design.md").read_text()
    for text in (printed, report):
        for words in (
            "Expected uncertainty after a motion of 8 s",
            "cog x",
            "angular acceleration",
            "swings on its cables",
        ):
            assert words in text
    assert "steelyard simulate cogiro --trajectory" in printed


def test_page_shows_the_motion(written):
    page = (written[0] / "design.html").read_text()
    for name in ("robot", "information-design", "motion-design-place", "motion-design-tensions"):
        assert f'id="figure-{name}' in page
    assert page.count('class="plot"') == 7


# That the robot can do it


def test_designed_motion_keeps_every_limit_densely_and_for_other_bodies(command, told):
    times = np.linspace(0, command.duration, 4001)
    assert motion_extremes(ROBOT, command, times).fraction <= 1
    margin = 0.2
    for share, shift in (
        (1 - margin, [0.05, 0, 0]),
        (1 + margin, [0, -0.05, 0]),
        (1.1, [0, 0, 0.05]),
    ):
        body = ROBOT.platform
        other = type(body)(
            share * body.mass, body.center_of_gravity + np.array(shift), share * body.inertia
        )
        for still in (False, True):
            tension = commanded_tensions(
                replace(ROBOT, platform=other), command, times[::40], still=still
            )
            assert tension.min() >= ROBOT.tension_limits[0]
            assert tension.max() <= ROBOT.tension_limits[1]


def test_designed_motion_keeps_the_limits_on_elastic_cables(command):
    state = (
        CablePlatform(ROBOT, ROBOT.platform).move(command, tolerance=1e-5).at(check_times(command))
    )
    acceleration = np.einsum("nij,nj->ni", state.rotation, state.specific_force) + ROBOT.gravity
    assert np.linalg.norm(acceleration, axis=1).max() <= ROBOT.limits.acceleration
    assert np.linalg.norm(state.alpha, axis=1).max() <= ROBOT.limits.angular_acceleration
    assert state.tension.min() >= ROBOT.tension_limits[0]


def test_motion_is_far_slower_than_the_platform_swings(told):
    assert told["highest_frequency"] < 0.35 * told["natural_frequencies"][0]


# What it says beforehand


@pytest.mark.slow
@pytest.mark.long
def test_maximum_likelihood_reports_what_was_predicted(command, told):
    recorded = simulate(ROBOT, {"design": command}, paper_sensors(ROBOT), seed=3)
    estimate = MaximumLikelihood()(recorded.experiment)
    said = told["standard_deviation"]
    J = np.array(said["inertia"])
    predicted = np.concatenate(
        [[said["mass"]], said["center_of_gravity"], np.diag(J), [J[1, 2], J[0, 2], J[0, 1]]]
    )
    # One recording: its noise decides a little how well it is known.
    np.testing.assert_allclose(estimate.standard_deviation / predicted, 1, atol=0.12)
    error = estimate.value - ROBOT.platform.body_parameters
    assert error @ np.linalg.solve(estimate.covariance, error) < 29.6


@pytest.mark.slow
def test_designed_motion_tells_the_inertia_several_times_better_than_the_usual_ones(told, run):
    J = np.array(told["standard_deviation"]["inertia"])
    for which, times in (("paper", 5), ("multisine", 1.5)):
        status, out, _ = run("design", "cogiro", "--check", which, "--duration", "9", "--json")
        assert status == 0
        other = np.array(json.loads(out)["standard_deviation"]["inertia"], dtype=float)
        # What it cannot tell at all is null.
        worst = np.inf if np.isnan(other).any() else other.max()
        assert worst > times * J.max()


@pytest.mark.slow
def test_check_says_what_a_motion_cannot_tell_and_what_it_exceeds(run, tmp_path):
    times = np.linspace(0, 6, 601)
    move = RestToRest(np.array([0, 0, 2, 0, 0, 0.0]), np.array([1.0, 0, 2, 0, 0, 0]), 1.0, 2.5)
    pl.DataFrame(
        np.column_stack([times, move.derivative(times, 0)]),
        schema=["t", "x", "y", "z", "roll", "pitch", "yaw"],
    ).write_csv(tmp_path / "own.csv")
    status, out, _ = run("design", "cogiro", "--check", str(tmp_path / "own.csv"), "--json")
    assert status == 0
    found = json.loads(out)
    assert set(found["unidentifiable"]) >= {"Jxx", "Jyy", "Jzz"}
    assert found["worst"]["over_target"] is None
    assert found["feasible"] is False
    assert any("acceleration" in text for text in found["violations"])
    status, out, _ = run("design", "cogiro", "--check", str(tmp_path / "own.csv"))
    assert "not identifiable: " in out
    assert "the robot cannot do it" in out


@pytest.mark.slow
@pytest.mark.long
def test_what_is_known_already_adds_to_what_a_motion_will_tell(run, tmp_path):
    _, out, _ = run("design", "cogiro", "--check", "multisine", "--duration", "9", "--json")
    plain = json.loads(out)["all_runs"]["standard_deviation"]
    motion = multisine([0, 0, 2, 0, 0, 0], [0.5, 0.5, 0.3, 0.2, 0.2, 0.3], 9, 4)
    recorded = simulate(ROBOT, {"run": motion}, paper_sensors(ROBOT))
    (tmp_path / "earlier").mkdir()
    write_experiment(recorded.experiment, tmp_path / "earlier")
    assert (
        run(
            "identify",
            str(tmp_path / "earlier" / "experiment.yaml"),
            "--out",
            str(tmp_path / "estimate"),
        )[0]
        == 0
    )
    found = []
    for earlier in (tmp_path / "estimate", tmp_path / "earlier" / "experiment.yaml"):
        check = ("--check", "multisine", "--duration", "9", "--after", str(earlier), "--json")
        status, out, _ = run("design", "cogiro", *check)
        assert status == 0
        both = json.loads(out)["all_runs"]["standard_deviation"]
        assert both["mass"] < plain["mass"]
        assert np.all(np.array(both["inertia"]) < np.array(plain["inertia"]))
        found.append(both)
    # The estimate in a file is that of the experiment.
    np.testing.assert_allclose(found[0]["inertia"], found[1]["inertia"], rtol=1e-6)


# The same again, several runs, other robots


ONE_SEED = f"""{WITHOUT_HASTE}
import sys
import numpy as np
from steelyard.excitation.design import design
from test_design import planned
found = design(planned(), 8.0, budget=30.0, seed=int(sys.argv[1]))
assert found.in_time
np.save(sys.argv[2], found.trajectories["design"].derivative(np.linspace(0, 8, 801), 0))
"""
"""Only where no search is cut short does the seed alone decide."""


@pytest.mark.slow
@pytest.mark.long
def test_same_seed_gives_the_same_motion_and_another_another(tmp_path, told, command):
    """In processes of their own, and as the command line has written it, where its search ended in
    time."""
    found = []
    for i, seed in enumerate("001"):
        path = tmp_path / f"{i}.npy"
        here = Path(__file__).parent
        places = os.pathsep.join([str(here), str(here.parent), os.environ.get("PYTHONPATH", "")])
        subprocess.run(
            [sys.executable, "-c", ONE_SEED, seed, str(path)],
            check=True,
            env={**os.environ, "PYTHONPATH": places},
        )
        found.append(np.load(path))
    once, again, other = found
    np.testing.assert_array_equal(once, again)
    assert np.abs(other - again).max() > 1e-3
    if told["search"]["in_time"]:
        # What is written has been through the rounding of a file and an interpolation.
        np.testing.assert_allclose(command.derivative(np.linspace(0, 8, 801), 0), once, atol=1e-7)


@pytest.mark.slow
@pytest.mark.long
def test_a_second_run_adds_what_the_first_one_lacks():
    found = design(planned(), 6.0, runs=2, budget=60.0).appraisal
    assert list(found.trajectories) == ["design-1", "design-2"]
    assert found.feasible
    alone = found.each["design-1"]
    assert np.all(found.standard_deviation < alone / 1.25)


@pytest.mark.slow
@pytest.mark.long
def test_start_and_end_are_those_asked_for():
    start, end = np.array([0.5, 0, 1.8, 0, 0, 0.1]), np.array([-0.5, 0.3, 2.2, 0.1, 0, 0])
    found = design(planned(), 8.0, start=start, end=end, budget=30.0).appraisal
    ends = found.trajectories["design"].derivative(np.array([0.0, 8.0]), 0)
    np.testing.assert_allclose(ends, [start, end], atol=1e-9)


@pytest.mark.slow
@pytest.mark.long
def test_targets_of_trackers_and_cables_keep_their_limits():
    instruments = dict(paper_sensors(ROBOT).instruments)
    instruments["tracker"] = type(instruments["tracker"]).model_validate(
        {
            **instruments["tracker"].model_dump(exclude_unset=True),
            "limits": {"speed": 1.2, "acceleration": 2.0},
        }
    )
    robot = replace(ROBOT, limits=replace(ROBOT.limits, cable_speed=1.0))
    experiment = replace(planned(robot), instruments=instruments)
    found = design(experiment, 8.0, budget=30.0).appraisal
    (verified,) = found.verified.values()
    for uses in (verified.commanded, verified.elastic):
        limited = {use.name: use for use in uses if use.limit}
        assert limited["speed of the target of 'tracker'"].fraction <= 1
        assert limited["acceleration of the target of 'tracker'"].fraction <= 1
        assert limited["cable speed"].fraction <= 1
    assert (
        max(
            use.fraction
            for use in verified.commanded
            if use.name in {"cable speed", "speed of the target of 'tracker'"}
        )
        > 0.6
    )


@pytest.mark.slow
@pytest.mark.long
def test_body_on_a_wrench_sensor_is_designed_for_too(tmp_path):
    robot = replace(
        ROBOT,
        name="arm",
        anchors=np.zeros((0, 3)),
        attachments=np.zeros((0, 3)),
        pulley_radius=np.zeros(0),
        pulley_axis=np.zeros((0, 3)),
    )
    instruments = {k: v for k, v in paper_sensors(robot).instruments.items() if k != "sensor"}
    instruments = {
        "sensor": Wrench.model_validate(
            {
                "kind": "wrench",
                "clock": "recorder",
                "rate": 100.0,
                "noise": {"force": 1.0, "torque": 0.1},
            }
        ),
        **instruments,
    }
    found = design(replace(planned(robot), instruments=instruments), 6.0, budget=30.0).appraisal
    assert found.feasible
    assert np.isfinite(found.standard_deviation).all()


# What it is made of


@pytest.mark.slow
def test_natural_frequencies_are_those_of_a_platform_that_is_let_go():
    """Moved by a tenth of a millimetre in one mode it swings with the frequency of that mode."""
    pose = np.array([0, 0, 2, 0, 0, 0.0])
    robot = replace(ROBOT, cable=replace(ROBOT.cable, damping_ratio=0.0))
    platform = CablePlatform(robot, robot.platform)
    frequencies = platform.natural_frequencies(pose)
    assert frequencies.shape == (6,)
    assert np.all(np.diff(frequencies) >= 0)
    # A straight push makes all modes swing; their frequencies are the peaks of what follows.
    push = RestToRest(pose, pose + np.array([2e-4, 1e-4, 1e-4, 2e-4, 1e-4, 3e-4]), 0.02, 0.0)

    class Pushed:
        duration = 40.0

        def derivative(self, t, order):
            return push.derivative(np.minimum(t, push.duration), order)

    times = np.arange(0.5, 40, 0.01)
    state = platform.move(Pushed(), tolerance=1e-9).at(times)
    swings = np.hstack([state.specific_force, state.alpha])
    power = np.sum(
        np.abs(np.fft.rfft((swings - swings.mean(0)) * np.hanning(len(times))[:, None], axis=0))
        ** 2,
        axis=1,
    )
    seen = np.fft.rfftfreq(len(times), 0.01)
    peaks, _ = find_peaks(power)
    for frequency in frequencies:
        # Within the resolution of forty seconds.
        assert np.abs(seen[peaks] - frequency).min() < 0.03


@pytest.mark.parametrize("pose", [[0, 0, 2, 0, 0, 0], [0.5, -1, 3, 0.3, -0.2, 0.4]])
def test_softness_sums_up_how_slowly_the_platform_swings(pose):
    """What the tension of the cables adds to their stiffness, and what their sag takes, is left
    out."""
    pose = np.array(pose, dtype=float)
    angular = 2 * np.pi * CablePlatform(ROBOT, ROBOT.platform).natural_frequencies(pose)
    assert dunkerley_sum_at(ROBOT, pose) == pytest.approx(np.sum(angular**-2.0), rel=0.1)


def test_motion_stays_where_the_platform_hangs_stiffly(command):
    poses = command.derivative(np.linspace(0, command.duration, 81), 0)
    softest = max(dunkerley_sum_at(ROBOT, pose) for pose in poses)
    assert softest < 1.45 * dunkerley_sum_at(ROBOT, poses[0])


def test_highest_frequency_is_that_of_a_sine():
    motion = multisine([0] * 6, [0.1] * 6, 40.0, 20)
    assert highest_frequency(motion) < 20 / 40 + 0.15
    assert highest_frequency(RestToRest(np.zeros(6), np.zeros(6), 2.0)) == 0.0


def test_bodies_within_a_margin_reach_its_edges():
    margin = Margin(0.35, ROBOT.size)
    bodies = list(bodies_within(ROBOT.platform, margin))
    masses = [body.mass / ROBOT.platform.mass for body in bodies]
    assert min(masses) == pytest.approx(0.65)
    assert max(masses) == pytest.approx(1.35)
    shifts = [
        np.linalg.norm(body.center_of_gravity - ROBOT.platform.center_of_gravity) for body in bodies
    ]
    assert max(shifts) == pytest.approx(margin.cog_offset)
    assert margin.cog_offset >= 0.1


def test_verification_sees_what_exceeds_a_limit():
    fast = multisine([0, 0, 2, 0, 0, 0], [1.0, 1.0, 0.5, 0.3, 0.3, 0.3], 6.0, 8)
    found = verify(ROBOT, {}, fast, Margin(0.0, ROBOT.size), 0.0)
    assert any(text.startswith("acceleration") for text in found.violations)
    assert found.fraction > 1


def test_paper_move_is_repeated_there_and_back():
    motion = repeated_move(20.0)
    assert motion.duration == 18.0
    pose = motion.derivative(np.array([0.0, 3.0, 6.0, 9.0]), 0)
    np.testing.assert_allclose(pose[0], pose[2], atol=1e-12)
    np.testing.assert_allclose(pose[1], pose[3], atol=1e-12)
    np.testing.assert_allclose(motion.derivative(np.array([3.0, 6.0]), 1), 0, atol=1e-12)
    around = motion.derivative(np.array([2.999, 3.001]), 0)
    np.testing.assert_allclose(around[0], around[1], atol=1e-6)


# How it refuses


def robot_text(**changes):
    values = robot_file(ROBOT)
    return {**values, **changes}


REFUSED = {
    "too short": ({}, ["--duration", "1"], "--duration"),
    "too long": ({}, ["--duration", "1e6"], "--duration"),
    "no duration": ({}, [], "--duration"),
    "not a duration": ({}, ["--duration", "nan"], "--duration"),
    "no workspace": ({"tension": {"min": 900.0, "max": 1000.0}}, ["--duration", "10"], "tension"),
    "start outside": (
        {},
        ["--duration", "10", "--start", *["0", "0", "9", "0", "0", "0"]],
        "--start",
    ),
    "end outside": ({}, ["--duration", "10", "--end", *["0", "0", "2", "80", "0", "0"]], "--end"),
    "start that no cable holds": (
        {},
        ["--duration", "10", "--start", *["3.9", "2.9", "3.4", "30", "30", "30"]],
        "--start",
    ),
    "start that is no number": (
        {},
        ["--duration", "10", "--start", *["nan", "0", "2", "0", "0", "0"]],
        "--start",
    ),
    "cable missing": ({"cables": robot_file(ROBOT)["cables"][:-1]}, ["--duration", "10"], "cables"),
    "three cables missing": (
        {"cables": robot_file(ROBOT)["cables"][:-3]},
        ["--duration", "10"],
        "cables",
    ),
    "no body": ({"platform": None}, ["--duration", "10"], "platform"),
    "margin too large": ({}, ["--duration", "10", "--margin", "3"], "--margin"),
    "margin that leaves nothing": ({}, ["--duration", "10", "--margin", ".85"], "--margin"),
    "too fast a move": (
        {},
        [
            "--duration",
            "3.3",
            "--start",
            *["-2", "-1.5", "2", "0", "0", "0"],
            "--end",
            *["2", "1.5", "2", "0", "0", "0"],
        ],
        "acceleration",
    ),
    "target that is none": ({}, ["--duration", "10", "--target", "weight=3"], "--target"),
    "target of nothing": ({}, ["--duration", "10", "--target", "mass=0"], "--target"),
    "no runs": ({}, ["--duration", "10", "--runs", "0"], "--runs"),
    "no time": ({}, ["--duration", "10", "--budget", "0"], "--budget"),
    "estimate that is not there": (
        {},
        ["--duration", "10", "--after", "nothing.json"],
        "nothing.json",
    ),
    "body that is not there": ({}, ["--duration", "10", "--body", "nothing.json"], "nothing.json"),
    "motion that is not there": ({}, ["--check", "nothing.csv"], "nothing.csv"),
    "sensors that are not there": (
        {},
        ["--duration", "10", "--sensors", "nothing.yaml"],
        "nothing.yaml",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_done_is_refused_with_one_sentence(case, run, tmp_path, monkeypatch):
    changes, options, word = REFUSED[case]
    values = {key: value for key, value in robot_text(**changes).items() if value is not None}
    monkeypatch.chdir(tmp_path)
    write_yaml(values, Path("robot.yaml"))
    status, out, err = run("design", "robot.yaml", "--out", "results", *options)
    assert status == 2
    assert out == ""
    assert word in err
    assert err.count("\n") == 1
    assert "Traceback" not in err
    assert not Path("results").exists()


def test_instruments_must_say_how_good_and_how_fast_they_are(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    plan = {
        "format": "steelyard/1",
        "robot": "cogiro",
        "instruments": {
            "cables": {"kind": "tension", "rate": 25},
            "imu": {
                "kind": "imu",
                "rate": 25,
                "noise": {"angular_velocity": 0.002, "orientation": 0.003},
            },
            "tracker": {"kind": "position", "rate": 100, "noise": 0.0005},
        },
    }
    write_yaml(plan, Path("plan.yaml"))
    status, _, err = run("design", "plan.yaml", "--duration", "8", "--out", "results")
    assert status == 2
    assert "'cables'" in err
    assert "noise" in err
    plan["instruments"]["cables"]["noise"] = 5.0
    del plan["instruments"]["imu"]["rate"]
    write_yaml(plan, Path("plan.yaml"))
    status, _, err = run("design", "plan.yaml", "--duration", "8", "--out", "results")
    assert status == 2
    assert "'imu'" in err
    assert "rate" in err


@pytest.mark.slow
@pytest.mark.long
def test_an_experiment_that_has_not_been_recorded_yet_is_designed_for(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    plan = {
        "format": "steelyard/1",
        "robot": "cogiro",
        "instruments": {
            "cables": {"kind": "tension", "rate": 25, "noise": 5.0},
            "imu": {
                "kind": "imu",
                "rate": 25,
                "noise": {"angular_velocity": 0.002, "orientation": 0.003},
            },
            "tracker": {
                "kind": "position",
                "rate": 100,
                "noise": 0.0005,
                "target": [0.1, 0.2, 1.1],
            },
        },
    }
    write_yaml(plan, Path("plan.yaml"))
    status, out, err = run("design", "plan.yaml", *QUICK, "--out", "results", "--json")
    assert status == 0, err
    found = json.loads(out)
    # Gains of 1 % on eight cables and .5 % common to all of them are more than any motion tells.
    floor = np.hypot(0.005, 0.01 / np.sqrt(8)) * ROBOT.platform.mass
    assert floor * 0.9 < found["standard_deviation"]["mass"] < floor * 1.2


@pytest.mark.slow
def test_robot_without_limits_stays_about_the_middle_and_the_report_says_what_is_free():
    robot = replace(ROBOT, limits=Limits(), tension_limits=(0.0, np.inf))
    found = design(planned(robot), 6.0, budget=30.0).appraisal
    poses = found.trajectories["design"].derivative(np.linspace(0, 6, 301), 0)
    middle, reach = workspace_of(robot)
    assert np.all(np.abs(poses - middle) <= reach * 1.0001)
    assert found.feasible
    said = "\n".join(each.text for each in statements(found))
    assert "does not limit speed, acceleration, angular speed, angular acceleration" in said
    # With the robot's own limits there is nothing to say.
    assert "does not limit" not in "\n".join(
        each.text for each in statements(replace(found, experiment=planned()))
    )


def computed_by(process):
    """[s] of processor time of each process that another one has started."""
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    for child in children:
        fields = Path(f"/proc/{child}/stat").read_text().rpartition(")")[2].split()
        yield (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def wait_for_a_search(process):
    """Until one of its processes has computed for a while, so that all have begun."""
    end = time.monotonic() + HANGS
    while process.poll() is None and max(computed_by(process), default=0.0) < 1.0:
        assert time.monotonic() < end, "no search has begun"
        time.sleep(0.2)


@pytest.mark.slow
def test_an_interrupted_search_ends_with_one_sentence_and_leaves_nothing(tmp_path):
    """Ctrl-C in a terminal reaches the searching processes too."""
    command = [
        sys.executable,
        "-m",
        "steelyard",
        "design",
        "cogiro",
        "--duration",
        "20",
        "--processes",
        "2",
    ]
    process = subprocess.Popen(
        [*command, "--out", "results"],
        cwd=tmp_path,
        start_new_session=True,
        stderr=subprocess.PIPE,
        text=True,
    )
    wait_for_a_search(process)
    os.killpg(process.pid, signal.SIGINT)
    _, err = process.communicate(timeout=HANGS)
    assert process.returncode == 130
    assert err.strip() == "steelyard: interrupted; nothing was written"
    assert not list(tmp_path.iterdir())


def test_refusal_in_python_is_the_same_error():
    with pytest.raises(InputError, match="platform"):
        design(planned(replace(ROBOT, platform=None)), 10.0)


def test_stiffness_that_is_not_known_is_said(tmp_path):
    robot = replace(ROBOT, cable=replace(ROBOT.cable, axial_stiffness=None, linear_density=None))
    assert len(natural_frequencies(robot, np.array([0, 0, 2, 0, 0, 0.0]), 0.0)) == 0
