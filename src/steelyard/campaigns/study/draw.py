"""What a worker does in a study: one experiment drawn, and identified."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from steelyard.campaigns.rows import DONE, LOST, REFUSED, failed
from steelyard.campaigns.study.resample import resampled
from steelyard.campaigns.study.setup import Setup
from steelyard.campaigns.tasks import Outcome, Row
from steelyard.campaigns.work import estimate_rows, said_of
from steelyard.errors import SteelyardError
from steelyard.estimates.estimate import plain
from steelyard.experiment.model import Experiment
from steelyard.experiment.read import read_experiment
from steelyard.identification.identification import Identification
from steelyard.inertia import BODY_PARAMETERS
from steelyard.inspection.identify import identify
from steelyard.report.evidence.made import steelyard_version
from steelyard.robot.model import Robot
from steelyard.simulation.mistakes import MISTAKES
from steelyard.simulation.sensors import read_sensors
from steelyard.simulation.simulate import simulate

BOUND = "bound"
"""In place of a method: the row of the Cramer-Rao bound of a draw."""


@dataclass(frozen=True)
class DrawTask:
    """One experiment to simulate and identify."""

    name: str
    path: str
    """Of the robot or experiment of the study."""
    asked: str
    methods: tuple[str, ...]
    seed: int
    sha256: str
    """Of the setup."""
    setup: Setup
    mistake: str = ""
    """Of :data:`.MISTAKES`, made in what was recorded or described; empty: none."""


@dataclass(frozen=True)
class ResampleTask:
    """One experiment to draw from the recordings of a real one, and to identify."""

    name: str
    path: str
    """Of the experiment."""
    asked: str
    methods: tuple[str, ...]
    seed: int
    sha256: str
    """Of the inputs."""
    block: float
    """Length of blocks [s]; 0: whole runs are drawn; below 0: nothing is drawn, the recording is
    taken as it is."""


def draw(task: DrawTask) -> Outcome:
    """Simulate, make the mistake, and identify; raises nothing."""
    return _done(task, lambda: _made(task))


def _made(task: DrawTask) -> Experiment:
    experiment = _recorded(task.setup, task.seed, task.sha256)
    if not task.mistake:
        return experiment
    return MISTAKES[task.mistake](experiment, np.random.default_rng([task.seed, 2]))


@lru_cache(maxsize=1)
def _recorded(setup: Setup, seed: int, _sha256: str) -> Experiment:
    """As :func:`drawn`; the mistakes of one draw come one after the other."""
    return drawn(setup, seed)


def resample(task: ResampleTask) -> Outcome:
    """Draw from recordings and identify; raises nothing."""
    return _done(task, lambda: _redrawn(task))


def _redrawn(task: ResampleTask) -> Experiment:
    experiment = read_experiment(task.path)
    if task.block < 0:
        return experiment
    return resampled(experiment, task.block, np.random.default_rng(task.seed))


def drawn(setup: Setup, seed: int) -> Experiment:
    """A simulated experiment, described as the real one is.

    The geometry is drawn about the described one with its uncertainty: what records is not known
    exactly.
    """
    robot = setup.robot_of()
    sigma = dict(setup.uncertainty)
    rng = np.random.default_rng([seed, 1])
    virtual = simulate(
        _uncertain(robot, sigma, rng),
        setup.trajectories(robot),
        read_sensors(setup.sensors, robot),
        seed=seed,
    )
    stated = sigma or dict(virtual.experiment.uncertainty)
    return replace(virtual.experiment, robot=robot, uncertainty=stated)


def _uncertain(robot: Robot, sigma: dict[str, float], rng: np.random.Generator) -> Robot:
    """A robot as it may really be."""
    shape = robot.anchors.shape
    strength = float(np.linalg.norm(robot.gravity))
    factor = 1 + rng.normal(0.0, sigma.get("gravity", 0.0)) / strength
    return replace(
        robot,
        anchors=robot.anchors + rng.normal(0.0, sigma.get("anchor", 0.0), shape),
        attachments=robot.attachments + rng.normal(0.0, sigma.get("attachment", 0.0), shape),
        gravity=robot.gravity * factor,
    )


def _done(task: DrawTask | ResampleTask, make: Callable[[], Experiment]) -> Outcome:
    """Rows of an experiment that is made here."""
    start = time.perf_counter()
    common: dict[str, Any] = {
        "experiment": task.name,
        "path": task.path,
        "asked": task.asked,
        "sha256": task.sha256,
        "version": steelyard_version(),
    }
    try:
        found = identify(make(), task.methods)
        rows: list[Row] = [{"status": DONE, **row} for row in estimate_rows(found)]
        if not getattr(task, "mistake", ""):
            rows += _bound(found)
    except SteelyardError as error:
        rows = [failed(task, REFUSED, str(error))]
    except Exception as error:
        # One draw must not cost the others.
        rows = [failed(task, LOST, said_of(error))]
    seconds = time.perf_counter() - start
    return Outcome(tuple({**row, **common, "seconds": seconds} for row in rows))


def _bound(found: Identification) -> list[Row]:
    """The row of what could be known at best; none where no method tells it."""
    if found.bound is None:
        return []
    sigmas = plain(found.bound.standard_deviation)
    named = {f"sigma_{p}": s for p, s in zip(BODY_PARAMETERS, sigmas, strict=True)}
    return [{"status": DONE, "method": BOUND, **named}]
