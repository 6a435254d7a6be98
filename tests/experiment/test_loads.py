"""Several loads in the experiment file."""

from dataclasses import replace

import numpy as np
import pytest
import yaml
from recordings import write_small

from steelyard.errors import InputError
from steelyard.experiment.read import read_experiment
from steelyard.experiment.write import write_experiment

BODY = {
    "mass": 180.0,
    "center_of_gravity": [0.0, -0.1, -0.2],
    "inertia": {"xx": 95.0, "yy": 90.0, "zz": 32.0, "yz": 4.0, "xz": 0.0, "xy": 0.0},
}
LOADS = {
    "empty": {},
    "with-fork": {"nominal": BODY},
    "reference": {"known": {"mass": {"value": 176.02, "sigma": 0.01}}},
}


def written(folder, change):
    """The small experiment with its run three times, after a change of its description."""
    path = write_small(folder / "small")
    values = yaml.safe_load(path.read_text())
    (run,) = values["runs"]
    values["runs"] = [
        {**run, "name": "a"},
        {**run, "name": "b", "load": "with-fork"},
        {**run, "name": "c", "load": "reference"},
    ]
    values["loads"] = dict(LOADS)
    change(values)
    path.write_text(yaml.safe_dump(values, sort_keys=False))
    return path


def test_runs_carry_loads(tmp_path):
    found = read_experiment(written(tmp_path, lambda values: None))
    assert [each.name for each in found.loads] == ["empty", "with-fork", "reference"]
    assert [found.load_of(run.name).name for run in found.runs] == list(LOADS)
    empty, fork, reference = found.loads
    assert empty.nominal is found.robot.platform
    assert fork.nominal.mass == 180
    assert reference.known == {"mass": (176.02, 0.01)}
    assert found.known == {}
    assert found.of_load(reference).known == reference.known
    alone = found.alone(fork)
    assert [run.name for run in alone.runs] == ["b"]
    assert alone.robot.platform is fork.nominal
    assert alone.loads == ()


def test_what_was_read_is_written(tmp_path):
    first = read_experiment(written(tmp_path, lambda values: None))
    (tmp_path / "again").mkdir()
    write_experiment(first, tmp_path / "again")
    second = read_experiment(tmp_path / "again" / "experiment.yaml")
    assert [run.load for run in second.runs] == [run.load for run in first.runs]
    for one, other in zip(first.loads, second.loads, strict=True):
        assert (one.name, one.known, one.rigid) == (other.name, other.known, other.rigid)
        assert (one.nominal is None) == (other.nominal is None)
        if one.nominal is not None:
            np.testing.assert_allclose(one.nominal.parameters, other.nominal.parameters)


def test_without_loads_there_is_one_body(tmp_path):
    found = read_experiment(write_small(tmp_path / "small"))
    assert found.loads == ()
    assert found.load_of(found.runs[0].name) is None


def in_run(key, value, number=1):
    return lambda values: values["runs"][number].update({key: value})


def in_load(name, **keys):
    return lambda values: values["loads"].update({name: keys})


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (in_run("load", "forklift"), "expected the name of a load, found 'forklift'; known here"),
        (lambda values: values.pop("loads"), "found 'with-fork'; add 'loads'"),
        (in_load("spare"), "expected a run that carries 'spare', found none"),
        (lambda values: values.update(known={"mass": 160}), "move it to 'loads: {empty:"),
        (
            in_load("with-fork", nominal={**BODY, "inertia": {**BODY["inertia"], "zz": 300.0}}),
            "expected a body that can exist",
        ),
        (in_load("with-fork", nominal={**BODY, "mass": -1}), "expected a number above 0, found -1"),
        (in_load("a#b"), "expected a name of letters"),
    ],
)
def test_a_mistake_is_said_with_its_place(tmp_path, change, said):
    with pytest.raises(InputError, match=r"experiment\.yaml") as error:
        read_experiment(written(tmp_path, change))
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_a_load_in_which_something_moves_needs_the_whole_wrench_in_motion(tmp_path):
    path = written(tmp_path, in_load("with-fork", rigid=False))
    found = read_experiment(path)
    assert [found.moves_within(run.name) for run in found.runs] == [False, True, False]
    values = yaml.safe_load(path.read_text())
    values["instruments"]["cables"]["without"] = [1, 2, 3]
    path.write_text(yaml.safe_dump(values, sort_keys=False))
    with pytest.raises(
        InputError, match="run 'b': expected poses at rest of a load in which"
    ) as error:
        read_experiment(path)
    assert "motion with 5" in str(error.value)


def test_a_load_is_no_name_of_an_instrument(tmp_path):
    def renamed(values):
        values["instruments"]["load"] = values["instruments"]["imu"]

    with pytest.raises(InputError, match="no key of a run"):
        read_experiment(written(tmp_path, renamed))


def test_what_is_known_of_one_load_is_not_of_another(tmp_path):
    found = read_experiment(written(tmp_path, lambda values: None))
    other = found.of_load(found.loads[2])
    assert replace(other, known={}).known == found.known


ADDED = {
    "mass": {"value": 20.0, "sigma": 0.01},
    "center_of_gravity": {"z": {"value": 0.5, "sigma": 0.005}},
}


def test_what_was_added_is_read_and_written(tmp_path):
    def add(values):
        values["loads"]["with-fork"] = {"added": ADDED}

    found = read_experiment(written(tmp_path, add))
    assert found.loads[1].added == {"mass": (20.0, 0.01), "cz": (0.5, 0.005)}
    assert found.loads[2].added == {}
    (tmp_path / "copy").mkdir()
    write_experiment(found, tmp_path / "copy")
    again = read_experiment(tmp_path / "copy" / "experiment.yaml")
    assert again.loads[1].added == found.loads[1].added


@pytest.mark.parametrize(
    ("load", "added", "message"),
    [
        ("empty", ADDED, "expected none of the first load, to which others are added"),
        ("reference", {"center_of_gravity": ADDED["center_of_gravity"]}, "expected the mass of"),
        ("reference", {"inertia": {}}, "inertia"),
    ],
)
def test_what_cannot_have_been_added_is_refused(tmp_path, load, added, message):
    def add(values):
        values["loads"][load] = {"added": added}

    with pytest.raises(InputError, match=message):
        read_experiment(written(tmp_path, add))
