"""The fit of a geometry to poses at rest: all instruments, all poses and all systematic errors at
once, by the same statement of the measurements as in `identify`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from steelyard.arrays import Array
from steelyard.calibration.in_motion import fit_in_motion, with_used_runs
from steelyard.calibration.leave_one_out import LeftOut, leaving_out
from steelyard.calibration.poses import forces_at_rest, segment_of, with_upright
from steelyard.calibration.settings import CALIBRATION, CalibrationSettings
from steelyard.calibration.wrong_rows import WrongRow, are_many, without_wrong
from steelyard.errors import InputError
from steelyard.estimates.estimate import plausible_radius
from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run
from steelyard.identification.known_body import known_bodies, plausible
from steelyard.identification.model.balance import Forces
from steelyard.identification.model.calibration_parameters import (
    CalibrationParameters,
    CalibrationValues,
    gather,
)
from steelyard.identification.model.motion_segment import Segment
from steelyard.identification.solve.beginning.first_body import first_body
from steelyard.identification.solve.beginning.motion_task import read_by, stated_noise
from steelyard.identification.solve.fit_state import Fit, FitState, Task
from steelyard.identification.solve.joint_fit import fit
from steelyard.inertia import TEN
from steelyard.instruments.base import Prior
from steelyard.instruments.length import ROLLER, ROLLER_AXIS

Progress = Callable[[str, float], None] | None
_RADIUS = 1.0
"""Of a body that nobody looks at [m]."""


@dataclass(frozen=True, eq=False)
class GeometryFit:
    """Where it ended."""

    experiment: Experiment
    """That was fitted, with the priors as they were taken."""
    task: Task
    fit: Fit
    """Its covariance is that of the body, where forces were read, and then of what was active."""
    wrong: tuple[WrongRow, ...]
    covariance: Array
    """Of all calibration parameters; zero for exact ones, shape (u, u). What was known beforehand,
    where the fit has not converged."""
    left_out: tuple[LeftOut, ...]
    body: tuple[Array, Array] | None = None
    """Ten linear parameters of the body that hung there, and their covariance, shapes (10,) and
    (10, 10); None: no forces were read."""
    notes: tuple[str, ...] = ()
    """What a reader should know of the recordings: what was not used, and why."""

    @property
    def ended(self) -> CalibrationValues:
        """Values at which the fit ended, converged or not: they show what stands in its way."""
        return self.fit.state.calibration

    @property
    def calibration(self) -> CalibrationValues:
        """Found values; those of the description where the fit has not converged."""
        if self.fit.converged:
            return self.ended
        return CalibrationValues(self.parameters, self.parameters.mean)

    @property
    def parameters(self) -> CalibrationParameters:
        """With their priors."""
        return self.ended.calibration_parameters

    @property
    def deviations(self) -> Array:
        """1-sigma of all calibration parameters, shape (u,)."""
        return np.asarray(np.sqrt(np.maximum(np.diag(self.covariance), 0.0)))


def fit_geometry(
    experiment: Experiment,
    progress: Progress = None,
    settings: CalibrationSettings = CALIBRATION,
) -> GeometryFit:
    """Fit the geometry of a robot to poses at rest and to motions.

    Args:
        experiment: With runs; ``uncertainty`` says how far its geometry may be off.
        progress: Is called with what is being done and the fraction that is done.
        settings: Levels.

    Raises:
        InputError: No run tells the geometry, or there are too few readings for the unknowns.
    """
    tell = progress or (lambda what, fraction: None)
    experiment, notes = with_used_runs(with_upright(_widened(experiment, settings), settings))
    if not experiment.runs:
        raise InputError(
            f"{experiment.source or experiment.name}: expected runs of poses at rest ('static:"
            " true') or in motion that tell where the cables are fixed, found"
            f" none{''.join(f'; {note}' for note in notes)}; record the platform at rest in some"
            " ten poses or more, or in motion"
        )
    moving = any(not run.static for run in experiment.runs)
    rested = _rested(experiment, tell, settings, with_forces=not moving)
    wrong = () if rested is None else tuple(rested.wrong)
    if moving:
        segments = () if rested is None else rested.fit.state.segments
        start = None
        if rested is not None and rested.fit.converged:
            start = rested.fit.state.calibration
        found = fit_in_motion(experiment, segments, start, tell, settings)
        task, fitted, body, covariance = found.task, found.fit, found.body, found.covariance
        notes += found.notes
    else:
        assert rested is not None  # there are runs
        task, fitted, body = rested.task, rested.fit, rested.body
        covariance = _covariance_of(task, fitted)
    if not fitted.converged:
        # Somewhere on the way there is nothing to be told, and no uncertainty of it.
        known = np.diag(task.calibration_parameters.deviation**2)
        return GeometryFit(experiment, task, fitted, wrong, known, (), None, _once(notes))
    tell("leaving out", 0.9)
    left_out = tuple(leaving_out(task, fitted))
    return GeometryFit(experiment, task, fitted, wrong, covariance, left_out, body, _once(notes))


def _once(notes: Sequence[str]) -> tuple[str, ...]:
    """Each note once, in the order in which they came."""
    return tuple(dict.fromkeys(notes))


def _covariance_of(task: Task, found: Fit) -> Array:
    """Of all calibration parameters, shape (u, u): of what no pose tells anything, what is known
    beforehand stays.
    """
    parameters = task.calibration_parameters
    rest = np.flatnonzero((parameters.deviation > 0) & ~task.active)
    covariance = np.zeros((len(parameters), len(parameters)))
    covariance[np.ix_(rest, rest)] = np.linalg.inv(parameters.precision[np.ix_(rest, rest)])
    own = np.flatnonzero(task.active)
    ten = len(found.covariance) - len(own)
    covariance[np.ix_(own, own)] = found.covariance[ten:, ten:]
    return covariance


@dataclass(frozen=True, eq=False)
class _Rested:
    """Where a fit of poses at rest ended."""

    task: Task
    fit: Fit
    wrong: list[WrongRow]
    body: tuple[Array, Array] | None


def _rested(
    experiment: Experiment,
    tell: Callable[[str, float], None],
    settings: CalibrationSettings,
    *,
    with_forces: bool,
) -> _Rested | None:
    """Fit the poses at rest alone; None: there are none.

    Raises:
        InputError: They leave the geometry undetermined.
    """
    runs = [run for run in experiment.runs if run.static]
    if not runs:
        return None
    task, state = _begun_at_rest(experiment, runs, tell)
    body = None
    try:
        found, wrong = _robust(task, state, settings)
        forces = tuple(forces_at_rest(experiment, run, settings) for run in runs)
        if with_forces and any(each is not None for each in forces):
            tell("fitting the forces", 0.6)
            found, task, body = _with_forces(task, found, forces)
    except np.linalg.LinAlgError:
        raise InputError(
            f"{experiment.source or experiment.name}: expected poses that tell the geometry, found"
            " that they leave it undetermined; add poses, or an instrument that tells how the"
            " platform stands"
        ) from None
    return _Rested(task, found, wrong, body)


def _begun_at_rest(
    experiment: Experiment, runs: Sequence[Run], tell: Callable[[str, float], None]
) -> tuple[Task, FitState]:
    """What is to be fitted of poses at rest, without forces, and where it begins."""
    tell("reading the poses", 0.05)
    begun = [segment_of(experiment, run) for run in runs]
    segments = tuple(segment for segment, _ in begun)
    parameters = gather(experiment)
    first = parameters.mean.copy()
    for run, (_, offsets) in zip(runs, begun, strict=True):
        for name, offset in offsets.items():
            first[parameters.place(name, "offset", run.name)] = offset
    task = Task(
        experiment,
        parameters,
        (None,) * len(segments),
        read_by(experiment, parameters, segments),
        stated_noise(experiment),
        plausible(np.ones(TEN), _RADIUS),
    )
    tell("fitting poses and geometry", 0.2)
    return task, FitState(segments, CalibrationValues(parameters, first), None)


def _widened(experiment: Experiment, settings: CalibrationSettings) -> Experiment:
    """With drums of any scale where something metric is read, and with offsets of lengths and
    rollers that nobody has stated.
    """
    robot = experiment.robot
    metric = any(
        experiment.instruments[name].is_motion
        and "position" in run.streams[name].values
        and not experiment.instruments[name].commanded
        for run in experiment.runs
        for name in run.streams
    )
    instruments = {}
    for name, instrument in experiment.instruments.items():
        if instrument.is_cable_motion:
            calibration = instrument.calibration
            stated = calibration.model_fields_set
            update: dict[str, Prior] = {}
            if "offset" not in stated:
                update["offset"] = Prior(sigma=settings.offset)
            if "gain" not in stated and metric:
                update["gain"] = Prior(sigma=settings.scale)
            rollers = {ROLLER: settings.roller, ROLLER_AXIS: settings.roller_axis}
            for key in rollers.keys() - stated if robot.pulley_radius.any() else ():
                update[key] = Prior(sigma=rollers[key])
            calibration = calibration.model_copy(update=update)
            instrument = instrument.model_copy(update={"calibration": calibration})
        instruments[name] = instrument
    uncertainty = {
        "anchor": settings.anchor,
        "attachment": settings.attachment,
        "gravity": 0.0,
        **experiment.uncertainty,
    }
    return replace(experiment, instruments=instruments, uncertainty=uncertainty)


def _with_forces(
    task: Task, found: Fit, forces: Sequence[Forces | None]
) -> tuple[Fit, Task, tuple[Array, Array]]:
    """Poses, geometry and the body that hangs there, once lengths have told them roughly."""
    experiment, parameters = task.experiment, task.calibration_parameters
    size = plausible_radius(experiment.robot) or _RADIUS
    state = found.state
    body = first_body(experiment, state, forces, experiment.known, task.settings)
    active = task.active.copy()
    for segment, each in zip(state.segments, forces, strict=True):
        if each is None:
            continue
        instrument = experiment.instruments[each.name]
        for term in instrument.terms(parameters.m):
            active[parameters.place(each.name, term.key, segment.run)] = True
    task = replace(
        task,
        force_samples=tuple(forces),
        active=active & (parameters.deviation > 0),
        sizes=plausible(body, size),
        known=lambda at: known_bodies(experiment, at.calibration, _body_of(at), size),
    )
    state = replace(state, parameters=body)
    fitted = fit(task, state)
    if experiment.robot.cable.axial_stiffness:
        # How cables stretch follows the forces once these are roughly right.
        fitted = fit(task, replace(fitted.state, segments=_following(fitted.state.segments)))
    ten = len(fitted.covariance) - int(task.active.sum())
    own = _body_of(fitted.state), fitted.covariance[:ten, :ten]
    return fitted, task, own


def _following(segments: Sequence[Segment]) -> tuple[Segment, ...]:
    """With lengths that follow the tensions as all that is fitted has them."""
    return tuple(
        replace(
            segment,
            readings=tuple(
                replace(reading, follows=reading.tension is not None)
                for reading in segment.readings
            ),
        )
        for segment in segments
    )


def _body_of(state: FitState) -> Array:
    """Its ten linear parameters."""
    assert state.parameters is not None
    return state.parameters


def _robust(
    task: Task, state: FitState, settings: CalibrationSettings
) -> tuple[Fit, list[WrongRow]]:
    """Fit, and again without rows that contradict all others.

    First with all noise taken as larger: next to a geometry that is off by decimetres no reading of
    a tenth of a millimetre stands out, and with it one that is off by metres does.
    """
    wrong: list[WrongRow] = []
    sources = {s.label(*r.source) for s in state.segments for r in s.readings}
    for factor in settings.coarse:
        coarse = replace(state, factors=dict.fromkeys(sources, factor))
        found, named = _repeated(task, coarse, wrong, settings, levels=False)
        if found.converged:
            state, wrong = replace(found.state, factors={}), named
    found, wrong = _repeated(task, state, wrong, settings, levels=True)
    # What has not settled contradicts more than some rows.
    return found, wrong if found.converged else []


def _repeated(
    task: Task,
    state: FitState,
    wrong: list[WrongRow],
    settings: CalibrationSettings,
    *,
    levels: bool,
) -> tuple[Fit, list[WrongRow]]:
    """A fit, again without the rows that stand out of it."""
    found = fit(task, state, levels=levels)
    for _ in range(settings.rounds):
        if not found.converged:
            break
        segments, more = without_wrong(task, found, settings)
        if not more or are_many([*wrong, *more], found.state.segments, settings):
            break
        wrong = [*wrong, *more]
        found = fit(task, replace(found.state, segments=segments), levels=levels)
    return found, wrong
