"""The best experiment that a robot can do."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from steelyard.arrays import Array
from steelyard.digits import LABELS
from steelyard.display import Display
from steelyard.errors import InputError
from steelyard.excitation.appraisal import Appraisal, appraise, natural_frequencies, rehearse
from steelyard.excitation.course import SIX, Course
from steelyard.excitation.criterion import Criterion, Target
from steelyard.excitation.demands import Demands, Margin
from steelyard.excitation.information import Outlook
from steelyard.excitation.plan import planned
from steelyard.excitation.poses import checked_pose, good_pose, held, within_bounds
from steelyard.excitation.ringing import PER_INTERVAL, Ringing, softness_at
from steelyard.excitation.search import Found, Problem
from steelyard.excitation.sight import View, border_of, columns_of
from steelyard.excitation.starts import searched
from steelyard.excitation.verification import Verified, verify
from steelyard.experiment.model import Experiment
from steelyard.identification.model.calibration_parameters import CalibrationParameters
from steelyard.identification.model.motion_residuals import Segment, jerk_matrices
from steelyard.identification.solve.bound import known_information
from steelyard.identification.solve.joint_study import Joint
from steelyard.identification.solve.normal_equations import TEN
from steelyard.identification.solve.segmentation import resampled
from steelyard.identification.solve.study import Progress
from steelyard.inertia import Inertia, body_jacobian
from steelyard.motion.trajectory import Sampled, Trajectory, multisine
from steelyard.robot.model import Robot
from steelyard.simulation.sensors import Sensors
from steelyard.simulation.trajectories import workspace_of
from steelyard.smoothing import knots

LONGEST = 120.0
"""Duration of a motion [s]; more runs tell more."""
_SOFTER = 1.4
"""By how much more softly than at its ends the platform may hang on its cables elsewhere, see
:func:`.softness_of`."""
_SLOW, _FAST = 5.0, 2.5
"""Lowest natural frequency over the highest one of a motion: as it should be, and as it must be at
least."""
_USUAL, _QUICK = 0.4, 0.8
"""Highest frequency of a motion where no stiffness is known, likewise [Hz]."""
_HIGHEST = 0.5
"""Of a motion that has the time [Hz]: robots of this kind are not faster."""
_FEWEST, _ENOUGH = 5, 10
"""Parts of a course: fewer leave no freedom between rest and rest; and as many as make it worth
while, where the platform lets it move that fast."""
_SHARE = 0.85
"""Part of the limits on speed and acceleration that a command may use where cables are elastic; the
rest is for what they add."""
_SHARE_STIFF = 0.97
_KNOTS = 2
"""Parts between knots of the motion, as the estimator would have it, to one of the course."""
_BEGINNING = 0.35
"""Amplitude of the motions that a search begins with, as a part of the reach."""
_STEPS = 50
_STARTS = 2
"""For a minute."""
_MINUTE = 60.0
_FOR_SEARCH, _AT_LEAST = 0.6, 0.2
"""Part of the budget after which all searches end, and what they have at least."""
_AFTERWARDS = 6.0
"""Time of what comes after the searches, in rehearsals."""
_SHRINK, _LEAST_SHRINK = 0.995, 0.7
"""By what a course that violates a limit is made smaller, at least and at most; by as much as the
limit asks for, where that is known."""
_BLIND = 0.95
"""Where it is not."""
_SHRINKS = 40
_ENLARGED = 3.0
_HALVINGS = 7
_ABOUT = 0.02
"""By how much a search may still exceed what it must keep to; the course is then made smaller."""


@dataclass(frozen=True, eq=False)
class Design:
    """The best experiment that was found."""

    appraisal: Appraisal
    starts: tuple[Found, ...]
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
        shape (10,); NaN: not told.
        """
        return self.appraisal.standard_deviation

    def __repr__(self) -> str:
        return self._display().text()

    def _repr_html_(self) -> str:
        return self._display().html()

    def _display(self) -> Display:
        parameter, ratio = self.appraisal.worst
        wanted = self.appraisal.target.each
        rows = zip(LABELS, self.standard_deviation, wanted, strict=True)
        violations = [text for each in self.appraisal.verified.values() for text in each.violations]
        lengths = ", ".join(
            f"'{run}' of {each.duration:g} s" for run, each in self.trajectories.items()
        )
        return Display(
            f"Design for {self.appraisal.experiment.robot.name}: {lengths}",
            tuple(
                (
                    name,
                    unit,
                    "not told" if np.isnan(sigma) else f"{sigma * factor:.3g}",
                    f"{goal * factor:.3g}",
                )
                for (name, unit, factor), sigma, goal in rows
            ),
            head=("", "", "1-sigma", "wanted"),
            sentences=(
                (
                    f"worst: {parameter},"
                    f" {f'{ratio:.3g} of what is wanted' if np.isfinite(ratio) else 'not told'}"
                ),
                *violations,
            ),
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
) -> Design:
    """Find motions that tell the body as well as the robot's limits allow.

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
        seed: Of the beginnings of the searches.
        processes: That search at a time.
        progress: Is told what is being done and the fraction that is done.

    Raises:
        InputError: There is no such motion, or the description lacks something; the message says
            what.
    """
    begun = time.time()
    tell = progress or (lambda what, fraction: None)
    experiment = planned(experiment, sensors)
    robot = within_bounds(experiment.robot)
    experiment = replace(experiment, robot=robot)
    wanted = target or Target.default(designed_body(robot))
    tell("design: where to begin", 0.0)
    demands, course, ringing = _prepared(
        experiment, duration, start, end, Margin(margin, robot.size)
    )
    _check_plain(robot, experiment, course, demands)
    starts = max(1, round(_STARTS * budget / _MINUTE / runs))
    rng = np.random.default_rng(seed)
    trajectories: dict[str, Sampled] = {}
    verified: dict[str, Verified] = {}
    ended: list[Found] = []
    known: Array | None = None
    in_time = True
    for run in range(runs):
        name = "design" if runs == 1 else f"design-{run + 1}"
        beginnings = [_beginning(course, int(rng.integers(2**31))) for _ in range(starts)]
        tell("design: what the instruments would see", 0.03 + 0.85 * run / runs)
        rehearsing = time.time()
        outlook, joint = _outlook(experiment, course, beginnings[0], demands.level)
        rehearsing = time.time() - rehearsing
        calibration_parameters = joint.fit.state.calibration.calibration_parameters
        if known is None:
            known = border_of(calibration_parameters)
            known[:TEN, :TEN] += before
            known[:TEN, :TEN] += known_information(
                experiment.known, body_jacobian(joint.study.parameters)
            )
        begun_with, _ = outlook.information(course.at(outlook.times).commands(beginnings[0]))
        criterion = Criterion.about(joint.study.parameters, wanted, known, begun_with)
        problem = Problem(course, outlook, criterion, demands, ringing)
        # What comes after the searches takes as long as some rehearsals, on a busy machine too.
        share = min(_FOR_SEARCH, 1 - _AFTERWARDS * rehearsing / budget)
        until = max(
            begun + share * budget * (run + 1) / runs, time.time() + _AT_LEAST * budget / runs
        )
        ended = searched(
            problem,
            beginnings,
            steps=_STEPS,
            until=until,
            processes=processes,
            watched=_watcher(tell, run, runs, starts),
        )
        in_time &= len(ended) == starts and all(each.in_time for each in ended)
        x, verified[name] = _kept(
            experiment,
            problem,
            beginnings,
            ended,
            lambda share: tell("design: looking at the limits", share),
        )
        trajectories[name] = course.trajectory(x)
        known = _shared(known + problem.information(x)[0], calibration_parameters)
    tell("design: what it will tell", 0.9)
    appraisal = appraise(
        experiment,
        trajectories,
        target=wanted,
        margin=demands.margin,
        level=demands.level,
        before=before,
        verified=verified,
    )
    return Design(appraisal, tuple(ended), seed, in_time)


def designed_body(robot: Robot) -> Inertia:
    """The nominal platform, for which motions are made.

    Raises:
        InputError: There is none, or none that can exist.
    """
    if robot.platform is None:
        raise InputError(
            f"robot '{robot.name}': expected a nominal platform to design for, found none; add"
            " 'platform' to its file, or give --body ESTIMATE"
        )
    if not robot.platform.is_physical:
        raise InputError(
            f"robot '{robot.name}': expected a platform that can exist, found one whose inertia no"
            " body has; correct 'platform.inertia', or give --body ESTIMATE"
        )
    return robot.platform


def _prepared(
    experiment: Experiment, duration: float, start: Array | None, end: Array | None, margin: Margin
) -> tuple[Demands, Course, Ringing | None]:
    robot = experiment.robot
    if not 0 < duration <= LONGEST:
        raise InputError(
            f"--duration: expected more than 0 and at most {LONGEST:g} s, found {duration:g};"
            " choose another, and --runs for several motions"
        )
    elastic = robot.m > 0 and bool(robot.cable.axial_stiffness)
    demands = held(
        Demands(robot, experiment.instruments, margin, 0.0, _SHARE if elastic else _SHARE_STIFF)
    )
    begin = good_pose(demands) if start is None else checked_pose(demands, start, "start")
    finish = begin if end is None else checked_pose(demands, end, "end")
    swings = natural_frequencies(robot, begin, demands.level)
    lowest = float(swings[swings > 0].min()) if (swings > 0).any() else None
    if elastic and lowest is not None:
        # Elsewhere the platform may swing more slowly, but not by much.
        softest = _SOFTER * max(softness_at(robot, begin), softness_at(robot, finish))
        demands, lowest = replace(demands, softest=softest), lowest / np.sqrt(_SOFTER)
    usual, quick = (
        (_USUAL, _QUICK) if lowest is None else (min(lowest / _SLOW, _HIGHEST), lowest / _FAST)
    )
    intervals = max(_FEWEST, round(2 * usual * duration), min(_ENOUGH, int(2 * quick * duration)))
    if intervals > 2 * quick * duration:
        why = (
            f"two fifths of its lowest natural frequency on the way, {lowest:.2g} Hz,"
            if lowest
            else f"{quick:g} Hz"
        )
        raise InputError(
            f"--duration: expected at least {np.ceil(10 * _FEWEST / (2 * quick)) / 10:g} s, found"
            f" {duration:g} s; from rest to rest a platform that moves below {why} needs that long"
        )
    _, reach = workspace_of(robot)
    course = Course(begin, finish, duration, intervals, reach)
    ringing = Ringing(robot, course.instants(PER_INTERVAL), lowest) if elastic and lowest else None
    return demands, course, ringing


def _check_plain(robot: Robot, experiment: Experiment, course: Course, demands: Demands) -> None:
    """The plain move from start to end must be possible, or nothing is."""
    found = verify(
        robot,
        experiment.instruments,
        course.trajectory(np.zeros(course.size)),
        demands.margin,
        demands.level,
        elastic=False,
    )
    if found.violations:
        raise InputError(
            f"robot '{robot.name}': expected that it can go from start to end in"
            f" {course.duration:g} s, found {found.violations[0]}; choose a longer --duration,"
            " other poses or a smaller --margin"
        )


def _beginning(course: Course, seed: int) -> Array:
    """Free coefficients of a random motion."""
    harmonics = max(2, course.intervals // 2)
    motion = multisine(
        [0.0] * SIX, list(_BEGINNING * course.reach), course.duration, harmonics, seed
    )
    still = replace(course, start=np.zeros(SIX), end=np.zeros(SIX))
    return still.near(motion)


def _outlook(
    experiment: Experiment, course: Course, x: Array, level: float
) -> tuple[Outlook, Joint]:
    """What would be seen along a course: instruments, clocks and smoothness as an estimator has
    them.
    """
    joint = rehearse(experiment, {"design": course.trajectory(x)}, level)
    run = joint.study.experiment.runs[0]
    segment = next(segment for segment in joint.fit.state.segments if segment.run == run.name)
    grid = knots(
        float(segment.knots[0]),
        float(segment.knots[-1]),
        course.duration / course.intervals / _KNOTS,
    )
    coarse: Segment = resampled(
        segment, replace(segment, knots=grid, jerks=jerk_matrices(grid), readings=())
    )
    calibration_parameters = joint.fit.state.calibration.calibration_parameters
    return (
        Outlook(
            View.of(joint, run, level),
            coarse,
            course.duration,
            TEN + int((calibration_parameters.deviation > 0).sum()),
        ),
        joint,
    )


def _watcher(
    tell: Callable[[str, float], None], run: int, runs: int, starts: int
) -> Callable[[int, int, float], None]:
    steps: dict[int, int] = {}

    def watched(start: int, step: int, value: float) -> None:
        steps[start] = step
        part = min(1.0, sum(steps.values()) / (_STEPS * starts))
        which = f"run {run + 1} of {runs}, " if runs > 1 else ""
        # The norm of the ten is near to the worst of them.
        tell(
            f"design: {which}start {start + 1} of {starts}, about {np.exp(value):.2f} of the wanted"
            " 1-sigma",
            0.05 + 0.85 * (run + part) / runs,
        )

    return watched


def _enlarged(problem: Problem, x: Array, most: float) -> Array:
    """A course as large as what it must keep to lets it be, at most by a factor."""
    low, high = 0.0, most
    if problem.constraints(most * x)[0].max() <= 1 + _ABOUT:
        return most * x
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        low, high = (
            (middle, high) if problem.constraints(middle * x)[0].max() <= 1 else (low, middle)
        )
    return low * x


def _kept(
    experiment: Experiment,
    problem: Problem,
    beginnings: Sequence[Array],
    ended: Sequence[Found],
    tell: Callable[[float], None],
) -> tuple[Array, Verified]:
    """The best course made as small as the limits ask for, and what it takes of them."""
    # Searches that were broken off may have ended where nothing is kept: then a beginning,
    # enlarged, may be better.
    candidates = [_enlarged(problem, found.x, 1.0) for found in ended]
    if any(found.excess > _ABOUT for found in ended):
        candidates += [found.kept for found in ended if found.kept is not None]
        candidates += [_enlarged(problem, x, _ENLARGED) for x in beginnings]
    x = min(candidates, key=lambda each: problem.objective(each)[0])
    scale = 1.0
    demands = problem.demands

    def looked(scale: float, *, elastic: bool) -> Verified:
        trajectory = problem.course.trajectory(scale * x)
        return verify(
            demands.robot,
            experiment.instruments,
            trajectory,
            demands.margin,
            demands.level,
            elastic=elastic,
        )

    for turn in range(_SHRINKS):
        # The quick look first.
        found = looked(scale, elastic=False)
        if not found.violations:
            tell(0.88 + 0.002 * turn)
            found = looked(scale, elastic=True)
        if not found.violations:
            return scale * x, found
        by = 0.998 / found.fraction if found.fraction > 1 else _BLIND
        scale *= float(np.clip(by, _LEAST_SHRINK, _SHRINK))
    raise InputError(
        f"robot '{demands.robot.name}': expected a motion that keeps the limits, found none but the"
        f" smallest ({found.violations[0]}); choose a longer --duration or a smaller --margin"
    )


def _shared(information: Array, calibration_parameters: CalibrationParameters) -> Array:
    """What a run leaves to the next: body and errors that are the same in all runs; what is drawn
    anew begins with its prior.
    """
    column_of = columns_of(calibration_parameters)
    places = [
        place
        for place, unknown, _ in calibration_parameters.components()
        if unknown.run is not None
    ]
    own = column_of[places]
    own = own[own >= 0]
    if not len(own):
        return information
    rest = np.setdiff1d(np.arange(len(information)), own)
    found = np.zeros_like(information)
    cross = information[np.ix_(rest, own)]
    found[np.ix_(rest, rest)] = information[np.ix_(rest, rest)] - cross @ np.linalg.solve(
        information[np.ix_(own, own)], cross.T
    )
    found[own, own] = border_of(calibration_parameters)[own, own]
    return found
