"""From the words of the command line to what a design takes; imported only where one is made."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import InputError
from steelyard.estimates.estimate import Estimate
from steelyard.estimates.file.places import read_estimates
from steelyard.excitation.design_file import RATE
from steelyard.excitation.evaluation import MotionEvaluation, evaluate_motions
from steelyard.excitation.information.optimality_criterion import Target
from steelyard.excitation.limits.motion_constraints import Margin, MotionConstraints
from steelyard.excitation.limits.rest_poses import with_tension_level
from steelyard.excitation.plan import is_experiment, planned
from steelyard.excitation.search.design_set_up import designed_body
from steelyard.experiment.model import Experiment
from steelyard.experiment.read import read_experiment
from steelyard.identification.methods.maximum_likelihood import MaximumLikelihood
from steelyard.identification.solve.posterior import Progress
from steelyard.inertia import Inertia, body_jacobian
from steelyard.motion.trajectory import Trajectory
from steelyard.simulation.trajectories import repeated_move, trajectories

_MARGINS = 0.0, 0.9
"""Shares of mass and inertia; a body of no mass cannot be held."""
_MOST_RUNS = 20
"""A design of so many motions takes hours."""
_BUDGETS = 5.0, 3600.0
"""[s]: less finds nothing, more is a mistake of the unit."""
_MOST_RATE = 10_000.0
"""[Hz]; no controller takes commands faster."""


@dataclass(frozen=True, eq=False)
class DesignTask:
    """What is designed for."""

    experiment: Experiment
    target: Target
    before: Array
    """Information on the ten linear parameters that earlier estimates have, shape (10, 10)."""


def check_numbers(margin: float, runs: int, budget: float, rate: float) -> None:
    """Refuse numbers of which no design comes.

    Raises:
        InputError: One is out of its range.
    """
    if not RATE <= rate <= _MOST_RATE:
        raise InputError(
            f"--rate: expected {RATE:g} to {_MOST_RATE:g} Hz, found {rate:g}; choose another"
        )
    if not _MARGINS[0] <= margin <= _MARGINS[1]:
        raise InputError(
            f"--margin: expected a share from {_MARGINS[0]:g} to {_MARGINS[1]:g}, found {margin:g};"
            " .2 is a body up to 20 % lighter or heavier"
        )
    if not 1 <= runs <= _MOST_RUNS:
        raise InputError(f"--runs: expected 1 to {_MOST_RUNS}, found {runs}; choose another number")
    if not _BUDGETS[0] <= budget <= _BUDGETS[1]:
        raise InputError(
            f"--budget: expected {_BUDGETS[0]:g} to {_BUDGETS[1]:g} s, found {budget:g}; choose"
            " another time"
        )


def check_unused(options: Mapping[str, object], beside: str) -> None:
    """Refuse options that would be passed over.

    Args:
        options: Name -> what was given; None, or nothing in it: it was not.
        beside: What has no use for them.

    Raises:
        InputError: One was given.
    """
    for name, value in options.items():
        if value is not None and value != ():
            raise InputError(
                f"{name}: expected no such option with {beside}, found one; leave it out"
            )


def design_task(
    place: str, sensors: str, body: str | None, after: Sequence[str], target: str | None
) -> DesignTask:
    """What is designed for, from files.

    Args:
        place: A robot or an experiment.
        sensors: Of a robot alone.
        body: An estimate; None: the body of the robot file, else as it was found before.
        after: Estimates and experiments of which the information is there already.
        target: Wanted 1-sigma, as ``--target`` has it.

    Raises:
        InputError: A file cannot be read, or lacks what it is read for.
    """
    earlier = [_estimate_of(each) for each in after]
    experiment = _with_body(planned(place, sensors), body, earlier)
    platform = designed_body(experiment.robot)
    before = np.zeros((10, 10))
    for each in earlier:
        before += _information(each, platform)
    return DesignTask(experiment, _target(target, platform), before)


def target_of(place: str, sensors: str, text: str | None) -> Target | None:
    """Wanted 1-sigma for what a robot carries, or the first load of an experiment; None: none is
    said.

    Args:
        place: A robot or an experiment.
        sensors: Of a robot alone.
        text: As ``--target`` has it.

    Raises:
        InputError: It is wrong, or there is no platform that its shares are of.
    """
    if text is None:
        return None
    return _target(text, designed_body(planned(place, sensors).robot))


def pose_of(values: Sequence[float] | None) -> Array | None:
    """A pose from x, y, z [m], roll, pitch, yaw [deg]; angles in radians, shape (6,).

    Raises:
        InputError: They are not all finite.
    """
    if not values:
        return None
    if not np.isfinite(values).all():
        raise InputError("--start, --end: expected six numbers, found others; correct them")
    return np.concatenate([values[:3], np.radians(values[3:])])


def checked_motion(
    task: DesignTask, which: str, duration: float | None, margin: float, tell: Progress
) -> MotionEvaluation:
    """What a given motion will achieve and what it takes; limits that it exceeds are said, not
    refused.

    Args:
        task: What it is for.
        which: ``paper``, ``multisine`` or a file.
        duration: Of the whole [s].
        margin: Share by which mass and inertia may differ.
        tell: Where progress goes.
    """
    robot = task.experiment.robot
    runs: dict[str, Trajectory] = (
        {"paper": repeated_move(duration)}
        if which == "paper"
        else trajectories(robot, which, duration, check=False)
    )
    constraints = with_tension_level(
        MotionConstraints(robot, task.experiment.instruments, Margin(margin, robot.size), 0.0, 1.0)
    )
    return evaluate_motions(
        task.experiment,
        runs,
        target=task.target,
        margin=constraints.margin,
        level=constraints.level,
        before=task.before,
        progress=tell,
    )


def _with_body(experiment: Experiment, body: str | None, earlier: Sequence[Estimate]) -> Experiment:
    """The experiment with the body that is designed for: as estimated, else as the robot file says,
    else as it was found before.
    """
    if body is not None:
        estimate = _estimate_of(body)
        if estimate.body is None:
            raise InputError(
                f"--body {body}: expected an estimate of all ten parameters, found one that lacks"
                " some; add what is missing as 'platform' to the robot file"
            )
        return replace(experiment, robot=replace(experiment.robot, platform=estimate.body))
    found = next((each.body for each in earlier if each.body is not None), None)
    if experiment.robot.platform is None and found is not None:
        return replace(experiment, robot=replace(experiment.robot, platform=found))
    return experiment


def _estimate_of(place: str) -> Estimate:
    """An estimate, or what maximum likelihood makes of an experiment."""
    path = Path(place)
    if path.suffix in {".yaml", ".yml"} and is_experiment(place):
        return MaximumLikelihood()(read_experiment(path))
    found = read_estimates([place])
    if len(found) != 1:
        raise InputError(
            f"{place}: expected one estimate, found {len(found)}; name the method behind a colon"
        )
    return found[0].estimate


def _information(estimate: Estimate, platform: Inertia) -> Array:
    """What an estimate knows of the ten linear parameters, shape (10, 10)."""
    known = np.isfinite(estimate.standard_deviation) & (estimate.standard_deviation > 0)
    if not known.any():
        return np.zeros((10, 10))
    jacobian = body_jacobian(platform.parameters)[known]
    covariance = estimate.covariance[np.ix_(known, known)]
    return np.asarray(jacobian.T @ np.linalg.pinv(covariance, hermitian=True) @ jacobian)


def _target(text: str | None, platform: Inertia) -> Target:
    """From ``mass=1.6,cog=0.002,inertia=1%``; what is not named takes its default."""
    target = Target.default(platform)
    if not text:
        return target
    whole = {
        "mass": platform.mass,
        "cog": None,
        "inertia": float(np.max(np.diag(platform.inertia))),
    }
    for part in text.split(","):
        key, _, value = (each.strip() for each in part.partition("="))
        number = _positive(value.removesuffix("%"))
        relative = value.endswith("%")
        if key not in whole or number is None or (relative and whole[key] is None):
            raise InputError(
                "--target: expected mass=KG,cog=M,inertia=KGM2 (mass and inertia also in %), found"
                f" '{part}'; correct it"
            )
        size = number / 100 * (whole[key] or 1.0) if relative else number
        target = replace(target, **{key: size})
    return target


def _positive(text: str) -> float | None:
    """A finite number above 0; None where it is none."""
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) and value > 0 else None
