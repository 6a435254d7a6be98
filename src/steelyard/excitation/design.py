"""The best experiment that a robot can do."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from steelyard.arrays import Array, number_given, whole_given
from steelyard.digits import LABELS, deviation, fixed
from steelyard.display import Display
from steelyard.errors import WrongValueError
from steelyard.excitation.evaluation import MotionEvaluation, evaluate_motions, information_before
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
from steelyard.identification.solve.posterior import Progress
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
            predicted = "not identifiable" if np.isnan(sigma) else deviation(sigma * factor)
            rows.append((name, unit, predicted, deviation(wanted * factor)))
        parameter, ratio = evaluation.worst
        worst = f"{fixed(ratio, 2)} of what is wanted" if np.isfinite(ratio) else "not identifiable"
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
    duration, budget = (
        number_given(duration, "--duration"),
        number_given(budget, "--budget", above=0),
    )
    margin, runs = number_given(margin, "--margin", least=0), whole_given(runs, "--runs", least=1)
    seed, processes = whole_given(seed, "--seed"), whole_given(processes, "--processes", least=1)
    if target is not None and not isinstance(target, Target):
        raise WrongValueError(
            f"target: expected a Target, found {type(target).__name__}; Target.default makes one"
        )
    experiment = planned(experiment, sensors)
    robot = with_pose_limits(experiment.robot)
    experiment = replace(experiment, robot=robot)
    wanted = target or Target.default(designed_body(robot))
    report("design: start pose and constraints", 0.0)
    family = motion_family(experiment, duration, start, end, Margin(margin, robot.size), settings)
    check_direct_move(family, settings)
    search = _DesignSearch(
        experiment, family, wanted, before, runs, budget, begun, processes, report, settings
    )
    count = max(1, round(settings.starts_per_minute * budget / _MINUTE / runs))
    rng = np.random.default_rng(seed)
    found: dict[str, _DesignedRun] = {}
    information: Array | None = None
    for run in range(runs):
        seeds = [int(rng.integers(2**31)) for _ in range(count)]
        starts = [random_start(family.spline, each, settings) for each in seeds]
        designed = search.designed(run, starts, information)
        found["design" if runs == 1 else f"design-{run + 1}"] = designed
        information = designed.information
    report("design: predicted precision", 0.9)
    evaluation = evaluate_motions(
        experiment,
        {name: each.trajectory for name, each in found.items()},
        target=wanted,
        margin=family.constraints.margin,
        level=family.constraints.level,
        before=before,
        verified={name: each.verified for name, each in found.items()},
        settings=settings,
    )
    return Design(evaluation, designed.ends, seed, all(each.in_time for each in found.values()))


@dataclass(frozen=True, eq=False)
class _DesignedRun:
    """The motion of one run, and what it leaves to the next."""

    trajectory: Sampled
    verified: Verified
    ends: tuple[SearchResult, ...]
    """Where the searches ended."""
    in_time: bool
    """Whether all of them ended by themselves."""
    information: Array
    """On body and errors that are the same in all runs, shape (b, b)."""


@dataclass(frozen=True, eq=False)
class _DesignSearch:
    """The search for the motions of all runs, one after the other."""

    experiment: Experiment
    family: MotionFamily
    """Motions to choose from."""
    wanted: Target
    before: Array | float
    """Information on the ten from earlier recordings, shape (10, 10)."""
    runs: int
    budget: float
    """Of the whole design [s]."""
    begun: float
    """When the design began, by :func:`time.time` [s]."""
    processes: int
    report: Callable[[str, float], None]
    """Is given what is being done and the fraction that is done."""
    settings: DesignSettings

    def designed(
        self, run: int, starts: Sequence[Array], information: Array | None
    ) -> _DesignedRun:
        """Find the motion of one run.

        Args:
            run: Its number, from 0.
            starts: Free coefficients to begin with, shape (6 f,) each.
            information: That runs before this one leave, shape (b, b); None: it is the first.
        """
        self.report("design: predicted information", 0.03 + 0.85 * run / self.runs)
        fitting = time.time()
        problem, calibration_parameters = self._problem(starts[0], information)
        until = self._end(run, time.time() - fitting)
        ends = multi_start(
            problem,
            starts,
            steps=self.settings.steps,
            until=until,
            processes=self.processes,
            progress=self._progress(run, len(starts)),
        )
        x, verified = feasible_motion(
            problem,
            starts,
            ends,
            lambda fraction: self.report("design: checking the limits", fraction),
        )
        in_time = len(ends) == len(starts) and all(each.in_time for each in ends)
        known = problem.criterion.prior_information + problem.information(x)[0]
        left = shared_information(known, calibration_parameters)
        return _DesignedRun(self.family.spline.trajectory(x), verified, tuple(ends), in_time, left)

    def _problem(
        self, start: Array, information: Array | None
    ) -> tuple[DesignProblem, CalibrationParameters]:
        """The problem of one run, and the calibration parameters in it.

        Args:
            start: Free coefficients about which all is linearised, shape (6 f,).
            information: Before the run, see :meth:`designed`.
        """
        spline, constraints = self.family.spline, self.family.constraints
        predicted, joint = predicted_information(
            self.experiment, spline, start, constraints.level, self.settings
        )
        if information is None:
            information = information_before(joint, self.before)
        at_start, _ = predicted.information(spline.at(predicted.times).commands(start))
        criterion = OptimalityCriterion.with_floor(
            joint.parameters, self.wanted, information, at_start, self.settings
        )
        problem = DesignProblem(
            spline, predicted, criterion, constraints, self.family.vibration, self.settings
        )
        return problem, joint.fit.state.calibration.calibration_parameters

    def _end(self, run: int, fitting: float) -> float:
        """When the searches of a run end at the latest, by :func:`time.time` [s].

        Args:
            run: Its number, from 0.
            fitting: Time of a noise-free fit [s].
        """
        # What follows the searches takes as long as some fits, on a busy machine too.
        afterwards = self.settings.fits_afterwards * fitting / self.budget
        share = min(self.settings.search_share, 1 - afterwards)
        least = self.settings.least_search_share * self.budget / self.runs
        return max(self.begun + share * self.budget * (run + 1) / self.runs, time.time() + least)

    def _progress(self, run: int, starts: int) -> MultiStartProgress:
        """Progress of the searches of a run as progress of the design.

        Args:
            run: Its number, from 0.
            starts: How many searches it has.
        """
        steps: dict[int, int] = {}

        def progress(start: int, step: int, value: float) -> None:
            steps[start] = step
            part = min(1.0, sum(steps.values()) / (self.settings.steps * starts))
            which = f"run {run + 1} of {self.runs}, " if self.runs > 1 else ""
            # The norm of the ten is near to the worst of them.
            self.report(
                f"design: {which}start {start + 1} of {starts}, about {np.exp(value):.2f} of the"
                " wanted 1-sigma",
                0.05 + 0.85 * (run + part) / self.runs,
            )

        return progress
