"""`identify` by itself says what is wrong with a description, and how to write it."""

import importlib
from dataclasses import replace

import numpy as np
import pytest
from mistaken import DESCRIPTIONS, vector
from places import ROOT
from simulated import sound

import steelyard
from steelyard.experiment.read import read_experiment
from steelyard.inspection.description import check_description
from steelyard.inspection.identify import identify
from steelyard.inspection.misplaced import misplaced
from steelyard.inspection.mistakes.sizes import size_mistakes
from steelyard.report.documents.inspection import statements

pytestmark = pytest.mark.integration

FOUR = ROOT / "tests" / "data" / "rough-robots" / "four-cables-00" / "experiment.yaml"
QUICK = {
    "cogiro": ("forces in kN", "geometry in mm", "gyro in deg/s", "swapped cables"),
    "four cables": ("forces in kN", "forces in lb", "accelerometer in g"),
}


def experiment(name):
    """Eight cables, or four that swing; nothing nominal is known of either body."""
    if name == "cogiro":
        whole = sound(1)
        return replace(whole, robot=replace(whole.robot, platform=None))
    return read_experiment(FOUR)


def cases():
    for robot, quick in QUICK.items():
        for what in DESCRIPTIONS:
            marks = () if what in quick else (pytest.mark.slow,)
            yield pytest.param(robot, what, marks=marks, id=f"{robot}, {what}")


@pytest.mark.slow
@pytest.mark.parametrize(("robot", "what"), list(cases()))
def test_a_wrong_description_is_rejected_with_what_to_write(robot, what):
    make, wanted = DESCRIPTIONS[what]
    found = identify(make(experiment(robot)))
    assert found.is_rejected
    assert found.estimate.verdict.accepted is False
    assert wanted in found.amendment
    assert found.to_dict()["amendment"] == found.amendment
    assert " ".join(found.amendment.split()) in repr(found)
    assert not any(estimate.verdict.accepted for estimate in found.estimates.values())


@pytest.mark.parametrize("robot", QUICK)
def test_sound_ones_have_nothing_to_change(robot):
    check = check_description(experiment(robot))
    assert not check.mistakes
    assert check.amendment == ""


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.mujoco
def test_a_motion_that_disturbs_is_in_no_other_unit(tmp_path, monkeypatch):
    # Filters, a hose and jumps on four cables: whatever makes the motion smaller agreed better, and
    # the tracker was said to read in ft.
    pytest.importorskip("mujoco")
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    recorded = importlib.import_module("rough.recording").recorded
    path, _ = recorded("four", "typical-at-platform", 7, tmp_path, 20.0)
    assert not check_description(read_experiment(path)).mistakes


@pytest.mark.slow
@pytest.mark.parametrize("name", ["points-00", "points-01", "points-02", "points-03", "ideal-points", "rough-robots/three-cables-00"])  # fmt: skip
def test_recordings_of_another_simulator_have_nothing_to_change(recordings, name):
    check = check_description(read_experiment(recordings / name / "experiment.yaml"))
    assert not check.mistakes


def drafted(whole):
    """As `init` describes it: nobody has said where IMU and tracker's target sit."""
    instruments = dict(whole.instruments)
    for name, key in (("imu", "position"), ("tracker", "target")):
        said = instruments[name].model_dump(exclude_unset=True)
        calibration = {**(said.get("calibration") or {}), key: 0.8}
        instruments[name] = type(instruments[name]).model_validate(
            {**said, key: (0.0, 0.0, 0.0), "calibration": calibration}
        )
    return replace(whole, instruments=instruments)


def test_a_place_that_is_said_to_be_unknown_is_no_mistake():
    """The target is 1.1 m off; orientations at 25 Hz tell its acceleration badly."""
    whole = drafted(experiment("cogiro"))
    target = np.array(sound(1).instruments["tracker"].target)
    assert np.linalg.norm(target) > 1.0
    assert not check_description(whole).mistakes


@pytest.mark.slow
@pytest.mark.parametrize("what", ["swapped cables", "quaternion order", "gyro in deg/s"])
def test_mistakes_are_told_though_places_are_unknown(what):
    make, wanted = DESCRIPTIONS[what]
    assert wanted in check_description(make(drafted(experiment("cogiro")))).amendment


@pytest.mark.slow
def test_a_draft_is_estimated_as_it_is():
    found = identify(drafted(experiment("cogiro")))
    estimate = found.estimate
    assert estimate.verdict.accepted is True
    truth = sound(1).robot.platform.body_parameters
    error = (estimate.value - truth) / np.sqrt(np.diag(estimate.covariance))
    assert np.abs(error).max() < 3.5


def test_the_way_in_is_the_public_one():
    assert steelyard.identify is identify


@pytest.mark.slow
def test_what_cannot_be_right_is_fitted_only_when_asked_for():
    wrong = vector("cables", "tension", 1e-3)(experiment("cogiro"))
    told = identify(wrong).estimates["maximum-likelihood"]
    assert np.isnan(told.value).all()
    assert "not begun" in told.verdict.reasons[-1]
    anyway = identify(wrong, "least-squares", anyway=True).estimate
    assert "not begun" not in str(anyway.verdict)
    assert anyway.verdict.accepted is False
    assert "kN" in anyway.verdict.reasons[0]


@pytest.mark.slow
def test_a_noise_that_is_stated_too_large_leaves_an_estimate():
    """It looks like another unit, or like what somebody has guessed: who knows the one knows the other."""
    four = read_experiment(FOUR)
    guessed = four.instruments["cables"].model_copy(update={"noise": 3.0})
    found = identify(replace(four, instruments={**four.instruments, "cables": guessed}))
    first = found.estimate.verdict.reasons[0]
    assert found.is_rejected
    assert "kgf" in first
    assert "or its 'noise', where that is not known" in first
    assert "has less noise than stated: 0.3 N" in found.amendment
    right = identify(four, "maximum-likelihood").estimate
    off = (found.estimate.value - right.value) / found.estimate.standard_deviation
    assert np.abs(off).max() < 3.0


def test_unstated_noise_and_limits_tell_no_unit():
    """Forces and body scale together: nothing is guessed then."""
    four = read_experiment(FOUR)
    quiet = four.instruments["cables"].model_copy(update={"noise": None})
    bare = replace(four, instruments={**four.instruments, "cables": quiet})
    assert not check_description(vector("cables", "tension", 1 / 9.80665)(bare)).mistakes


def test_limits_of_tension_say_that_a_light_platform_is_meant():
    """What a robot file says goes before a rule of thumb."""
    weak = vector("cables", "tension", 1e-3)(experiment("cogiro"))
    for limits, said in ((0.0, np.inf), 1), ((0.1, np.inf), 0), ((50.0, np.inf), 1):
        robot = replace(weak.robot, tension_limits=limits)
        unstated = weak.instruments["cables"].model_copy(update={"noise": None})
        instruments = {**weak.instruments, "cables": unstated}
        found = size_mistakes(replace(weak, robot=robot, instruments=instruments))
        assert len(found) == said


@pytest.mark.parametrize("key", ["scale", "columns"])
def test_what_is_to_be_merged_takes_the_mistake_back(tmp_path, key):
    """Written into the file as it was printed."""
    what = {"scale": "forces in kN", "columns": "swapped cables"}[key]
    make, _ = DESCRIPTIONS[what]
    right = experiment("cogiro")
    steelyard.write_experiment(make(right), tmp_path)
    file = tmp_path / "experiment.yaml"
    check = check_description(read_experiment(file))
    line = check.amendment.splitlines()[2]
    text = file.read_text()
    assert text.count("\n  cables:\n") == 1
    file.write_text(text.replace("\n  cables:\n", f"\n  cables:\n{line}\n"))
    amended = read_experiment(file)
    np.testing.assert_allclose(
        amended.runs[0].streams["cables"].values["tension"],
        right.runs[0].streams["cables"].values["tension"],
        rtol=1e-9,
    )
    assert not check_description(amended).mistakes


def test_the_verb_prints_what_to_merge(run, tmp_path):
    make, wanted = DESCRIPTIONS["forces in kN"]
    steelyard.write_experiment(make(experiment("cogiro")), tmp_path)
    file = tmp_path / "experiment.yaml"
    status, out, err = run("identify", file, "--out", tmp_path / "out")
    assert (status, err) == (3, "")
    assert out.rstrip().endswith(wanted)
    assert f"To merge into {file}:" in out
    assert '"amendment"' in (tmp_path / "out" / "estimate.json").read_text()


def test_contacts_wait_for_a_mistake():
    found = steelyard.inspect(DESCRIPTIONS["swapped cables"][0](sound(1)))
    assert found.mistakes
    assert found.contacts == ()
    assert any("once the mistakes are corrected" in remark for remark in found.remarks)


def found_by_a_fit(name="imu.position", size=-0.3):
    """Directed tests as a fit gives them, the largest first."""
    return [
        {"name": f"{name} x", "z": -40.0, "size": size, "sigma": 0.004},
        {"name": "attachment 1 x", "z": 7.0, "size": 0.01, "sigma": 0.001},
        {"name": f"{name} y", "z": 2.0, "size": 0.05, "sigma": 0.025},
    ]


def test_a_place_that_the_fit_contradicts_most_is_amended():
    whole = sound(1)
    place = misplaced(whole, found_by_a_fit())
    stated = np.array(whole.instruments["imu"].position)
    np.testing.assert_allclose(place.place, stated + np.array([-0.3, 0, 0]))
    assert place.amendment.startswith("instruments:\n  imu:\n    position: [")
    assert "calibration: {position: 0.05}" in place.amendment
    assert "by 0.30 m" in place.remark


@pytest.mark.parametrize("tests", [[], found_by_a_fit(size=0.02), found_by_a_fit("anchor 3")])
def test_what_is_near_or_no_place_is_not_amended(tests):
    assert misplaced(sound(1), tests) is None


@pytest.mark.slow
def test_instruments_do_not_agree_with_an_imu_that_sits_elsewhere():
    found = steelyard.inspect(DESCRIPTIONS["wrong IMU place"][0](experiment("four cables")))
    assert found.misplaced.instrument == "imu"
    said = [each.text for each in statements(found)]
    assert any("imu seems to sit elsewhere" in text for text in said)
    assert not any("all instruments agree" in text for text in said)
