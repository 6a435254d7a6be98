"""From the streams of a run to segments: where they begin and end, and what was read along them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run
from steelyard.identification.model.balance import Forces
from steelyard.identification.model.calibration_parameters import CalibrationValues, clock_of
from steelyard.identification.model.motion_segment import (
    PARTS,
    Reading,
    Segment,
    jerk_matrices,
)
from steelyard.identification.model.processes import unresolved
from steelyard.identification.model.settings import MOTION, MotionSettings
from steelyard.identification.samples.faulty_stretches import without_jumps, without_stuck
from steelyard.identification.samples.first_poses.spline_through_poses import poses_of, started
from steelyard.identification.samples.force_samples import (
    force_samples_of,
    least_forces,
    louder_forces,
    with_unresolved,
)
from steelyard.identification.samples.knot_spacing import chosen_spacing, closest_spacing
from steelyard.identification.samples.motion_noise import (
    LEAST_RAPID,
    least_noise,
    rapid_scatter,
    scatter,
    stands_still,
)
from steelyard.identification.samples.motion_streams import (
    MotionStream,
    motion_streams,
    steps_of,
    stretches_of,
)
from steelyard.identification.samples.prepared import Samples
from steelyard.instruments.unread_cables import UnreadCables
from steelyard.smoothing import knots


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
    closest: float = np.inf
    """Spacing of the knots that they resolve at all [s]; infinite of poses at rest."""
    louder: dict[tuple[str, str], float] = field(default_factory=dict)
    """Quantity -> by how much it scatters more than stated about a motion of its own, where a drive
    or the frame shakes the sensor."""


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
    numbers, pose = samples.time, poses_of(samples, experiment.robot.up)
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
    force_samples = force_samples_of(experiment, run, samples, -np.inf, np.inf)
    force_samples = force_samples.part(np.isin(force_samples.time, numbers))

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
        {**least, **least_forces(experiment, run)},
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
    run, stuck = without_stuck(experiment, run)
    run, jumped = without_jumps(experiment, run)
    notes += stuck + jumped
    streams = list(motion_streams(experiment, run, calibration, samples, settings))
    if not streams:
        return Recorded((), (), {}, tuple(notes))
    force = experiment.force_instrument(run)
    assert force is not None
    forces = experiment.common_time(
        run, force, calibration.delay(clock_of(experiment, force), run.name)
    )
    stretches, gaps = stretches_of(run, streams, forces, settings)
    notes += gaps
    finest = np.inf
    swinging = run.locked and isinstance(experiment.instruments[force], UnreadCables)
    if spacing is None:
        spacing, finest = chosen_spacing(experiment, streams, stretches, settings, samples.tension)
        if swinging:
            # The balance is no looser than its equations: the motion has to be able to fulfil them.
            spacing = min(spacing, settings.swinging)
    pose = poses_of(samples, experiment.robot.up)
    least = least_forces(experiment, run)
    segments, force_samples = [], []
    louder: dict[tuple[str, str], float] = {}
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
            least_seen = least_noise(stream.values[use], settings) / stream.mean_of**0.5
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
            if stream.sigma and sigma is not None and stream.order and not still:
                shaken = _shaken(stream, use, sigma, (start, end, width), settings)
                if shaken > 1:
                    louder[stream.source] = max(louder.get(stream.source, 1.0), shaken)
            least[stream.source] = min(least.get(stream.source, np.inf), least_seen)
            tension = None
            if stream.needs_tension and samples.tension is not None:
                tension = np.column_stack(
                    [np.interp(stream.common[use], samples.time, c) for c in samples.tension.T]
                )
            if sigma is not None:
                readings.append(
                    Reading(
                        stream.source,
                        stream.time[use],
                        stream.values[use],
                        sigma,
                        tension,
                        still=still,
                    )
                )
        own = force_samples_of(experiment, run, samples, start, end)
        own = with_unresolved(experiment, own, spacing)
        if coefficients is None or not readings or not len(own.time):
            continue
        # What the motion instruments feel too is a vibration, for finer knots to follow.
        if not any(stream.source in louder for stream in streams):
            for quantity, factor in louder_forces(own, settings).items():
                louder[own.name, quantity] = max(louder.get((own.name, quantity), 1.0), factor)
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
        tuple(_smooth(segments, spacing, None if swinging else steps_of(streams), settings)),
        tuple(force_samples),
        least,
        tuple(notes),
        finest,
        closest_spacing(experiment, streams, settings),
        louder,
    )


def _shaken(
    stream: MotionStream,
    use: NDArray[np.bool_],
    sigma: float,
    grid: tuple[float, float, float],
    settings: MotionSettings,
) -> float:
    """By how much readings of a rate or an acceleration scatter more than their noise about a
    spline of their own; 1 where it is not much.

    Args:
        stream: Of a run.
        use: Its readings, shape (n,).
        sigma: Their 1-sigma.
        grid: Start, end and spacing of the spline [s].
        settings: What is much.
    """
    values = stream.values[use]
    if len(values) < LEAST_RAPID or rapid_scatter(values) < settings.shaken * sigma:
        return 1.0
    found = scatter(stream.common[use], values, *grid, settings)
    if found is None or not settings.shaken <= found / sigma <= settings.most_shaken:
        return 1.0
    return found / sigma


def _smooth(
    segments: Sequence[Segment],
    spacing: float,
    steps: Mapping[str, float] | None,
    settings: MotionSettings,
) -> Iterator[Segment]:
    """Segments with a first guess of how smooth they are: as rough as they begin with, spread over
    all they could do.

    A part that its instruments do not resolve is no looser than it seems: nothing but forces would
    hold it, and these are to tell the body. A swing is held by its own equations of motion.

    Args:
        segments: Of one run.
        spacing: Of their knots [s].
        steps: Part of the pose -> time between two readings of it [s]; None: of a swing.
        settings: How much looser.
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
    looser = dict.fromkeys(PARTS, settings.looser_swinging)
    if steps is not None:
        resolved = {p: spacing >= settings.per_knot * steps.get(p, 0.0) for p in PARTS}
        looser = {part: settings.looser if own else 1.0 for part, own in resolved.items()}
    for segment in segments:
        yield replace(segment, smoothness=rough, looser=looser)
