"""Robot files in millimetres are named whatever else is known; robots of 2 cm and of 1500 m are not.

Recordings of other sizes come from plain vector algebra (``benchmarks/abuse.py``).
"""

import sys
from dataclasses import replace

import pytest
from mistaken import DESCRIPTIONS
from places import ROOT
from simulated import sound

from steelyard.experiment.read import read_experiment
from steelyard.inspection.description import check_description
from steelyard.inspection.mistakes.geometry import in_millimetres, most_carried
from steelyard.inspection.mistakes.settings import SIZES

pytestmark = pytest.mark.integration

FOUR = ROOT / "tests" / "data" / "rough-robots" / "four-cables-00" / "experiment.yaml"


def of_size(size, mass):
    """Eight cables, a platform of a tenth of the frame, with a motion of 10 cm at most."""
    sys.path.append(str(ROOT / "benchmarks"))
    try:
        from abuse import BASE, recorded
    finally:
        sys.path.pop()
    return recorded(**{**BASE, "size": size, "mass": mass}, seed=0)[0]


def typed(experiment, anchors=1.0, attachments=1.0):
    """Points of the robot file with factors; nothing nominal is known."""
    r = experiment.robot
    points = {"anchors": anchors * r.anchors, "attachments": attachments * r.attachments}
    return replace(experiment, robot=replace(r, **points, platform=None))


def without_forces(experiment):
    runs = tuple(
        replace(run, streams={k: v for k, v in run.streams.items() if k != "cables"})
        for run in experiment.runs
    )
    instruments = {k: v for k, v in experiment.instruments.items() if k != "cables"}
    return replace(experiment, runs=runs, instruments=instruments)


RECORDED = {
    "cogiro": lambda: sound(1),
    "four cables": lambda: read_experiment(FOUR),
    "1500 m": lambda: of_size(1500.0, 1e5),
    "1500 m, 1 kg": lambda: of_size(1500.0, 1.0),
    "700 m": lambda: of_size(700.0, 1e5),
    "2 cm": lambda: of_size(0.02, 1.0),
    "2 cm, 1 g": lambda: of_size(0.02, 1e-3),
}


@pytest.mark.parametrize("name", RECORDED)
@pytest.mark.parametrize("forces", [True, False])
def test_a_robot_of_any_size_is_believed(name, forces):
    experiment = RECORDED[name]()
    experiment = experiment if forces else without_forces(experiment)
    assert in_millimetres(typed(experiment), SIZES) is None


WAYS = {
    "anchors and attachments": (1000.0, 1000.0),
    "anchors": (1000.0, 1.0),
    "attachments": (1.0, 1000.0),
}


@pytest.mark.slow
@pytest.mark.parametrize("which", WAYS)
@pytest.mark.parametrize("name", ["cogiro", "four cables"])
@pytest.mark.parametrize("forces", [True, False])
def test_millimetres_are_named_with_those_points_that_are(name, which, forces):
    experiment = RECORDED[name]()
    experiment = experiment if forces else without_forces(experiment)
    found = in_millimetres(typed(experiment, *WAYS[which]), SIZES)
    assert found is not None
    assert found.which == which


def test_a_small_robot_in_millimetres_is_told_by_weight_and_readings():
    """It would be 10 m wide, which no size forbids."""
    wrong = typed(RECORDED["2 cm, 1 g"](), 1000.0, 1000.0)
    found = in_millimetres(wrong, SIZES)
    assert found.which == "anchors and attachments"
    assert "less than the air" in found.said
    assert "a thousandth" in found.said


def test_weight_is_what_cables_pull_at_most():
    experiment = sound(1)
    body = experiment.robot.platform.mass
    assert body < most_carried(experiment) < 10 * body
    assert most_carried(without_forces(experiment)) == body
    bare = typed(without_forces(experiment))
    assert most_carried(bare) is None
    assert most_carried(replace(bare, known={"mass": (70.0, 5.0)})) == 70.0


def test_a_large_robot_has_nothing_to_change():
    assert not check_description(RECORDED["700 m"]()).mistakes


def test_forces_in_another_unit_are_no_geometry():
    make, wanted = DESCRIPTIONS["forces in kN"]
    assert wanted in check_description(make(typed(sound(1)))).amendment
