"""Disturbances that are stated: coloured noise, drifts and shifts of instruments, an unmodelled
wrench on the platform.

They are there from the beginning, with what is stated of level and correlation time; the rest is
taken from the data.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from steelyard.arrays import Array
from steelyard.experiment.model import Experiment
from steelyard.experiment.surroundings import UnmodelledForm
from steelyard.identification.model.balance import UNMODELLED_PARTS, Forces
from steelyard.identification.model.motion_segment import Segment
from steelyard.identification.model.processes import (
    Process,
    integrals_of,
    named,
)
from steelyard.identification.model.segment import motion_at
from steelyard.identification.model.settings import MOTION, MotionSettings
from steelyard.identification.model.sources import Source
from steelyard.identification.solve.fit_state import FitState, Task
from steelyard.instruments import Instrument
from steelyard.instruments.noise import Disturbance

_AS_LONG = 2.0
"""Correlation time of a drift in lengths of its segment: within it, it grows as a random walk
does."""
_LEAST = 0.05
"""Part of a heading that any axis of an orientation may have, so that none is exact."""


_SWINGS = 0.5
"""Correlation time of what swings or flows in a load [s]: of pendulums and liquids of some
decimetres. Longer ones would take up the weight."""
_ALONG_GRAVITY = 0.5
"""How much of that it pulls along gravity, as a part of what it pulls across: by the angle to which
it swings. What it pulls at the frequencies of the motion is told as errors of offsets and places,
too: with a fifth masses of a desk robot were 1.3 to 1.9 of their 1-sigma too small."""


def denied(experiment: Experiment) -> frozenset[Source]:
    """What is stated not to be there, and is not asked for either."""
    wrench = UNMODELLED_PARTS if experiment.surroundings.unmodelled == 0.0 else ()
    stated = _disturbances(experiment)
    none = (source for source, each in stated if each.cause == "colored" and each.level == 0)
    return frozenset([*wrench, *none])


def with_stated(task: Task, state: FitState) -> FitState:
    """A state with the disturbances that are stated; those that it has stay as they are."""
    segments = []
    for segment, forces in zip(state.segments, task.force_samples, strict=True):
        present = {each.source for each in segment.processes}
        new = [] if segment.static else list(_stated(task, state, segment, forces))
        new = [each for each in new if each.source not in present]
        segments.append(segment.disturbed((*segment.processes, *new)) if new else segment)
    return replace(state, segments=tuple(segments))


def size_of(
    task: Task, state: FitState, segment: Segment, forces: Forces | None, source: Source
) -> Array | None:
    """Noise of what may be disturbed, the unit of its process, shape (p,); None: it is not in the
    segment.
    """
    if source in UNMODELLED_PARTS:
        if forces is None:
            return None
        arm = 1.0 if source == next(iter(UNMODELLED_PARTS)) else task.experiment.robot.size
        return np.full(3, arm * float(np.median(forces.sigma)))
    owner, name = source
    sigmas = {each.source: each.sigma for each in segment.readings}
    if forces is not None:
        sigmas |= {(forces.name, q): float(forces.sigma[p.start]) for q, p in forces.places.items()}
    if source not in sigmas:
        return None
    width = task.experiment.instruments[owner].quantity(name, task.experiment.robot.m).size
    return np.full(width, sigmas[source] * state.factors.get(source, 1.0))


def _disturbances(experiment: Experiment) -> Iterator[tuple[Source, Disturbance]]:
    """All that are stated, of the unmodelled wrench and of every quantity."""
    unmodelled = experiment.surroundings.unmodelled
    if isinstance(unmodelled, UnmodelledForm):
        for source, level in zip(
            UNMODELLED_PARTS, (unmodelled.force, unmodelled.torque), strict=True
        ):
            yield source, Disturbance("colored", level, unmodelled.time)
    for name, instrument in experiment.instruments.items():
        for quantity in instrument.quantities(experiment.robot.m):
            for each in quantity.disturbed:
                yield (name, quantity.name), each


def _stated(
    task: Task, state: FitState, segment: Segment, forces: Forces | None
) -> Iterator[Process]:
    """Of one segment."""
    instruments, settings = task.experiment.instruments, task.settings.motion
    for source, each in _disturbances(task.experiment):
        noise = size_of(task, state, segment, forces, source)
        if noise is None:
            continue
        for process in _process(source, each, noise, segment, settings):
            if not each.vertical:
                yield process
                continue
            up = task.experiment.robot.up
            share = _shares_of_heading(segment, instruments[source[0]], up)
            yield replace(process, sizes=process.sizes * share)
    unmodelled = task.experiment.surroundings.unmodelled
    if forces is None or isinstance(unmodelled, UnmodelledForm):
        return
    if task.experiment.moves_within(segment.run):
        yield from _moving_within(task, state, segment, forces)


def _moving_within(
    task: Task, state: FitState, segment: Segment, forces: Forces
) -> Iterator[Process]:
    """What a load in which something moves pulls beside what answers accelerations at once: as much
    as the data show, across gravity more than along it.
    """
    gravity = task.experiment.robot.gravity
    along = (gravity / np.linalg.norm(gravity)) ** 2
    stated = Disturbance("colored", None, _SWINGS)
    for source, part in UNMODELLED_PARTS.items():
        noise = size_of(task, state, segment, forces, source)
        assert noise is not None
        for process in _process(source, stated, noise, segment, task.settings.motion):
            if part.start == 0:
                sizes = process.sizes * np.sqrt(1 - (1 - _ALONG_GRAVITY**2) * along)
                process = replace(process, sizes=sizes, upright=True)
            yield process


def _process(
    source: Source,
    stated: Disturbance,
    noise: Array,
    segment: Segment,
    settings: MotionSettings = MOTION,
) -> Iterator[Process]:
    """One process; none where it is stated that there is none, or nothing makes it.

    Args:
        source: What it disturbs.
        stated: Of it.
        noise: 1-sigma of the readings, where its level is to be found, shape (p,).
        segment: Along which it goes.
        settings: Bounds of correlation times.
    """
    if stated.level == 0:
        return
    level, time = stated.level, stated.time
    start, end = segment.span
    if stated.cause == "drift":
        time = _AS_LONG * (end - start)
        # So that it grows by the stated square per second.
        level = None if level is None else level * np.sqrt(time / 2)
    elif stated.cause == "reacquired":
        lost = _losses(segment, source, settings)
        if not lost:
            return
        time = (end - start) / (lost + 1)
    sizes = noise if level is None else np.full(len(noise), level)
    yield Process(
        named(source, stated.cause),
        sizes,
        1.0,
        float(time) if time is not None else np.sqrt(settings.shortest_correlation * (end - start)),
        integrals_of(segment.knots),
        stated.cause,
        level_stated=level is not None,
        time_stated=time is not None,
    )


def _losses(segment: Segment, source: Source, settings: MotionSettings) -> int:
    """How often an instrument had no reading for a while."""
    times = [each.time for each in segment.readings if each.source == source]
    if not times or len(times[0]) < 2:
        return 0
    steps = np.diff(times[0])
    return int(np.sum(steps > max(settings.lost, 5 * float(np.median(steps)))))


def _shares_of_heading(segment: Segment, instrument: Instrument, up: Array) -> Array:
    """How much of a rotation about the vertical an orientation sees about each of its axes, rms
    along a segment, shape (3,).
    """
    local = segment.basis(np.linspace(*segment.span, 100))
    pose, *_ = motion_at(local, segment.coefficients)
    rotation = Rotation.from_quat(pose[:, [4, 5, 6, 3]]).as_matrix()
    vertical = (up @ rotation) @ instrument.mounting.rotation
    return np.asarray(np.maximum(np.sqrt(np.mean(vertical**2, axis=0)), _LEAST))
