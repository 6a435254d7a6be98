"""Parts that move against the platform, against an integrated pendulum and MuJoCo."""

import importlib
import itertools
from dataclasses import replace

import numpy as np
import pytest
from places import ROOT
from scipy.integrate import solve_ivp
from scipy.interpolate import make_interp_spline
from simulated import RECORDER, ROBOT, TRUTH, sound, with_stream

from steelyard.experiment.read import read_experiment
from steelyard.identification.methods.method import JointMotion
from steelyard.identification.model.settings import MOTION
from steelyard.identification.solve.joint_motion import fit_jointly
from steelyard.identification.solve.settings import FIT
from steelyard.identification.verdict.assessment import reasons
from steelyard.identification.verdict.force_stretch import force_stretches
from steelyard.identification.verdict.resonance import (
    _frequencies,
    _moved_body,
    _rows_at,
    resonance,
)
from steelyard.identification.verdict.responses import KINDS, AskedStretch, oscillator
from steelyard.robot.kinematics import cables_at

pytestmark = pytest.mark.integration
AT = np.array([0.1, -0.05, -0.4])
"""Where it is fixed [m]."""


def withstood(experiment, force_of):
    """With the tensions that hold the platform against a force at a point of it, platform frame."""
    time = experiment.runs[0].streams["cables"].time
    state = RECORDER.response.at(np.clip(time - time[0], 0.0, RECORDER.response.duration))
    since = time - time[0]
    place = state.position + state.rotation @ AT
    acceleration = make_interp_spline(since, place, k=5).derivative(2)
    force = force_of(since, acceleration, state.rotation)
    wrench = np.concatenate([force, np.cross(AT, force)], axis=1)
    W = cables_at(ROBOT, state.position, state.rotation, state.tension).structure
    more = np.einsum("nmk,nk->nm", np.linalg.pinv(W), wrench)
    return with_stream(experiment, "cables", lambda v: {"tension": v["tension"] - more})


def on_a_string(mass, length):
    """Pull of a load that swings in earnest: no small angles."""

    def force(since, acceleration, rotation):
        def rate(time, state):
            away, speed = state[:2], state[2:]
            down = np.sqrt(length**2 - away @ away)
            pull = -acceleration(time)[:2] - 9.81 * away / down - 0.05 * speed
            return np.concatenate([speed, pull])

        solved = solve_ivp(rate, (0, since[-1]), np.zeros(4), t_eval=since, rtol=1e-8, atol=1e-10)
        away = solved.y[:2].T
        down = np.sqrt(length**2 - np.sum(away**2, axis=1))
        level = np.column_stack([mass * 9.81 * away / down[:, None], np.zeros(len(since))])
        return np.einsum("nji,nj->ni", rotation, level)

    return force


@pytest.mark.parametrize("duration", [12.0, 20.0, 60.0])
@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: f"{kind.name} {kind.at_any_angle}")
def test_no_resonance_stands_between_two_frequencies(kind, duration):
    """With steps of 6 % and a damping ratio of .02 a load that swung at .58 Hz was not seen."""
    time = np.arange(0.0, duration, 0.01)
    driven = np.random.default_rng(3).normal(size=(len(time), 3)).cumsum(axis=0)
    asked = _frequencies(kind, max(kind.lowest, 4 / duration), duration)

    def followed(frequency, damping):
        response = oscillator(driven - driven[0], 2 * np.pi * frequency, damping, 0.01)
        return response - driven + driven[0]

    def seen(response, others):
        """Share of its square along the nearest of others."""
        along = [np.vdot(response, each) ** 2 / np.vdot(each, each) for each in others]
        return max(along) / np.vdot(response, response)

    for below, above in list(itertools.pairwise(asked))[::5]:
        swings = followed((below + above) / 2, 0.003)
        assert (
            seen(swings, [followed(below, max(kind.damping)), followed(above, max(kind.damping))])
            > 0.5
        )
        near = np.linspace(below, above, 5)
        assert seen(swings, [followed(each, min(kind.damping)) for each in near]) > 0.9


@pytest.mark.slow
@pytest.mark.parametrize(("mass", "length"), [(4.0, 0.6), (3.0, 1.5)])
def test_a_load_on_a_string_is_named(mass, length):
    posterior = fit_jointly(withstood(sound(0), on_a_string(mass, length)))
    found = resonance(posterior)
    assert found.name == "swings"
    assert found.mass == pytest.approx(mass, rel=0.4)
    # Twelve seconds tell a frequency to about a tenth of a hertz.
    assert found.frequency == pytest.approx(np.sqrt(9.81 / length) / (2 * np.pi), abs=0.1)
    assert any(
        "swing at" in each and "no part of a rigid body" in each for each in reasons(posterior)
    )


@pytest.mark.slow
def test_a_mass_that_is_known_is_not_moved():
    """A load that swings moves what the readings tell, not what a scale has told."""
    swinging = withstood(sound(0), on_a_string(4.0, 0.6))
    moved = {}
    for sigma in (10.0, 1e-3):
        known = replace(swinging, known={"mass": (TRUTH[0], sigma)})
        posterior = fit_jointly(known)
        (stretch,) = force_stretches(posterior)
        asked = [AskedStretch.of(stretch, KINDS[0], TRUTH[0])]
        pull = np.array([-4.0, *(-4.0 * AT)])
        (rows,) = _rows_at(asked, 0.64)
        moved[sigma] = _moved_body(posterior, [stretch], [rows @ pull])
    assert abs(moved[10.0][0]) > 0.01
    assert abs(moved[1e-3][0]) < 1e-4
    # The centre of gravity still follows.
    assert np.abs(moved[1e-3][1:4]).max() > 0.1


@pytest.fixture
def rough(tmp_path, monkeypatch):
    """A recording of MuJoCo with something that is no rigid body."""
    pytest.importorskip("mujoco")
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    recorded = importlib.import_module("rough.recording").recorded

    def drawn(robot, kind, number=0, motion="multisine"):
        path, _ = recorded(robot, kind, number, tmp_path / robot, 20.0, motion)
        return read_experiment(path)

    return drawn


@pytest.mark.mujoco
@pytest.mark.slow
@pytest.mark.long
def test_a_part_that_bends_is_named(rough):
    # A fifth of the mass on springs of 7 Hz: it was accepted, with a centre of gravity 9 sigma off.
    found = resonance(fit_jointly(rough("desk", "platform-bends")))
    assert found.name == "bends"
    assert found.frequency == pytest.approx(7.0, rel=0.1)
    assert found.mass is None
    assert "stiffen it" in str(found)


@pytest.mark.mujoco
@pytest.mark.slow
@pytest.mark.long
def test_a_load_that_swings_on_circles_is_not_accepted(rough):
    # Of one frequency a hose and parts that bend explain it: the centre of gravity is 8 cm off.
    # On knots that follow what seems to move nothing seemed to, and that estimate was accepted.
    found = JointMotion()(rough("cogiro", "load-swings", 80, "circles"))
    assert any("as a load that swings does" in reason for reason in reasons(found))


@pytest.mark.mujoco
@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "looser", "frequency"),
    # Of a motion that is held firmly the second asks for a matrix of residual flexibility that is
    # none: it was accepted with 7.2.
    [(53, MOTION.looser_jointly, pytest.approx(7.0, abs=0.4)), (56, 30.0, None)],
)
def test_what_bends_near_its_own_frequency_is_named(rough, number, looser, frequency):
    settings = replace(FIT, motion=replace(MOTION, looser_jointly=looser))
    found = resonance(fit_jointly(rough("desk", "platform-bends", number), settings=settings))
    assert (found.name, found.mass) == ("bends", None)
    assert found.frequency == frequency
    assert "no part of a rigid body" in str(found) or "does not explain" in str(found)


@pytest.mark.mujoco
@pytest.mark.slow
@pytest.mark.long
def test_what_seems_to_touch_it_again_and_again_is_no_touch(rough):
    # A load that swings by a right angle: its largest pulls had been left out as contacts.
    posterior = fit_jointly(rough("cogiro", "load-swings"))
    assert any("that is one thing rather than many" in each for each in reasons(posterior))


@pytest.mark.mujoco
@pytest.mark.slow
@pytest.mark.long
def test_a_load_that_swings_far_is_named(rough):
    # As an oscillator it took 31 off the cost, as a string at any angle 780; it was accepted, 15 times
    # its covariance off.
    found = resonance(fit_jointly(rough("cogiro", "load-swings", 7)))
    assert found.name == "swings"
    assert found.frequency == pytest.approx(0.64, abs=0.02)
    assert found.mass == pytest.approx(3.6, rel=0.1)


@pytest.mark.parametrize("seed", range(4))
def test_a_rigid_body_has_none(seed):
    assert resonance(fit_jointly(sound(seed))) is None


BEGINS = 5.0
"""In the middle of a motion [s]."""


def ringing(since, acceleration, rotation):
    """A platform that rings on its cables after a move, as a part that hung at rest in the beginning
    would.
    """
    omega, later = 2 * np.pi * 2.7, np.maximum(since - BEGINS, 0.0)
    along = 90.0 * acceleration.derivative()(BEGINS) / omega
    waves = np.exp(-0.01 * omega * later) * np.sin(omega * later)
    return np.einsum("nji,j->ni", rotation, along) * waves[:, None]


@pytest.mark.parametrize("seed", range(2))
def test_a_platform_that_rings_freely_is_one_body(seed):
    experiment = withstood(sound(seed), ringing)
    (run,) = experiment.runs
    late = replace(experiment, runs=(replace(run, window=(BEGINS, BEGINS + 5.0)),))
    assert resonance(fit_jointly(late)) is None


def humming(since, acceleration, rotation):
    """Something that pulls at it along z, whatever it does [N]."""
    return 60.0 * np.sin(2 * np.pi * 6.3 * since)[:, None] * [0.0, 0.3, 1.0]


@pytest.mark.slow
def test_what_hums_is_no_part_that_moves():
    experiment = withstood(sound(1), humming)
    assert resonance(fit_jointly(experiment)) is None
    (run,) = experiment.runs
    parts = [(0.0, BEGINS), (BEGINS + 0.5, 12.0)]
    runs = [replace(run, name=f"{part[0]}", window=part) for part in parts]
    assert resonance(fit_jointly(replace(experiment, runs=tuple(runs)))) is None


@pytest.mark.slow
def test_a_few_seconds_do_not_hide_a_load_on_a_string():
    experiment = withstood(sound(0), on_a_string(4.0, 0.9))
    (run,) = experiment.runs
    short = replace(experiment, runs=(replace(run, window=(BEGINS, BEGINS + 5.0)),))
    found = list(reasons(fit_jointly(short)))
    assert any("swing" in each for each in found), found
