"""From raw streams to samples: one time base, the platform frame, everything filtered alike.

What the classical methods stand on. Readings are turned into parts of the platform's state by the
measurement equations of the instruments themselves, with systematic errors at the values known
beforehand.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import AtRestError, InputError
from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run
from steelyard.identification.model.calibration_parameters import CalibrationValues
from steelyard.identification.model.settings import PREPARATION, PreparationSettings
from steelyard.identification.model.sources import Acceleration, Source, choose_sources
from steelyard.identification.samples.first_poses.first_motion import (
    FIRST_MOTION,
    first_motion,
    lacks_pose,
    turns_are_told,
    with_first_motion,
)
from steelyard.identification.samples.prepared import Samples
from steelyard.identification.samples.reading import SmoothPart
from steelyard.identification.samples.run_reader import RunReader
from steelyard.motion.state import specific_force_of
from steelyard.robot.cable_inertia import cable_inertia_wrench
from steelyard.rotations import quaternions_of
from steelyard.smoothing import Samples1D, choose_spacing, pieces, segments


@dataclass(frozen=True, eq=False)
class Plan:
    """How a run is cut into parts and filtered."""

    spacing: float
    """Of the knots of the filter [s]."""
    parts: tuple[tuple[float, float, Array], ...]
    """Start and end of what is fitted [s], and the times at which it is evaluated [s], shape
    (n,)."""
    gaps: int


def prepare(
    experiment: Experiment,
    run: Run,
    *,
    acceleration: Acceleration | None = None,
    straight: bool = False,
    calibration: CalibrationValues | None = None,
    thin: bool = False,
    commanded: bool = False,
    settings: PreparationSettings = PREPARATION,
) -> Samples:
    """Samples of one run.

    Args:
        experiment: With robot and instruments.
        run: One of its runs.
        acceleration: Where to take the acceleration from; None: the IMU where there is one.
        straight: Whether to take the cables as massless and straight, as the paper does.
        calibration: Values of the systematic errors; None: as known beforehand.
        thin: Whether few samples between two knots of the filter will do, and samples far from all
            others be left out.
        commanded: Whether the commanded pose will do where none is measured, and one by
            :mod:`.first_motion` where there is no command.
        settings: Of the filter, and of what is a motion.

    Raises:
        InputError: A quantity that is needed is missing, or the streams do not overlap.
        AtRestError: Nothing moves.
    """
    robot = experiment.robot.with_straight_cables() if straight else experiment.robot
    if thin:
        run = with_every_cable(experiment, run)
    elif missing := cables_without(experiment, run):
        raise InputError(
            f"run '{run.name}': expected the force of every cable, found none of"
            f" {', '.join(f'cable {i + 1}' for i in missing)}; use maximum-likelihood, which does"
            " without"
        )
    if commanded and lacks_pose(experiment, run) and turns_are_told(experiment, run):
        found = first_motion(experiment, run)
        if found is not None:
            experiment, run = with_first_motion(experiment, run, found)
    sources = choose_sources(experiment, run, acceleration, commanded=commanded)
    task = RunReader(experiment, robot, run, sources, calibration)
    return _static(task) if run.static else _moving(task, settings, thin=thin)


def cables_without(experiment: Experiment, run: Run) -> list[int]:
    """Cables, from 0, of which no force is read in a run."""
    force = experiment.force_instrument(run)
    values = None if force is None else run.streams[force].values.get("tension")
    return [] if values is None else np.flatnonzero(~np.isfinite(values).any(axis=0)).tolist()


def with_every_cable(experiment: Experiment, run: Run) -> Run:
    """A run in which cables without a sensor pull like the others: what begins with it finds out
    how they do.
    """
    missing, force = cables_without(experiment, run), experiment.force_instrument(run)
    if not missing or force is None:
        return run
    stream = run.streams[force]
    values = stream.values["tension"].copy()
    values[:, missing] = np.delete(values, missing, axis=1).mean(axis=1, keepdims=True)
    stream = replace(stream, values={**stream.values, "tension": values})
    return replace(run, streams={**run.streams, force: stream})


def _static(task: RunReader) -> Samples:
    """Samples of a run of poses at rest."""
    sources, streams = task.sources, task.run.streams
    raw = {source: streams[source[0]].values[source[1]] for source in sources.used()}
    forces = streams[sources.force].values
    rows = np.all(
        [np.isfinite(v.reshape(len(v), -1)).all(axis=1) for v in [*raw.values(), *forces.values()]],
        axis=0,
    )
    if not rows.any():
        raise InputError(
            f"{task.where}: expected at least one complete pose, found none; fill the empty cells"
        )
    still = np.zeros((int(rows.sum()), 3))
    gravity = task.gravity
    rotation = position = None
    if sources.rotation:
        rotation = task.solve("rotation", sources.rotation, raw[sources.rotation][rows])
        # At rest the specific force is gravity alone, and the attitude knows it without an
        # accelerometer's bias.
        specific_force = specific_force_of(rotation, still, gravity)
    else:
        assert sources.specific_force is not None
        specific_force = task.solve(
            "specific_force",
            sources.specific_force,
            raw[sources.specific_force][rows],
            omega=still,
            alpha=still,
        )
    if sources.position and rotation is not None:
        position = task.solve(
            "position", sources.position, raw[sources.position][rows], rotation=rotation
        )
    pose = (
        {} if position is None or rotation is None else {"position": position, "rotation": rotation}
    )
    readings = {k: v[rows] for k, v in forces.items()}
    force_samples = task.force_samples(readings, {**pose, "velocity": still, "omega": still})
    carried: dict[str, Any] = task.carried(force_samples, position, rotation)
    return Samples(
        run=task.run.name,
        time=streams[sources.force].time[rows],
        omega=still,
        alpha=still,
        specific_force=specific_force,
        **carried,
        position=position,
        rotation=rotation,
        velocity=still if task.behind_rollers else None,
        static=True,
        free_offset=task.free_offset,
        alpha_noise=0.0,
        spacing=0.0,
        position_sigma=0.0,
    )


def _moving(task: RunReader, settings: PreparationSettings, *, thin: bool) -> Samples:
    """Samples of a run in motion, part by part between its gaps."""
    run, sources = task.run, task.sources
    everything = [
        *sources.used(),
        *((sources.force, quantity) for quantity in run.streams[sources.force].values),
    ]
    raw = {source: samples_of(task, source, settings) for source in everything}
    plan = _planned(task, raw, settings, thin=thin)
    spacing = plan.spacing

    def state(part: tuple[float, float, Array]) -> tuple[dict[str, Array], dict[str, float]] | None:
        start, end, times = part
        return SmoothPart(task, raw, start, end, spacing, robust=thin).state(times)

    if len(plan.parts) > 1:
        # What is done on long arrays leaves other threads alone.
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            states = list(pool.map(state, plan.parts))
    else:
        states = [state(part) for part in plan.parts]
    parts = [state for state, _ in filter(None, states)]
    found = sum(len(p["time"]) for p in parts)
    if found < settings.fewest:
        raise InputError(
            f"{task.where}: expected at least {settings.fewest} force samples where all streams"
            f" have data, found {found}; record longer, or widen 'window'"
        )
    joined: dict[str, Any] = {key: np.concatenate([p[key] for p in parts]) for key in parts[0]}
    if task.calibration and task.robot.m and task.robot.cable.linear_density:
        joined["wrench"] = joined["wrench"] + task.calibration.drag * cable_inertia_wrench(
            task.robot, gravity=task.gravity, **{name: joined[name] for name in _DRAGGING}
        )
    noises, counts = [noise for _, noise in filter(None, states)], [len(p["time"]) for p in parts]
    noise = {
        key: float(np.sqrt(np.average([n[key] ** 2 for n in noises], weights=counts)))
        for key in noises[0]
    }
    alpha_noise = noise.pop("alpha")
    _check_motion(task.where, joined, alpha_noise, settings)
    turned = joined.pop("omega_of_attitude")
    # What follows from the cables is a beginning, and contradicts no gyro.
    told = sources.rotation is None or sources.rotation[0] != FIRST_MOTION
    notes = _gyro_notes(run.name, joined["omega"], turned, settings) if told else []
    for what, source in (("position", sources.position), ("orientation", sources.rotation)):
        if source and source[0] == FIRST_MOTION:
            notes.append(
                f"run '{run.name}': no instrument measures the {what} by itself: it follows from"
                " the cables"
            )
        elif source and task.experiment.instruments[source[0]].commanded:
            notes.append(
                f"run '{run.name}': the {what} is the commanded one, for want of a measured one"
            )
    if plan.gaps:
        notes.append(
            f"run '{run.name}': {plan.gaps} gap{'s' if plan.gaps > 1 else ''} in the streams"
            " left out"
        )
    return Samples(
        run=run.name,
        static=False,
        free_offset=task.free_offset,
        alpha_noise=alpha_noise,
        noise=noise,
        spacing=plan.spacing,
        position_sigma=task.position_sigma,
        notes=tuple(notes),
        **joined,
    )


_DRAGGING = ("position", "rotation", "specific_force", "omega", "alpha")


def _planned(
    task: RunReader, raw: Mapping[Source, Samples1D], settings: PreparationSettings, *, thin: bool
) -> Plan:
    """Cut a run where streams have gaps, and choose the filter from the data."""
    start, end = task.run.window or (-np.inf, np.inf)
    start = max(start, *(float(s.time[0]) for s in raw.values()))
    end = min(end, *(float(s.time[-1]) for s in raw.values()))
    if end <= start:
        raise InputError(
            f"{task.where}: expected streams that overlap in time, found none; correct 'sync' or"
            " 'window'"
        )
    sources = task.sources
    # The paper's procedure looks at what it differentiates; others at all that tells the motion.
    differentiated: list[Source | None] = (
        [*sources.used()] if thin else [sources.omega or sources.rotation]
    )
    if sources.specific_force is None and not thin:
        differentiated.append(sources.position)
    judged = [raw[s] for s in differentiated if s]
    spacing = _spacing(judged, list(raw.values()), start, end, settings, robust=thin)
    times = task.time(sources.force)
    parts, gaps = [], -1
    for part_start, part_end in segments([s.time for s in raw.values()], start, end, spacing):
        gaps += 1
        for a, b, first, last in pieces(part_start, part_end, spacing):
            inside = times[(times >= first) & (times < last)]
            enough = round(settings.evaluated_per_knot * (last - first) / spacing)
            if thin and len(inside) > enough:
                inside = np.asarray(first + (np.arange(enough) + 0.5) * ((last - first) / enough))
            if len(inside):
                parts.append((a, b, inside))
    return Plan(spacing, tuple(parts), gaps)


def _gyro_notes(
    run: str, omega: Array, omega_of_attitude: Array, settings: PreparationSettings
) -> list[str]:
    """Say where gyro and attitude contradict each other: a wrong axis, sign or unit passes all
    other checks.
    """
    notes = []
    for axis, name in enumerate("xyz"):
        own, other = omega[:, axis], omega_of_attitude[:, axis]
        own, other = own - own.mean(), other - other.mean()
        if np.sqrt(np.mean(other**2)) <= settings.least_compared:
            continue
        factor = float(own @ other / (other @ other)) - 1
        if abs(factor) > settings.largest_factor:
            notes.append(
                f"run '{run}': about {name} the gyro turns {factor + 1:.2g} times as fast as the"
                " orientation; check axes, signs and units"
            )
    return notes


def samples_of(
    task: RunReader, source: Source, settings: PreparationSettings = PREPARATION
) -> Samples1D:
    """A quantity with its complete samples on the common clock; rotations already of the platform,
    as quaternions.
    """
    name, quantity = source
    stream = task.run.streams[name]
    values = stream.values[quantity]
    valid = np.isfinite(values.reshape(len(values), -1)).all(axis=1)
    time = task.time(name)
    if task.run.window:
        start, end = task.run.window
        valid &= (time >= start - settings.margin) & (time <= end + settings.margin)
    time, values = time[valid], values[valid]
    if len(time) < 2:
        for fault in task.run.excluded:
            of_it = fault.instrument == name and fault.channel.startswith(quantity)
            if fault.kind == "dead" and of_it:
                raise InputError(
                    f"{stream.source}: expected readings of {name} that change, found the same"
                    f" {fault.channel.replace('_', ' ')} in all {fault.count} samples while its"
                    " other channels read noise; repair the sensor, or take the instrument out of"
                    " the experiment"
                )
        raise InputError(
            f"{stream.source}: expected at least 2 complete samples of"
            f" {quantity.replace('_', ' ')}, found {len(time)}; fill the empty cells"
        )
    if values.ndim == 3:
        values = quaternions_of(task.solve("rotation", source, values))
    elif quantity == "angular_velocity":
        values = task.solve("omega", source, values)
    return Samples1D(time, values)


def _spacing(
    judged: list[Samples1D],
    used: list[Samples1D],
    start: float,
    end: float,
    settings: PreparationSettings,
    *,
    robust: bool,
) -> float:
    """Knot spacing from the data: at least two samples of the slowest stream, at most what the
    motion bears.
    """
    steps = [np.diff(s.time[(s.time >= start) & (s.time <= end)]) for s in used]
    slowest = max((float(np.median(step)) for step in steps if len(step)), default=settings.widest)
    finest = settings.samples_per_knot * slowest
    widest = max(finest, min(settings.widest, (end - start) / settings.fewest_knots))
    if robust:
        finest = min(widest, max(finest, settings.finest))
    candidates = np.geomspace(finest, widest, 1 + int(np.ceil(2 * np.log2(widest / finest))))
    # No spline crosses a gap: the longest part without one is looked at.
    parts = segments([s.time for s in used], start, end, finest)
    start, end = max(parts, key=lambda part: part[1] - part[0], default=(start, end))
    end = min(end, start + settings.judged)
    return choose_spacing(judged, [float(c) for c in candidates], start, end, robust=robust)


def _check_motion(
    where: str, state: Mapping[str, Array], alpha_noise: float, settings: PreparationSettings
) -> None:
    """Refuse a recording of a platform at rest: its place is among the static runs."""
    turning, moving = _scatter(state["alpha"]), _scatter(state["specific_force"])
    least_turning = max(settings.beyond_noise * alpha_noise, settings.least_turning)
    if turning < least_turning and moving < settings.least_moving:
        raise AtRestError(
            f"{where}: expected a motion, found a platform (nearly) at rest: {turning:.2g} rad/s^2"
            f" and {moving:.2g} m/s^2 rms; record a motion, or list it under 'static: true'"
        )


def _scatter(vectors: Array) -> float:
    """Root mean square distance of vectors, shape (n, 3), from their mean."""
    off = vectors - vectors.mean(axis=0)
    return float(np.sqrt(np.mean(np.sum(off**2, axis=1))))
