"""Poses at rest for a calibration: what is promised of them, and that no others are as good."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner
from grids import columns, is_a_deviation
from scipy.spatial.transform import Rotation

from steelyard.calibration.calibrate import calibrate
from steelyard.cli import app
from steelyard.errors import InputError
from steelyard.excitation.limits.motion_constraints import Margin, MotionConstraints
from steelyard.excitation.poses.candidate_poses import candidate_poses, in_sequence, regular_grid
from steelyard.excitation.poses.pose_choice import PoseChoice
from steelyard.excitation.poses.pose_design import design_poses, predicted_fit
from steelyard.excitation.poses.pose_information import pose_choice
from steelyard.excitation.settings import DesignSettings
from steelyard.experiment.model import Experiment
from steelyard.experiment.read import read_experiment
from steelyard.experiment.recording import Run, Stream
from steelyard.instruments import Attitude, Length, Position, Tension
from steelyard.report.documents.poses import poses_document
from steelyard.robot.file import read_robot
from steelyard.robot.model import Robot

pytestmark = pytest.mark.integration

POSES = 12
FEW = DesignSettings(candidate_poses=30)
TARGET = np.array([0.1, 0.2, 1.1])
NOISE = 5e-4  # [m], of lengths and of the tracker
TURN = 1e-3  # [rad]
FORCE = 2.0  # [N]
EXACT = {"target": 0, "frame": {"position": 0, "rotation": 0}}


def plain_robot():
    """CoGiRo with cables that are straight lines between points: the oracle below is vector
    algebra."""
    robot = read_robot("cogiro")
    plain = Robot("plain", robot.anchors, robot.attachments, platform=robot.platform)
    return replace(plain, tension_limits=robot.tension_limits, limits=robot.limits)


def instruments(*, forces=True, attitude=True):
    found = {}
    if forces:
        found["cables"] = Tension.model_validate(
            {
                "kind": "tension",
                "noise": FORCE,
                "calibration": {"offset": 2.0, "gain": 0.005, "common_gain": 0.0},
            }
        )
    found["lengths"] = Length.model_validate({"kind": "length", "noise": NOISE})
    found["tracker"] = Position.model_validate(
        {"kind": "position", "target": tuple(TARGET.tolist()), "noise": NOISE, "calibration": EXACT}
    )
    if attitude:
        found["attitude"] = Attitude.model_validate(
            {"kind": "attitude", "noise": TURN, "calibration": {"misalignment": 0, "reference": 0}}
        )
    return found


@pytest.fixture(scope="module", params=[True, False], ids=["forces", "no forces"])
def planned(request):
    stated = {"anchor": 0.05, "attachment": 0.01, "gravity": 0.0}
    return Experiment("plan", plain_robot(), instruments(forces=request.param), (), (), stated)


@pytest.fixture(scope="module")
def designed(planned):
    return design_poses(planned, POSES)


def mean_deviation(found):
    return np.mean([each.mean() for each in found.deviations.values()])


def recorded(experiment, poses, seed):
    """Noisy readings of the poses by a robot whose geometry is off, by plain vector algebra."""
    rng = np.random.default_rng(seed)
    robot, noise = experiment.robot, rng.standard_normal
    anchors, attachments = (
        points + experiment.uncertainty[key] * noise(points.shape)
        for key, points in (("anchor", robot.anchors), ("attachment", robot.attachments))
    )
    turned = Rotation.from_euler("ZYX", poses[:, :2:-1])
    R, n = turned.as_matrix(), len(poses)
    arms = np.einsum("nij,mj->nmi", R, attachments)
    along = anchors - (poses[:, None, :3] + arms)
    length = np.linalg.norm(along, axis=2)
    place = poses[:, :3] + R @ TARGET + NOISE * noise((n, 3))
    seen = turned * Rotation.from_rotvec(TURN * noise((n, 3)))
    streams = {
        "lengths": {"length": length + noise(8) + NOISE * noise((n, 8))},
        "tracker": {"position": place},
        "attitude": {"orientation": seen.as_matrix()},
    }
    if "cables" in experiment.instruments:
        pull = along / length[:, :, None]
        W = np.concatenate([pull, np.cross(arms, pull)], axis=2).transpose(0, 2, 1)
        body = robot.platform
        weight = body.mass * robot.gravity
        about = np.cross(R @ body.center_of_gravity, weight)
        needed = -np.hstack([np.tile(weight, (n, 1)), about])
        tension = np.einsum("nmk,nk->nm", np.linalg.pinv(W), needed)
        gain, offset = 1 + 0.005 * noise(8), 2.0 * noise(8)
        read = gain * tension + offset + FORCE * noise(tension.shape)
        streams = {"cables": {"tension": read}, **streams}
    number = np.arange(n, dtype=float)
    run = Run(
        "poses", {key: Stream(number, each, key) for key, each in streams.items()}, static=True
    )
    return replace(experiment, runs=(run,)), np.concatenate([anchors.ravel(), attachments.ravel()])


def test_what_is_promised_is_what_calibrate_says_of_data(planned, designed):
    promised = designed.predicted.covariance
    chi = []
    for seed in range(3):
        experiment, true = recorded(planned, designed.poses, seed)
        found = calibrate(experiment)
        assert not found.reasons
        ratio = np.sqrt(np.diag(found.covariance) / np.diag(promised))
        # About a geometry that is 5 cm off, the derivatives differ by a per cent.
        np.testing.assert_allclose(ratio, 1.0, atol=0.05)
        off = np.concatenate([found.points[key].ravel() for key in ("anchor", "attachment")]) - true
        chi.append(off @ np.linalg.solve(promised, off) / len(off))
    assert 0.6 < np.mean(chi) < 1.5


def test_the_poses_beat_a_regular_grid_and_random_ones(planned, designed):
    assert designed.over_grid["anchor"] < 0.9
    assert designed.over_grid["attachment"] < 0.9
    held = candidate_poses(_constraints(planned, designed.level), seed=5)
    for seed in range(3):
        few = np.random.default_rng(seed).choice(len(held), POSES, replace=False)
        random = type(designed.predicted)(predicted_fit(planned, held[few], designed.level))
        assert mean_deviation(designed.predicted) < 0.9 * mean_deviation(random)


def _constraints(experiment, level):
    robot = experiment.robot
    return MotionConstraints(robot, experiment.instruments, Margin(0.2, robot.size), level, 1.0)


def test_each_deviation_is_written_with_two_digits(designed):
    written = columns(poses_document(designed), r"^[xyz]$|before|1-sigma$|these poses|grid")
    assert len(written) > 20
    assert [text for text in written if not is_a_deviation(text)] == []
    assert all(
        re.fullmatch(r"\d+\.\d\d", each) for each in columns(poses_document(designed), "ratio")
    )


def test_every_pose_can_be_held_within_the_limits(planned, designed):
    low, high = np.array(planned.robot.limits.position)
    assert (designed.poses[:, :3] >= low - 1e-9).all()
    assert (designed.poses[:, :3] <= high + 1e-9).all()
    assert (np.abs(np.degrees(designed.poses[:, 3:])) <= 35 + 1e-6).all()
    assert len(np.unique(designed.poses, axis=0)) == POSES


def test_single_poses_add_up_to_what_all_of_them_tell(planned, designed):
    found = predicted_fit(planned, designed.poses, designed.level)
    choice = pose_choice(found)
    covariance = np.linalg.inv(choice.prior + choice.each.sum(axis=0))[
        np.ix_(choice.wanted, choice.wanted)
    ]
    whole = designed.predicted.covariance
    # One is in units of what is known beforehand.
    ratio = np.sqrt(np.diag(whole) / np.diag(covariance))
    np.testing.assert_allclose(ratio, np.repeat([0.05, 0.01], 24), rtol=1e-3)


@pytest.mark.slow
def test_the_same_seed_gives_the_same_poses(planned):
    one, same, other = (design_poses(planned, 6, seed=seed, settings=FEW) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one.poses, same.poses)
    assert not np.allclose(one.poses, other.poses)


def test_exchanges_find_the_best_of_a_small_problem():
    rng = np.random.default_rng(0)
    rows = rng.standard_normal((9, 2, 4))
    each = rows.transpose(0, 2, 1) @ rows
    choice = PoseChoice(1e-3 * np.eye(4), each, np.array([True, True, False, True]))
    chosen = choice.best(3)
    every = [
        choice.value(np.array([i, j, k])) for i in range(9) for j in range(i) for k in range(j)
    ]
    assert choice.value(chosen) == pytest.approx(max(every))
    # By the covariance itself.
    covariance = np.linalg.inv(choice.prior + each[chosen].sum(axis=0))
    own = covariance[np.ix_(choice.wanted, choice.wanted)]
    assert choice.value(chosen) == pytest.approx(-np.linalg.slogdet(own)[1])


def test_a_grid_has_as_many_poses_and_corners_first(planned, designed):
    grid = regular_grid(_constraints(planned, designed.level), POSES)
    assert len(grid) == POSES
    assert np.linalg.norm(grid[0, :3] - [0, 0, 2]) > 4


def test_the_way_from_pose_to_pose_is_short():
    poses = np.zeros((4, 6))
    poses[:, 0] = [0, 2, 1, 3]
    np.testing.assert_array_equal(in_sequence(poses, np.ones(6))[:, 0], [0, 1, 2, 3])


def test_nothing_tells_a_geometry_without_lengths():
    experiment = Experiment("plan", plain_robot(), instruments(), ())
    without = {key: each for key, each in experiment.instruments.items() if key != "lengths"}
    with pytest.raises(InputError, match=r"kind length.*found none"):
        design_poses(replace(experiment, instruments=without))
    with pytest.raises(InputError, match="known exactly; state 'uncertainty"):
        design_poses(replace(experiment, uncertainty={"anchor": 0.0, "attachment": 0.0}))
    with pytest.raises(InputError, match="expected 3 to 100, found 2"):
        design_poses(experiment, 2)
    alone = experiment.instruments | {"lengths": Length.model_validate({"kind": "length"})}
    with pytest.raises(InputError, match="expected the noise of its length"):
        design_poses(replace(experiment, instruments=alone))
    tense = replace(experiment.robot, tension_limits=(2000.0, 2100.0))
    with pytest.raises(InputError, match="found none; check that all cables are listed"):
        design_poses(replace(experiment, robot=tense))


SENSORS = """\
instruments:
  cables: {kind: tension, rate: 25, noise: 5.0}
  lengths: {kind: length, rate: 25, noise: 0.0005}
  tracker: {kind: position, rate: 25, target: [0.1, 0.2, 1.1], noise: 0.0005}
"""
EXPERIMENT = """\
format: steelyard/1
robot: cogiro
instruments:
  lengths: {kind: length, noise: 0.0005}
  command: {kind: command, noise: {position: 0.01, rotation: 0.01}}
runs:
  - {name: poses, static: true, command: poses.csv, lengths: lengths.csv}
"""


@pytest.mark.slow
def test_the_verb_writes_poses_that_an_experiment_reads(tmp_path):
    sensors = tmp_path / "sensors.yaml"
    sensors.write_text(SENSORS)
    out = tmp_path / "out"
    words = ["cogiro", "--calibration", "--poses", "6", "--sensors", str(sensors)]
    ran = CliRunner().invoke(app, ["design", *words, "--out", str(out)])
    assert ran.exit_code == 0, ran.output
    assert "6 poses at rest" in ran.stdout
    assert "Taken as exact" in ran.stdout
    assert {each.name for each in out.iterdir()} == {
        "poses.csv",
        "poses.json",
        "poses.html",
        "poses.md",
        "provenance.json",
    }
    found = json.loads((out / "poses.json").read_text())
    assert found["format"] == "steelyard-poses/1"
    assert len(found["poses"]) == 6
    assert np.shape(found["standard_deviation"]["anchors"]) == (8, 3)
    assert set(found["over_regular_grid"]) == {"anchors", "attachments"}
    lines = "\n".join([",".join(f"l{i + 1}" for i in range(8)), *["5" + ",5" * 7] * 6])
    (out / "lengths.csv").write_text(lines + "\n")
    (out / "experiment.yaml").write_text(EXPERIMENT)
    read = read_experiment(out / "experiment.yaml", weighed=False)
    # The plan and the record of it are the same description.
    plan = design_poses(out / "experiment.yaml", 6, settings=FEW)
    assert plan.experiment.uncertainty == read.uncertainty == {}
    place = read.runs[0].streams["command"].values["position"]
    np.testing.assert_allclose(place, [each["position"] for each in found["poses"]])


def test_options_of_a_motion_are_refused():
    for words in (["--duration", "20"], ["--check", "paper"], ["--target", "mass=1"]):
        ran = CliRunner().invoke(app, ["design", "cogiro", "--calibration", *words])
        assert isinstance(ran.exception, InputError)
        assert "leave it out" in str(ran.exception)
    ran = CliRunner().invoke(app, ["design", "cogiro", "--duration", "20", "--poses", "5"])
    assert "--poses: expected no such option" in ran.exception.on_command_line
