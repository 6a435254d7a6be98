"""Readings of the force instrument within a stretch of a run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run
from steelyard.identification.model.balance import UNMODELLED, Forces
from steelyard.identification.model.calibration_parameters import ROBOT
from steelyard.identification.model.processes import unresolved
from steelyard.identification.model.settings import MOTION, MotionSettings
from steelyard.identification.model.sources import Source
from steelyard.identification.samples.force_noise import force_sigma, least_sigma
from steelyard.identification.samples.motion_noise import LEAST_RAPID, rapid_scatter
from steelyard.identification.samples.prepared import Samples
from steelyard.robot.model import DIRECTIONS


def force_samples_of(
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
        time: By its clock, moved to the common event [s]; of poses at rest their number; shape
            (n,).
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


def with_unresolved(experiment: Experiment, forces: Forces, spacing: float) -> Forces:
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


def louder_forces(forces: Forces, settings: MotionSettings = MOTION) -> dict[str, float]:
    """Quantity -> by how much its readings scatter more than their noise from one sample to the
    next, as those of an amplifier that picks up a hum do; without those of which it is not much.

    Args:
        forces: Of a run in motion.
        settings: What is much.
    """
    found = {}
    for quantity, own in forces.places.items():
        kept = np.where(forces.left_out[:, own], np.nan, forces.readings[quantity])
        if len(kept) < LEAST_RAPID:
            continue
        factor = rapid_scatter(kept) / float(forces.sigma[own.start])
        if settings.humming <= factor <= settings.most_shaken:
            found[quantity] = factor
    return found


def least_forces(experiment: Experiment, run: Run) -> dict[Source, float]:
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
