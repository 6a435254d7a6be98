"""The best experiment that a robot can do."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from steelyard.arrays import Array
from steelyard.digits import LABELS
from steelyard.display import Display
from steelyard.excitation.evaluation import MotionEvaluation, evaluate_motions
from steelyard.excitation.information.linearisation_point import prior_information
from steelyard.excitation.information.optimality_criterion import OptimalityCriterion, Target
from steelyard.excitation.limits.motion_constraints import Margin
from steelyard.excitation.limits.rest_poses import with_pose_limits
from steelyard.excitation.limits.verification import Verified
from steelyard.excitation.plan import planned
from steelyard.excitation.search.design_problem import DesignProblem, SearchResult
from steelyard.excitation.search.design_set_up import (
    MotionFamily,
    check_direct_move,
    designed_body,
    motion_family,
    predicted_information,
    random_start,
    shared_information,
)
from steelyard.excitation.search.feasible_motion import feasible_motion
from steelyard.excitation.search.multi_start import MultiStartProgress, multi_start
from steelyard.excitation.settings import DEFAULT, DesignSettings
from steelyard.experiment.model import Experiment
from steelyard.identification.model.calibration_parameters import CalibrationParameters
from steelyard.identification.solve.bound import known_information
from steelyard.identification.solve.posterior import Posterior, Progress
from steelyard.inertia import TEN, body_jacobian
from steelyard.motion.trajectory import Sampled, Trajectory
from steelyard.robot.model import Robot
from steelyard.simulation.sensors import Sensors

_MINUTE = 60.0
"""[s]"""


@dataclass(frozen=True, eq=False)
class Design:
    """The best experiment that was found."""

    appraisal: MotionEvaluation
    """What the motions will identify, and how much of the limits they use."""
    starts: tuple[SearchResult, ...]
    """Where the searches for the last run ended."""
    seed: int
    in_time: bool
    """Whether all searches ended by themselves: only then does the same seed give the same motion
    on any machine."""

    @property
    def trajectories(self) -> Mapping[str, Trajectory]:
        """Run -> its motion, for :func:`steelyard.simulate`."""
        return self.appraisal.trajectories

    @property
    def standard_deviation(self) -> Array:
        """1-sigma that all runs will give, of the ten of :data:`steelyard.inertia.BODY_PARAMETERS`,
        shape (10,); NaN: not identifiable.
        """
        return self.appraisal.standard_deviation

    def __repr__(self) -> str:
        return self._display().text()

    def _repr_html_(self) -> str:
        return self._display().html()

    def _display(self) -> Display:
        """Predicted and wanted 1-sigma, the worst parameter, and violations of limits."""
        evaluation = self.appraisal
        rows = []
        for (name, unit, factor), sigma, wanted in zip(
            LABELS, self.standard_deviation, evaluation.target.each, strict=True
        ):
            predicted = "not identifiable" if np.isnan(sigma) else f"{sigma * factor:.3g}"
            rows.append((name, unit, predicted, f"{wanted * factor:.3g}"))
        parameter, ratio = evaluation.worst
        worst = f"{ratio:.3g} of what is wanted" if np.isfinite(ratio) else "not identifiable"
        violations: list[str] = []
        for each in evaluation.verified.values():
            violations += each.violations
        lengths = [f"'{run}' of {each.duration:g} s" for run, each in self.trajectories.items()]
        return Display(
            f"Design for {evaluation.experiment.robot.name}: {', '.join(lengths)}",
            tuple(rows),
            head=("", "", "1-sigma", "wanted"),
            sentences=(f"worst: {parameter}, {worst}", *violations),
        )


def design(
    experiment: Experiment | Robot | str | Path,
    duration: float,
    *,
    sensors: Sensors | str = "paper",
    start: Array | None = None,
    end: Array | None = None,
    target: Target | None = None,
    margin: float = 0.2,
    runs: int = 1,
    before: Array | float = 0.0,
    budget: float = _MINUTE,
    seed: int = 0,
    processes: int = 1,
    progress: Progress = None,
    settings: DesignSettings = DEFAULT,
) -> Design:
    """Find motions that identify the body as well as the robot's limits allow.

    Args:
        experiment: Robot, with its nominal platform and limits, and instruments; or a robot, or the
            path or bundled name of either.
        duration: Of a run [s].
        sensors: Of a robot that comes alone: ``paper``, ``ideal``, or the path of a YAML file.
        start: Pose x, y, z [m], roll, pitch, yaw [rad] to begin in, shape (6,); None: a good one.
        end: To end in; None: the start.
        target: 1-sigma that is wanted; None: :meth:`Target.default`.
        margin: Share by which mass and inertia may differ from the nominal ones.
        runs: How many motions.
        before: Information that there is on the ten linear parameters, shape (10, 10).
        budget: Time to spend [s].
        seed: Of the starts of the searches.
        processes: That search at a time.
        progress: Is given what is being done and the fraction that is done.
        settings: Thresholds and levels of the method.

    Raises:
        InputError: There is no such motion, or the description lacks something; the message says
            what.
    """
    begun = time.time()
    report = progress or (lambda what, fraction: None)
    experiment = planned(experiment, sensors)
    robot = with_pose_limits(experiment.robot)
    experiment = replace(experiment, robot=robot)
    wanted = target or Target.default(designed_body(robot))
    report("design: start pose and constraints", 0.0)
    family = motion_family(experiment, duration, start, end, Margin(margin, robot.size), settings)
    check_direct_move(robot, experiment, family, settings)
    constraints, spline = family.constraints, family.spline
    count = max(1, round(settings.starts_per_minute * budget / _MINUTE / runs))
    rng = np.random.default_rng(seed)
    trajectories: dict[str, Sampled] = {}
    verified: dict[str, Verified] = {}
    ends: list[SearchResult] = []
    information: Array | None = None
    in_time = True
    for run in range(runs):
        name = "design" if runs == 1 else f"design-{run + 1}"
        starts = [random_start(spline, int(rng.integers(2**31)), settings) for _ in range(count)]
        report("design: predicted information", 0.03 + 0.85 * run / runs)
        fitting = time.time()
        problem, calibration_parameters, information = _problem(
            experiment, family, starts[0], wanted, before, information, settings
        )
        fitting = time.time() - fitting
        until = _end_of_search(begun, budget, run, runs, fitting, settings)
        ends = multi_start(
            problem,
            starts,
            steps=settings.steps,
            until=until,
            processes=processes,
            progress=_search_progress(report, run, runs, count, settings.steps),
        )
        in_time &= len(ends) == count and all(each.in_time for each in ends)
        x, verified[name] = feasible_motion(
            experiment,
            problem,
            starts,
            ends,
            lambda fraction: report("design: checking the limits", fraction),
        )
        trajectories[name] = spline.trajectory(x)
        information = shared_information(
            information + problem.information(x)[0], calibration_parameters
        )
    report("design: predicted precision", 0.9)
    evaluation = evaluate_motions(
        experiment,
        trajectories,
        target=wanted,
        margin=constraints.margin,
        level=constraints.level,
        before=before,
        verified=verified,
        settings=settings,
    )
    return Design(evaluation, tuple(ends), seed, in_time)


def _problem(
    experiment: Experiment,
    family: MotionFamily,
    start: Array,
    wanted: Target,
    before: Array | float,
    information: Array | None,
    settings: DesignSettings,
) -> tuple[DesignProblem, CalibrationParameters, Array]:
    """The problem of one run, with the calibration parameters and the information before it.

    Args:
        experiment: Robot and instruments.
        family: Motions to choose from.
        start: Free coefficients about which all is linearised, shape (6 f,).
        wanted: 1-sigma.
        before: Information on the ten from earlier recordings, shape (10, 10).
        information: That runs before this one leave, shape (b, b); None: it is the first.
        settings: Of the design.
    """
    spline, constraints = family.spline, family.constraints
    predicted, joint = predicted_information(experiment, spline, start, constraints.level, settings)
    if information is None:
        information = _prior(experiment, joint, before)
    at_start, _ = predicted.information(spline.at(predicted.times).commands(start))
    criterion = OptimalityCriterion.with_floor(
        joint.parameters, wanted, information, at_start, settings
    )
    problem = DesignProblem(spline, predicted, criterion, constraints, family.vibration, settings)
    return problem, joint.fit.state.calibration.calibration_parameters, information


def _prior(experiment: Experiment, joint: Posterior, before: Array | float) -> Array:
    """Information before the first run: priors, known parameters, earlier estimates, shape (b,
    b).
    """
    information = prior_information(joint.fit.state.calibration.calibration_parameters)
    information[:TEN, :TEN] += before
    jacobian = body_jacobian(joint.parameters)
    information[:TEN, :TEN] += known_information(experiment.known, jacobian)
    return information


def _end_of_search(
    begun: float, budget: float, run: int, runs: int, fitting: float, settings: DesignSettings
) -> float:
    """When the searches of a run end at the latest, by :func:`time.time` [s].

    Args:
        begun: When the design began.
        budget: Of the whole design [s].
        run: Number of the run, from 0.
        runs: How many there are.
        fitting: Time of a noise-free fit [s].
        settings: Of the design.
    """
    # What follows the searches takes as long as some fits, on a busy machine too.
    share = min(settings.search_share, 1 - settings.fits_afterwards * fitting / budget)
    least = settings.least_search_share * budget / runs
    return max(begun + share * budget * (run + 1) / runs, time.time() + least)


def _search_progress(
    report: Callable[[str, float], None], run: int, runs: int, starts: int, most: int
) -> MultiStartProgress:
    """Progress of the searches of a run as progress of the design.

    Args:
        report: Is given what is being done and the fraction that is done.
        run: Number of the run, from 0.
        runs: How many there are.
        starts: How many searches a run has.
        most: Iterations of a search.
    """
    steps: dict[int, int] = {}

    def progress(start: int, step: int, value: float) -> None:
        steps[start] = step
        part = min(1.0, sum(steps.values()) / (most * starts))
        which = f"run {run + 1} of {runs}, " if runs > 1 else ""
        # The norm of the ten is near to the worst of them.
        report(
            f"design: {which}start {start + 1} of {starts}, about {np.exp(value):.2f} of the wanted"
            " 1-sigma",
            0.05 + 0.85 * (run + part) / runs,
        )

    return progress
