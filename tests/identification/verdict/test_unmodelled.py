"""An unmodelled torque beside the torque that turns the body: independent of the motion only as far as
chance leaves it. Coloured noise that takes up a wrong sign.
"""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.interpolate import make_lsq_spline

from steelyard.identification.model.balance import UNMODELLED_PARTS, Balance
from steelyard.identification.model.calibration_parameters import ATTACHED, BENDING_KEYS, ROBOT
from steelyard.identification.model.motion_segment import Reading, Segment
from steelyard.identification.model.processes import Process, integrals_of
from steelyard.identification.model.segment import POSE
from steelyard.identification.verdict import unmodelled
from steelyard.identification.verdict.settings import VERDICT
from steelyard.identification.verdict.unmodelled import (
    _against_motion,
    of_disturbances,
    of_imitations,
    scatter_beside,
)
from steelyard.inertia import Inertia
from steelyard.smoothing import DEGREE, knots

BODY = Inertia(10.0, np.zeros(3), np.diag([0.2, 0.3, 0.4]))
FELT = np.array([[0.6, 0.0, 9.81 + 0.8]])  # accelerated by 10 N
ALPHA = np.array([[0.0, 0.0, 2.0]])  # turns with .8 N m
FORCE, TORQUE = sorted(UNMODELLED_PARTS, key=lambda source: UNMODELLED_PARTS[source].start)


@dataclass
class Samples:
    run: str = "swings"
    alpha: np.ndarray = None
    omega: np.ndarray = None
    rotation: np.ndarray = None
    specific_force: np.ndarray = None

    def __len__(self):
        return len(self.alpha)


def posterior(torque, stated=False, to_and_fro=True, source=TORQUE, duration=5.0, loose=False):
    turns = np.cos(2 * np.pi * 5 * np.linspace(0, 1, 400)) * np.sqrt(2)
    along = np.zeros((400, 3))
    along[:, 2] = torque * (turns if to_and_fro else np.linspace(0.9, 1.1, 400))
    process = SimpleNamespace(is_stated=stated, disturbs=source, source=source)
    segment = SimpleNamespace(
        static=False,
        run="swings",
        span=(0.0, duration),
        spacing=0.1,
        processes=(process,),
        basis=lambda times: None,
        disturbance=lambda process, local: along,
    )
    return SimpleNamespace(
        experiment=SimpleNamespace(
            robot=SimpleNamespace(gravity=np.array([0, 0, -9.81]), size=1),
            moves_within=lambda run: loose,
        ),
        parameters=BODY.parameters,
        parameters_in=lambda run: BODY.parameters,
        fit=SimpleNamespace(state=SimpleNamespace(segments=(segment,))),
        calibration=SimpleNamespace(gravity=np.array([0, 0, -9.81])),
        samples=(Samples("swings", ALPHA, np.zeros((1, 3)), np.eye(3)[None], FELT),),
    )


@pytest.mark.parametrize(("torque", "count"), [(0.1, 0), (0.32, 1)])
def test_one_that_is_a_large_part_of_what_turns_the_body_is_no_promise(torque, count):
    found = list(of_disturbances(posterior(torque), VERDICT))
    assert len(found) == count
    if found:
        assert "40% of the torque that turns the platform" in found[0]


def test_one_that_drifts_does_not_follow_the_motion():
    # Cells that drift were taken for it: a third of what turns the body, as steady as the day.
    assert not list(of_disturbances(posterior(0.32, to_and_fro=False), VERDICT))


@pytest.mark.parametrize(
    ("force", "duration", "count"), [(0.3, 5.0, 0), (0.6, 5.0, 1), (0.6, 20.0, 0)]
)
def test_a_few_seconds_do_not_tell_a_load_that_swings(force, duration, count):
    found = list(of_disturbances(posterior(force, source=FORCE, duration=duration), VERDICT))
    assert len(found) == count
    if found:
        assert "6% of the force that accelerates the platform, and 5 s of motion" in found[0]


def test_one_that_is_stated_is_known():
    assert not list(of_disturbances(posterior(0.3, stated=True), VERDICT))


@pytest.mark.parametrize(("part", "count"), [(0.3, 0), (0.7, 1)])
@pytest.mark.parametrize("source", [FORCE, TORQUE])
def test_what_moves_in_a_load_pulls_less_than_it_weighs(part, count, source):
    pulls = part * 98.1
    found = list(of_disturbances(posterior(pulls, True, source=source, loose=True), VERDICT))
    assert len(found) == count
    if found:
        assert "what moves in the load would pull with 69 N" in found[0]


@pytest.mark.parametrize(("wrench", "of_readings"), [(0.2, 0.0), (0.0, 0.2)])
def test_noise_that_a_process_takes_up_counts_as_noise(monkeypatch, wrench, of_readings):
    # Half of the variance of the noise is in the process.
    at = Balance(
        time=np.zeros(1),
        motion={},
        measured=SimpleNamespace(
            unmodelled=SimpleNamespace(wrench=np.eye(6)[None]), wrench_by_reading=np.eye(6)[None]
        ),
        left_over=np.zeros((1, 6)),
        sigmas=np.ones((1, 6)),
        unmodelled_sigma=np.zeros(6),
        noise=SimpleNamespace(whitener=np.eye(6)[None] * np.sqrt(0.5) / 0.2),
        disturbance=np.full((1, 6), wrench),
        coloured=np.full((1, 6), of_readings),
        told=np.ones(1, dtype=bool),
    )
    monkeypatch.setattr(unmodelled, "balance_of", lambda *given: at)
    state = SimpleNamespace(segments=(None,), calibration=None, parameters=np.ones(10), factors={})
    found = SimpleNamespace(
        experiment=None, fit=SimpleNamespace(state=state), force_samples=(None,)
    )
    assert scatter_beside(found) == pytest.approx(0.5)


def test_what_reads_against_the_motion_is_seen_beside_its_coloured_noise():
    """A slow rate of the wrong sign is no coloured noise, though one of twice its size makes it fit."""
    grid = knots(0.0, 4.0, 0.1)
    time = np.arange(0.0, 4.0, 0.01)
    rate = np.sin(2 * np.pi * time)
    read = 0.02 * np.column_stack([rate, rate, -rate])
    source = ("imu", "angular_velocity")
    coefficients = np.zeros((len(grid) - DEGREE - 1, POSE))
    coefficients[:, 3] = 1.0
    segment = Segment("run", grid, (Reading(source, time, read, 0.00175),), coefficients)
    process = Process(source, np.ones(3), 1.0, 0.5, integrals_of(grid))
    segment = segment.disturbed((process,))
    # What the readings of the first lack is a part of them, of the second all, of the third twice.
    lacks = 0.02 * np.column_stack([0.5 * rate, -rate + 1e-3 * np.cos(time), 2 * rate])
    coefficients = segment.coefficients.copy()
    coefficients[:, POSE:] = make_lsq_spline(time, lacks, grid, k=DEGREE).c
    segment = replace(segment, coefficients=coefficients)
    (process,) = segment.processes
    assert _against_motion(segment, process, VERDICT) == [2]
    quiet = replace(segment, readings=(replace(segment.readings[0], sigma=0.02),))
    assert _against_motion(quiet, process, VERDICT) == []


HOSE = [(ROBOT, key, None) for key, _ in ATTACHED]


@pytest.mark.parametrize(
    ("asked", "counts"), [([], 0), (HOSE, 0), (BENDING_KEYS, 0), ([*HOSE, *BENDING_KEYS], 1)]
)
def test_a_hose_and_parts_that_bend_are_a_load_that_swings(asked, counts):
    reasons = list(of_imitations(SimpleNamespace(asked_for=frozenset(asked))))
    assert len(reasons) == counts
    assert all("as a load that swings does" in each for each in reasons)
