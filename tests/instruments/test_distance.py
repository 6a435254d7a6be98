"""A distance to a plane: one instrument in one file, in everything that reads instruments."""

import json

import numpy as np
import pytest
from jsonschema import Draft202012Validator
from mistaken import vector
from recordings import write_small
from scipy.spatial.transform import Rotation
from scipy.stats import chi2
from simulated import PAPER, RECORDER, ROBOT, TRUTH

from steelyard.clocks.clock_signals import clocks_of
from steelyard.clocks.offsets import joined
from steelyard.errors import InputError
from steelyard.experiment.read import read_experiment
from steelyard.experiment.schema import schema
from steelyard.files.yaml_file import read_yaml
from steelyard.identification.methods.maximum_likelihood import MaximumLikelihood
from steelyard.inspection.agreements.excerpt import excerpts
from steelyard.inspection.agreements.judgement import judged
from steelyard.inspection.inspect import inspect
from steelyard.inspection.mistakes.search import mistakes
from steelyard.instruments import Distance
from steelyard.instruments.equations import linearised, predict, term_columns
from steelyard.motion.state import State

N = 9
DIFFERENCE = 1e-6  # step of central differences
DIFFERENCED = 1e-8  # what such differences of numbers near one are right to
KEYS = {
    "kind": "distance",
    "point": (0.3, 0.1, -0.2),
    "plane": {"normal": (0.0, 1.0, -2.0), "offset": 0.5},
    "rate": 50.0,
    "noise": 0.002,
}
LASER = Distance.model_validate(KEYS)
FLOOR = Distance.model_validate(
    {
        **KEYS,
        "plane": {"normal": (0, 0, 3), "offset": -0.4},
        "calibration": {"offset": 0.02, "delay": 0.01},
    }
)
ERRORS = {"offset": np.array([0.03]), "target": np.array([0.02, -0.01, 0.04])}


@pytest.fixture
def motion():
    """Pose and its derivatives, shape (n, 7) each."""
    rng = np.random.default_rng(3)
    pose = np.hstack([rng.normal(0, 2, (N, 3)), rng.normal(0, 1, (N, 4))])
    return pose, rng.normal(0, 1, (N, 7)), rng.normal(0, 3, (N, 7))


def state_of(pose):
    """Of poses at rest."""
    nothing = np.zeros((N, 3))
    return State(
        position=pose[:, :3],
        rotation=Rotation.from_quat(pose[:, 3:], scalar_first=True).as_matrix(),
        velocity=nothing,
        omega=nothing,
        specific_force=nothing,
        alpha=nothing,
        tension=None,
        wrench=None,
        gravity=ROBOT.gravity,
    )


def least_distance(pose):
    """Length of the shortest way from the plane to the point, by its nearest one of the plane; the
    plane is spanned from three of its points."""
    normal, offset = np.array([0.0, 1.0, -2.0]), 0.5
    foot = offset * normal / np.linalg.norm(normal)
    along = np.linalg.svd(normal[None])[2][1:]
    found = []
    for row in pose:
        R = Rotation.from_quat(row[3:], scalar_first=True).as_matrix()
        away = row[:3] + R @ (np.array([0.3, 0.1, -0.2]) + ERRORS["target"]) - foot
        nearest, *_ = np.linalg.lstsq(along.T, away)
        straight = away - along.T @ nearest
        found.append(np.sign(straight @ normal) * np.linalg.norm(straight))
    return np.array(found)[:, None] + ERRORS["offset"]


def test_the_reading_is_the_way_to_the_nearest_point_of_the_plane(motion):
    found = predict(LASER, ROBOT, state_of(motion[0]), ERRORS)["distance"]
    np.testing.assert_allclose(found, least_distance(motion[0]), atol=1e-12)
    assert (found > 0).any()
    assert (found < 0).any()


def test_the_length_of_the_normal_does_not_matter(motion):
    longer = Distance.model_validate(
        {**KEYS, "plane": {"normal": (0.0, 7.0, -14.0), "offset": 0.5}}
    )
    one, other = (
        predict(each, ROBOT, state_of(motion[0]), ERRORS)["distance"] for each in (LASER, longer)
    )
    np.testing.assert_allclose(other, one, atol=1e-12)


def test_derivatives_are_those_of_differences(motion):
    errors = np.concatenate(list(ERRORS.values()))
    measured = np.zeros((N, 1))
    found = linearised(LASER, "distance", ROBOT, measured, motion, errors, ROBOT.gravity)
    np.testing.assert_allclose(found["residual"], -least_distance(motion[0]), atol=1e-12)
    for j in range(7):
        step = np.zeros(7)
        step[j] = DIFFERENCE
        ahead, behind = (least_distance(motion[0] + sign * step) for sign in (1, -1))
        slope = (behind - ahead) / (2 * DIFFERENCE)
        np.testing.assert_allclose(found["by_pose"][:, :, j], slope, atol=DIFFERENCED)
    assert not found["by_rate"].any()
    assert not found["by_acceleration"].any()


def test_columns_of_its_errors_are_those_of_differences(motion):
    state = state_of(motion[0])
    found = term_columns(LASER, "distance", ROBOT, state)
    assert {key: each.shape for key, each in found.items()} == {
        "offset": (N, 1, 1),
        "target": (N, 1, 3),
    }
    zero = {key: np.zeros_like(value) for key, value in ERRORS.items()}
    for key, columns in found.items():
        for j in range(columns.shape[2]):
            step = np.zeros(columns.shape[2])
            step[j] = DIFFERENCE
            ahead, behind = (
                predict(LASER, ROBOT, state, {**zero, key: sign * step})["distance"]
                for sign in (1, -1)
            )
            slope = (ahead - behind) / (2 * DIFFERENCE)
            np.testing.assert_allclose(columns[:, :, j], slope, atol=DIFFERENCED)


def test_defaults_are_those_of_the_contract():
    terms = {term.key: term for term in LASER.terms(ROBOT.m)}
    assert {key: (term.size, term.unit) for key, term in terms.items()} == {
        "offset": (1, "m"),
        "target": (3, "m"),
    }
    assert {float(each) for term in terms.values() for each in term.deviation} == {0.005}
    (quantity,) = LASER.quantities(ROBOT.m)
    assert (quantity.forms, quantity.unit, quantity.noise) == ((("d",),), "m", 0.002)


# In a recording

WITH_LASER = {**PAPER, "laser": FLOOR}


def recorded(seed, instruments=WITH_LASER):
    """The motion of the other tests with the distance to the floor."""
    return RECORDER(seed, instruments=instruments)


@pytest.mark.integration
def test_it_is_calibrated_beside_the_other_instruments():
    experiment = recorded(11)
    drawn = RECORDER.drawn["run"]["laser"]
    estimate = MaximumLikelihood()(experiment)
    assert estimate.verdict.accepted, estimate.verdict.reasons
    off = np.linalg.solve(estimate.covariance, estimate.value - TRUTH) @ (estimate.value - TRUTH)
    assert off < chi2.ppf(1 - 1e-4, 10)
    found = estimate.calibration["laser"]
    for key, value in drawn.calibration.items():
        sigma = found[key]["standard_deviation"]
        assert np.all(np.abs(np.array(found[key]["value"]) - value) < 4 * np.array(sigma))
    assert float(np.max(found["offset"]["standard_deviation"])) < 0.5 * 0.02


@pytest.mark.slow
@pytest.mark.integration
def test_it_takes_the_place_of_what_the_tracker_does_not_tell():
    # Of three distances to planes square to each other the place follows as from a tracker.
    planes = {f"wall-{axis}": np.eye(3)[i] for i, axis in enumerate("xyz")}
    walls = {
        name: Distance.model_validate({**KEYS, "plane": {"normal": tuple(normal), "offset": -9.0}})
        for name, normal in planes.items()
    }
    without_tracker = {key: each for key, each in PAPER.items() if key != "tracker"}
    estimate = MaximumLikelihood()(recorded(3, {**without_tracker, **walls}))
    assert np.isfinite(estimate.value).all()
    off = np.linalg.solve(estimate.covariance, estimate.value - TRUTH) @ (estimate.value - TRUTH)
    assert off < chi2.ppf(1 - 1e-4, 10)


@pytest.mark.integration
def test_inspection_compares_it_with_the_motion():
    (excerpt,) = excerpts(recorded(2), 1)
    found = judged(excerpt)
    assert not found.bad
    own = [a for a in found.agreements.values() if ("laser", "distance") in a.between]
    assert own
    assert all(a.channels == ("d", "offset", "target", "delay") for a in own)


@pytest.mark.integration
def test_inspection_says_what_the_recording_tells_of_it():
    found = inspect(recorded(2))
    assert not found.mistakes
    groups = {each.group: each for each in found.excitation.calibration}
    assert groups["laser.offset"].sigma < 0.5 * groups["laser.offset"].prior
    assert "laser.target" in groups
    assert any(report.instrument == "laser" for report in found.streams)


@pytest.mark.integration
@pytest.mark.parametrize(
    ("factor", "words"),
    [(-1.0, "wrong sign"), (1000.0, "units: {d: mm}"), (100.0, "units: {d: cm}")],
)
def test_a_wrong_sign_or_unit_is_named(factor, words):
    (excerpt,) = excerpts(vector("laser", "distance", factor)(recorded(2)), 1)
    found, after = mistakes(excerpt)
    (mistake,) = found
    assert mistake.amendment.subject == "laser"
    assert words in f"{mistake.amendment.what}; {mistake.amendment.proposal}"
    assert not after.bad


@pytest.mark.integration
def test_its_clock_is_found_from_the_data():
    experiment = recorded(4)
    run = experiment.runs[0]
    wanted = {"command", "laser"}
    found = joined([c for c in clocks_of(experiment, run) if wanted & set(c.instruments)])
    offsets = {each.instruments[0]: each for each in found}
    begins = {
        name: run.sync[name] + RECORDER.drawn["run"][name].delay for name in ("command", "laser")
    }
    late = offsets["laser"].value - offsets["command"].value
    assert offsets["laser"].known
    assert late == pytest.approx(begins["laser"] - begins["command"], abs=0.01)


@pytest.mark.integration
def test_a_place_alone_does_not_tell_its_clock():
    experiment = recorded(4)
    wanted = {"tracker", "laser"}
    clocks = [c for c in clocks_of(experiment, experiment.runs[0]) if wanted & set(c.instruments)]
    assert not joined(clocks)[1].known


# As a file

STREAM = "t,d\n" + "\n".join(f"{0.02 * i:.2f},{1 + 0.001 * i:.3f}" for i in range(300)) + "\n"


def written(folder, laser):
    """A small experiment with a distance sensor; its file as data."""
    path = write_small(folder)
    data = read_yaml(path).data
    data["instruments"]["laser"] = laser
    (folder / "laser.csv").write_text(STREAM)
    data["runs"][0]["laser"] = "laser.csv"
    data["runs"][0]["sync"]["laser"] = 0.0
    return path, data


def stated(**keys):
    """The instrument as a file has it."""
    plane = {"normal": [0.0, 0.0, 1.0], "offset": 0.0}
    return {"kind": "distance", "point": [0.1, 0.0, 0.0], "plane": plane, **keys}


def saved(path, data):
    path.write_text(json.dumps(data))
    return path


@pytest.mark.integration
def test_a_file_with_it_is_read(tmp_path):
    path, data = written(tmp_path, stated())
    Draft202012Validator(schema("experiment")).validate(data)
    experiment = read_experiment(saved(path, data))
    assert isinstance(experiment.instruments["laser"], Distance)
    assert experiment.runs[0].streams["laser"].values["distance"].shape == (300, 1)


BAD = {
    "no plane": (lambda i: i.pop("plane"), r"'instruments\.laser\.?.*'plane'"),
    "no normal": (lambda i: i["plane"].pop("normal"), "'normal'"),
    "no offset": (lambda i: i["plane"].pop("offset"), "'offset'"),
    "normal of two": (lambda i: i["plane"].update(normal=[0.0, 1.0]), "normal"),
    "target in place of point": (lambda i: i.update(target=[0.0, 0.0, 0.0]), "target"),
    "unknown error": (lambda i: i.update(calibration={"frame": 0.1}), "frame"),
}


@pytest.mark.parametrize("case", BAD)
def test_wrong_keys_are_refused_with_a_sentence(tmp_path, case):
    change, words = BAD[case]
    path, data = written(tmp_path, stated())
    change(data["instruments"]["laser"])
    assert not Draft202012Validator(schema("experiment")).is_valid(data)
    with pytest.raises(InputError, match=words):
        read_experiment(saved(path, data))


def test_a_normal_without_direction_is_refused_with_a_sentence(tmp_path):
    path, data = written(tmp_path, stated(plane={"normal": [0.0, 0.0, 0.0], "offset": 1.0}))
    with pytest.raises(InputError, match=r"expected a direction, found \[0, 0, 0\]") as refused:
        read_experiment(saved(path, data))
    assert "instruments.laser.plane.normal" in str(refused.value)


def test_a_stream_without_its_column_is_refused(tmp_path):
    path, data = written(tmp_path, stated())
    (tmp_path / "laser.csv").write_text(STREAM.replace("t,d", "t,range"))
    with pytest.raises(InputError, match=r"laser\.csv: expected columns d, found no d"):
        read_experiment(saved(path, data))


SENSORS = """
sync: 0.005
instruments:
  cables:
    kind: tension
    clock: recorder
    rate: 50
    noise: 5.0
    calibration: {offset: 5.0, gain: 0.0, common_gain: 0.0}
  imu:
    kind: imu
    clock: recorder
    rate: 50
    noise: {angular_velocity: 0.002, specific_force: 0.03, orientation: 0.003}
  tracker: {kind: position, target: [0.1, 0.2, 1.1], rate: 50, noise: 0.0005}
  laser:
    kind: distance
    point: [0.3, 0.1, -0.2]
    plane: {normal: [0, 0, 2], offset: -0.4}
    rate: 50
    noise: 0.002
"""


@pytest.mark.slow
def test_all_verbs_take_it(tmp_path, run):
    (tmp_path / "sensors.yaml").write_text(SENSORS)
    recorded_in, estimate = tmp_path / "recorded", tmp_path / "estimate"
    suite = ("--sensors", tmp_path / "sensors.yaml", "--seed", 3)
    assert run("simulate", "cogiro-cuboid", *suite, "--duration", 8, "--out", recorded_in)[0] == 0
    experiment = recorded_in / "experiment.yaml"
    assert (recorded_in / "multisine" / "laser.csv").read_text().startswith("t,d\n")
    status, printed, _ = run("inspect", experiment, "--json")
    assert status == 0
    found = json.loads(printed)
    assert not found["mistakes"]
    assert any("distance of laser" in each["between"] for each in found["agreements"])
    assert "laser.offset" in found["excitation"]["calibration"]
    assert run("identify", experiment, "--out", estimate)[0] == 0
    written = json.loads((estimate / "estimate.json").read_text())
    laser = written["estimates"]["maximum-likelihood"]["calibration"]["laser"]
    assert set(laser) == {"offset", "target", "delay"}
    truth = json.loads((recorded_in / "truth.json").read_text())["calibration"]["laser"]["offset"]
    error = np.ravel(laser["offset"]["value"]) - np.ravel(truth)
    assert np.all(np.abs(error) < 4 * np.ravel(laser["offset"]["standard_deviation"]))
    assert "laser, distance" in (estimate / "report.html").read_text(encoding="utf-8")
    status, printed, _ = run("design", experiment, "--check", "paper", "--json", "--duration", 8)
    assert status == 0
    assert json.loads(printed)["standard_deviation"]["mass"] > 0
