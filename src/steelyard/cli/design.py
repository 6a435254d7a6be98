"""The verb that finds the best experiment, or looks at one that a user has in mind."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from steelyard.arrays import Array
from steelyard.cli.progress import progress
from steelyard.cli.verbs import print_json
from steelyard.errors import InputError
from steelyard.estimates.estimate import Estimate
from steelyard.estimates.estimate_file import read_estimates
from steelyard.excitation.design import design
from steelyard.excitation.design_file import (
    RATE,
    RESULT,
    command_names,
    design_dict,
    evaluation_dict,
    write_design,
)
from steelyard.excitation.evaluation import MotionEvaluation, evaluate_motions
from steelyard.excitation.information.optimality_criterion import Target
from steelyard.excitation.limits.motion_constraints import Margin, MotionConstraints
from steelyard.excitation.limits.rest_poses import with_tension_level
from steelyard.excitation.plan import is_experiment, planned
from steelyard.excitation.search.design_set_up import designed_body
from steelyard.experiment.model import Experiment
from steelyard.experiment.read import read_experiment
from steelyard.identification.methods.maximum_likelihood import MaximumLikelihood
from steelyard.identification.solve.study import Progress
from steelyard.inertia import Inertia, body_jacobian
from steelyard.motion.trajectory import Trajectory
from steelyard.output import check_target, results_folder, write_json
from steelyard.report.design import show_design
from steelyard.report.design_document import design_document
from steelyard.report.write import write_document
from steelyard.simulation.trajectories import repeated_move, trajectories

_MARGINS = 0.0, 0.9
_MOST_RUNS = 20
_BUDGETS = 5.0, 3600.0
_MOST_RATE = 10_000.0
REPORT = "design"


def run_design(
    place: str,
    *,
    duration: float | None,
    out: Path | None,
    check: str | None,
    start: Sequence[float] | None,
    end: Sequence[float] | None,
    target: str | None,
    margin: float,
    runs: int,
    after: Sequence[str],
    body: str | None,
    sensors: str,
    budget: float,
    seed: int,
    processes: int | None,
    rate: float,
    force: bool,
    as_json: bool,
    quiet: bool,
) -> None:
    """Find motions and write them, or look at one that is given."""
    _check_numbers(margin, runs, budget, rate)
    if out is not None:
        check_target(out, force=force)
    with progress(quiet=quiet) as tell:
        earlier = [_estimate(each) for each in after]
        experiment = _with_body(planned(place, sensors), body, earlier)
        platform = designed_body(experiment.robot)
        before = sum((_information(each, platform) for each in earlier), start=np.zeros((10, 10)))
        wanted = _target(target, platform)
        if check is not None:
            evaluation = _checked(experiment, check, duration, margin, wanted, before, tell)
            values = evaluation_dict(evaluation)
            if out is not None:
                with results_folder(out, force=force) as folder:
                    write_json(values, folder / RESULT)
                    write_document(design_document(evaluation), folder, REPORT)
        else:
            if duration is None:
                raise InputError(
                    "--duration: expected the length of the motion in seconds, found none; add it"
                )
            if out is None:
                raise InputError("--out: expected a folder for the commands, found none; add it")
            found = design(
                experiment,
                duration,
                start=_pose(start),
                end=_pose(end),
                target=wanted,
                margin=margin,
                runs=runs,
                before=before,
                budget=budget,
                seed=seed,
                processes=processes or os.cpu_count() or 1,
                progress=tell,
            )
            evaluation, values = found.appraisal, design_dict(found)
            with results_folder(out, force=force) as folder:
                write_design(found, folder, rate)
                write_document(design_document(evaluation), folder, REPORT)
    if as_json:
        print_json(values)
        return
    show_design(evaluation)
    if check is None and out is not None:
        if not found.in_time:
            print(
                "The time was up before all searches had ended: another run may find another"
                " motion; a larger --budget helps."
            )
        files = ", ".join(name for _, name in command_names(evaluation))
        print(f"\n{files} and {RESULT} are in {out}/; {REPORT}.html shows the motion.")
        if is_experiment(place):
            print(
                f"Record the motion, add it as a run to {place}, then: steelyard identify"
                f" {_quoted(place)}"
            )
        else:
            print("Try it on the simulated robot next:")
            print(
                f"  steelyard simulate {_quoted(place)} --trajectory {out / 'command.csv'} --out"
                f" {out / 'virtual'}"
            )


def _quoted(place: str) -> str:
    return f"'{place}'" if " " in place else place


def _check_numbers(margin: float, runs: int, budget: float, rate: float) -> None:
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


def _with_body(experiment: Experiment, body: str | None, earlier: Sequence[Estimate]) -> Experiment:
    """The experiment with the body that is designed for: as estimated, else as the robot file says,
    else as it was found before.
    """
    if body is not None:
        estimate = _estimate(body)
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


def _estimate(place: str) -> Estimate:
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
    told = np.isfinite(estimate.standard_deviation) & (estimate.standard_deviation > 0)
    if not told.any():
        return np.zeros((10, 10))
    rows = body_jacobian(platform.parameters)[told]
    return np.asarray(
        rows.T @ np.linalg.pinv(estimate.covariance[np.ix_(told, told)], hermitian=True) @ rows
    )


def _target(text: str | None, platform: Inertia) -> Target:
    """From ``mass=1.6,cog=0.002,inertia=1%``; what is not named takes its default."""
    target = Target.default(platform)
    whole = {
        "mass": platform.mass,
        "cog": None,
        "inertia": float(np.max(np.diag(platform.inertia))),
    }
    for part in (text or "").split(",") if text else ():
        key, _, value = (each.strip() for each in part.partition("="))
        number = _number(value.removesuffix("%"))
        relative = value.endswith("%")
        if key not in whole or number is None or (relative and whole[key] is None):
            raise InputError(
                "--target: expected mass=KG,cog=M,inertia=KGM2 (mass and inertia also in %), found"
                f" '{part}'; correct it"
            )
        size = number / 100 * (whole[key] or 1.0) if relative else number
        target = replace(target, **{key: size})
    return target


def _number(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) and value > 0 else None


def _pose(values: Sequence[float] | None) -> Array | None:
    """x, y, z [m], roll, pitch, yaw [deg] as a pose."""
    if not values:
        return None
    if not np.isfinite(values).all():
        raise InputError("--start, --end: expected six numbers, found others; correct them")
    return np.concatenate([values[:3], np.radians(values[3:])])


def _checked(
    experiment: Experiment,
    which: str,
    duration: float | None,
    margin: float,
    target: Target,
    before: Array,
    tell: Progress,
) -> MotionEvaluation:
    """What a given motion will tell and what it takes; limits that it exceeds are said, not
    refused.
    """
    robot = experiment.robot
    runs: dict[str, Trajectory] = (
        {"paper": repeated_move(duration)}
        if which == "paper"
        else trajectories(robot, which, duration, check=False)
    )
    constraints = with_tension_level(
        MotionConstraints(robot, experiment.instruments, Margin(margin, robot.size), 0.0, 1.0)
    )
    return evaluate_motions(
        experiment,
        runs,
        target=target,
        margin=constraints.margin,
        level=constraints.level,
        before=before,
        progress=tell,
    )
