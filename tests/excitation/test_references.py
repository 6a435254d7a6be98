"""References beside an experiment: the bound of both together, against one fit of both and against
estimates from noisy recordings.
"""

import json
import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from click.testing import CliRunner
from grids import columns, is_a_deviation
from simulated import BODY, CENTER, EXACT, PAPER, REACH, ROBOT, Recorder, changed

from steelyard.cli import app
from steelyard.errors import InputError
from steelyard.excitation.information.noise_free_recording import (
    fit_noise_free,
    fit_recorded,
    noise_free_poses,
    with_noise_free_runs,
)
from steelyard.excitation.information.optimality_criterion import Target
from steelyard.excitation.references.added_information import bound_with
from steelyard.excitation.references.addition import additions, places_on
from steelyard.excitation.references.reference_design import design_references
from steelyard.excitation.references.reference_file import reference_dict
from steelyard.excitation.settings import DesignSettings
from steelyard.experiment.model import Experiment, Load
from steelyard.identification.identify import identify
from steelyard.inertia import Inertia
from steelyard.motion.trajectory import multisine
from steelyard.report.documents.references import reference_document
from steelyard.report.forms.markdown import markdown

pytestmark = pytest.mark.integration

LEVEL = 600.0  # [N]
MOTION = multisine(list(CENTER), list(REACH), 5.0, 4)
INSTRUMENTS = {
    **PAPER,
    "cables": changed(PAPER["cables"], calibration={"gain": 0.01, "common_gain": 0.005}),
}
STATED = {**EXACT, "anchor": 0.002, "attachment": 0.002}
PLAN = Experiment("plan", ROBOT, INSTRUMENTS, (), (), STATED)
WEIGHT, PLACE, SIGMA, OFF = 32.0, np.array([0.1, 0.0, 0.5]), 0.01, 0.005
ADDED = Inertia(WEIGHT, PLACE, 0.1 * np.eye(3))
HEAVIER = Inertia.from_parameters(BODY.parameters + ADDED.parameters)
POSES = np.array(
    [[0, 0, 2, 0, 0, 0], [1, 1, 1.5, 0.2, 0, 0], [-1, 1, 2.5, 0, 0.2, 0], [0, -1, 2, 0, -0.2, 0.3]]
)
FEW = DesignSettings(reference_shares=(0.2,), replacing_shares=(1.0,))


def load_of(kind):
    if kind == "in place":
        return Load("reference", known={"mass": (BODY.mass, SIGMA)}, nominal=BODY)
    places = {f"c{axis}": (float(v), OFF) for axis, v in zip("xyz", PLACE, strict=True)}
    return Load("reference", nominal=HEAVIER, added={"mass": (WEIGHT, SIGMA), **places})


@cache
def base(exact=False):
    plan = replace(PLAN, uncertainty=EXACT) if exact else PLAN
    return fit_noise_free(plan, {"move": MOTION}, LEVEL)


def recorded(load, *, moving, exact=False):
    """A noise-free recording of a load by itself."""
    body = BODY if load is None else load.nominal
    alone = replace(base(exact).experiment, robot=replace(ROBOT, platform=body), runs=())
    if moving:
        return with_noise_free_runs(alone, {"reference": MOTION}, LEVEL)
    return replace(alone, runs=(noise_free_poses(alone, "reference", POSES, LEVEL),))


@pytest.mark.parametrize(
    ("kind", "moving"),
    [("poses", False), ("added", False), ("in place", False), ("added", True)],
)
def test_the_bound_is_that_of_one_fit_of_both(kind, moving):
    load = None if kind == "poses" else load_of(kind)
    further = recorded(load, moving=moving)
    found = bound_with(base(), fit_recorded(further), load).standard_deviation
    (run,) = further.runs
    whole = replace(base().experiment, runs=(*base().experiment.runs, run))
    if load is not None:
        run = replace(run, load=load.name)
        whole = replace(
            whole, runs=(*whole.runs[:-1], run), loads=(Load("first", nominal=BODY), load)
        )
    np.testing.assert_allclose(found, fit_recorded(whole).bound.standard_deviation, rtol=2e-3)
    assert (found <= base().bound.standard_deviation * (1 + 1e-6)).all()


@pytest.mark.slow
def test_loads_that_are_there_already_take_part():
    fork = Inertia.from_parameters(
        BODY.parameters + Inertia(16.0, np.array([0.2, -0.1, -0.4]), 0.5 * np.eye(3)).parameters
    )
    plan = replace(base().experiment, runs=())
    runs = {}
    for name, body in (("bare", BODY), ("fork", fork)):
        carried = replace(plan, robot=replace(ROBOT, platform=body))
        (run,) = with_noise_free_runs(carried, {name: MOTION}, LEVEL).runs
        runs[name] = replace(run, load=name)
    loads = (Load("bare", nominal=BODY), Load("fork", nominal=fork))
    two = replace(plan, runs=tuple(runs.values()), loads=loads)
    load = load_of("in place")
    further = recorded(load, moving=False)
    found = bound_with(fit_recorded(two), fit_recorded(further), load).standard_deviation
    (run,) = further.runs
    whole = replace(two, runs=(*two.runs, replace(run, load=load.name)), loads=(*loads, load))
    np.testing.assert_allclose(found, fit_recorded(whole).bound.standard_deviation, rtol=2e-3)


def noisy(seed):
    """A motion with the platform alone and once more with the reference, and the reference as a
    balance and a tape have it."""
    rng = np.random.default_rng(seed)
    weighed = WEIGHT + SIGMA * rng.standard_normal()
    place = PLACE + OFF * rng.standard_normal(3)
    places = {f"c{axis}": (float(v), OFF) for axis, v in zip("xyz", place, strict=True)}
    loads = (Load("bare"), Load("reference", added={"mass": (weighed, SIGMA), **places}))
    runs = []
    for i, (load, body) in enumerate(zip(loads, (BODY, HEAVIER), strict=True)):
        # The same errors of the instruments, other noise.
        one = Recorder(MOTION, body, following=True)
        drawn = one(seed, instruments=INSTRUMENTS, runs=("a", "b"))
        runs.append(replace(drawn.runs[i], load=load.name))
    return replace(drawn, runs=tuple(runs), loads=loads)


@pytest.mark.slow
def test_estimates_are_as_uncertain_as_was_promised():
    load = load_of("added")
    promised = bound_with(base(True), fit_recorded(recorded(load, moving=True, exact=True)), load)
    found = identify(noisy(0), "maximum-likelihood").estimate
    assert found.verdict.accepted
    ratio = found.standard_deviation / promised.standard_deviation
    np.testing.assert_allclose(ratio, 1.0, atol=0.1)
    off = found.value - BODY.body_parameters
    assert off @ np.linalg.solve(promised.covariance, off) < 29.6  # one in a thousand
    # The gain that all cables share is what a weighed body tells.
    alone = base(True).bound.standard_deviation[0]
    assert promised.standard_deviation[0] < 0.4 * alone


@pytest.mark.slow
def test_a_reference_that_was_weighed_wrongly_is_found():
    experiment = noisy(3)
    bare, reference = experiment.loads
    wrong = {**reference.added, "mass": (WEIGHT - 3.0, SIGMA)}
    experiment = replace(experiment, loads=(bare, replace(reference, added=wrong)))
    verdict = identify(experiment, "maximum-likelihood").estimate.verdict
    assert not verdict.accepted
    said = " ".join(verdict.reasons)
    assert "load 'reference': what is known beforehand does not go with the readings" in said
    assert "added mass is stated as 29" in said


@cache
def designed():
    return design_references(PLAN, motion={"move": MOTION}, poses=4, settings=FEW)


@pytest.mark.slow
def test_the_table_has_the_most_helpful_first():
    design = designed()
    scores = [design.score(each) for each in design.predictions]
    assert scores == sorted(scores)
    assert scores[-1] <= 1
    kinds = {(each.addition.kind, each.addition.poses is None) for each in design.predictions}
    assert kinds == {("poses", False), ("added", False), ("added", True), ("in place", False)}
    best = design.predictions[0]
    expected = np.exp(np.mean(np.log(design.ratios(best))))
    assert design.score(best) == pytest.approx(expected)
    # A target for the mass alone puts a body of known mass before everything.
    wanted = replace(design, target=Target(0.1, 1.0, 100.0))
    first = min(design.predictions, key=wanted.score)
    assert first.standard_deviation[0] == min(
        each.standard_deviation[0] for each in design.predictions
    )
    assert "worst 1-sigma" in wanted.criterion


def test_the_table_is_written():
    design = designed()
    values = reference_dict(design)
    json.dumps(values)
    assert values["format"] == "steelyard-reference/1"
    best = values["candidates"][0]
    assert best["ratio"]["mass"] == pytest.approx(
        best["standard_deviation"]["mass"] / values["without"]["standard_deviation"]["mass"]
    )
    document = reference_document(design)
    deviations = columns(document, r"\[mm\]|\[kg|^nothing$|^\d$")
    assert len(deviations) > 20
    assert [text for text in deviations if not is_a_deviation(text)] == []
    ratios = columns(document, "ratio")
    assert all(re.fullmatch(r"\d+\.\d\d", text) for text in ratios)
    said = markdown(document)
    assert "Most helps: " in said
    assert "reference: {added: {mass: {value: 32.21, sigma: 0.01}" in said


def test_a_recording_is_improved_as_its_plan_is():
    experiment = Recorder(MOTION, following=True)(0, instruments=INSTRUMENTS)
    settings = DesignSettings(reference_shares=(), replacing_shares=(1.0,))
    design = design_references(experiment, poses=4, settings=settings)
    assert design.recorded
    # What was planned without noise is what the recording gives.
    np.testing.assert_allclose(
        design.without.standard_deviation, base(True).bound.standard_deviation, rtol=0.05
    )
    assert {each.addition.kind for each in design.predictions} == {"poses", "in place"}


def test_a_load_that_cannot_be_held_is_left_out():
    robot = replace(ROBOT, tension_limits=(50.0, 1200.0))
    settings = DesignSettings(reference_shares=(0.1, 30.0), replacing_shares=())
    found = list(
        additions(
            robot, BODY, POSES, sigma=SIGMA, motion=MOTION, level=0.0, name="x", settings=settings
        )
    )
    masses = {each.mass for each in found if each.mass is not None}
    assert masses == {0.1 * BODY.mass}


def test_places_are_within_the_attachments():
    low, high = ROBOT.attachments.min(axis=0), ROBOT.attachments.max(axis=0)
    places = places_on(ROBOT)
    assert len(places) == 4
    for place in places.values():
        assert (place >= low - 1e-9).all()
        assert (place <= high + 1e-9).all()
    flat = replace(ROBOT, attachments=ROBOT.attachments * [1, 1, 0])
    assert list(places_on(flat)) == [
        "at the middle of the attachments",
        "out along +x",
        "out along +y",
    ]


def test_what_cannot_be_predicted_is_refused():
    with pytest.raises(InputError, match="expected more than 0 kg, found -1"):
        design_references(PLAN, sigma=-1.0)
    with pytest.raises(InputError, match="poses: expected 1 to 100, found 0"):
        design_references(PLAN, poses=0)
    experiment = Recorder(MOTION, following=True)(0, instruments=INSTRUMENTS)
    with pytest.raises(InputError, match="no motion beside recordings"):
        design_references(experiment, duration=8.0)
    silent = {**INSTRUMENTS, "cables": changed(INSTRUMENTS["cables"], noise=None)}
    with pytest.raises(InputError, match="expected the noise of its tension"):
        design_references(replace(experiment, instruments=silent))
    for words in (["--start", *"000000"], ["--body", "x"], ["--after", "x"]):
        ran = CliRunner().invoke(app, ["design", "cogiro", "--reference", *words])
        assert "expected no such option with reference" in str(ran.exception)
    ran = CliRunner().invoke(app, ["design", "cogiro", "--reference", "--calibration"])
    assert (
        "--reference: expected no such option with --calibration" in ran.exception.on_command_line
    )
