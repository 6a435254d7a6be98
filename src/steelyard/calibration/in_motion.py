"""The geometry from recordings in motion, alone or beside poses at rest: the joint fit of
`identify`, about the geometry that it finds.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from steelyard.arrays import Array
from steelyard.calibration.poses import forces_at_rest
from steelyard.calibration.settings import CalibrationSettings
from steelyard.calibration.wrong_units import in_millimetres
from steelyard.errors import InputError
from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run
from steelyard.experiment.unread import with_unread_cables
from steelyard.identification.model.balance import Forces
from steelyard.identification.model.calibration_parameters import CalibrationValues
from steelyard.identification.model.motion_segment import Segment
from steelyard.identification.model.segment import motion_at
from steelyard.identification.samples.prepared import Samples
from steelyard.identification.samples.segmentation import Recorded
from steelyard.identification.solve.beginning.begin import Beginning, NoBalanceError, begin
from steelyard.identification.solve.beginning.motion_task import motion_task
from steelyard.identification.solve.beginning.readings import Readings, read
from steelyard.identification.solve.conclusion import concluded, sound
from steelyard.identification.solve.fit_readings import fit_readings
from steelyard.identification.solve.fit_state import Fit, FitState, Task
from steelyard.identification.solve.fitted import stretch_of
from steelyard.identification.solve.joint_fit import fit
from steelyard.identification.solve.misfits.jitter import with_jitter
from steelyard.identification.solve.posterior import Posterior
from steelyard.inertia import TEN
from steelyard.instruments.unread_cables import UnreadCables
from steelyard.robot.covariance import POINTS

Tell = Callable[[str, float], None]
_LARGEST = 1000.0
"""Span of the anchors of any robot [m]: beyond, motion is not looked for."""


@dataclass(frozen=True, eq=False)
class MotionFit:
    """Where a fit of recordings in motion ended."""

    task: Task
    fit: Fit
    covariance: Array
    """Of all calibration parameters; zero for those that are not estimated, shape (u, u)."""
    body: tuple[Array, Array] | None
    """Ten linear parameters and their covariance; None: no forces were read."""
    notes: tuple[str, ...]


def with_used_runs(experiment: Experiment) -> tuple[Experiment, list[str]]:
    """The experiment without the runs that cannot be used, and a sentence on each of these.

    Args:
        experiment: With its runs.
    """
    runs, notes = [], []
    for run in experiment.runs:
        wrenches = [n for n in run.streams if experiment.instruments[n].measured_force == "wrench"]
        if wrenches:
            notes.append(
                f"run '{run.name}': {' and '.join(wrenches)} not used: a wrench does not depend on"
                " where the cables are fixed"
            )
            kept = {n: stream for n, stream in run.streams.items() if n not in wrenches}
            run = replace(run, streams=kept)
        lack = _lack(experiment, run)
        if lack:
            notes.append(f"run '{run.name}': not used: {lack}")
        else:
            runs.append(run)
    return replace(experiment, runs=tuple(runs)), notes


def _lack(experiment: Experiment, run: Run) -> str:
    """Why a run tells nothing of the geometry; empty: it does."""
    told = {
        quantity
        for name, stream in run.streams.items()
        if not experiment.instruments[name].commanded
        for quantity in stream.values
    }
    force = experiment.force_instrument(run)
    pulls = force is not None and experiment.instruments[force].measured_force == "tension"
    if run.static:
        return "" if "length" in told else "expected cable lengths (kind: length); add them"
    if "length" not in told and not pulls:
        return (
            "nothing in it depends on where the cables are fixed; add their lengths (kind: length)"
            " or tensions (kind: tension)"
        )
    if pulls:
        return ""
    missing = [
        f"{what} ({kinds})"
        for what, kinds, key in (
            ("a place", "kind: position or pose", "position"),
            ("an orientation", "kind: imu, attitude or pose", "orientation"),
        )
        if key not in told
    ]
    if missing:
        return (
            f"expected {' and '.join(missing)} beside lengths in motion without tensions, found"
            " none; add it, or the tensions"
        )
    return ""


def fit_in_motion(
    experiment: Experiment,
    resting: Sequence[Segment],
    start: CalibrationValues | None,
    tell: Tell,
    settings: CalibrationSettings,
) -> MotionFit:
    """Fit all runs together, again about the geometry found where it has moved by much: the sag of
    cables and their way over rollers are those of the robot file otherwise.

    Args:
        experiment: With its priors as they are to be taken; they count from its robot file however
            far the geometry moves.
        resting: The poses at rest, run by run.
        start: Values to begin with; None: as known beforehand.
        tell: Is called with what is being done and the fraction that is done.
        settings: Levels.

    Raises:
        InputError: A run lacks what is needed, or motion and readings cannot be fitted.
    """
    unit = in_millimetres(experiment)
    if unit and float(np.ptp(experiment.robot.anchors, axis=0).max()) > _LARGEST:
        raise InputError(f"{experiment.source or experiment.name}: {unit}")
    experiment = with_unread_cables(experiment, every=True)
    weighed = any(_is_weighed(experiment, run) for run in experiment.runs)
    about = experiment if start is None else _about(experiment, start)
    for turn in range(settings.renewals):
        last = turn == settings.renewals - 1
        readings = _readings(about, resting, start, tell, settings)
        found: MotionFit | None = None
        try:
            if not weighed:
                found = _by_motion_alone(readings, tell)
                values = found.fit.state.calibration
            else:
                begun = begin(readings, tell, thorough=False)
                values = begun.state.calibration
                if last or not _is_far(about, values, settings):
                    found = _with_forces(readings, begun, tell)
                    values = found.fit.state.calibration
        except (np.linalg.LinAlgError, NoBalanceError) as error:
            raise _not_fitted(experiment, error) from None
        if found is not None and (last or not _is_far(about, values, settings)):
            return found
        tell("again about the geometry found", 0.3)
        about, start = _about(experiment, values), values
    raise AssertionError("the last turn ends the loop")


def _is_weighed(experiment: Experiment, run: Run) -> bool:
    """Whether a run tells of forces: by sensors, or since winches are locked."""
    force = experiment.force_instrument(run)
    if force is None:
        return False
    return run.locked or not isinstance(experiment.instruments[force], UnreadCables)


def _about(experiment: Experiment, values: CalibrationValues) -> Experiment:
    """The experiment with the robot as it was found."""
    anchors, attachments = (values.geometry[f"{key}s"].reshape(-1, 3) for key in POINTS)
    robot = replace(experiment.robot, anchors=anchors, attachments=attachments)
    return replace(experiment, robot=robot)


def _is_far(about: Experiment, values: CalibrationValues, settings: CalibrationSettings) -> bool:
    """Whether a point has moved so far that cables sag and roll otherwise."""
    moved = [
        values.geometry[f"{key}s"].reshape(-1, 3) - getattr(about.robot, f"{key}s")
        for key in POINTS
    ]
    return bool(np.linalg.norm(np.concatenate(moved), axis=1).max() > settings.renewed)


def _readings(
    experiment: Experiment,
    resting: Sequence[Segment],
    start: CalibrationValues | None,
    tell: Tell,
    settings: CalibrationSettings,
) -> Readings:
    """All runs, cut into segments."""
    moving = [run for run in experiment.runs if not run.static]
    found = read(experiment, start, tell, runs=moving)
    records = [
        replace(
            record, force_samples=tuple(_as_read(experiment, run, f) for f in record.force_samples)
        )
        for run, record in zip(moving, found.records, strict=True)
    ]
    by_name = {run.name: run for run in experiment.runs}
    samples = list(found.samples)
    for segment in resting:
        run = by_name[segment.run]
        forces = forces_at_rest(experiment, run, settings)
        assert forces is not None  # cables that nobody reads stand in for them
        records.append(Recorded((segment,), (_as_read(experiment, run, forces),), {}, ()))
        samples.append(_samples_at_rest(segment, experiment))
        moving.append(run)
    return replace(found, runs=tuple(moving), samples=tuple(samples), records=tuple(records))


def _as_read(experiment: Experiment, run: Run, forces: Forces) -> Forces:
    """Forces of a run; those that only stand in for sensors say nothing, not even that the platform
    hangs freely.
    """
    if _is_weighed(experiment, run):
        return forces
    return replace(forces, left_out=np.ones_like(forces.left_out))


def _samples_at_rest(segment: Segment, experiment: Experiment) -> Samples:
    """Poses at rest to begin with."""
    n = len(segment.coefficients)
    pose, *_ = motion_at(segment.basis(segment.knots), segment.coefficients)
    rotation = Rotation.from_quat(pose[:, 3:], scalar_first=True).as_matrix()
    still = np.zeros((n, 3))
    return Samples(
        run=segment.run,
        time=segment.knots,
        omega=still,
        alpha=still,
        specific_force=-np.einsum("nji,j->ni", rotation, experiment.robot.gravity),
        wrench=np.zeros((n, 6)),
        static=True,
        free_offset=False,
        alpha_noise=0.0,
        spacing=0.0,
        position_sigma=0.0,
        position=pose[:, :3],
        rotation=rotation,
    )


def _with_forces(readings: Readings, begun: Beginning, tell: Tell) -> MotionFit:
    """Motion, forces, body and geometry at once.

    Raises:
        NoBalanceError: Forces and motion cannot be fitted.
    """
    fitted = fit_readings(readings, begun, tell)
    posterior = sound(lambda: concluded([stretch_of(readings, fitted)]))
    whole = posterior.solution.covariance
    active = fitted.task.active
    covariance = np.where(np.outer(active, active), whole[TEN:, TEN:], 0.0)
    body = posterior.parameters, whole[:TEN, :TEN]
    notes = (*posterior.notes, *_contacts(posterior))
    return MotionFit(fitted.task, fitted.fit, covariance, body, tuple(dict.fromkeys(notes)))


def _contacts(posterior: Posterior) -> list[str]:
    """What touched the platform, in words."""
    return [
        f"run '{run}': something touched the platform"
        f" {', '.join(f'from {a:.1f} to {b:.1f} s' for a, b in each)}: left out"
        for run, each in posterior.contacts.items()
    ]


def _by_motion_alone(readings: Readings, tell: Tell) -> MotionFit:
    """Motion and geometry, where no force was read.

    Raises:
        numpy.linalg.LinAlgError: The motion is not determined.
    """
    task = motion_task(readings)
    if not readings.segments:
        raise NoBalanceError("; ".join(readings.notes))
    segments = tuple(each.wandering for each in readings.segments)
    task, state = with_jitter(task, FitState(segments, readings.calibration, None))
    found = fit(task, state, lambda part: tell("fitting the motion", 0.25 + 0.5 * part))
    u = len(task.calibration_parameters)
    covariance = np.zeros((u, u))
    covariance[np.ix_(task.active, task.active)] = found.covariance
    notes = dict.fromkeys(
        [
            *(note for samples in readings.samples for note in samples.notes if "gap" not in note),
            *readings.notes,
        ]
    )
    return MotionFit(task, found, covariance, None, tuple(notes))


def _not_fitted(experiment: Experiment, error: Exception) -> InputError:
    """In one sentence."""
    said = str(error) if isinstance(error, NoBalanceError) else ""
    return InputError(
        f"{experiment.source or experiment.name}: expected recordings that tell motion and"
        f" geometry, found that they do not fit at all{f' ({said})' if said else ''}; check units,"
        " signs and the order of the cables"
    )
