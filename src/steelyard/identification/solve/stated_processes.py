"""Disturbances that are stated: coloured noise, drifts and shifts of instruments, an unmodelled wrench
on the platform.

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
from steelyard.identification.model.motion_residuals import Segment
from steelyard.identification.model.processes import (
    Process,
    SplineIntegrals,
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
"""Correlation time of a drift in lengths of its segment: within it, it grows as a random walk does."""
_LEAST = 0.05
"""Part of a heading that any axis of an orientation may have, so that none is exact."""


def denied(experiment: Experiment) -> frozenset[Source]:
    """What is stated not to be there, and is not asked for either."""
    found = set(UNMODELLED_PARTS) if experiment.surroundings.unmodelled == 0.0 else set()
    for name, instrument in experiment.instruments.items():
        for quantity in instrument.quantities(experiment.robot.m):
            for each in quantity.disturbed:
                if each.cause == "colored" and each.level == 0:
                    found.add((name, quantity.name))
    return frozenset(found)


def with_stated(task: Task, state: FitState) -> FitState:
    """A state with the disturbances that are stated; those that it has stay as they are."""
    segments = []
    for segment, forces in zip(state.segments, task.force_samples, strict=True):
        present = {each.source for each in segment.processes}
        new = [] if segment.static else list(_stated(task, state, segment, forces))
        new = [each for each in new if each.source not in present]
        segments.append(segment.disturbed((*segment.processes, *new)) if new else segment)
    return replace(state, segments=tuple(segments))


def _stated(
    task: Task, state: FitState, segment: Segment, forces: Forces | None
) -> Iterator[Process]:
    """Of one segment."""
    integrals = integrals_of(segment.knots)
    experiment, settings = task.experiment, task.settings.motion
    unmodelled = experiment.surroundings.unmodelled
    if isinstance(unmodelled, UnmodelledForm) and forces is not None:
        usual = float(np.median(forces.sigma))
        arms = (1.0, experiment.robot.size)
        levels = (unmodelled.force, unmodelled.torque)
        for source, level, arm in zip(UNMODELLED_PARTS, levels, arms, strict=True):
            own = Disturbance("colored", level, unmodelled.time)
            yield from _process(source, own, np.full(3, arm * usual), integrals, segment, settings)
    sigmas = {each.source: each.sigma for each in segment.readings}
    if forces is not None:
        ends = np.cumsum([0, *(v.shape[1] for v in forces.readings.values())])
        sigmas |= {
            (forces.name, q): float(forces.sigma[i])
            for q, i in zip(forces.readings, ends, strict=False)
        }
    for source, sigma in sigmas.items():
        instrument = experiment.instruments[source[0]]
        quantity = instrument.quantity(source[1], experiment.robot.m)
        size = np.full(quantity.size, sigma * state.factors.get(source, 1.0))
        for each in quantity.disturbed:
            for process in _process(source, each, size, integrals, segment, settings):
                share = _shares_of_heading(segment, instrument) if each.vertical else 1.0
                yield replace(process, sizes=process.sizes * share)


def _process(
    source: Source,
    stated: Disturbance,
    noise: Array,
    integrals: SplineIntegrals,
    segment: Segment,
    settings: MotionSettings = MOTION,
) -> Iterator[Process]:
    """One process; none where it is stated that there is none, or nothing makes it.

    Args:
        source: What it disturbs.
        stated: Of it.
        noise: 1-sigma of the readings, where its level is to be found, shape (p,).
        integrals: Of the segment's splines.
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
        integrals,
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


def _shares_of_heading(segment: Segment, instrument: Instrument) -> Array:
    """How much of a rotation about the vertical an orientation sees about each of its axes, rms along
    a segment, shape (3,).
    """
    local = segment.basis(np.linspace(*segment.span, 100))
    pose, *_ = motion_at(local, segment.coefficients)
    rotation = Rotation.from_quat(pose[:, [4, 5, 6, 3]]).as_matrix()
    vertical = rotation[:, 2] @ instrument.mounting.rotation
    return np.asarray(np.maximum(np.sqrt(np.mean(vertical**2, axis=0)), _LEAST))
