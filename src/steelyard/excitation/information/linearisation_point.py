"""The values about which a planned run is linearised: instruments with rates and noise, systematic
errors, body and tension level.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run
from steelyard.identification.model.calibration_parameters import (
    CalibrationParameters,
    CalibrationValues,
    columns_of,
)
from steelyard.identification.solve.posterior import Posterior
from steelyard.inertia import TEN


class MotionReadings(NamedTuple):
    """Readings of the motion in one run."""

    instrument: str
    quantity: str
    sigma: float
    """1-sigma of a reading, in its unit."""
    rate: float
    """Readings a second [Hz]."""


class ForceReadings(NamedTuple):
    """Readings of the force instrument in one run."""

    instrument: str
    quantities: tuple[str, ...]
    sigma: Array
    """1-sigma of its numbers [N], [N m], shape (r,)."""
    rate: float
    """Readings a second [Hz]."""


@dataclass(frozen=True, eq=False)
class LinearisationPoint:
    """What is read in a run, and the values about which all is linearised."""

    experiment: Experiment
    run: Run
    calibration: CalibrationValues
    parameters: Array
    """The ten of the body, shape (10,)."""
    level: float
    """Tension near which the cables are held [N]."""
    motion_readings: tuple[MotionReadings, ...]
    force_readings: ForceReadings

    @classmethod
    def of(cls, joint: Posterior, run: Run, level: float) -> LinearisationPoint:
        """As an estimator had it when it fitted the noise-free recording."""
        state = joint.fit.state
        assert state.parameters is not None
        pairs = zip(state.segments, joint.force_samples, strict=True)
        segment, force_samples = next(each for each in pairs if each[0].run == run.name)
        motion_readings = []
        for each in segment.readings:
            factor = state.factors.get(segment.label(*each.source), 1.0)
            motion_readings.append(
                MotionReadings(*each.source, each.sigma * factor, _rate(each.time))
            )
        force_readings = ForceReadings(
            force_samples.name,
            tuple(force_samples.readings),
            force_samples.sigma,
            _rate(force_samples.time),
        )
        return cls(
            joint.experiment,
            run,
            state.calibration,
            state.parameters,
            level,
            tuple(motion_readings),
            force_readings,
        )


def _rate(time: Array) -> float:
    return (len(time) - 1) / float(time[-1] - time[0])


def border_columns(calibration_parameters: CalibrationParameters) -> NDArray[np.intp]:
    """Border parameter of each systematic error, after the ten of the body; -1: it is known
    exactly; shape (u,).
    """
    return columns_of(calibration_parameters.deviation > 0, TEN)


def prior_information(calibration_parameters: CalibrationParameters) -> Array:
    """Information on the border parameters before any reading: the priors of the systematic
    errors, shape (b, b).
    """
    uncertain = calibration_parameters.deviation > 0
    found = np.zeros((TEN + int(uncertain.sum()),) * 2)
    found[TEN:, TEN:] = calibration_parameters.precision[np.ix_(uncertain, uncertain)]
    return found
