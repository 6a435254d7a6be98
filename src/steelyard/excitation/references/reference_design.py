"""Which reference bodies and further poses at rest would help most: the bound of an experiment with
each of them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from steelyard.arrays import Array, number_given, whole_given
from steelyard.bodies.nearest_body import nearest_body
from steelyard.errors import InputError
from steelyard.estimates.estimate import identifiable_parameters
from steelyard.excitation.information.noise_free_recording import (
    check_noise,
    fit_noise_free,
    fit_recorded,
    noise_free_poses,
    with_noise_free_runs,
)
from steelyard.excitation.information.optimality_criterion import Target
from steelyard.excitation.limits.motion_constraints import Margin, MotionConstraints
from steelyard.excitation.limits.rest_poses import with_pose_limits, with_tension_level
from steelyard.excitation.plan import is_experiment, planned
from steelyard.excitation.references.added_information import bound_with
from steelyard.excitation.references.addition import Addition, additions, rest_poses
from steelyard.excitation.search.design_set_up import designed_body
from steelyard.excitation.settings import DEFAULT, DesignSettings
from steelyard.experiment.model import Experiment
from steelyard.experiment.read import read_experiment
from steelyard.experiment.unread import is_unread
from steelyard.files.yaml_file import read_yaml
from steelyard.identification.methods.fall_back import fit_that_arrives
from steelyard.identification.solve.beginning.begin import NoBalanceError
from steelyard.identification.solve.posterior import Posterior, Progress
from steelyard.identification.synchronisation import synchronise
from steelyard.inertia import Inertia
from steelyard.motion.trajectory import Sampled, Trajectory
from steelyard.robot.model import Robot
from steelyard.simulation.sensors import Sensors
from steelyard.simulation.trajectories import trajectories

USUAL_SIGMA = 0.01
"""To which a reference is weighed [kg]."""
USUAL_REST = 9
"""Poses at rest in which it is carried: the middle and the corners of the workspace."""
_MOST_REST = 100
"""Poses at rest of one reference: more than anybody drives to."""


@dataclass(frozen=True, eq=False)
class ReferencePrediction:
    """What an experiment with one recording more will tell."""

    addition: Addition
    covariance: Array
    """Of the ten of :data:`steelyard.inertia.BODY_PARAMETERS`, shape (10, 10)."""
    identifiable: NDArray[np.bool_]
    """Which of the ten are told, shape (10,)."""

    @property
    def standard_deviation(self) -> Array:
        """1-sigma of the ten, NaN where not told, shape (10,)."""
        return np.where(self.identifiable, np.sqrt(np.diag(self.covariance)), np.nan)


@dataclass(frozen=True, eq=False)
class ReferenceDesign:
    """What might be recorded beside an experiment, the most helpful first."""

    experiment: Experiment
    """That is to be improved, with its runs."""
    without: ReferencePrediction
    """What it tells by itself."""
    predictions: tuple[ReferencePrediction, ...]
    target: Target | None
    """1-sigma that is wanted, in units of which they are ordered; None: by the mean of the
    logarithms of :meth:`ratios`."""
    recorded: bool
    """Whether the experiment has been made; else it is a plan."""
    not_at_rest: str | None = None
    """Why the instruments tell nothing of poses at rest; None: they do."""

    @property
    def criterion(self) -> str:
        """What :meth:`score` is, in words."""
        if self.target is not None:
            return "ordered by the worst 1-sigma of the ten in units of the target"
        return (
            "ordered by the geometric mean over the ten of 1-sigma over that without anything added"
        )

    def ratios(self, prediction: ReferencePrediction) -> Array:
        """1-sigma over that without anything added, of all that is told without, NaN of the rest,
        shape (10,).
        """
        ratio = np.sqrt(np.diag(prediction.covariance) / np.diag(self.without.covariance))
        return np.where(self.without.identifiable, ratio, np.nan)

    def score(self, prediction: ReferencePrediction) -> float:
        """What they are ordered by, the less the better: the mean ratio (geometric) or, with a
        target, the worst 1-sigma in units of it.
        """
        if self.target is not None:
            return float(np.sqrt(np.diag(prediction.covariance) / self.target.each**2).max())
        # What becomes told by it counts too.
        ratio = np.diag(prediction.covariance) / np.diag(self.without.covariance)
        return float(np.exp(np.mean(np.log(ratio)) / 2))


def design_references(
    subject: Experiment | Robot | str | Path,
    *,
    sensors: Sensors | str = "paper",
    motion: Mapping[str, Trajectory] | str | None = None,
    duration: float | None = None,
    poses: int = USUAL_REST,
    sigma: float = USUAL_SIGMA,
    target: Target | None = None,
    progress: Progress = None,
    settings: DesignSettings = DEFAULT,
) -> ReferenceDesign:
    """Compare weighed bodies and poses at rest by what they would add to an experiment.

    Args:
        subject: An experiment, recorded or not; a robot; or the path or bundled name of one of
            them.
        sensors: Instruments of a robot that comes alone.
        motion: Of an experiment that has not been recorded: run -> motion, ``paper``, ``multisine``
            or the path of a CSV file of kind ``command``; None: the multisine.
        duration: Of a motion that is named [s]; None: its default.
        poses: How many poses at rest, at most.
        sigma: 1-sigma to which a reference is weighed [kg].
        target: Wanted 1-sigma, by which to order; None: by the mean of all ten.
        progress: Is given what is being done.
        settings: Of the references.

    Raises:
        InputError: Nothing can be predicted: no force is read, an instrument states no noise, or
            the experiment cannot be fitted.
    """
    tell = progress or (lambda what, fraction: None)
    _check(whole_given(poses, "--poses"), number_given(sigma, "--reference-sigma"))
    base, runs = _base(subject, sensors, motion, duration, progress, settings)
    experiment, recorded = base.experiment, _is_recorded(subject)
    body = _body_of(base) if recorded else designed_body(experiment.robot)
    robot = with_pose_limits(replace(experiment.robot, platform=body))
    exact = MotionConstraints(robot, {}, Margin(0.0, robot.size), 0.0, 1.0)
    constraints = with_tension_level(exact, settings)
    at_rest = rest_poses(constraints, poses, settings)
    every = list(
        additions(
            robot,
            body,
            at_rest,
            sigma=sigma,
            motion=next(iter(runs.values()), None),
            level=constraints.level,
            name=_free_name(experiment),
            settings=settings,
        )
    )
    predictions = []
    unread: InputError | None = None
    for i, addition in enumerate(every):
        if unread is not None and addition.poses is not None:
            continue
        tell(f"reference: {addition}", 0.3 + 0.7 * i / len(every))
        try:
            further = _recorded(experiment, robot, addition, runs, constraints.level, settings)
        except InputError as error:
            if addition.poses is None:
                raise
            # In motion instruments tell more than at rest.
            unread = error
            continue
        found = bound_with(base, further, addition.load).covariance
        predictions.append(_prediction(base, addition, found))
    if unread is not None and not predictions:
        raise unread
    without = _prediction(base, Addition("poses", None, None), base.bound.covariance)
    design = ReferenceDesign(
        experiment,
        without,
        (),
        target,
        recorded,
        None if unread is None else str(unread),
    )
    ordered = sorted(predictions, key=design.score)
    return replace(design, predictions=tuple(ordered))


def _check(poses: int, sigma: float) -> None:
    """Refuse numbers of which no table comes."""
    if not 1 <= poses <= _MOST_REST:
        raise InputError(
            f"--poses: expected 1 to {_MOST_REST}, found {poses}; choose another number"
        )
    if not (np.isfinite(sigma) and sigma > 0):
        raise InputError(f"--reference-sigma: expected more than 0 kg, found {sigma:g}; correct it")


def _is_recorded(subject: Experiment | Robot | str | Path) -> bool:
    """Whether there are recordings."""
    if isinstance(subject, Experiment):
        return bool(subject.runs)
    if isinstance(subject, Robot) or not is_experiment(subject):
        return False
    data = read_yaml(Path(subject)).data
    return isinstance(data, dict) and bool(data.get("runs"))


def _base(
    subject: Experiment | Robot | str | Path,
    sensors: Sensors | str,
    motion: Mapping[str, Trajectory] | str | None,
    duration: float | None,
    progress: Progress,
    settings: DesignSettings,
) -> tuple[Posterior, Mapping[str, Trajectory]]:
    """What is known without anything added, and the motions of which the first may be made again.

    Raises:
        InputError: The experiment cannot be fitted.
    """
    if _is_recorded(subject):
        recorded = subject if isinstance(subject, Experiment) else None
        if recorded is None:
            assert isinstance(subject, str | Path)
            recorded = read_experiment(subject)
        source = recorded.source or recorded.name
        if motion is not None or duration is not None:
            raise InputError(
                f"{source}: expected no motion beside recordings, found one; leave out --check and"
                " --duration"
            )
        if is_unread(recorded) or recorded.frequencies:
            raise InputError(
                f"{source}: expected runs that read forces, and no natural frequencies, found"
                " others; references calibrate force sensors"
            )
        check_noise(recorded)
        try:
            base = fit_that_arrives(synchronise(recorded, progress).experiment, progress)
        except NoBalanceError as error:
            raise InputError(
                f"{source}: expected a recording to improve, found that {error}"
            ) from None
        return base, _motions(base, settings)
    plan = planned(subject, sensors)
    designed_body(plan.robot)
    if not isinstance(motion, Mapping):
        motion = trajectories(plan.robot, motion or "multisine", duration)
    exact = MotionConstraints(
        with_pose_limits(plan.robot), {}, Margin(0.0, plan.robot.size), 0.0, 1.0
    )
    level = with_tension_level(exact, settings).level
    return fit_noise_free(plan, motion, level, progress, settings=settings), motion


def _motions(base: Posterior, settings: DesignSettings) -> dict[str, Trajectory]:
    """Run -> its motion as it was found, smooth enough to be made again; of runs in one piece."""
    found: dict[str, Trajectory] = {}
    for each in base.motion:
        if each.run in found or each.time[-1] - each.time[0] < 1.0:
            continue
        count = int((each.time[-1] - each.time[0]) * settings.motion_instants) + 2
        time = np.linspace(each.time[0], each.time[-1], count)
        turned = Rotation.from_quat(each.rotation, scalar_first=True)
        angles = np.unwrap(turned.as_euler("ZYX")[:, ::-1], axis=0)
        poses = np.hstack([each.values["position"], angles])
        sampled = np.column_stack([np.interp(time, each.time, column) for column in poses.T])
        found[each.run] = Sampled.through(time - time[0], sampled)
    return found


def _body_of(base: Posterior) -> Inertia:
    """What the platform carries: as found where mass and centre of gravity are told, or the nearest
    that can exist; else as the robot file has it.
    """
    found = Inertia.from_parameters(base.parameters)
    if base.identifiable[:4].all() and found.mass > 0:
        return found if found.is_physical else nearest_body(found).solution.body
    robot = base.experiment.robot
    if robot.platform is None:
        raise InputError(
            f"robot '{robot.name}': expected a recording that tells mass and centre of gravity, or"
            " a nominal platform, found neither; add 'platform' to its file"
        )
    return designed_body(robot)


def _free_name(experiment: Experiment) -> str:
    """A name that no run and no load has."""
    taken = {run.name for run in experiment.runs} | {load.name for load in experiment.loads}
    names = ("reference", *(f"reference {i}" for i in range(2, len(taken) + 3)))
    return next(name for name in names if name not in taken)


def _recorded(
    experiment: Experiment,
    robot: Robot,
    addition: Addition,
    runs: Mapping[str, Trajectory],
    level: float,
    settings: DesignSettings,
) -> Posterior:
    """What a noise-free recording of an addition tells by itself."""
    load = addition.load
    carried = robot if load is None else replace(robot, platform=load.nominal)
    # Nothing is known beforehand but what joins it to the experiment.
    alone = replace(experiment, robot=carried, loads=(), known={}, mass_assumed=False)
    if addition.poses is None:
        trajectory = next(iter(runs.values()))
        moving = with_noise_free_runs(alone, {addition.run: trajectory}, level, settings)
        return fit_recorded(moving)
    run = noise_free_poses(alone, addition.run, addition.poses, level, settings=settings)
    return fit_recorded(replace(alone, runs=(run,)))


def _prediction(base: Posterior, addition: Addition, covariance: Array) -> ReferencePrediction:
    """With what is told."""
    told = identifiable_parameters(float(base.parameters[0]), covariance, base.size)
    return ReferencePrediction(addition, covariance, told)
