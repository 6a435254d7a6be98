"""The moving body at the times of force readings: what its wrench depends on."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from steelyard.arrays import Array
from steelyard.dynamics import platform_regressor
from steelyard.experiment.model import Experiment
from steelyard.identification.model.balance.equations import motion_and_wrench
from steelyard.identification.model.balance.force_readings import Forces
from steelyard.identification.model.calibration_parameters import (
    AIR,
    ATTACHED,
    CalibrationValues,
)
from steelyard.identification.model.motion_segment import Segment
from steelyard.identification.model.reading_times import reference_clocks, time_of
from steelyard.identification.model.segment import Basis, motion_at
from steelyard.inertia import TEN
from steelyard.instruments.base import TIME_CONSTANT


class MovingAt(NamedTuple):
    """The moving body at the times of force readings."""

    times: Array
    """Within the segment [s], of poses at rest their numbers, shape (n,)."""
    local: Basis
    """Spline functions there."""
    inputs: dict[str, Array | float]
    """See :func:`moving_body`."""
    parameters: Array
    """The ten of the first load, shape (10,)."""
    constant: float
    """Time constant of the filter of the forces [s]; 0: there is none. Below zero, on the way of a
    fit, forces are early by it and less smooth by what a filter of its size smooths: where late
    forces have both a latency and a filter, what is left over is nearly linear in what is smoothed,
    and a fit that may not go below nothing goes to and fro."""


def moving_at(
    experiment: Experiment,
    segment: Segment,
    force_samples: Forces,
    calibration: CalibrationValues,
    parameters: Array,
) -> MovingAt:
    """The moving body at the times of force readings; arguments as of :func:`balance_of`."""
    times = balance_times(experiment, segment, force_samples, calibration)
    local = segment.basis(times)
    inputs = moving_body(segment, local, calibration, parameters)
    constant = 0.0
    if force_samples.smoothed and not segment.static:
        constant = time_constant(experiment, segment, force_samples, calibration)
    return MovingAt(times, local, inputs, parameters, constant)


def time_constant(
    experiment: Experiment, segment: Segment, force_samples: Forces, calibration: CalibrationValues
) -> float:
    """Of the filter of a force instrument [s]."""
    instrument = experiment.instruments[force_samples.name]
    errors = calibration.of(force_samples.name, instrument, segment.run)
    return float(np.squeeze(errors.get(TIME_CONSTANT, 0.0)))


def balance_times(
    experiment: Experiment, segment: Segment, force_samples: Forces, calibration: CalibrationValues
) -> Array:
    """Times of force readings within a segment [s], of poses at rest their numbers, shape (n,)."""
    if segment.static:
        return force_samples.time
    references = reference_clocks(experiment, calibration.calibration_parameters, segment)
    name, time = force_samples.name, force_samples.time
    times, *_ = time_of(experiment, segment, calibration, references, name, time)
    return times


def moving_body(
    segment: Segment, local: Basis, calibration: CalibrationValues, parameters: Array
) -> dict[str, Array | float]:
    """What the wrench of the moving body depends on, as
    :func:`steelyard.identification.model.balance.equations.motion_and_wrench` takes it.

    Args:
        segment: With its motion.
        local: Spline functions at the times that are meant.
        calibration: Present values of the calibration parameters.
        parameters: The ten of the first load, shape (10,).
    """
    pose, rate, acceleration, _ = motion_at(local, segment.coefficients)
    apparent = calibration.apparent(segment.run)
    return {
        "pose": pose,
        "rate": rate,
        "acceleration": acceleration,
        "gravity": calibration.gravity,
        "parameters": calibration.body(parameters, segment.run) + apparent,
        # What answers accelerations otherwise weighs what it weighs.
        "weight": -apparent[0],
        "drag": 0.0 if segment.static else calibration.drag,
        "attached": calibration.of_robot(*ATTACHED),
        "air": calibration.of_robot(*AIR, run=segment.run),
        "hoses": calibration.hoses,
        "swivel": calibration.swivel(segment.run),
    }


def regressor_at(
    experiment: Experiment, segment: Segment, times: Array, calibration: CalibrationValues
) -> Array:
    """Regressor of the body along a motion, shape (n, 6, 10).

    Args:
        experiment: With its robot.
        segment: With its motion.
        times: Within the segment [s], shape (n,).
        calibration: Present values of the calibration parameters.
    """
    inputs = moving_body(segment, segment.basis(times), calibration, np.zeros(TEN))
    motion = motion_and_wrench(experiment.robot, *calibration.pulling)(**inputs)
    return platform_regressor(motion["specific_force"], motion["omega"], motion["alpha"])
