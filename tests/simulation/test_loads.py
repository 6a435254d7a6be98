"""Files of loads to simulate, and what the loads really are."""

import json
import re
from itertools import pairwise

import numpy as np
import pytest
import yaml

from steelyard.errors import InputError
from steelyard.experiment.read import read_experiment
from steelyard.inertia import BODY_PARAMETERS, Inertia
from steelyard.robot.file import read_robot
from steelyard.simulation.loads import read_loads, recordings
from steelyard.simulation.simulate import simulate

ROBOT = read_robot("cogiro")
BODY = {
    "mass": 180.0,
    "center_of_gravity": [0.0, -0.1, -0.2],
    "inertia": {"xx": 110.0, "yy": 105.0, "zz": 42.0, "yz": 4.0, "xz": 0.0, "xy": 0.0},
}
WEIGHT = {
    "mass": {"value": 32.2, "sigma": 0.01},
    "center_of_gravity": {
        "x": {"value": 0.1, "sigma": 0.005},
        "y": {"value": -0.2, "sigma": 0.005},
        "z": {"value": 0.3, "sigma": 0.005},
    },
}


def read(folder, loads, **keys):
    path = folder / "loads.yaml"
    path.write_text(yaml.safe_dump({"loads": loads, **keys}, sort_keys=False))
    return read_loads(path, ROBOT)


def test_an_order_is_one_recording_after_the_other():
    order = ["a", "b", "b", "a"]
    found = recordings(order, ["forward", "backward"])
    assert [load for load, _ in found.values()] == [each for each in order for _ in range(2)]
    assert list(found)[:4] == ["forward a", "backward a", "forward b", "backward b"]
    assert list(found)[4:] == ["forward b 2", "backward b 2", "forward a 2", "backward a 2"]
    assert len(recordings(["a", "a 2", "a"], ["m"])) == 3


def test_a_load_of_which_nothing_is_said_is_the_platform(tmp_path):
    loads = read(tmp_path, {"empty": {}, "part": {"nominal": BODY}})
    assert loads.order == ("empty", "part")
    bodies = loads.drawn(np.random.default_rng(1))
    np.testing.assert_array_equal(bodies["empty"].parameters, ROBOT.platform.parameters)
    assert bodies["part"].mass == 180.0
    np.testing.assert_array_equal(bodies["part"].center_of_gravity, [0.0, -0.1, -0.2])


def test_what_is_known_lies_off_by_its_sigma(tmp_path):
    known = {"mass": {"value": 162.0, "sigma": 0.5}, "inertia": {"xx": {"value": 96, "sigma": 2}}}
    loads = read(tmp_path, {"empty": {"known": known}})
    drawn = [loads.drawn(np.random.default_rng(seed))["empty"] for seed in range(400)]
    values = np.array([each.body_parameters for each in drawn])
    i, k = BODY_PARAMETERS.index("mass"), BODY_PARAMETERS.index("Jxx")
    # Means and deviations of 400 draws are told to 5 and 4 % of the 1-sigma.
    told = (values[:, [i, k]].mean(axis=0) - [162, 96]) / [0.5, 2]
    np.testing.assert_allclose(told, 0, atol=0.2)
    np.testing.assert_allclose(values[:, [i, k]].std(axis=0), [0.5, 2], rtol=0.15)
    others = np.delete(values, [i, k], axis=1)
    kept = np.delete(ROBOT.platform.body_parameters, [i, k])
    np.testing.assert_allclose(others, np.tile(kept, (400, 1)), rtol=1e-12)


@pytest.mark.parametrize("nominal", [None, BODY])
def test_what_was_added_is_what_a_load_has_more(tmp_path, nominal):
    stated = {"known": {"mass": {"value": 160.0, "sigma": 1.0}}}
    own = {"added": WEIGHT, **({"nominal": nominal} if nominal else {})}
    loads = read(tmp_path, {"empty": stated, "weight": own})
    more = []
    for seed in range(300):
        bodies = loads.drawn(np.random.default_rng(seed))
        # Moments of the pseudo-inertia are sums over the mass, whatever body it belongs to.
        extra = bodies["weight"].pseudo_inertia - bodies["empty"].pseudo_inertia
        more.append([extra[3, 3], *extra[:3, 3] / extra[3, 3]])
    np.testing.assert_allclose(np.mean(more, axis=0), [32.2, 0.1, -0.2, 0.3], atol=0.002)
    np.testing.assert_allclose(np.std(more, axis=0), [0.01, 0.005, 0.005, 0.005], rtol=0.15)


def test_a_weight_is_a_compact_ball(tmp_path):
    bodies = read(tmp_path, {"empty": {}, "weight": {"added": WEIGHT}}).drawn(
        np.random.default_rng(3)
    )
    extra = Inertia.from_parameters(bodies["weight"].parameters - bodies["empty"].parameters)
    volume = WEIGHT["mass"]["value"] / 7800
    radius = (volume * 3 / 4 / np.pi) ** (1 / 3)
    np.testing.assert_allclose(
        extra.inertia, 2 / 5 * 32.2 * radius**2 * np.eye(3), rtol=1e-6, atol=1e-9
    )


@pytest.mark.parametrize(
    ("loads", "keys", "said"),
    [
        ({}, {}, "loads"),
        ({"empty": {}, "part": {}}, {}, r"load 'part': expected the whole body to simulate"),
        (
            {"empty": {}, "part": {"added": {"mass": 3.0}}},
            {},
            r"load 'part': expected the place of what was added to simulate it, found no cx",
        ),
        ({"empty": {}}, {"order": ["emty"]}, r"expected the name of a load, found 'emty'"),
        (
            {"empty": {}, "part": {"nominal": BODY}},
            {"order": ["empty"]},
            r"expected every load, found none of 'part'",
        ),
        ({"empty": {"rigid": False}}, {}, r"expected a rigid body"),
        ({"a#b": {}}, {}, r"expected a name of letters"),
        (
            {"empty": {"known": {"inertia": {"zz": 400.0}}}},
            {},
            r"load 'empty': expected a body that can exist",
        ),
        ({"empty": {"added": WEIGHT}}, {}, r"expected none of the first load"),
    ],
)
def test_a_mistake_is_said_with_its_place(tmp_path, loads, keys, said):
    with pytest.raises(InputError, match=r"loads\.yaml") as error:
        read(tmp_path, loads, **keys)
    assert re.search(said, str(error.value))
    assert "\n" not in str(error.value)


@pytest.mark.integration
def test_an_order_is_recorded_and_read_back(tmp_path):
    stated = {
        "empty": {},
        "weight": {"added": WEIGHT},
        "part": {"nominal": BODY, "known": {"mass": {"value": 180.0, "sigma": 0.2}}},
    }
    order = ["empty", "part", "weight", "part", "empty"]
    read(tmp_path, stated, order=order)
    virtual = simulate("cogiro", duration=2, seed=4, loads=tmp_path / "loads.yaml")
    virtual.write(tmp_path / "made")
    found = read_experiment(tmp_path / "made" / "experiment.yaml")
    assert [run.load for run in found.runs] == order
    assert [run.name for run in found.runs][-2:] == ["multisine part 2", "multisine empty 2"]
    assert [load.name for load in found.loads] == list(stated)
    assert found.loads[1].added == {
        "mass": (32.2, 0.01),
        "cx": (0.1, 0.005),
        "cy": (-0.2, 0.005),
        "cz": (0.3, 0.005),
    }
    assert found.loads[2].known == {"mass": (180.0, 0.2)}
    truth = json.loads((tmp_path / "made" / "truth.json").read_text())
    assert list(truth["loads"]) == list(stated)
    assert truth["mass"] == truth["loads"]["empty"]["mass"] == ROBOT.platform.mass
    assert truth["loads"]["part"]["mass"] != 180.0
    # What hangs on the cables is what the truth says: the mean of the vertical pull is the weight.
    for run in found.runs:
        assert _weighs(found, run) == pytest.approx(truth["loads"][run.load]["mass"], rel=0.03)


def _weighs(experiment, run):
    """Mass by the forces at the pose at which the run begins, cables taken as straight lines."""
    place = run.streams["tracker"].values["position"][:20].mean(axis=0)
    at = place - np.array(experiment.instruments["tracker"].target)
    pull = ROBOT.anchors - at - ROBOT.attachments
    up = pull[:, 2] / np.linalg.norm(pull, axis=1)
    return run.streams["cables"].values["tension"][:4].mean(axis=0) @ up / 9.81


@pytest.mark.integration
def test_one_more_recording_changes_nothing_before_it(tmp_path):
    read(tmp_path, {"empty": {"known": {"mass": {"value": 160, "sigma": 1}}}})
    once = simulate("cogiro", duration=2, seed=4, loads=tmp_path / "loads.yaml")
    read(tmp_path, {"empty": {"known": {"mass": {"value": 160, "sigma": 1}}}}, order=["empty"] * 2)
    twice = simulate("cogiro", duration=2, seed=4, loads=str(tmp_path / "loads.yaml"))
    assert once.body.mass == twice.body.mass
    first, again = (
        [run.streams["cables"].values["tension"] for run in each.experiment.runs]
        for each in (once, twice)
    )
    np.testing.assert_array_equal(first[0], again[0])
    assert all(np.any(a != b) for a, b in pairwise(again))


def test_loads_are_bodies_or_a_file():
    with pytest.raises(ValueError, match="loads: expected a mapping of names to bodies, or the"):
        simulate("cogiro", duration=2, loads=[ROBOT.platform])
