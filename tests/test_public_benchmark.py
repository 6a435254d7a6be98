"""The public benchmark: its scorer against cases by hand, its generator, and an example of a method."""

import importlib
import json
import sys
from dataclasses import replace

import numpy as np
import pytest
from places import ROOT
from scipy.spatial.transform import Rotation

from steelyard.robot.kinematics import cables_at
from steelyard.robot.model import CableProperties, Robot

HOME = ROOT / "benchmarks" / "public"
TRUTH = [10.0, 0.1, 0.0, 0.0, 2.0, 2.0, 1.0, 0.0, 0.0, 0.0]


@pytest.fixture
def public(monkeypatch):
    """Imports a module of the benchmark, whose folder is no package."""
    monkeypatch.syspath_prepend(str(HOME))
    names = ("score", "recording", "robots", "simulator", "generate", "run")
    yield importlib.import_module
    for name in [*names, *(each for each in sys.modules if each.split(".")[0] == "peers")]:
        sys.modules.pop(name, None)


def result(**keys):
    plain = {
        "format": "cable-robot-benchmark/1", "method": "by hand", "recording": "robot/plain-00",
        "data": "full", "value": TRUTH, "covariance": np.eye(10).tolist(), "accepted": None,
        "seconds": 2.0, "failure": None,
    }  # fmt: skip
    return {**plain, **keys}


def test_errors_of_a_body_by_hand(public):
    score = public("score")
    value = [10.1, 0.1, 0.05, 0.0, 2.0, 2.0, 1.0, 0.3, 0.0, 0.0]
    found = score.score_one(result(value=value), TRUTH)
    assert found["error"]["mass"] == pytest.approx(0.01)
    # Radius of gyration sqrt((2 + 2 + 1) / 2 / 10) = .5 m.
    assert found["error"]["center_of_gravity"] == pytest.approx(0.1)
    # .3 stands twice in a matrix whose norm is 3.
    assert found["error"]["inertia"] == pytest.approx(0.3 * np.sqrt(2) / 3)


def test_chi_square_and_intervals_by_hand(public):
    score = public("score")
    value = list(TRUTH)
    value[0] += 3.0
    value[4] += 12.0
    variance = np.eye(10)
    variance[4, 4] = 4.0
    found = score.score_one(result(value=value, covariance=variance.tolist()), TRUTH)
    assert found["chi_square"] == pytest.approx(9.0 + 36.0)
    assert (found["inside"], found["intervals"], found["far"]) == (8, 10, 1)


def test_correlation_counts_in_chi_square(public):
    score = public("score")
    value = list(TRUTH)
    value[0] += 1.0
    value[4] += 1.0
    covariance = np.eye(10)
    covariance[0, 4] = covariance[4, 0] = 0.5
    found = score.score_one(result(value=value, covariance=covariance.tolist()), TRUTH)
    # (1, 1) [[1, .5], [.5, 1]]^-1 (1, 1)^T = 4/3
    assert found["chi_square"] == pytest.approx(4 / 3)


def test_null_is_neither_an_error_nor_an_interval(public):
    score = public("score")
    value = [10.0, None, 0.0, 0.0, 2.0, 2.0, 1.0, 0.0, 0.0, 0.0]
    rows = [[None if 1 in (i, j) else float(i == j) for j in range(10)] for i in range(10)]
    found = score.score_one(result(value=value, covariance=rows), TRUTH)
    assert found["given"] == found["intervals"] == found["freedom"] == 9
    assert found["error"]["center_of_gravity"] is None
    assert found["error"]["mass"] == 0.0


@pytest.mark.parametrize("covariance", [None, (-np.eye(10)).tolist(), np.zeros((10, 10)).tolist()])
def test_without_a_usable_covariance_there_are_errors_alone(public, covariance):
    found = public("score").score_one(result(covariance=covariance), TRUTH)
    assert found["chi_square"] is None
    assert found["intervals"] == 0
    assert found["error"]["mass"] == 0.0


def test_summary_counts_failures_verdicts_and_confident_wrong_numbers(public):
    score = public("score")
    wrong = [TRUTH[0] + 6.0, *TRUTH[1:]]
    scores = []
    for given in (
        result(accepted=True),
        result(value=wrong, accepted=True),
        result(value=wrong, accepted=False),
        result(value=[None] * 10, covariance=None, failure="it could not"),
    ):
        keys = ("accepted", "seconds", "failure")
        scores.append({**score.score_one(given, TRUTH), **{key: given[key] for key in keys}})
    found = score.summary(scores)
    assert (found["recordings"], found["failed"], found["rejected"]) == (4, 1, 1)
    assert (found["far"], found["far_unrejected"]) == (2, 1)
    assert found["coverage"] == pytest.approx(28 / 30)
    assert found["chi_square"] == pytest.approx(3.6)
    assert found["error"]["mass"] == pytest.approx(0.6)
    assert found["null"] == 0.0
    assert found["seconds"] == 2.0


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"format": "else"}, "expected format"),
        ({"value": [1.0]}, "expected 10 numbers or nulls, found 1"),
        ({"covariance": [[1.0]]}, "expected 10 rows of 10"),
        ({"method": ...}, "expected the keys method"),
    ],
)
def test_what_has_not_the_form_is_refused_in_one_sentence(public, tmp_path, capsys, change, words):
    given = {key: each for key, each in result(**change).items() if each is not ...}
    (tmp_path / "a.json").write_text(json.dumps(given), encoding="utf-8")
    assert public("score").main([str(tmp_path), str(tmp_path)]) == 2
    said = capsys.readouterr().err
    assert words in said
    assert len(said.splitlines()) == 1


@pytest.mark.mujoco
def test_list_of_checksums_is_that_of_the_default_plan(public):
    generate = public("generate")
    names = {line.split("  ")[1] for line in (HOME / "checksums.sha256").read_text().splitlines()}
    planned = {f"{robot}/{key}-{number:02d}" for robot, key, number in generate.plan(1)}
    assert {
        each.removeprefix("truth/").removesuffix(".json") for each in names if "truth" in each
    } == planned
    assert all(f"{each}/cables.csv" in names for each in planned)


@pytest.mark.mujoco
def test_friction_builds_up_to_one_and_turns(public):
    travel = np.concatenate([np.linspace(0, 0.1, 200), np.linspace(0.1, 0.0, 200)])[:, None]
    state = public("generate").rolled(travel, 0.005)
    assert state[199, 0] == pytest.approx(1.0, abs=1e-8)
    assert state[-1, 0] == pytest.approx(-1.0, abs=1e-8)
    # The exact law of Dahl after 10 mm of 5 mm: 1 - exp(-2).
    assert np.interp(0.01, travel[:200, 0], state[:200, 0]) == pytest.approx(
        1 - np.exp(-2), rel=1e-3
    )


@pytest.mark.mujoco
def test_example_method_from_a_recording_to_the_table(public, tmp_path, monkeypatch):
    """A recording of a second, through the files, the example and the scorer."""
    generate, run, score = (public(name) for name in ("generate", "run", "score"))
    monkeypatch.setattr(public("simulator"), "SETTLING", 1.0)
    robot = generate.ROBOTS["cogiro"]
    robot = replace(robot, reach=robot.reach / 20)
    name = "cogiro/plain-00"
    made = generate.recorded(robot, generate.CONDITIONS["plain"], name, 5, duration=1.0)
    generate.write(made, tmp_path / name, tmp_path / "truth" / f"{name}.json")
    # What Newton and Euler say of the friendlier version, but for noise, offsets and biases.
    platform = public("recording").read_platform(tmp_path / name)
    mean_force = platform.wrench[:, :3] / robot.mass - platform.specific_force
    assert np.abs(mean_force.mean(axis=0)).max() < 0.4
    attitude = Rotation.from_quat(platform.quaternion, scalar_first=True)
    up = attitude.apply(platform.specific_force).mean(axis=0)
    assert up == pytest.approx([0.0, 0.0, 9.81], abs=1.0)
    found = run.result_of(HOME / "example_method.py", tmp_path, name)
    assert found["failure"] is None
    (tmp_path / "results").mkdir()
    (tmp_path / "results" / "a.json").write_text(json.dumps(found), encoding="utf-8")
    scored = score.score(score.read_results(tmp_path / "results"), tmp_path / "truth")
    own = scored["example: weighing at rest (NumPy) [platform]"]["cogiro"]
    assert own["null"] == pytest.approx(0.6)
    assert own["error"]["mass"] < 0.1
    assert "example: weighing" in score.markdown(scored)


def cables_of(public, condition):
    """CoGiRo, and its cables in a condition of the benchmark."""
    robots = public("robots")
    robot, own = robots.ROBOTS["cogiro"], robots.CONDITIONS[condition]
    return robot, public("simulator").Cables.of(robot, own, robot.anchors, robot.attachments)


def as_the_package_has_it(robot, cables):
    """The same robot in the terms of the package."""
    m = len(robot.anchors)
    return Robot(
        name=robot.name,
        anchors=robot.anchors,
        attachments=robot.attachments,
        pulley_radius=np.full(m, cables.roller_radius),
        pulley_axis=np.tile([0.0, 0.0, 1.0], (m, 1)),
        gravity=np.array([0.0, 0.0, -9.81]),
        cable=CableProperties(
            diameter=0.003,
            axial_stiffness=robot.axial_stiffness,
            linear_density=cables.linear_density or None,
        ),
    )


@pytest.fixture
def simulator(public):
    return public("simulator")


@pytest.mark.mujoco
def test_cables_leave_their_rollers_as_the_package_has_it(public, simulator):
    robot, cables = cables_of(public, "rollers")
    rng = np.random.default_rng(1)
    position = robot.center + rng.normal(0, 0.5, (20, 3))
    rotation = Rotation.from_rotvec(rng.normal(0, 0.2, (20, 3))).as_matrix()
    ends = position[:, None] + np.einsum("nij,mj->nmi", rotation, robot.attachments)
    leave, rolled_up = cables.leaving(ends)
    own = simulator.structure_of(leave, robot.attachments, position, rotation)
    ours = cables_at(
        as_the_package_has_it(robot, cables), position, rotation, np.full((20, 8), 600.0)
    ).structure
    world = np.einsum("nij,nkjm->nkim", rotation, ours.reshape(20, 2, 3, 8)).reshape(own.shape)
    np.testing.assert_allclose(own, world, atol=1e-12)
    # What lies on the roller and the straight part follow the end as the straight part alone does.
    step = 1e-6
    for axis in np.eye(3):
        longer = [
            rolled + np.linalg.norm(away - there, axis=2)
            for there in (ends + step * axis, ends - step * axis)
            for away, rolled in [cables.leaving(there)]
        ]
        slope = (longer[0] - longer[1]) / (2 * step)
        along = (ends - leave) / np.linalg.norm(ends - leave, axis=2, keepdims=True)
        np.testing.assert_allclose(slope, along @ axis, atol=1e-8)
    assert rolled_up.min() > 0.06 * np.pi / 2


@pytest.mark.slow
@pytest.mark.mujoco
def test_cables_with_weight_hang_and_vibrate_as_strings_do(public, simulator):
    robot, cables = cables_of(public, "heavy-cables")
    springs = simulator.Springs(robot, cables)
    model, data = springs.model, springs.data
    data.qpos[:3], data.qpos[3] = robot.center, 1.0
    fed = simulator.fed_lengths(robot, cables, np.concatenate([robot.center, np.zeros(3)])[None])[0]
    springs.fed(fed, np.zeros(8))
    simulator.mujoco.mj_step(model, data, nstep=16_000)
    tension, last = springs.seen(fed, np.zeros(8))
    position = data.qpos[None, :3].copy()
    rotation = Rotation.from_quat(data.qpos[3:7], scalar_first=True).as_matrix()[None]
    own = simulator.structure_of(last.reshape(1, 8, 3), robot.attachments, position, rotation)[0]
    catenary = cables_at(
        as_the_package_has_it(robot, cables), position, rotation, tension[None]
    ).structure[0]
    world = (rotation @ catenary.reshape(2, 3, 8)).reshape(own.shape)
    np.testing.assert_allclose(own, world, atol=1e-5)
    # It does not move, and forces bear its weight and that of half of the cables.
    assert (own @ tension)[2] == pytest.approx(9.81 * robot.mass, rel=1e-4)
    # The first cable is plucked: the frequency of a string of its length, weight and tension.
    springs.damped([0.0] * 6, 0.0)
    data.qvel[:] = 0.0
    shape = np.sin(np.pi * (np.arange(simulator.MASSES) + 0.5) / simulator.MASSES)
    data.qvel[6 : 6 + 3 * simulator.MASSES : 3] = 0.5 * shape
    seen = []
    for _ in range(8000):
        simulator.mujoco.mj_step(model, data)
        seen.append(data.qpos[7 + 3 * (simulator.MASSES // 2)])
    size = np.abs(np.fft.rfft((np.array(seen) - np.mean(seen)) * np.hanning(len(seen)), 2**17))
    frequency = np.fft.rfftfreq(2**17, model.opt.timestep)[np.argmax(size)]
    string = np.sqrt(tension[0] / cables.linear_density) / (2 * fed[0])
    assert frequency == pytest.approx(string, rel=0.03)


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.mujoco
@pytest.mark.parametrize("condition", ["plain", "rollers", "heavy-cables"])
def test_the_cables_move_the_body(public, simulator, condition):
    """By Newton and Euler: forces of hundreds of newtons leave a hundredth of one."""
    robot, cables = cables_of(public, condition)
    # Far from slack: cables that come tight again jerk.
    robot = replace(robot, reach=robot.reach / 4)
    moved = simulator.taut(robot, cables, 2.0, np.random.default_rng(1))
    at = moved.at(np.arange(0.1, 1.9, simulator.SEEN * 5))
    structure = simulator.structure_of(at.leave, robot.attachments, at.position, at.rotation)
    wrench = np.einsum("nkm,nm->nk", structure, at.tension).reshape(-1, 2, 3)
    force, torque = np.einsum("nji,nkj->nki", at.rotation, wrench).transpose(1, 0, 2)
    c, J = robot.center_of_gravity, robot.inertia
    needed = robot.mass * (
        at.specific_force + np.cross(at.alpha, c) + np.cross(at.omega, np.cross(at.omega, c))
    )
    spin = at.alpha @ J + np.cross(at.omega, at.omega @ J)
    np.testing.assert_allclose(force, needed, atol=0.01)
    np.testing.assert_allclose(torque, spin + np.cross(c, needed), atol=0.01)


@pytest.mark.slow
@pytest.mark.mujoco
def test_the_friendlier_version_is_off_by_one_constant_wrench(public):
    """By Newton and Euler, with gains and offsets of cells but nearly no noise."""
    generate = public("generate")
    robot, condition = generate.ROBOTS["cogiro"], generate.CONDITIONS["rough"]
    nothing = dict.fromkeys(
        ["tension", "angular_velocity", "specific_force", "gyro_bias", "accelerometer_bias"], 1e-9
    )
    robot = replace(robot, sensing=replace(robot.sensing, **nothing))
    made = generate.recorded(robot, condition, "cogiro/rough-00", 5, duration=4.0)
    header, values = made.tables["platform.csv"]
    column = dict(zip(header.split(","), values.T, strict=True))
    t, omega, at_origin, force, torque = (
        np.column_stack([column[key] for key in keys.split()])
        for keys in ("t", "wx wy wz", "ax ay az", "fx fy fz", "tx ty tz")
    )
    alpha, c = np.gradient(omega, t[:, 0], axis=0), robot.center_of_gravity
    at_center = at_origin + np.cross(alpha, c) + np.cross(omega, np.cross(omega, c))
    spin = alpha @ robot.inertia + np.cross(omega, omega @ robot.inertia)
    off = np.hstack(
        [
            force - robot.mass * at_center,
            torque - spin - np.cross(c, robot.mass * at_center),
        ]
    )[10:-10]
    assert np.abs(off.mean(axis=0)).max() > 1.0
    # Accelerations are differences of rates, which cables of 500 kN make vibrate.
    assert off.std(axis=0).max() < 0.3


def test_example_method_is_short():
    assert len((HOME / "example_method.py").read_text().splitlines()) < 45


def test_method_that_fails_says_so(public, tmp_path):
    file = tmp_path / "bad.py"
    file.write_text(
        "NAME, DATA = 'bad', 'full'\ndef estimate(folder):\n    raise ValueError('no')\n"
    )
    found = public("run").result_of(file, tmp_path, "robot/plain-00")
    assert found["failure"] == "ValueError: no"
    assert found["value"] == [None] * 10
