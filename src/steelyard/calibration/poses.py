"""Poses at rest as a segment: what all instruments read in each of them, and where to begin."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from steelyard.arrays import Array
from steelyard.calibration.first_poses import UPRIGHT, first_poses
from steelyard.calibration.settings import CALIBRATION, CalibrationSettings
from steelyard.errors import InputError
from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run
from steelyard.identification.model.balance import Forces
from steelyard.identification.model.motion_segment import Reading, Segment
from steelyard.identification.model.settings import MOTION
from steelyard.identification.samples.force_samples import forces_of
from steelyard.instruments import Attitude

_FIRST_NOISE = 1e-3
"""1-sigma of readings whose noise is not stated, to begin with: the residuals tell it."""


def with_upright(experiment: Experiment, settings: CalibrationSettings = CALIBRATION) -> Experiment:
    """The experiment with a vague orientation in runs whose instruments do not tell one: the
    platform hangs upright, to about a radian.

    Args:
        experiment: With poses at rest.
        settings: How vague.
    """
    upright = Attitude.model_validate(
        {
            "kind": "attitude",
            "noise": settings.upright,
            "calibration": {"misalignment": 0.0, "reference": 0.0, "delay": 0.0},
        }
    )
    runs = []
    for run in experiment.runs:
        told = any("orientation" in each.values for each in run.streams.values())
        if run.static and not told:
            first = next(iter(run.streams.values()))
            n = len(first)
            stream = replace(first, values={"orientation": np.tile(np.eye(3), (n, 1, 1))})
            run = replace(run, streams={**run.streams, UPRIGHT: stream})
        runs.append(run)
    instruments = dict(experiment.instruments)
    if any(UPRIGHT in run.streams for run in runs):
        instruments[UPRIGHT] = upright
    return replace(experiment, instruments=instruments, runs=tuple(runs))


def segment_of(experiment: Experiment, run: Run) -> tuple[Segment, Mapping[str, Array]]:
    """The poses of a static run, with all readings of how the platform stands; and offsets of
    lengths to begin with, where nothing else than forces tells them.

    Args:
        experiment: With robot and instruments.
        run: Static.

    Raises:
        InputError: No instrument tells where the platform was, or streams have other numbers of
            rows.
    """
    counts = {name: len(each) for name, each in run.streams.items()}
    count = next(iter(counts.values()))
    if set(counts.values()) != {count}:
        raise InputError(
            f"run '{run.name}': expected a row for every pose in every stream, found"
            f" {', '.join(f'{n} of {name}' for name, n in counts.items())}; correct them"
        )
    tension = tensions(experiment, run, count)
    readings: list[Reading] = []
    for name, stream in run.streams.items():
        instrument = experiment.instruments[name]
        if not (instrument.is_motion or instrument.is_cable_motion) or instrument.commanded:
            continue
        for quantity in instrument.quantities(experiment.robot.m):
            values = stream.values.get(quantity.name)
            if values is None or quantity.name in {"angular_velocity", "specific_force"}:
                continue
            sigma = quantity.noise or MOTION.at_rest(quantity.unit) or _FIRST_NOISE
            flat = values.reshape(len(values), -1)
            use = np.isfinite(flat).any(axis=1)
            if quantity.rotation:
                use = np.isfinite(flat).all(axis=1)
            own = tension[use] if instrument.is_cable_motion else None
            numbers = np.arange(len(values), dtype=np.float64)[use]
            readings.append(Reading((name, quantity.name), numbers, values[use], sigma, own))
    pose, offsets = first_poses(experiment, run, readings, count)
    numbers = np.arange(count, dtype=np.float64)
    return Segment(run.name, numbers, tuple(readings), pose, static=True), offsets


def forces_at_rest(
    experiment: Experiment, run: Run, settings: CalibrationSettings
) -> Forces | None:
    """Tensions that were read in the poses of a run; None: there are none.

    Args:
        experiment: With the force instrument.
        run: Static.
        settings: Noise to begin with, where it is not stated.
    """
    name = experiment.force_instrument(run)
    if name is None or "tension" not in run.streams[name].values:
        return None
    m, values = experiment.robot.m, run.streams[name].values["tension"]
    there = np.abs(values[np.isfinite(values)])
    usual = float(np.median(there)) if there.size else 1.0
    noise = experiment.instruments[name].quantity("tension", m).noise
    sigma = np.full(m, noise or settings.force * usual)
    number = np.arange(len(values), dtype=np.float64)
    return forces_of(experiment, name, number, {"tension": values}, sigma)


def tensions(experiment: Experiment, run: Run, count: int) -> Array:
    """Of the cables at the platform [N], as read, else their share of the weight, shape (n, m): how
    far they stretch and sag.
    """
    robot = experiment.robot
    name = experiment.force_instrument(run)
    mass = experiment.known["mass"][0] if "mass" in experiment.known else None
    if mass is None:
        mass = robot.platform.mass if robot.platform is not None else 1.0
    share = mass * float(np.linalg.norm(robot.gravity)) / max(1, robot.m)
    found = np.full((count, robot.m), share)
    if name is not None and "tension" in run.streams[name].values:
        read = run.streams[name].values["tension"][:count]
        found = np.where(np.isfinite(read) & (read > 0), read, found)
    return found
