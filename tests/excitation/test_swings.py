"""Which free swings to record, and that they tell what was promised."""

import json
from dataclasses import replace

import numpy as np
import pytest
from grids import columns, is_a_deviation
from mujoco_swings import BODY, swinging_robot
from scipy.spatial.transform import Rotation

from steelyard.errors import InputError
from steelyard.excitation.settings import DesignSettings
from steelyard.excitation.swings.candidate_swings import cable_sets, places_of_rest, swings_at
from steelyard.excitation.swings.swing_design import _recorded, design_swings
from steelyard.excitation.swings.swing_file import swings_dict, write_swings
from steelyard.experiment.recording import Stream
from steelyard.identification.methods.maximum_likelihood import MaximumLikelihood
from steelyard.report.documents.free_swings import free_swings_document
from steelyard.robot.file import read_robot
from steelyard.simulation.sensors import SWING_SENSORS, read_sensors

pytestmark = pytest.mark.integration
FEW = DesignSettings(swing_places=1)


@pytest.fixture(scope="module")
def robot():
    return replace(swinging_robot(3), platform=BODY)


@pytest.fixture(scope="module")
def design(robot):
    return design_swings(robot, 2, duration=4.0, cables=[1, 2, 3], settings=FEW)


def test_every_further_swing_helps(design):
    sigma = np.array([each.standard_deviation for each in design.best.steps])
    assert sigma.shape == (2, 9)
    assert (np.diff(sigma, axis=0) < 1e-12).all()
    assert design.candidates == 4


def test_the_prediction_is_that_of_the_choice(design):
    # The choice looks at a part of the samples, each swing about its own motion.
    ratio = design.predicted.per_mass.standard_deviation / design.best.steps[-1].standard_deviation
    assert ((ratio > 0.85) & (ratio < 1.25)).all()


def test_swings_keep_all_cables_taut(design):
    for each in design.swings:
        assert each.least_tension > 0.05 * each.modes.rest.tension.max()
        assert each.push


@pytest.mark.slow
def test_noisy_swings_tell_what_was_promised(design):
    rng = np.random.default_rng(3)
    recorded = _recorded(design.experiment, design.swings, FEW).experiment
    noisy = []
    for run in recorded.runs:
        stream = run.streams["pose"]
        turned = rng.normal(0, 0.0005, (len(stream), 3))
        values = {
            "position": stream.values["position"] + rng.normal(0, 0.0003, (len(stream), 3)),
            "orientation": stream.values["orientation"] @ Rotation.from_rotvec(turned).as_matrix(),
        }
        own = Stream(stream.time, values, stream.source)
        noisy.append(replace(run, streams={**run.streams, "pose": own}))
    found = MaximumLikelihood()(replace(recorded, runs=tuple(noisy)))
    predicted = design.predicted.per_mass
    assert found.verdict.accepted
    ratio = found.per_mass.standard_deviation / predicted.standard_deviation
    assert ((ratio > 0.9) & (ratio < 1.15)).all()
    off = (found.per_mass.value - predicted.value) / predicted.standard_deviation
    assert np.abs(off).max() < 4


def test_sets_of_cables():
    assert [len(each) for each in cable_sets(swinging_robot(3))] == [3, 2, 2, 2]
    assert len(list(cable_sets(read_robot("cogiro")))) == 56 + 70 + 56 + 28


def test_pushes_are_the_modes_and_all_at_once(robot):
    modes = places_of_rest(robot, BODY, FEW)[0]
    pushed = list(swings_at(modes, 2.0, FEW))
    assert [each.pushed for each in pushed] == [None, 0, 1, 2]
    assert [each.frequency for each in pushed[1:]] == list(modes.frequencies)


def test_files(design, tmp_path):
    write_swings(design, tmp_path)
    told = json.loads((tmp_path / "swings.json").read_text())
    assert told == json.loads(json.dumps(swings_dict(design)))
    assert told["cables"] == [1, 2, 3]
    assert len(told["swings"]) == 2
    assert read_robot(tmp_path / "robot.yaml").m == 3


def test_each_deviation_is_written_with_two_digits(design):
    written = columns(free_swings_document(design), r"cog \[mm\]|moments / mass|^1-sigma$")
    assert len(written) > 10
    assert [text for text in written if not is_a_deviation(text)] == []


def test_mocap_is_assumed_for_a_robot_alone(design, robot):
    assert design.assumed
    assert set(read_sensors(SWING_SENSORS, robot).instruments) == {"pose"}


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"swings": 0}, "expected 1 to 30 swings, found 0"),
        ({"duration": 0.5}, "expected 2 to 120 s of a swing, found 0.5"),
        ({"cables": [1, 4]}, "one to five of the 3 cables, counted from 1, found 1, 4"),
    ],
)
def test_what_cannot_be_designed_is_said(robot, options, words):
    with pytest.raises(InputError, match=words):
        design_swings(robot, **{"swings": 3, **options})


@pytest.mark.slow
def test_where_nothing_hangs_is_said(robot):
    far = replace(robot, limits=replace(robot.limits, position=((9.0, 9, 9), (10.0, 10, 10))))
    with pytest.raises(InputError, match="hang upright on these cables, all taut, found none"):
        design_swings(far, 2, cables=[1, 2, 3], settings=FEW)


def test_a_body_is_needed(robot):
    with pytest.raises(InputError, match="platform"):
        design_swings(replace(robot, platform=None))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ("--free --check paper", "--check: expected no such option with --free, found one"),
        ("--free --calibration", "--calibration: expected no such option with --free, found one"),
        ("--cables 1,2 --duration 5", "--cables: expected no such option with anything but --free"),
        ("--free --cables one", "--cables: expected numbers with commas between, such as 1,3,5"),
        ("--free --cables 9", "of the 8 cables, counted from 1, found 9"),
        ("--free --poses 0", "expected 1 to 30 swings, found 0"),
    ],
)
def test_options_that_do_not_go_together(run, options, words):
    status, out, err = run("design", "cogiro", *options.split())
    assert (status, out) == (2, "")
    assert words in " ".join(err.split())
