"""The fit of a geometry to poses at rest: all instruments, all poses and all systematic errors at
once, by the same statement of the measurements as in `identify`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.calibration.poses import forces_of, segment_of, with_upright
from steelyard.calibration.settings import CALIBRATION, CalibrationSettings
from steelyard.errors import InputError
from steelyard.estimates.estimate import plausible_radius
from steelyard.experiment.model import Experiment
from steelyard.identification.known_body import known_bodies, plausible
from steelyard.identification.model.balance import Forces
from steelyard.identification.model.calibration_parameters import (
    ROBOT,
    CalibrationParameters,
    CalibrationValues,
    gather,
)
from steelyard.identification.model.motion_residuals import (
    Reading,
    Segment,
    Tally,
    motion_residuals,
)
from steelyard.identification.model.segment import Rows
from steelyard.identification.solve.beginning import first_body
from steelyard.identification.solve.fit_state import Fit, FitState, Task
from steelyard.identification.solve.joint_fit import fit
from steelyard.inertia import TEN
from steelyard.instruments.base import Prior

Progress = Callable[[str, float], None] | None
_RADIUS = 1.0
"""Of a body that nobody looks at [m]."""


@dataclass(frozen=True)
class WrongRow:
    """A reading that contradicts all others, and was left out."""

    run: str
    instrument: str
    row: int
    """Of the stream, from 1."""
    channel: str
    off: float
    """Measured less predicted, in the unit of the reading."""
    unit: str

    def __str__(self) -> str:
        return (
            f"run '{self.run}': row {self.row} of {self.instrument}: {self.channel} is off by"
            f" {self.off:+.3g} {self.unit} against all others: left out; correct it, or leave the"
            " row out"
        )


@dataclass(frozen=True, eq=False)
class LeftOut:
    """Residuals of lengths that were predicted from all other readings."""

    run: str
    instrument: str
    pose: NDArray[np.intp]
    """Number of the pose of each row, from 0, shape (n,)."""
    residual: Array
    """Measured less predicted [m], NaN where nothing was read, shape (n, m)."""


@dataclass(frozen=True, eq=False)
class GeometryFit:
    """Where it ended."""

    experiment: Experiment
    """That was fitted, with the priors as they were taken."""
    task: Task
    fit: Fit
    wrong: tuple[WrongRow, ...]
    covariance: Array
    """Of all calibration parameters; zero for exact ones, shape (u, u)."""
    left_out: tuple[LeftOut, ...]
    body: tuple[Array, Array] | None = None
    """Ten linear parameters of the body that hung there, and their covariance, shapes (10,) and (10,
    10); None: no forces were read."""

    @property
    def calibration(self) -> CalibrationValues:
        """Found values."""
        return self.fit.state.calibration

    @property
    def parameters(self) -> CalibrationParameters:
        """With their priors."""
        return self.calibration.calibration_parameters


def fit_geometry(
    experiment: Experiment,
    progress: Progress = None,
    settings: CalibrationSettings = CALIBRATION,
) -> GeometryFit:
    """Fit the geometry of a robot to poses at rest.

    Args:
        experiment: With static runs; ``uncertainty`` says how far its geometry may be off.
        progress: Is called with what is being done and the fraction that is done.
        settings: Levels.

    Raises:
        InputError: There are no poses at rest, or too few readings for the unknowns.
    """
    tell = progress or (lambda what, fraction: None)
    experiment = with_upright(_widened(experiment, settings), settings)
    runs = [run for run in experiment.runs if run.static]
    if not runs:
        raise InputError(
            f"{experiment.source or experiment.name}: expected runs of poses at rest ('static:"
            " true'), found none; record the platform at rest in some ten poses or more"
        )
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
        _active(experiment, parameters, segments),
        _stated(experiment),
        plausible(np.ones(TEN), _RADIUS),
    )
    _check_lengths(task, segments)
    state = FitState(segments, CalibrationValues(parameters, first), None)
    forces = tuple(forces_of(experiment, run, settings) for run in runs)
    tell("fitting poses and geometry", 0.2)
    try:
        found, wrong = _robust(task, state, settings)
        body = None
        if any(each is not None for each in forces):
            tell("fitting the forces", 0.6)
            found, task, body = _with_forces(task, found, forces)
    except np.linalg.LinAlgError:
        raise InputError(
            f"{experiment.source or experiment.name}: expected poses that tell the geometry, found"
            " that they leave it undetermined; add poses, or an instrument that tells how the"
            " platform stands"
        ) from None
    tell("leaving out", 0.8)
    covariance = np.zeros((len(parameters), len(parameters)))
    own = np.flatnonzero(task.active)
    covariance[np.ix_(own, own)] = found.covariance
    # Lengths are left out of what the motion instruments say.
    alone = replace(found, state=replace(found.state, parameters=None))
    left_out = tuple(_left_out(task, alone))
    return GeometryFit(experiment, task, found, tuple(wrong), covariance, left_out, body)


def _widened(experiment: Experiment, settings: CalibrationSettings) -> Experiment:
    """With drums of any scale where something metric is read, and offsets of lengths that nobody has
    stated.
    """
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


def _active(
    experiment: Experiment, parameters: CalibrationParameters, segments: Sequence[Segment]
) -> NDArray[np.bool_]:
    """Calibration parameters that act on a reading and are not exact, shape (u,)."""
    active = np.zeros(len(parameters), dtype=bool)
    for segment in segments:
        for reading in segment.readings:
            instrument = experiment.instruments[reading.source[0]]
            if instrument.is_cable_motion:
                for key in ("anchor", "attachment"):
                    active[parameters.places[ROBOT, key, None]] = True
            for term in instrument.terms(parameters.m):
                active[parameters.place(reading.source[0], term.key, segment.run)] = True
    return active & (parameters.deviation > 0)


def _stated(experiment: Experiment) -> frozenset[tuple[str, str]]:
    """Quantities whose noise is stated, at rest too."""
    return frozenset(
        (name, quantity.name + rest)
        for rest in ("", " at rest")
        for name, instrument in experiment.instruments.items()
        for quantity in instrument.quantities(experiment.robot.m)
        if quantity.noise
    )


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
    active[parameters.places[ROBOT, "gravity", None]] = True
    task = replace(
        task,
        force_samples=tuple(forces),
        active=active & (parameters.deviation > 0),
        sizes=plausible(body, size),
        known=lambda at: known_bodies(experiment, at.calibration, _body_of(at), size),
    )
    state = replace(state, parameters=body)
    fitted = fit(task, state)
    ten = len(fitted.covariance) - int(task.active.sum())
    own = _body_of(fitted.state), fitted.covariance[:ten, :ten]
    return replace(fitted, covariance=fitted.covariance[ten:, ten:]), task, own


def _body_of(state: FitState) -> Array:
    """Its ten linear parameters."""
    assert state.parameters is not None
    return state.parameters


def _check_lengths(task: Task, segments: Sequence[Segment]) -> None:
    """Refuse poses in which nothing was read that depends on where the cables are fixed."""
    names = {reading.source[0] for segment in segments for reading in segment.readings}
    if not any(task.experiment.instruments[name].is_cable_motion for name in names):
        raise InputError(
            f"{task.experiment.source or task.experiment.name}: expected cable lengths (kind: length)"
            " in the poses at rest, which tell where the cables are fixed, found none; add them"
        )


def _robust(
    task: Task, state: FitState, settings: CalibrationSettings
) -> tuple[Fit, list[WrongRow]]:
    """Fit, and again without rows that contradict all others.

    First with all noise taken as larger: next to a geometry that is off by decimetres no reading of a
    tenth of a millimetre stands out, and with it one that is off by metres does.
    """
    wrong: list[WrongRow] = []
    sources = {s.label(*r.source) for s in state.segments for r in s.readings}
    for factor in settings.coarse:
        coarse = replace(state, factors=dict.fromkeys(sources, factor))
        found, wrong = _repeated(task, coarse, wrong, settings, levels=False)
        if not found.converged:
            continue
        state = replace(found.state, factors={})
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
        segments, more = _without_wrong(task, found, settings)
        if not more or _are_many([*wrong, *more], found.state.segments, settings):
            break
        wrong = [*wrong, *more]
        found = fit(task, replace(found.state, segments=segments), levels=levels)
    return found, wrong


def _are_many(
    wrong: Sequence[WrongRow], segments: Sequence[Segment], settings: CalibrationSettings
) -> bool:
    """Whether so many rows of one channel are wrong that it is no row but what is said of it."""
    poses = sum(len(segment.coefficients) for segment in segments)
    counts = Counter((each.instrument, each.channel) for each in wrong)
    return max(counts.values()) > max(2, settings.most_wrong * poses)


def _without_wrong(
    task: Task, found: Fit, settings: CalibrationSettings
) -> tuple[tuple[Segment, ...], list[WrongRow]]:
    """Segments without the channels that stand farthest from all others, pose by pose the worst."""
    wrong, segments = [], []
    for segment in found.state.segments:
        worst: dict[int, tuple[float, int, int, int]] = {}
        for place, (reading, size) in enumerate(_sizes(task, found, segment)):
            numbers = reading.time.astype(int)
            for i, k in zip(*np.nonzero(size > settings.wrong), strict=True):
                if size[i, k] > worst.get(int(numbers[i]), (0.0,))[0]:
                    worst[int(numbers[i])] = float(size[i, k]), place, int(i), int(k)
        dropped: dict[int, list[tuple[int, int]]] = {}
        for _, place, i, k in worst.values():
            dropped.setdefault(place, []).append((i, k))
            wrong.append(_named(task, found, segment, segment.readings[place], i, k))
        readings = [
            _dropped(task, reading, dropped.get(place, []))
            for place, reading in enumerate(segment.readings)
        ]
        segments.append(replace(segment, readings=tuple(readings)))
    return tuple(segments), wrong


def _dropped(task: Task, reading: Reading, cells: Sequence[tuple[int, int]]) -> Reading:
    """A reading without some numbers; a rotation is one, and goes as a whole."""
    if not cells:
        return reading
    instrument = task.experiment.instruments[reading.source[0]]
    if not instrument.quantity(reading.source[1], task.experiment.robot.m).rotation:
        values = reading.values.copy()
        for i, k in cells:
            values[i, k] = np.nan
        return replace(reading, values=values)
    keep = ~np.isin(np.arange(len(reading.values)), [i for i, _ in cells])
    tension = None if reading.tension is None else reading.tension[keep]
    return replace(reading, time=reading.time[keep], values=reading.values[keep], tension=tension)


def _named(task: Task, found: Fit, segment: Segment, reading: Reading, i: int, k: int) -> WrongRow:
    """What is wrong with a reading."""
    name, what = reading.source
    quantity = task.experiment.instruments[name].quantity(what, task.experiment.robot.m)
    return WrongRow(
        segment.run,
        name,
        int(reading.time[i]) + 1,
        quantity.name if quantity.rotation else quantity.forms[0][k],
        _off(task, found, segment, reading, i, k),
        "rad" if quantity.rotation else quantity.unit,
    )


def _rows_of(task: Task, found: Fit, segment: Segment, reading: Reading) -> Rows:
    """Rows of one reading about the end, without Huber's weights."""
    state = found.state
    alone = replace(segment, readings=(reading,))
    rows = motion_residuals(
        task.experiment, alone, state.calibration, task.column_of(state), state.factors, Tally()
    )
    return next(iter(rows))


def _sizes(task: Task, found: Fit, segment: Segment) -> list[tuple[Reading, Array]]:
    """Residuals of every reading in their 1-sigma; Huber's weights are taken off."""
    result = []
    for reading in segment.readings:
        residual = _rows_of(task, found, segment, reading).residual
        # Weighted by the root of c / size, a residual is the root of c times its size.
        limit = _LIMIT
        size = np.abs(residual)
        result.append((reading, np.where(size > limit, size**2 / limit, size)))
    return result


_LIMIT = 3.8906
"""Size from which Huber's weight of a single number is below 1."""


def _off(task: Task, found: Fit, segment: Segment, reading: Reading, i: int, k: int) -> float:
    """Measured less predicted, in the unit of the reading."""
    factor = found.state.factors.get(segment.label(*reading.source), 1.0)
    residual = float(_rows_of(task, found, segment, reading).residual[i, k])
    size = abs(residual)
    whole = size**2 / _LIMIT if size > _LIMIT else size
    return float(np.sign(residual) * whole * reading.sigma * factor)


def _left_out(task: Task, found: Fit) -> list[LeftOut]:
    """Residuals of lengths in each pose about the geometry that all other poses tell: the pose
    itself is fitted to its readings again, the geometry is not.
    """
    state = found.state
    border = task.border(state)
    total = np.diag(task.calibration_parameters.deviation[task.active] ** -2.0)
    poses = []
    for segment in state.segments:
        parts = [(reading, _rows_of(task, found, segment, reading)) for reading in segment.readings]
        for number in range(len(segment.coefficients)):
            own = [(reading, _of_pose(rows, number, border)) for reading, rows in parts]
            A = np.concatenate([pose for _, (_, pose, _) in own])
            B = np.concatenate([errors for _, (_, _, errors) in own])
            e = np.concatenate([residual for _, (residual, _, _) in own])
            # The length of the quaternion is no reading, and is held.
            left = np.linalg.svd(A, full_matrices=True)
            rank = int(np.sum(1e-9 * max(float(left.S.max(initial=0.0)), 1e-300) < left.S))
            across = left.U[:, rank:]
            told = across.T @ B
            total += told.T @ told
            poses.append((segment, own, across, told, across.T @ e))
    found_rows: dict[tuple[str, str], list[tuple[int, Array]]] = {}
    scale = 1 / np.sqrt(np.maximum(np.diag(total), 1e-300))
    for place, (segment, own, across, told, e) in enumerate(poses):
        others = (total - told.T @ told) * np.outer(scale, scale)
        moved = scale * np.linalg.solve(others, scale * (told.T @ e))
        residual = across @ (e + told @ moved)
        number = place - sum(
            len(each.coefficients) for each in state.segments[: list(state.segments).index(segment)]
        )
        start = 0
        for reading, (size, _, _) in own:
            part = residual[start : start + len(size)]
            start += len(size)
            if not task.experiment.instruments[reading.source[0]].is_cable_motion or not len(part):
                continue
            sigma = reading.sigma * state.factors.get(segment.label(*reading.source), 1.0)
            i = int(np.flatnonzero(reading.time.astype(int) == number)[0])
            there = np.isfinite(reading.values[i])
            off = np.where(there, part * sigma, np.nan)
            found_rows.setdefault((segment.run, reading.source[0]), []).append((number, off))
    return [
        LeftOut(
            run, name, np.array([n for n, _ in rows], dtype=np.intp), np.array([r for _, r in rows])
        )
        for (run, name), rows in found_rows.items()
    ]


def _of_pose(rows: Rows, number: int, border: int) -> tuple[Array, Array, Array]:
    """Residual, and derivatives by the pose and by the border, of the rows of one pose."""
    own = np.flatnonzero(rows.first == number)
    residual = rows.residual[own].reshape(-1)
    pose = rows.by_motion[own].reshape(len(residual), rows.by_motion.shape[2])
    errors = np.zeros((len(residual), border))
    columns = np.arange(rows.by_errors.shape[2]) if rows.columns is None else rows.columns
    errors[:, columns] = rows.by_errors[own].reshape(len(residual), len(columns))
    return residual, pose, errors
