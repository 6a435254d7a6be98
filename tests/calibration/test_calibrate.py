"""The geometry of a robot from poses at rest: lengths and places of plain vector algebra."""

import json
from dataclasses import replace

import numpy as np
import pytest
from halls import NOISE, errors, recorded
from scipy.spatial.transform import Rotation

from steelyard.calibration.calibrate import calibrate
from steelyard.calibration.robot_text import robot_text
from steelyard.cli.verbs.calibrate import calibrate as calibrate_verb
from steelyard.errors import InputError
from steelyard.experiment.model import Experiment
from steelyard.experiment.read import read_experiment
from steelyard.experiment.recording import Run, Stream
from steelyard.experiment.write import write_experiment
from steelyard.identification.model.calibration_parameters import gather
from steelyard.instruments import Length, Position
from steelyard.report.documents.calibration import calibration_document
from steelyard.report.forms.markdown import markdown
from steelyard.report.write_calibration import write_calibration
from steelyard.robot.file import read_robot
from steelyard.robot.model import Robot


@pytest.mark.parametrize("m", [3, 4, 8, 12])
def test_anchors_and_attachments_are_found(m):
    experiment, true = recorded(m=m)
    found = calibrate(experiment)
    assert not found.reasons
    assert not found.unobservable
    off = errors(found, true)
    chi = off @ np.linalg.solve(found.covariance, off) / len(off)
    assert 0.5 < chi < 1.7
    assert np.abs(found.points["anchor"] - true.anchors).max() < 0.02
    assert np.nanmax(found.leave_one_out) < 2 * NOISE


@pytest.mark.slow
@pytest.mark.integration
def test_intervals_cover():
    chi = []
    for seed in range(12):
        experiment, true = recorded(seed)
        off = errors(found := calibrate(experiment), true)
        chi.append(off @ np.linalg.solve(found.covariance, off) / len(off))
    assert 0.8 < np.mean(chi) < 1.2


def test_a_drum_of_twice_the_size_is_found():
    experiment, true = recorded(scale=2.0)
    found = calibrate(experiment)
    assert not found.reasons
    places = found.found.parameters.places["lengths", "gain", None]
    np.testing.assert_allclose(found.found.calibration.values[places], 2.0, atol=0.01)
    assert np.abs(found.points["anchor"] - true.anchors).max() < 0.05


def test_a_row_that_is_wrong_is_named_and_left_out():
    experiment, true = recorded()
    (run,) = experiment.runs
    place = run.streams["tracker"].values["position"].copy()
    place[7, 0] += 0.1
    length = run.streams["lengths"].values["length"].copy()
    length[20, 3] -= 0.03
    streams = {
        **run.streams,
        "tracker": replace(run.streams["tracker"], values={"position": place}),
        "lengths": replace(run.streams["lengths"], values={"length": length}),
    }
    found = calibrate(replace(experiment, runs=(replace(run, streams=streams),)))
    lengths, tracker = sorted(found.found.wrong, key=lambda each: each.instrument)
    assert (lengths.row, lengths.channel) == (21, "l4")
    assert lengths.off == pytest.approx(-0.03, abs=0.005)
    assert (tracker.row, tracker.channel) == (8, "x")
    assert tracker.off == pytest.approx(0.1, abs=0.01)
    assert "row 21 of lengths: l4 is off by -0.0" in str(lengths)
    off = errors(found, true)
    assert off @ np.linalg.solve(found.covariance, off) / len(off) < 1.7


@pytest.mark.integration
def test_a_pose_that_was_typed_wrong_is_named():
    experiment, true = recorded()
    found = calibrate(_with(experiment, "tracker", "position", _typed_wrong))
    assert not found.reasons
    assert {(each.instrument, each.row) for each in found.found.wrong} == {("tracker", 6)}
    assert np.abs(found.points["anchor"] - true.anchors).max() < 0.02


def _typed_wrong(values):
    values[5] = [9.9, -3.0, 2.0]
    return values


def _with(experiment, name, quantity, change):
    (run,) = experiment.runs
    stream = run.streams[name]
    values = {**stream.values, quantity: change(stream.values[quantity].copy())}
    streams = {**run.streams, name: replace(stream, values=values)}
    return replace(experiment, runs=(replace(run, streams=streams),))


def _mirrored(robot):
    anchors = robot.anchors.copy()
    anchors[1, 1] *= -1
    return replace(robot, anchors=anchors)


MISTAKES = {
    "lengths in millimetres": lambda e: _with(e, "lengths", "length", lambda v: 1000 * v),
    "places in millimetres": lambda e: _with(e, "tracker", "position", lambda v: 1000 * v),
    "robot in millimetres": lambda e: replace(
        e,
        robot=replace(
            e.robot, anchors=1000 * e.robot.anchors, attachments=1000 * e.robot.attachments
        ),
    ),
    "order of the cables": lambda e: _with(
        e, "lengths", "length", lambda v: v[:, [1, 0, 2, 3, 4, 5, 6, 7]]
    ),
    "degrees for radians": lambda e: _with(
        e,
        "attitude",
        "orientation",
        lambda v: Rotation.from_rotvec(np.radians(Rotation.from_matrix(v).as_rotvec())).as_matrix(),
    ),
    "orientation the other way round": lambda e: _with(
        e, "attitude", "orientation", lambda v: v.transpose(0, 2, 1)
    ),
    "sign of the lengths": lambda e: _with(e, "lengths", "length", lambda v: -v),
    "axes of the tracker": lambda e: _with(e, "tracker", "position", lambda v: v[:, [0, 2, 1]]),
    "rows of another pose": lambda e: _with(
        e, "lengths", "length", lambda v: np.roll(v, 1, axis=0)
    ),
    "sign of a coordinate": lambda e: replace(e, robot=_mirrored(e.robot)),
}


def has_no_numbers(found):
    """Whether nothing of where the fit ended stands in what is written."""

    def leaves(entry):
        if isinstance(entry, dict | list):
            values = entry.values() if isinstance(entry, dict) else entry
            return [leaf for value in values for leaf in leaves(value)]
        return [entry]

    written = found.to_dict()
    keys = {"anchors", "attachments", "calibration", "axial_stiffness", "pulley_radius"}
    assert not [each for key in keys for each in leaves(written[key]) if each is not None]
    assert "body" not in written
    assert written["residuals"]["leave_one_out"] is None
    assert (written["gauge"], written["unobservable"]) == ([], [])
    text = robot_text(found)
    assert "The fit did not converge" in text
    assert all(
        "1-sigma not told, not told, not told" in line
        for line in text.splitlines()
        if "1-sigma" in line
    )
    drawn = found.experiment.robot
    assert np.array_equal(found.robot.anchors, drawn.anchors)
    assert "What has moved" not in markdown(calibration_document(found))
    return True


@pytest.mark.slow
@pytest.mark.integration
@pytest.mark.parametrize("off", [0.3, 0.05])
@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_rejected(mistake, off):
    experiment, _ = recorded(3, off=off)
    found = calibrate(MISTAKES[mistake](experiment))
    assert found.reasons
    assert not found.to_dict()["verdict"]["accepted"]
    assert found.arrived or has_no_numbers(found)
    if mistake == "order of the cables":
        assert "order of the cables" in " ".join(found.reasons)
    if "in millimetres" in mistake and not mistake.startswith("places"):
        assert "seem to be in millimetres" in found.reasons[0].replace("seems", "seem")
    if mistake == "sign of the lengths":
        assert "turn their signs" in " ".join(found.reasons)


def _point_on_four_lines(seed, order=(0, 1, 2, 3)):
    """Lengths in 44 poses of a point, and where it was in nine of them; no noise is stated."""
    rng = np.random.default_rng(seed)
    anchors = np.array([[0, -1.6, -0.1], [1.5, 0.9, -0.1], [-1.4, 0.8, -0.1], [0, 0, 2.3]])
    places = rng.uniform([-0.7, -0.7, 0], [0.7, 0.7, 1.2], (44, 3))
    lengths = np.linalg.norm(places[:, None] - anchors, axis=2)
    lengths += -np.linalg.norm(anchors, axis=1) + rng.normal(0, 5e-4, lengths.shape)
    places[9:] = np.nan
    robot = Robot("point", anchors + rng.normal(0, 0.1, (4, 3)), np.zeros((4, 3)))
    number = np.arange(44.0)
    exact = {"target": 0, "frame": {"position": 0, "rotation": 0}}
    return Experiment(
        "point",
        robot,
        {
            "lines": Length(kind="length", calibration={"gain": 0.02}),
            "place": Position(kind="position", calibration=exact),
        },
        (
            Run(
                "poses",
                {
                    "lines": Stream(number, {"length": lengths[:, order]}, "poses.csv"),
                    "place": Stream(number, {"position": places}, "poses.csv"),
                },
                static=True,
            ),
        ),
        uncertainty={"anchor": 0.3, "attachment": 0.0},
    )


@pytest.mark.integration
@pytest.mark.parametrize("order", [(1, 0, 2, 3), (0, 2, 1, 3), (3, 1, 2, 0), (1, 2, 0, 3)])
def test_cables_in_another_order_are_no_noise_of_few_places(order):
    # Nine places are few of 44 rows: leaving four of them out is no correction of rows, and places
    # whose noise nobody has stated may not be taken as known to decimetres instead.
    assert not calibrate(_point_on_four_lines(1)).reasons
    found = calibrate(_point_on_four_lines(1, order))
    assert "order of the cables" in " ".join(found.reasons)


def test_what_one_height_does_not_tell_is_null_and_named():
    experiment, _ = recorded(poses=6, flat=True, attitude=False)
    values = calibrate(experiment).to_dict()
    assert values["unobservable"]
    named = [each for each in values["unobservable"] if each.startswith("anchor.")]
    i, axis = named[0].split(".")[1:]
    assert values["anchors"]["value"][int(i) - 1]["xyz".index(axis)] is None
    assert values["anchors"]["standard_deviation"][int(i) - 1]["xyz".index(axis)] is None


def test_a_frame_that_nothing_ties_is_said():
    experiment, _ = recorded(attitude=False)
    found = calibrate(experiment)
    gauge = found.gauges["attachment"]
    assert "rotation about z" in gauge.untied
    assert "nothing ties the platform frame" in str(gauge)
    assert not found.gauges["anchor"].untied
    # The shape is told far better than the frame.
    sigma = found.deviations["attachment"]
    whole = np.sqrt(np.diag(found.covariance))[24:].reshape(-1, 3)
    assert np.median(sigma) < np.median(whole) / 2


def test_leaving_out_a_pose_is_a_fit_without_it():
    experiment, _ = recorded(poses=25)
    found = calibrate(experiment)
    (run,) = experiment.runs
    keep = np.arange(25) != 11
    streams = {
        name: replace(
            each,
            time=np.arange(24.0),
            values={key: value[keep] for key, value in each.values.items()},
        )
        for name, each in run.streams.items()
    }
    others = calibrate(replace(experiment, runs=(replace(run, streams=streams),)))
    # The pose, about the geometry of the others, which is exact now.
    held = replace(
        experiment,
        robot=replace(others.robot, covariance=None),
        uncertainty={"anchor": 0.0, "attachment": 0.0},
        instruments={
            **experiment.instruments,
            "lengths": Length.model_validate(
                {
                    "kind": "length",
                    "noise": NOISE,
                    "calibration": {
                        key: {
                            "value": tuple(
                                others.found.calibration.values[
                                    others.found.parameters.places["lengths", key, None]
                                ].tolist()
                            ),
                            "sigma": 0,
                        }
                        for key in ("offset", "gain")
                    },
                }
            ),
        },
    )
    alone = calibrate(held)
    (there,), (expected,) = found.found.left_out, alone.found.left_out
    np.testing.assert_allclose(there.residual[11], expected.residual[11], atol=0.05 * NOISE)


@pytest.mark.integration
def test_a_robot_that_was_calibrated_is_read_with_its_covariance(tmp_path):
    experiment, true = recorded()
    found = calibrate(experiment)
    write_calibration(found, tmp_path / "out")
    robot = read_robot(tmp_path / "out" / "robot.yaml")
    np.testing.assert_allclose(robot.anchors, found.robot.anchors, atol=1e-6)
    np.testing.assert_allclose(robot.covariance, found.covariance, rtol=1e-9, atol=1e-15)
    assert "# 1-sigma" in (tmp_path / "out" / "robot.yaml").read_text()
    parameters = gather(replace(experiment, robot=robot))
    place = parameters.places["robot", "anchor", None]
    np.testing.assert_allclose(np.linalg.inv(parameters.precision[place, place])[0, 0] > 0, True)
    # What it is told for the second time it knows better.
    again = calibrate(replace(experiment, robot=robot))
    assert np.median(again.deviations["anchor"]) < np.median(found.deviations["anchor"])
    (tmp_path / "copy").mkdir()
    write_experiment(replace(experiment, robot=robot), tmp_path / "copy")
    copied = read_experiment(tmp_path / "copy" / "experiment.yaml", weighed=False)
    np.testing.assert_allclose(copied.robot.covariance, robot.covariance, rtol=1e-9)
    assert true.m == copied.robot.m


@pytest.mark.integration
@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda text: "", "expected a table of a covariance"),
        (lambda text: text.replace("anchor.1.x", "anchor.9.x"), "a row and a column of anchor.1.x"),
        (lambda text: _with_cell(text, "x"), "expected numbers in all"),
        (lambda text: _with_cell(text, "-1.0"), "expected a covariance"),
    ],
)
def test_a_covariance_that_is_none_is_said(tmp_path, change, said):
    write_calibration(calibrate(recorded()[0]), tmp_path / "out")
    path = tmp_path / "out" / "robot.covariance.csv"
    path.write_text(change(path.read_text()))
    with pytest.raises(InputError) as error:
        read_robot(tmp_path / "out" / "robot.yaml")
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def _with_cell(text, cell):
    lines = text.splitlines()
    cells = lines[1].split(",")
    cells[1] = cell
    return "\n".join([lines[0], ",".join(cells), *lines[2:]])


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda e: replace(e, runs=()), "expected runs of poses at rest"),
        (
            lambda e: replace(
                e, runs=(replace(e.runs[0], streams={"tracker": e.runs[0].streams["tracker"]}),)
            ),
            "expected cable lengths",
        ),
    ],
)
def test_a_recording_that_tells_nothing_is_refused(change, said):
    with pytest.raises(InputError, match=said):
        calibrate(change(recorded()[0]))


def test_streams_of_other_numbers_of_rows_are_refused(tmp_path):
    experiment, _ = recorded()
    (run,) = experiment.runs
    tracker = run.streams["tracker"]
    short = replace(
        tracker, time=tracker.time[:-1], values={"position": tracker.values["position"][:-1]}
    )
    broken = replace(experiment, runs=(replace(run, streams={**run.streams, "tracker": short}),))
    with pytest.raises(InputError, match="39 of tracker"):
        calibrate(broken)
    (tmp_path / "in").mkdir()
    write_experiment(broken, tmp_path / "in")
    with pytest.raises(InputError, match=r"experiment\.yaml"):
        read_experiment(tmp_path / "in" / "experiment.yaml", weighed=False)


def test_the_verb_writes_all_of_it(tmp_path, capsys):
    (tmp_path / "in").mkdir()
    write_experiment(recorded()[0], tmp_path / "in")
    arguments = [str(tmp_path / "in" / "experiment.yaml"), "--out", str(tmp_path / "out"), "--json"]
    calibrate_verb.main([*arguments, "--quiet"], standalone_mode=False)
    printed = json.loads(capsys.readouterr().out)
    written = json.loads((tmp_path / "out" / "calibration.json").read_text())
    assert written.pop("provenance")["inputs"]
    assert printed == written
    assert printed["format"] == "steelyard-calibration/1"
    assert printed["verdict"]["accepted"]
    assert len(printed["residuals"]["leave_one_out"]) == 8
    names = sorted(each.name for each in (tmp_path / "out").iterdir())
    assert names == [
        "calibration.html", "calibration.json", "calibration.md", "provenance.json", "robot.covariance.csv", "robot.yaml",
    ]  # fmt: skip


@pytest.mark.integration
def test_a_calibration_that_is_not_accepted_ends_with_status_3(tmp_path):
    experiment, _ = recorded(off=0.05)
    (run,) = experiment.runs
    lengths = run.streams["lengths"]
    swapped = lengths.values["length"][:, ::-1]
    streams = {**run.streams, "lengths": replace(lengths, values={"length": swapped})}
    (tmp_path / "in").mkdir()
    write_experiment(replace(experiment, runs=(replace(run, streams=streams),)), tmp_path / "in")
    with pytest.raises(SystemExit) as end:
        calibrate_verb.main(
            [str(tmp_path / "in" / "experiment.yaml"), "--json", "--quiet"], standalone_mode=False
        )
    assert end.value.code == 3
