"""Drawn recordings with imperfections: what they say is true, and a seed is a recording."""

import importlib
import json

import numpy as np
import pytest
from places import ROOT
from scipy.stats import chi2

from steelyard.dynamics import platform_wrench
from steelyard.experiment.read import read_experiment
from steelyard.identification.identify import identify
from steelyard.inertia import Inertia

pytestmark = pytest.mark.mujoco
pytest.importorskip("mujoco")
SECONDS, CALM = 3.0, 16.0  # [s]


@pytest.fixture
def rough(monkeypatch):
    """Imports a module of the drawn recordings."""
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    return lambda name: importlib.import_module(f"rough.{name}")


@pytest.mark.slow
@pytest.mark.parametrize("name", ["three", "five", "six", "desk"])
def test_cables_carry_what_moves_the_body(rough, name):
    robots, kinds, motion, shared = map(rough, ("robots", "kinds", "motion", "shared"))
    rng = np.random.default_rng(3)
    robot = robots.drawn(robots.ROBOTS[name], rng)
    plain = robot.plain
    made = motion.course(robot, kinds.KINDS["sound"], plain.anchors, plain.attachments, CALM, rng)
    at = made.at(np.linspace(0.5, CALM - 0.5, 40))
    structure = shared.public.structure_of(
        plain.anchors, plain.attachments, at.position, at.rotation
    )
    wrench = np.einsum("nkm,nm->nk", structure, at.tension).reshape(-1, 2, 3)
    own = np.einsum("nji,nkj->nki", at.rotation, wrench).reshape(-1, 6)
    body = Inertia.from_body_parameters(made.body).parameters
    needed = platform_wrench(body, at.specific_force, at.omega, at.alpha)
    assert made.slack == 0.0
    np.testing.assert_allclose(own, needed, atol=1e-4 * robot.weight)


@pytest.mark.slow
@pytest.mark.long
def test_every_kind_is_a_recording_that_can_be_read(rough, tmp_path):
    recording, kinds = rough("recording"), rough("kinds")
    for kind, what in kinds.KINDS.items():
        robot = what.robots[-1]
        path, body = recording.recorded(robot, kind, 0, tmp_path / kind, SECONDS)
        found = read_experiment(path)
        assert set(found.instruments) >= {"cables"}
        assert json.loads((tmp_path / kind / "truth.json").read_text())["body"] == list(body)


def test_a_seed_is_a_recording(rough, tmp_path):
    recorded = rough("recording").recorded
    for number, place in ((0, "one"), (0, "again"), (1, "other")):
        recorded("six", "sound", number, tmp_path / place, SECONDS)
    one, again, other = (
        (tmp_path / each / "run" / "cables.csv").read_bytes() for each in ("one", "again", "other")
    )
    assert one == again != other


@pytest.mark.slow
@pytest.mark.parametrize(("name", "number"), [("six", 1), ("six", 3), ("cogiro", 1)])
def test_what_level_circles_tell_is_true(rough, tmp_path, name, number):
    """Nothing but vibrations that the gyro barely sees turns the platform: what noise alone tells of
    the moments, and of the gyro, is told by nothing."""
    path, body = rough("recording").recorded(name, "sound", number, tmp_path, 10.0, "circles")
    found = identify(read_experiment(path), ["maximum-likelihood"]).estimate
    told = np.isfinite(found.value)
    error = (found.value - body)[told]
    assert found.verdict.accepted, found.verdict.reasons
    assert told[:4].all()
    assert not told[6]
    assert error @ np.linalg.solve(found.covariance[np.ix_(told, told)], error) < chi2.isf(
        1e-3, told.sum()
    )
