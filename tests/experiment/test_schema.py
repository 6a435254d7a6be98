"""JSON schemas for editors: they take what the readers take, and refuse what those refuse for its
form."""

import json
from functools import cache
from importlib import resources

import pytest
from jsonschema import Draft202012Validator
from recordings import write_small

from steelyard.errors import InputError
from steelyard.experiment.read import read_experiment
from steelyard.experiment.schema import schema
from steelyard.files.yaml_file import read_yaml
from steelyard.instruments import AnyInstrument
from steelyard.robot.file import bundled_names, read_robot

KINDS = (
    "tension",
    "wrench",
    "imu",
    "attitude",
    "position",
    "pose",
    "length",
    "distance",
    "command",
    "frequencies",
    "weight",
)


@cache
def validator(which):
    return Draft202012Validator(schema(which))


def check(which, data):
    validator(which).validate(data)


def refuses(which, data):
    return not validator(which).is_valid(data)


@pytest.mark.parametrize("which", ["experiment", "robot"])
def test_the_schema_is_one(which):
    Draft202012Validator.check_schema(schema(which))


@pytest.mark.parametrize("name", bundled_names())
def test_bundled_robots(name):
    with resources.as_file(resources.files("steelyard.robot") / "library" / f"{name}.yaml") as path:
        check("robot", read_yaml(path).data)


def test_examples(examples):
    for path in examples.glob("*/robot.yaml"):
        check("robot", read_yaml(path).data)
    for path in examples.glob("*/experiment.yaml"):
        check("experiment", read_yaml(path).data)


@pytest.mark.integration
def test_what_the_verbs_write(tmp_path, run, examples):
    assert (
        run(
            "simulate",
            "cogiro-cuboid",
            "--sensors",
            "ideal",
            "--duration",
            2,
            "--out",
            tmp_path / "virtual",
        )[0]
        == 0
    )
    check("experiment", read_yaml(tmp_path / "virtual" / "experiment.yaml").data)
    small = write_small(tmp_path / "small")
    check("robot", read_yaml(small.parent / "robot.yaml").data)
    status, _, _ = run(
        "init",
        small.parent / "moving",
        "--robot",
        small.parent / "robot.yaml",
        "--out",
        tmp_path / "e.yaml",
    )
    assert status == 0
    check("experiment", read_yaml(tmp_path / "e.yaml").data)
    assert run("convert", small, "--out", tmp_path / "tidy")[0] == 0
    check("experiment", read_yaml(tmp_path / "tidy" / "experiment.yaml").data)
    check("robot", read_yaml(tmp_path / "tidy" / "robot.yaml").data)


EXPERIMENT = {
    "no format": lambda e: e.pop("format"),
    "another format": lambda e: e.update(format="steelyard/2"),
    "no robot": lambda e: e.pop("robot"),
    "no runs": lambda e: e.update(runs=[]),
    "no instruments": lambda e: e.update(instruments={}),
    "unknown key": lambda e: e.update(runz=1),
    "unknown key of an instrument": lambda e: e["instruments"]["imu"].update(colour="red"),
    "no kind": lambda e: e["instruments"]["imu"].pop("kind"),
    "unknown kind": lambda e: e["instruments"]["imu"].update(kind="sonar"),
    "noise below 0": lambda e: e["instruments"]["cables"].update(noise=-1.0),
    "noise that is text": lambda e: e["instruments"]["cables"].update(noise="5 N"),
    "noise that is true": lambda e: e["instruments"]["cables"].update(noise=True),
    "rate of 0": lambda e: e["instruments"]["cables"].update(rate=0),
    "two coordinates": lambda e: e["instruments"]["imu"].update(position=[0.0, 0.0]),
    "four coordinates": lambda e: e["instruments"]["imu"].update(position=[0.0, 0.0, 0.0, 0.0]),
    "unknown error": lambda e: e["instruments"]["imu"]["calibration"].update(gyro_gain=0.1),
    "prior without sigma": (
        lambda e: e["instruments"]["imu"]["calibration"].update(gyro_bias={"value": 0.1})
    ),
    "prior with null sigma": (
        lambda e: e["instruments"]["imu"]["calibration"].update(gyro_bias={"sigma": None})
    ),
    "prior per week": (
        lambda e: e["instruments"]["imu"]["calibration"].update(
            gyro_bias={"sigma": 0.1, "per": "week"}
        )
    ),
    "run without name": lambda e: e["runs"][0].pop("name"),
    "run without streams": lambda e: e["runs"].append({"name": "none"}),
    "stream without file": lambda e: e["runs"][0].update(imu={"columns": {"wx": "a"}}),
    "stream with another key": lambda e: e["runs"][0].update(imu={"file": "imu.csv", "sheet": "a"}),
    "stream that is a number": lambda e: e["runs"][0].update(imu=5),
    "sync of text": lambda e: e["runs"][0].update(sync="manual"),
    "sync that is no number": lambda e: e["runs"][0].update(sync={"imu": "soon"}),
    "window of three": lambda e: e["runs"][0].update(window=[0, 1, 2]),
    "known that is text": lambda e: e.update(known={"mass": "heavy"}),
    "known of what is none": lambda e: e.update(known={"length": 1.0}),
    "uncertainty below 0": lambda e: e.update(uncertainty={"anchor": -0.1}),
}
"""Wrong experiment files whose mistake is one of form."""

FORMS = {
    "bare sigma": lambda e: e["instruments"]["imu"]["calibration"].update(gyro_bias=0.1),
    "sigma of each": lambda e: e["instruments"]["imu"]["calibration"].update(gyro_bias=[0.1, 0.2, 0.3]),
    "prior": lambda e: e["instruments"]["imu"]["calibration"].update(
        gyro_bias={"value": 0.1, "sigma": 0.1, "per": "run"}
    ),
    "sync auto": lambda e: e["runs"][0].update(sync="auto"),
    "window": lambda e: e["runs"][0].update(window=[0.5, 3]),
    "bare mass": lambda e: e.update(known={"mass": 161}),
    "known with sigma": lambda e: e.update(known={"center_of_gravity": {"x": {"value": 0.1, "sigma": 0.01}}}),
    "whole stream": lambda e: e["runs"][0].update(imu={"file": "moving/imu.csv", "columns": {}, "units": {"ax": "m/s2"}}),
}  # fmt: skip
"""Ways to write the same that a reader takes."""


def small(folder):
    path = write_small(folder)
    return path, read_yaml(path).data


@pytest.mark.parametrize("case", EXPERIMENT)
def test_wrong_forms_are_refused_by_both(tmp_path, case):
    path, data = small(tmp_path)
    EXPERIMENT[case](data)
    assert refuses("experiment", data)
    path.write_text(json.dumps(data))
    with pytest.raises(InputError):
        read_experiment(path)


@pytest.mark.parametrize("case", FORMS)
def test_short_and_long_forms_are_taken_by_both(tmp_path, case):
    path, data = small(tmp_path)
    FORMS[case](data)
    check("experiment", data)
    path.write_text(json.dumps(data))
    read_experiment(path)


@pytest.mark.parametrize(
    "change",
    [
        {"name": 5}, {"gravity": "down"}, {"gravity": -9.81}, {"cables": None}, {"cables": [{"anchor": [0, 0, 0]}]}, {"mass": 5},
        {"cable": {"damping_ratio": 2}}, {"tension": {"min": 1}}, {"limits": {"position": [[0, 0, 0]]}}, {"platform": {"mass": 1.0}},
    ],
    ids=str,
)  # fmt: skip
def test_wrong_robots(tmp_path, change):
    small(tmp_path)
    data = {**read_yaml(tmp_path / "robot.yaml").data, **change}
    assert refuses("robot", data)
    (tmp_path / "robot.yaml").write_text(json.dumps(data))
    with pytest.raises(InputError):
        read_robot("robot.yaml", tmp_path)


def test_every_number_says_its_unit_or_what_it_is():
    """What an editor shows beside a key comes from the code, so that it cannot differ from it."""
    parts = {**schema("experiment")["$defs"], **schema("robot")["$defs"]}
    assert parts["Imu"]["properties"]["position"]["description"].startswith(
        "Origin of the instrument frame in the platform frame [m]"
    )
    assert "[N]" in parts["Tension"]["properties"]["noise"]["description"]
    assert "[rad/s]" in parts["ImuCalibration"]["properties"]["gyro_bias"]["description"]
    assert "[kg/m]" in parts["CablePropertiesForm"]["properties"]["linear_density"]["description"]
    kinds = {
        kind.model_fields["kind"].annotation.__args__[0]
        for kind in AnyInstrument.__origin__.__args__
    }
    assert kinds == set(KINDS)
    for name, part in parts.items():
        assert "description" in part, name


def test_the_verb(tmp_path, run):
    status, printed, _ = run("schema")
    assert status == 0
    assert json.loads(printed) == schema("experiment")
    out = tmp_path / "robot.schema.json"
    assert run("schema", "robot", "--out", out)[0] == 0
    assert json.loads(out.read_text()) == schema("robot")
    assert run("schema", "robot", "--out", out)[0] == 2
    assert run("schema", "robots")[0] == 2
