"""Whether forces and accelerometer feel a vibration that the fitted motion does not follow.

Instruments of their own have nothing in common but the motion: where what is left of one goes with
what is left of the other, it is no noise but motion.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array
from steelyard.experiment.model import Experiment
from steelyard.identification.model.balance import Balance
from steelyard.identification.model.calibration_parameters import CalibrationValues
from steelyard.identification.model.looked_at import looked_at
from steelyard.identification.model.motion_segment import Reading, Segment
from steelyard.identification.model.reading_times import reference_clocks
from steelyard.identification.solve.settings import FIT, FitSettings


@dataclass(frozen=True)
class Coherence:
    """What is left of an accelerometer against what is left of the forces."""

    correlation: float
    """The largest at any lag; 0 where chance explains it."""
    lag: float
    """By how much the accelerometer is later than its clock is thought to be [s]."""
    instrument: str


def coherence(
    experiment: Experiment,
    segment: Segment,
    at: Balance,
    calibration: CalibrationValues,
    mass: float,
    settings: FitSettings = FIT,
) -> Coherence:
    """The accelerometer that goes best with the forces.

    Args:
        experiment: With its instruments.
        segment: With its motion.
        at: The balance of its forces.
        calibration: Values of the systematic errors.
        mass: Of the body [kg].
        settings: With what is coherent.
    """
    if segment.static or mass <= 0 or len(at.time) < 2:
        return Coherence(0.0, 0.0, "")
    found = Coherence(0.0, 0.0, "")
    force_samples = at.left_over[:, :3] / mass
    for reading in segment.readings:
        instrument = experiment.instruments[reading.source[0]]
        if reading.source[1] == "specific_force" and len(reading.time) > 1:
            R = instrument.mounting.rotation
            own = _largest(
                experiment, segment, reading, R, at.time, force_samples, calibration, settings
            )
            found = max(found, own, key=lambda each: each.correlation)
    return found


def _largest(
    experiment: Experiment,
    segment: Segment,
    reading: Reading,
    R_platform_instrument: Array,
    time: Array,
    force_samples: Array,
    calibration: CalibrationValues,
    settings: FitSettings,
) -> Coherence:
    """Largest correlation, at any lag, of the residuals of one accelerometer with those of the
    forces.
    """
    references = reference_clocks(experiment, calibration.calibration_parameters, segment)
    times, *_, linear = looked_at(
        experiment, segment, reading, slice(None), calibration, references
    )
    left = np.nan_to_num(linear["residual"]) @ R_platform_instrument.T
    step = float(np.median(np.diff(times)))
    largest, best = 0.0, 0.0
    for lag in np.arange(-settings.coherence_lag, settings.coherence_lag, max(step / 2, 1e-3)):
        moved = np.column_stack([np.interp(time + lag, times, column) for column in left.T])
        norm = float(np.sqrt(np.sum(moved**2) * np.sum(force_samples**2)))
        correlation = float(np.sum(moved * force_samples)) / max(norm, 1e-300)
        if correlation > largest:
            largest, best = correlation, float(lag)
    chance = settings.coherence_chance / np.sqrt(min(len(times), len(time)))
    return Coherence(largest if largest > chance else 0.0, best, reading.source[0])
