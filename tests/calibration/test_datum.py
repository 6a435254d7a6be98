"""What defines the world frame: shape and its uncertainty do not depend on it, the rest follows by
plain geometry."""

import json
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from halls import NOISE, errors, hung, recorded
from scipy.spatial.transform import Rotation

from steelyard.calibration.calibrate import calibrate
from steelyard.errors import InputError
from steelyard.experiment.model import Datum
from steelyard.experiment.read import read_experiment
from steelyard.experiment.recording import Stream
from steelyard.experiment.write import write_experiment
from steelyard.identification.model.calibration_parameters import gather
from steelyard.instruments import Command, Distance, Pose, Position
from steelyard.report.documents.calibration import calibration_document
from steelyard.report.write_calibration import write_calibration
from steelyard.robot.file import read_robot

THREE = Datum(anchors=(1, 3, 6))
WHERE, TURNED = 0.05, 0.02  # 1-sigma of a tracker that somebody has put up [m], [rad]


def put_up(seed, *, datum=None, m=8, command=True, **uncertainty):
    """A tracker of which nobody knows well where it stands, and the poses as they were commanded."""
    experiment, true = recorded(seed, m=m, attitude=False, **uncertainty)
    rng = np.random.default_rng(1000 + seed)
    (run,) = experiment.runs
    turned = Rotation.from_rotvec(TURNED * rng.standard_normal(3))
    origin = WHERE * rng.standard_normal(3)
    seen = turned.inv().apply(run.streams["tracker"].values["position"] - origin)
    seen = Stream(run.streams["tracker"].time, {"position": seen}, "tracker")
    # The same draw as in the hall: where the platform really was.
    again = np.random.default_rng(seed)
    again.standard_normal((m, 3))
    place = again.uniform([-2.5, -2, 1], [2.5, 2, 3], (len(seen), 3))
    R = Rotation.from_rotvec(again.uniform(-0.4, 0.4, (len(seen), 3))).as_matrix()
    streams = {**run.streams, "tracker": seen}
    commanded = Stream(seen.time, {"position": place, "orientation": R}, "command")
    streams |= {"command": commanded} if command else {}
    priors = {"target": 0, "frame": {"position": WHERE, "rotation": TURNED}}
    tracker = experiment.instruments["tracker"].model_copy(
        update={
            "calibration": Position.model_fields["calibration"].annotation.model_validate(priors)
        }
    )
    instruments = {
        **experiment.instruments,
        "tracker": tracker,
        "command": Command(kind="command"),
    }
    runs = (replace(run, streams=streams),)
    return replace(experiment, instruments=instruments, runs=runs, datum=datum), true


def distances(points, covariance):
    """Between all points, and their covariance, shapes (d,) and (d, d)."""
    pairs = list(combinations(range(len(points)), 2))
    J = np.zeros((len(pairs), 3 * len(points)))
    found = []
    for row, (i, j) in zip(J, pairs, strict=True):
        off = points[i] - points[j]
        found.append(np.linalg.norm(off))
        row[3 * i : 3 * i + 3], row[3 * j : 3 * j + 3] = off / found[-1], -off / found[-1]
    return np.array(found), J @ covariance @ J.T


@pytest.fixture(scope="module")
def one():
    return calibrate(put_up(0)[0])


def on(found, datum):
    """The same fit, in another world."""
    fit = replace(found.found, experiment=replace(found.experiment, datum=datum))
    return replace(found, found=fit)


DATUMS = [THREE, Datum(anchors=(2, 4, 5, 7, 8)), Datum(pose="poses")]


@pytest.mark.parametrize("datum", DATUMS)
def test_distances_do_not_depend_on_it(one, datum):
    m = len(one.points["anchor"])
    before, spread = distances(one.points["anchor"], one.covariance[: 3 * m, : 3 * m])
    moved = on(one, datum)
    after, there = distances(moved.points["anchor"], moved.covariance[: 3 * m, : 3 * m])
    np.testing.assert_allclose(after, before, rtol=1e-12)
    np.testing.assert_allclose(there, spread, rtol=1e-6, atol=1e-9 * spread.max())
    # Nor do those between an anchor and the tracker, or what is told in the platform.
    np.testing.assert_array_equal(moved.points["attachment"], one.points["attachment"])
    place = one.found.parameters.places["tracker", "frame.position", None]
    use = [*range(*one.found.parameters.places["robot", "anchor", None].indices(10**6)), *range(place.start, place.stop)]  # fmt: skip
    both = [
        distances(each.placed.values[use].reshape(-1, 3), each.placed.covariance[np.ix_(use, use)])
        for each in (one, moved)
    ]
    np.testing.assert_allclose(both[1][0], both[0][0], rtol=1e-12)
    np.testing.assert_allclose(np.diag(both[1][1]), np.diag(both[0][1]), rtol=1e-5)


def nearest(points, drawn):
    """The rigid motion by singular values [Kabsch1976]."""
    centre, middle = drawn.mean(axis=0), points.mean(axis=0)
    U, _, V = np.linalg.svd((points - middle).T @ (drawn - centre))
    R = V.T @ np.diag([1, 1, np.linalg.det(V.T @ U.T)]) @ U.T
    return R, centre - R @ middle


def test_anchors_of_the_datum_are_nearest_and_have_the_covariance_of_that(one):
    moved, own = on(one, THREE), np.array(THREE.anchors) - 1
    drawn, points = one.experiment.robot.anchors, one.points["anchor"]

    def expected(flat):
        each = flat.reshape(-1, 3)
        R, t = nearest(each[own], drawn[own])
        return (each @ R.T + t).ravel()

    np.testing.assert_allclose(moved.points["anchor"].ravel(), expected(points.ravel()), atol=1e-12)
    # By differences of the singular values' answer.
    step = 1e-6
    J = np.stack(
        [
            (expected(points.ravel() + step * e) - expected(points.ravel() - step * e)) / (2 * step)
            for e in np.eye(points.size)
        ],
        axis=1,
    )
    C = one.covariance[: points.size, : points.size]
    there = moved.covariance[: points.size, : points.size]
    np.testing.assert_allclose(there, J @ C @ J.T, rtol=1e-5, atol=1e-6 * there.max())
    # Three points have three distances: six of nine motions are none of theirs.
    rows = (3 * own[:, None] + np.arange(3)).ravel()
    values = np.linalg.eigvalsh(there[np.ix_(rows, rows)])
    assert values[5] < 1e-9 * values[6]


def test_the_sigma_of_points_on_the_datum_is_that_of_their_distances():
    """A triangle in its own plane: moments of the classical free network by plain algebra."""
    found = on(calibrate(put_up(3)[0]), THREE)
    own = np.array(THREE.anchors) - 1
    drawn = found.experiment.robot.anchors[own]
    rows = (3 * own[:, None] + np.arange(3)).ravel()
    points = found.points["anchor"][own]
    _, spread = distances(points, found.covariance[np.ix_(rows, rows)])
    # Nearest to those drawn: of all moves that give these distances the one without a rigid motion.
    J = np.zeros((3, 9))
    for row, (i, j) in zip(J, combinations(range(3), 2), strict=True):
        off = (points[i] - points[j]) / np.linalg.norm(points[i] - points[j])
        row[3 * i : 3 * i + 3], row[3 * j : 3 * j + 3] = off, -off
    inner = np.zeros((6, 9))
    for k, point in enumerate(drawn - drawn.mean(axis=0)):
        inner[:3, 3 * k : 3 * k + 3] = np.eye(3)
        inner[3:, 3 * k : 3 * k + 3] = np.cross(np.eye(3), point).T
    back = np.linalg.inv(np.concatenate([J, inner]))[:, :3]
    expected = back @ spread @ back.T
    np.testing.assert_allclose(
        found.covariance[np.ix_(rows, rows)], expected, rtol=1e-4, atol=1e-4 * expected.max()
    )


@pytest.mark.slow
@pytest.mark.integration
def test_intervals_about_a_pose_cover():
    chi, better = [], []
    for seed in range(10):
        # Of a platform that is well known, one pose says where the world is.
        experiment, true = put_up(seed, attachment=1e-3)
        without = calibrate(experiment)
        found = on(without, Datum(pose="poses"))
        off = errors(found, true)
        chi.append(off @ np.linalg.solve(found.covariance, off) / len(off))
        sigma = [each.deviations["anchor"].mean() for each in (without, found)]
        better.append(sigma[1] / sigma[0])
    print(
        f"chi-square over its freedom {np.mean(chi):.2f}, 1-sigma {np.mean(better):.2f} of before"
    )
    assert 0.8 < np.mean(chi) < 1.25
    assert np.mean(better) < 0.6


def test_the_first_pose_is_as_it_was_commanded(one):
    """By plain geometry: lengths from the commanded place to the anchors of the new world."""
    found = on(one, Datum(pose="poses"))
    (run,) = one.experiment.runs
    R, p = (run.streams["command"].values[key][0] for key in ("orientation", "position"))
    tips = p + found.points["attachment"] @ R.T
    length = np.linalg.norm(found.points["anchor"] - tips, axis=1)
    places = one.found.parameters.places
    offset = found.placed.values[places["lengths", "offset", None]]
    gain = found.placed.values[places["lengths", "gain", None]]
    seen = run.streams["lengths"].values["length"][0]
    np.testing.assert_allclose(gain * length + offset, seen, atol=5 * NOISE)


@pytest.mark.integration
def test_a_pose_instrument_says_it_where_there_is_no_command():
    experiment, _ = put_up(1)
    (run,) = experiment.runs
    streams = {name: each for name, each in run.streams.items() if name != "command"}
    seen = replace(run.streams["command"], values=dict(run.streams["command"].values))
    # In a frame of its own, with its target beside the origin of the platform.
    R = Rotation.from_euler("ZYX", [90, 20, 0], degrees=True)
    target, origin = np.array([0.3, -0.2, 0.5]), np.array([1.0, 2.0, 0.5])
    turned = seen.values["orientation"]
    seen.values["position"] = R.inv().apply(seen.values["position"] + turned @ target - origin)
    seen.values["orientation"] = R.inv().as_matrix() @ turned
    camera = Pose.model_validate(
        {
            "kind": "pose",
            "position": tuple(target),
            "frame": {"position": tuple(origin), "rpy_deg": (0.0, 20.0, 90.0)},
            "noise": {"position": 0.5, "rotation": 0.2},
        }
    )
    one = replace(
        experiment,
        instruments={**experiment.instruments, "camera": camera},
        runs=(replace(run, streams={**streams, "camera": seen}),),
        datum=Datum(pose="poses"),
    )
    by_command = calibrate(replace(experiment, datum=Datum(pose="poses")))
    by_camera = calibrate(one)
    assert "as camera says" in by_camera.placed.words
    off = by_camera.points["anchor"] - by_command.points["anchor"]
    assert (np.abs(off) < 0.5 * by_command.deviations["anchor"]).all()


def test_without_either_it_is_refused():
    experiment, _ = put_up(1, command=False)
    with pytest.raises(InputError, match="expected a command or an instrument of kind 'pose'"):
        calibrate(replace(experiment, datum=Datum(pose="poses")))


@pytest.mark.slow
@pytest.mark.integration
def test_gravity_and_rollers_turn_with_the_world():
    experiment, _ = hung(2)
    experiment = replace(experiment, datum=THREE)
    found = calibrate(experiment)
    R = found.placed.rotation
    assert np.abs(R - np.eye(3)).max() > 1e-5
    np.testing.assert_allclose(found.robot.gravity, R @ [0, 0, -9.81], atol=1e-12)
    np.testing.assert_allclose(found.robot.pulley_axis, np.tile(R[:, 2], (8, 1)), atol=1e-12)
    # The angle between gravity and what the anchors span is told, in any world.
    without = on(found, None)

    def down(each):
        a = each.points["anchor"]
        normal = np.cross(a[2] - a[0], a[5] - a[0])
        return normal @ each.robot.gravity / np.linalg.norm(normal)

    assert down(found) == pytest.approx(down(without), rel=1e-9)


def test_anchors_that_are_exact_are_that_already():
    experiment, _ = recorded(anchor=0.0)
    found = calibrate(replace(experiment, datum=THREE))
    np.testing.assert_allclose(found.points["anchor"], experiment.robot.anchors, atol=1e-12)
    assert not found.deviations["anchor"].any()


def test_it_is_said_in_words(tmp_path, one):
    found = on(one, THREE)
    said = (
        "the world frame is that in which anchors 1, 3 and 6 are nearest to those of the robot file"
    )
    values = found.to_dict()
    assert values["gauge"][0].startswith(said)
    world = values["datum"]["world_from_described"]
    R, t = nearest(one.points["anchor"][[0, 2, 5]], one.experiment.robot.anchors[[0, 2, 5]])
    np.testing.assert_allclose(world["translation"]["value"], t, atol=1e-12)
    np.testing.assert_allclose(
        world["rotation"]["value"], Rotation.from_matrix(R).as_rotvec(), atol=1e-12
    )
    assert "datum" not in one.to_dict()
    write_calibration(found, tmp_path / "out")
    assert json.loads((tmp_path / "out" / "calibration.json").read_text()) == values
    assert said in (tmp_path / "out" / "robot.yaml").read_text()
    # The next calibration begins with what these three leave of the world.
    robot = read_robot(tmp_path / "out" / "robot.yaml")
    again = gather(replace(one.experiment, robot=robot, datum=None))
    assert np.linalg.eigvalsh(again.precision).min() > -1e-6
    assert said[4:] in str(calibration_document(found))
    pose = on(one, Datum(pose="poses")).to_dict()["gauge"][0]
    assert "that in which the first pose of run 'poses' is as command says (datum)" in pose


@pytest.mark.integration
def test_a_tracker_whose_place_was_exact_has_one_in_the_new_world():
    experiment, _ = recorded()
    found = calibrate(replace(experiment, datum=THREE))
    frame = found.to_dict()["calibration"]["tracker"]["frame"]
    np.testing.assert_allclose(frame["position"]["value"], found.placed.translation, atol=1e-12)
    assert min(frame["position"]["standard_deviation"]) > 0
    assert "frame" not in calibrate(experiment).to_dict()["calibration"].get("tracker", {})


def test_a_plane_of_the_world_is_refused():
    experiment, _ = recorded()
    (run,) = experiment.runs
    laser = Distance.model_validate(
        {"kind": "distance", "noise": 0.01, "plane": {"normal": (0, 0, 1), "offset": 0.0}}
    )
    height = run.streams["tracker"].values["position"][:, 2:]
    streams = {
        **run.streams,
        "laser": Stream(run.streams["tracker"].time, {"distance": height}, ""),
    }
    experiment = replace(
        experiment,
        instruments={**experiment.instruments, "laser": laser},
        runs=(replace(run, streams=streams),),
        datum=THREE,
    )
    with pytest.raises(InputError, match="expected no instrument of kind 'distance'"):
        calibrate(experiment)


def test_the_file_is_read_and_written(tmp_path):
    for datum in (THREE, Datum(pose="poses")):
        folder = tmp_path / str(datum.pose)
        folder.mkdir()
        write_experiment(put_up(0, datum=datum)[0], folder)
        assert read_experiment(folder / "experiment.yaml", weighed=False).datum == datum


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ("{anchors: [1, 2, 9]}", "expected numbers of the 8 cables of the robot, from 1, found 9"),
        ("{anchors: [1, 2, 0]}", "found 0"),
        ("{anchors: [1, 2]}", "expected at least three anchors that are on no line"),
        ("{anchors: []}", "found none"),
        ("{anchors: [1, 2, 2]}", "expected each anchor once, found 2 twice"),
        ("{anchors: [1, 2, x]}", "datum.anchors"),
        ("{pose: pose}", "expected the name of a run of poses at rest, found 'pose'; known here"),
        ("{pose: poses, anchors: [1, 2, 3]}", "expected one of the keys 'anchors' and 'pose'"),
        ("{}", "expected one of the keys 'anchors' and 'pose', found none"),
        ("{points: [1, 2, 3]}", "points"),
    ],
)
def test_what_is_no_datum_is_said(tmp_path, entry, said):
    write_experiment(put_up(0)[0], tmp_path)
    path = tmp_path / "experiment.yaml"
    path.write_text(path.read_text() + f"datum: {entry}\n")
    with pytest.raises(InputError) as error:
        read_experiment(path, weighed=False)
    assert said in str(error.value)
    assert "\n" not in str(error.value)
