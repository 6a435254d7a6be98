"""From the streams of a run to segments: where they begin and end, what was read along them, and a
motion to begin with.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from steelyard.arrays import Array
from steelyard.experiment.faults.jumps import jumps
from steelyard.experiment.faults.stuck import FEWEST_REPEATS, stuck_alone
from steelyard.experiment.model import Experiment, Run
from steelyard.identification.model.balance import UNMODELLED, Forces
from steelyard.identification.model.calibration_parameters import (
    ROBOT,
    CalibrationValues,
    clock_of,
)
from steelyard.identification.model.motion_segment import (
    PARTS,
    Reading,
    Segment,
    jerk_matrices,
)
from steelyard.identification.model.processes import unresolved
from steelyard.identification.model.segment import motion_at
from steelyard.identification.model.settings import MOTION, MotionSettings
from steelyard.identification.model.sources import Source
from steelyard.identification.samples.force_noise import force_sigma, least_sigma
from steelyard.identification.samples.knot_spacing import Channelled, best_spacing
from steelyard.identification.samples.preparation import Samples
from steelyard.instruments.base import Part
from steelyard.instruments.equations import order_of
from steelyard.instruments.noise import Disturbance
from steelyard.instruments.unread_cables import UnreadCables
from steelyard.robot.model import DIRECTIONS
from steelyard.rotations import quaternions_of
from steelyard.smoothing import DEGREE, Samples1D, fit, knots

_FLICKER = 3
"""Values that an encoder at rest may read: its count and those beside it."""


@dataclass(frozen=True, eq=False)
class Recorded:
    """What one run gives."""

    segments: tuple[Segment, ...]
    force_samples: tuple[Forces, ...]
    """Of each segment."""
    least: dict[tuple[str, str], float]
    """Quantity -> least 1-sigma that its noise may be estimated at."""
    notes: tuple[str, ...]
    finest: float = np.inf
    """Spacing of the knots that its instruments could still resolve [s]; infinite where it is that
    fine already."""


def scatter(
    time: Array,
    values: Array,
    start: float,
    end: float,
    spacing: float,
    settings: MotionSettings = MOTION,
) -> float | None:
    """1-sigma of samples about their own spline; None where they do not determine one, not even between
    their gaps.
    """
    flat = values.reshape(len(values), -1)
    whole = fit(Samples1D(time, flat), start, end, spacing, robust=True) if len(time) else None
    sigma = whole.sigma if whole is not None else _between_gaps(time, flat, spacing)
    if sigma is None:
        return None
    # Nine elements of a rotation matrix scatter by sqrt(6 / 9) of the rotation vector.
    scale = np.sqrt(1.5) if values.ndim == 3 else 1.0
    return max(sigma * scale, least_noise(values, settings))


def _between_gaps(time: Array, values: Array, spacing: float) -> float | None:
    """1-sigma of samples about splines of their own between gaps that a spline of this spacing does
    not bridge; None where they do not determine any.
    """
    square, count = 0.0, 0
    for start, end in _unbroken(time, spacing) if len(time) else ():
        own = (time >= start) & (time <= end)
        if end - start <= spacing:
            continue
        fitted = fit(Samples1D(time[own], values[own]), start, end, spacing, robust=True)
        if fitted is not None:
            square += int(own.sum()) * fitted.sigma**2
            count += int(own.sum())
    return float(np.sqrt(square / count)) if count else None


def least_noise(values: Array, settings: MotionSettings = MOTION) -> float:
    """Least 1-sigma of a quantity, from how much it varies."""
    flat = values.reshape(len(values), -1)
    return float(
        settings.least_noise * np.nanstd(flat, axis=0).max()
        + 1e-9 * np.nanmax(np.abs(flat))
        + 1e-12
    )


def stands_still(values: Array) -> bool:
    """Whether a quantity does nothing but flicker by its last digit, as the encoders of locked winches
    do: it tells nothing of its noise.

    Args:
        values: Readings, shape (n, ...).
    """
    flat = values.reshape(len(values), -1)
    return all(len(np.unique(own[np.isfinite(own)])) <= _FLICKER for own in flat.T)


def started(
    time: Array, pose: Array, grid: Array, start: float, end: float, spacing: float
) -> Array | None:
    """Coefficients of a spline through poses; None where they do not determine one.

    Args:
        time: [s], shape (n,).
        pose: Position and quaternion without jumps of sign, shape (n, 7).
        grid: Knots [s].
        start: Of the knots [s].
        end: Of the knots [s].
        spacing: Of the knots [s].
    """
    if len(time) <= 1:
        return None
    # Samples do not reach the ends, and may be few: the nearest pose stands in there.
    fine = np.linspace(start, end, 3 * (len(grid) - DEGREE))
    filled = np.column_stack([np.interp(fine, time, column) for column in pose.T])
    fitted = fit(Samples1D(fine, filled), start, end, spacing)
    return None if fitted is None else np.asarray(fitted.spline.c[:, :7])


def poses_of(samples: Samples) -> Array:
    """Position and quaternion that samples show, the latter without jumps of sign, shape (n, 7)."""
    n = len(samples)
    position = np.zeros((n, 3)) if samples.position is None else samples.position
    rotation = _tilt(samples).as_matrix() if samples.rotation is None else samples.rotation
    return np.hstack([position, quaternions_of(rotation)])


def _tilt(samples: Samples) -> Rotation:
    """Attitude of a body of which only its own feelings are known: gravity says where up is, the
    gyro how it has turned.
    """
    up = np.array([0.0, 0.0, 1.0])
    turned = [Rotation.identity()]
    if not samples.static:
        for omega, step in zip(samples.omega[:-1], np.diff(samples.time), strict=True):
            turned.append(turned[-1] * Rotation.from_rotvec(omega * step))
    else:
        turned *= len(samples)
    found = []
    for rotation, force_samples in zip(turned, samples.specific_force, strict=True):
        feels = rotation.apply(force_samples)
        axis = np.cross(feels, up)
        angle = np.arctan2(np.linalg.norm(axis), feels @ up)
        found.append(
            Rotation.from_rotvec(axis / max(float(np.linalg.norm(axis)), 1e-12) * angle) * rotation
        )
    return Rotation.concatenate(found)


def resampled(segment: Segment, onto: Segment) -> Segment:
    """A segment on other knots with the motion of this one."""
    start, end = float(onto.knots[0]), float(onto.knots[-1])
    spacing = float(onto.knots[DEGREE + 1] - onto.knots[DEGREE])
    times = np.linspace(
        max(start, float(segment.knots[0])), min(end, float(segment.knots[-1])), 4 * len(onto.knots)
    )
    pose, *_ = motion_at(segment.basis(times), segment.coefficients)
    coefficients = started(times, pose, onto.knots, start, end, spacing)
    return onto if coefficients is None else replace(onto, coefficients=coefficients)


def recorded(
    experiment: Experiment,
    run: Run,
    samples: Samples,
    calibration: CalibrationValues,
    spacing: float | None = None,
    settings: MotionSettings = MOTION,
) -> Recorded:
    """Arcs of one run.

    Args:
        experiment: With robot and instruments.
        run: One of its runs.
        samples: Of it, to begin with.
        calibration: Values of the systematic errors, to begin with.
        spacing: Of the knots [s]; None: as the readings ask for.
        settings: Of segments and knots.
    """
    return (
        _poses(experiment, run, samples, settings)
        if run.static
        else _moving(experiment, run, samples, calibration, spacing, settings)
    )


def _poses(
    experiment: Experiment, run: Run, samples: Samples, settings: MotionSettings
) -> Recorded:
    """The one segment of a run of poses at rest."""
    numbers, pose = samples.time, poses_of(samples)
    readings = []
    for name, stream in run.streams.items():
        instrument = experiment.instruments[name]
        if not instrument.is_motion:
            continue
        for quantity in instrument.quantities(experiment.robot.m):
            values = stream.values.get(quantity.name)
            # Many poses that differ by more than noise do not tell it.
            sigma = quantity.noise or (
                settings.at_rest(quantity.unit) if values is not None else None
            )
            if values is None or sigma is None:
                continue
            use = np.isfinite(values.reshape(len(values), -1)).all(axis=1) & np.isin(
                stream.time, numbers
            )
            readings.append(Reading((name, quantity.name), stream.time[use], values[use], sigma))
    segment = Segment(run.name, numbers, tuple(readings), pose, static=True)
    force_samples = _force_samples(experiment, run, samples, -np.inf, np.inf)
    keep = np.isin(force_samples.time, numbers)
    force_samples = replace(
        force_samples,
        time=force_samples.time[keep],
        readings={k: v[keep] for k, v in force_samples.readings.items()},
        left_out=force_samples.left_out[keep],
    )

    def unit_of(source: tuple[str, str]) -> str:
        instrument = experiment.instruments[source[0]]
        return instrument.quantity(source[1], experiment.robot.m).unit

    least = {
        reading.source: settings.at_rest(unit_of(reading.source)) / settings.best_at_rest
        for reading in readings
    }
    return Recorded(
        (segment,),
        (force_samples,),
        {**least, **_least_forces(experiment, run)},
        (),
    )


def _moving(
    experiment: Experiment,
    run: Run,
    samples: Samples,
    calibration: CalibrationValues,
    spacing: float | None,
    settings: MotionSettings,
) -> Recorded:
    """Segments of a run in motion, each with its readings and a motion to begin with."""
    notes: list[str] = []
    run, stuck = _without_stuck(experiment, run)
    run, jumped = _without_jumps(experiment, run)
    notes += stuck + jumped
    streams = list(_streams(experiment, run, calibration, samples, settings))
    if not streams:
        return Recorded((), (), {}, tuple(notes))
    force = experiment.force_instrument(run)
    assert force is not None
    forces = experiment.common_time(
        run, force, calibration.delay(clock_of(experiment, force), run.name)
    )
    stretches, gaps = _stretches(run, streams, forces, settings)
    notes += gaps
    finest = np.inf
    if spacing is None:
        spacing, finest = _spacing(experiment, streams, stretches, settings)
        if run.locked and isinstance(experiment.instruments[force], UnreadCables):
            # The balance is no looser than its equations: the motion has to be able to fulfil them.
            spacing = min(spacing, settings.swinging)
    pose = poses_of(samples)
    least = _least_forces(experiment, run)
    segments, force_samples = [], []
    for start, end in stretches:
        first, last = start - settings.margin, end + settings.margin
        grid = knots(first, last, spacing)
        coefficients = started(samples.time, pose, grid, first, last, spacing)
        readings = []
        for stream in streams:
            # Where no force is read, nobody knows how far cables stretch.
            margin = 0.0 if stream.needs_tension else settings.margin / 2
            use = (stream.common >= start - margin) & (stream.common <= end + margin)
            if not use.any():
                continue
            width = max(
                spacing,
                (
                    settings.per_knot * float(np.median(np.diff(stream.common[use])))
                    if use.sum() > 1
                    else spacing
                ),
            )
            least_seen = least_noise(stream.values[use], settings)
            least_stated = settings.finest_noise / settings.least_noise * least_seen
            still = stands_still(stream.values[use])
            if still:
                least_seen = settings.at_rest(stream.unit) / settings.best_at_rest
            sigma = (
                float(
                    np.hypot(
                        max(stream.sigma, least_stated),
                        unresolved(stream.disturbed, spacing, stream.step),
                    )
                )
                if stream.sigma
                else settings.at_rest(stream.unit)
                if still
                else scatter(stream.common[use], stream.values[use], start, end, width, settings)
            )
            least[stream.source] = min(least.get(stream.source, np.inf), least_seen)
            tension = None
            if stream.needs_tension and samples.tension is not None:
                tension = np.column_stack(
                    [np.interp(stream.common[use], samples.time, c) for c in samples.tension.T]
                )
            if sigma is not None:
                readings.append(
                    Reading(stream.source, stream.time[use], stream.values[use], sigma, tension)
                )
        own = _force_samples(experiment, run, samples, start, end)
        own = _with_unresolved(experiment, own, spacing)
        if coefficients is None or not readings or not len(own.time):
            continue
        segments.append(
            Segment(
                run.name,
                grid,
                tuple(readings),
                coefficients,
                placed=any("position" in s.determines and not s.order for s in streams),
                jerks=jerk_matrices(grid),
            )
        )
        force_samples.append(own)
    if not segments:
        notes.append(f"run '{run.name}': nothing that forces and motion tell together")
    return Recorded(
        tuple(_smooth(segments, spacing, _steps(streams), settings)),
        tuple(force_samples),
        least,
        tuple(notes),
        finest,
    )


def _smooth(
    segments: Sequence[Segment],
    spacing: float,
    steps: Mapping[str, float],
    settings: MotionSettings,
) -> Iterator[Segment]:
    """Arcs with a first guess of how smooth they are: as rough as they begin with, spread over all
    they could do.

    A part that its instruments do not resolve is no looser than it seems: nothing but forces would
    hold it, and these are to tell the body.
    """
    if not segments:
        return
    length = sum(float(segment.knots[-1] - segment.knots[0]) for segment in segments)
    rough = {
        part: (
            max(sum(segment.roughness[part] for segment in segments) / length, settings.least_jerk)
            * spacing
        )
        for part in PARTS
    }
    looser = {
        part: settings.looser if spacing >= settings.per_knot * step else 1.0
        for part, step in steps.items()
    }
    for segment in segments:
        yield replace(segment, smoothness=rough, looser=looser)


@dataclass(frozen=True, eq=False)
class _MotionStream:
    """One quantity of one instrument over a run."""

    source: tuple[str, str]
    time: Array
    """By its clock, moved to the common event [s]."""
    common: Array
    """Common time [s]."""
    values: Array
    sigma: float | None
    unit: str
    order: int
    """Highest derivative of the motion that it reads."""
    determines: tuple[Part, ...]
    """Parts of the motion that follow from it."""
    needs_tension: bool = False
    disturbed: tuple[Disturbance, ...] = ()
    """Errors that go on for a while, as stated."""

    @property
    def step(self) -> float:
        """Between samples [s]."""
        return float(np.median(np.diff(self.common))) if len(self.common) > 1 else 1.0


def _streams(
    experiment: Experiment,
    run: Run,
    calibration: CalibrationValues,
    samples: Samples,
    settings: MotionSettings,
) -> Iterator[_MotionStream]:
    """What is read of the motion; a command stands in for a place that nothing measures."""
    told = {
        quantity
        for name, stream in run.streams.items()
        if experiment.instruments[name].is_motion or experiment.instruments[name].is_cable_motion
        for quantity in stream.values
    }
    missing = {"position"} if not told & {"position", "length"} else set[str]()
    missing |= {"orientation"} if "orientation" not in told else set[str]()
    for name, stream in run.streams.items():
        instrument = experiment.instruments[name]
        stands_in = (
            instrument.commanded
            and not instrument.is_measurement
            and bool(missing)
            and experiment.robot.m > 0
        )
        looks_at_cables = instrument.is_cable_motion and samples.tension is not None
        if not (instrument.is_motion or stands_in or looks_at_cables):
            continue
        time = experiment.common_time(run, name, 0.0)
        common = time - calibration.delay(clock_of(experiment, name), run.name)
        for quantity in instrument.quantities(experiment.robot.m):
            values = stream.values.get(quantity.name)
            if values is None or (stands_in and quantity.name not in missing):
                continue
            flat = np.isfinite(values.reshape(len(values), -1))
            use = flat.all(axis=1) if values.ndim == 3 else flat.any(axis=1)
            if run.window is not None:
                use &= (common >= run.window[0] - 1.0) & (common <= run.window[1] + 1.0)
            sigma = quantity.noise or None
            if stands_in:
                # It is wrong for a while where it is wrong: as much is known as few independent
                # readings tell.
                step = float(np.median(np.diff(common))) if len(common) > 1 else 1.0
                sigma = (
                    _commanded(quantity.name, settings)
                    * max(1.0, 1 / (settings.commanded_rate * max(step, 1e-6))) ** 0.5
                )
            yield _MotionStream(
                (name, quantity.name),
                time[use],
                common[use],
                values[use],
                sigma,
                quantity.unit,
                order_of(instrument, quantity.name, experiment.robot),
                quantity.determines,
                looks_at_cables,
                quantity.disturbed,
            )


def _commanded(quantity: str, settings: MotionSettings) -> float:
    """1-sigma of a command that stands in for a measurement [m] or [rad]."""
    place = quantity == "position"
    return settings.commanded_position if place else settings.commanded_orientation


def _stretches(
    run: Run, streams: Sequence[_MotionStream], forces: Array, settings: MotionSettings
) -> tuple[list[tuple[float, float]], list[str]]:
    """Stretches of common time [s] in which rotation and translation are told all along, and notes
    of what is not.
    """
    start, end = float(forces[0]), float(forces[-1])
    if run.window is not None:
        start, end = max(start, run.window[0]), min(end, run.window[1])
    notes = []
    groups = [
        [s for s in streams if "rotation" in s.determines],
        [s for s in streams if "position" in s.determines],
    ]
    parts = [(start, end)]
    for group in groups:
        if not group:
            continue
        times = np.unique(np.concatenate([s.common for s in group]))
        step = min(float(np.median(np.diff(s.common))) for s in group if len(s.common) > 1)
        own = _unbroken(times, max(settings.gap, 5 * step))
        parts = [(max(a, c), min(b, d)) for a, b in parts for c, d in own if min(b, d) > max(a, c)]
    for stream in streams:
        for a, b in _holes(stream.common, start, end, settings.gap):
            notes.append(
                f"run '{run.name}': {stream.source[0]} has no {stream.source[1].replace('_', ' ')}"
                f" from {a:.2f} to {b:.2f} s"
            )
    return [(a, b) for a, b in parts if b - a >= settings.shortest], notes


def _unbroken(times: Array, gap: float) -> list[tuple[float, float]]:
    breaks = np.flatnonzero(np.diff(times) > gap)
    edges = [times[0], *(t for i in breaks for t in (times[i], times[i + 1])), times[-1]]
    return [(float(a), float(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _holes(times: Array, start: float, end: float, gap: float) -> list[tuple[float, float]]:
    inside = times[(times >= start) & (times <= end)]
    if len(inside) < 2:
        return []
    steps = np.diff(inside)
    return [
        (float(inside[i]), float(inside[i + 1]))
        for i in np.flatnonzero(steps > max(gap, 5 * float(np.median(steps))))
    ]


def _spacing(
    experiment: Experiment,
    streams: Sequence[_MotionStream],
    stretches: Sequence[tuple[float, float]],
    settings: MotionSettings,
) -> tuple[float, float]:
    """Spacing of the knots: as fine as the readings ask for, and somewhat finer; and what they
    could resolve, see :class:`Recorded`.
    """
    if not stretches:
        return settings.widest, np.inf
    start, end = max(stretches, key=lambda part: part[1] - part[0])
    end = min(end, start + settings.judged)
    channelled = []
    for stream in streams:
        values, sigma = stream.values, stream.sigma
        if values.ndim == 3:
            values = quaternions_of(values)
            # A quaternion turns half as fast as the rotation vector.
            sigma = sigma / 2 if sigma else None
        complete = np.isfinite(values).all(axis=1)
        channelled.append(
            Channelled(stream.common[complete], values[complete], stream.order, sigma)
        )
    limit = settings.finest if experiment.robot.m else settings.finest_on_sensor
    finest = max(limit, settings.per_knot * max(_steps(streams).values()))
    widest = max(finest, min(settings.widest, (end - start) / 8))
    candidates = np.geomspace(finest, widest, 1 + int(np.ceil(2 * np.log2(widest / finest))))
    best = best_spacing(channelled, [float(c) for c in candidates], start, end, settings=settings)
    force_samples = [
        float(np.median(np.diff(s.common)))
        for s in streams
        if s.source[1] == "specific_force" and len(s.common) > 1
    ]
    # Where the readings would have it finer than they resolve, it is no use to go on.
    resolved = (
        max(limit, settings.per_vibration * min(force_samples))
        if force_samples and best > finest
        else np.inf
    )
    return float(max(finest, best / np.sqrt(2))), resolved


def _steps(streams: Sequence[_MotionStream]) -> dict[str, float]:
    """Part of the pose -> time between samples of the fastest instrument that tells it [s]."""
    steps = {}
    for part in ("rotation", "position"):
        own = [
            float(np.median(np.diff(s.common)))
            for s in streams
            if part in s.determines and len(s.common) > 1
        ]
        steps[part] = min(own, default=0.0)
    return steps


def _least_forces(experiment: Experiment, run: Run) -> dict[Source, float]:
    """Least 1-sigma of every quantity of the force instrument, and of the unmodelled wrench."""
    name = experiment.force_instrument(run)
    assert name is not None
    values, least = run.streams[name].values, least_sigma(experiment, run)
    sizes = [each.shape[1] for each in values.values()]
    parts = np.split(least, np.cumsum(sizes)[:-1])
    found = {(name, q): float(part[0]) for q, part in zip(values, parts, strict=True)}
    return {**found, (ROBOT, UNMODELLED): float(np.min(least))}


def _usual(readings: Array) -> Array:
    """Median of every column, of a column without a reading that of the others, shape (r,)."""
    found = np.zeros(readings.shape[1])
    there = np.isfinite(readings).any(axis=0)
    if there.any():
        found[there] = np.nanmedian(readings[:, there], axis=0)
        found[~there] = found[there].mean()
    return found


def _with_unresolved(experiment: Experiment, forces: Forces, spacing: float) -> Forces:
    """With the noise that stated disturbances add between knots."""
    instrument, m = experiment.instruments[forces.name], experiment.robot.m
    quantities = [instrument.quantity(q, m) for q in forces.readings]
    if not all(q.noise for q in quantities):
        return forces
    step = float(np.median(np.diff(forces.time))) if len(forces.time) > 1 else 1.0
    further = np.concatenate(
        [np.full(q.size, unresolved(q.disturbed, spacing, step)) for q in quantities]
    )
    return replace(forces, sigma=np.hypot(forces.sigma, further))


def _force_samples(
    experiment: Experiment, run: Run, samples: Samples, start: float, end: float
) -> Forces:
    """Force readings within an interval of common time [s]; a cable without a reading is left out
    of its sample.
    """
    name = experiment.force_instrument(run)
    assert name is not None
    time = experiment.common_time(run, name, 0.0)
    common = experiment.common_time(run, name)
    values = run.streams[name].values
    inside = (
        (common >= start)
        & (common <= end)
        & np.any([np.isfinite(v).any(axis=1) for v in values.values()], axis=0)
    )
    sigma = force_sigma(experiment, run, samples)[0]
    read = {quantity: own[inside] for quantity, own in values.items()}
    return forces_of(experiment, name, time[inside], read, sigma)


def forces_of(
    experiment: Experiment, name: str, time: Array, readings: Mapping[str, Array], sigma: Array
) -> Forces:
    """Readings of the force instrument, of which some may not be there.

    Args:
        experiment: With the instrument.
        name: Of it.
        time: By its clock, moved to the common event [s]; of poses at rest their number; shape (n,).
        readings: Quantity -> readings, r numbers a sample in all.
        sigma: 1-sigma of single readings, shape (r,).
    """
    instrument = experiment.instruments[name]
    stacked = np.hstack(list(readings.values()))
    missing = ~np.isfinite(stacked)
    quantities = instrument.quantities(experiment.robot.m)
    columns = [column for q in quantities if q.name in readings for column in q.forms[0]]
    # Of cables without a sensor, or without a single number.
    unread = np.array([c in instrument.unread for c in columns]) | missing.all(axis=0)
    filled = np.where(missing, _usual(stacked), stacked)
    ends = np.cumsum([v.shape[1] for v in readings.values()])[:-1]
    return Forces(
        name=name,
        time=time,
        readings=dict(zip(readings, np.split(filled, ends, axis=1), strict=True)),
        sigma=sigma,
        left_out=missing & ~unread,
        unmodelled=_unmodelled(experiment, name, unread, sigma),
        unread=unread if unread.any() else None,
    )


def _unmodelled(
    experiment: Experiment, name: str, unread: NDArray[np.bool_], sigma: Array
) -> Array | None:
    """1-sigma of the white part of the wrench that nothing explains, in units of its level, where
    the cables with a sensor cannot carry every wrench, shape (6,); None: they can.
    """
    robot = experiment.robot
    if experiment.instruments[name].measured_force != "tension":
        return None
    if int(np.sum(~unread)) >= DIRECTIONS:
        return None
    return float(np.median(sigma)) * np.array([1.0] * 3 + [robot.size] * 3)


def _without_stuck(experiment: Experiment, run: Run) -> tuple[Run, list[str]]:
    """The run without readings that stay the same in one channel while the others of the instrument
    change.
    """
    streams, notes = dict(run.streams), []
    for name, stream in run.streams.items():
        values = dict(stream.values)
        for quantity, each in stream.values.items():
            if each.ndim != 2 or each.shape[1] < 2 or len(each) < 2 * FEWEST_REPEATS:
                continue
            mask = stuck_alone(each)
            for channel in np.flatnonzero(mask.any(axis=0)):
                own = np.flatnonzero(mask[:, channel])
                time = experiment.common_time(run, name)[own]
                notes.append(
                    f"run '{run.name}': {quantity.replace('_', ' ')} {channel + 1} of {name} is"
                    f" stuck between {time[0]:.2f} and {time[-1]:.2f} s: left out"
                )
            values[quantity] = np.where(mask, np.nan, each)
        streams[name] = replace(stream, values=values)
    return replace(run, streams=streams), notes


def _without_jumps(experiment: Experiment, run: Run) -> tuple[Run, list[str]]:
    """The run without stretches in which an instrument shows another place."""
    streams, notes = dict(run.streams), []
    for name, stream in run.streams.items():
        for quantity in experiment.instruments[name].quantities(experiment.robot.m):
            values = stream.values.get(quantity.name)
            if values is None or quantity.determines != ("position",) or quantity.unit != "m":
                continue
            time = experiment.common_time(run, name)
            found = jumps(time, values)
            left_out = np.zeros(len(values), dtype=bool)
            for each in found:
                left_out[each.first : each.end] = True
                notes.append(
                    f"run '{run.name}': {quantity.name} of {name} jumps by {1e3 * each.size:.0f} mm"
                    f" between {time[each.first]:.2f} and {time[each.end - 1]:.2f} s: left out"
                )
            if found:
                # What looks at another place has no orientation of this one either.
                streams[name] = replace(
                    stream,
                    values={
                        q: np.where(left_out.reshape(-1, *[1] * (v.ndim - 1)), np.nan, v)
                        for q, v in stream.values.items()
                    },
                )
                break
    return replace(run, streams=streams), notes
