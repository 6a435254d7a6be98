"""What is fitted where the motion alone is: which calibration parameters its readings tell, and
whose noise is stated.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from steelyard.estimates.estimate import plausible_radius
from steelyard.experiment.model import Experiment
from steelyard.identification.known_body import plausible
from steelyard.identification.model.calibration_parameters import (
    ROBOT,
    CalibrationParameters,
    clock_of,
)
from steelyard.identification.model.motion_segment import AT_REST, Segment
from steelyard.identification.model.sources import Source
from steelyard.identification.solve.beginning.readings import Readings
from steelyard.identification.solve.fit_state import Task
from steelyard.inertia import TEN


def motion_task(readings: Readings) -> Task:
    """The fit of the motion to its instruments alone."""
    experiment, segments = readings.experiment, readings.segments
    parameters = readings.calibration.calibration_parameters
    least = {
        (name, quantity + rest): value
        for each in readings.records
        for (name, quantity), value in each.least.items()
        for rest in ("", AT_REST)
    }
    return Task(
        experiment,
        parameters,
        (None,) * len(segments),
        read_by(experiment, parameters, segments),
        stated_noise(experiment),
        plausible(np.ones(TEN), plausible_radius(experiment.robot)),
        least=least,
        settings=readings.settings,
    )


def read_by(
    experiment: Experiment,
    calibration_parameters: CalibrationParameters,
    segments: Sequence[Segment],
) -> NDArray[np.bool_]:
    """Calibration parameters that act on the readings of the motion and are not known exactly,
    shape (u,).

    Args:
        experiment: With its instruments.
        calibration_parameters: All there are.
        segments: With the readings.
    """
    active = np.zeros(len(calibration_parameters), dtype=bool)
    for segment in segments:
        for reading in segment.readings:
            name = reading.source[0]
            if experiment.instruments[name].is_cable_motion:
                for key in ("anchor", "attachment"):
                    active[calibration_parameters.places[ROBOT, key, None]] = True
            for term in experiment.instruments[name].terms(calibration_parameters.m):
                active[calibration_parameters.place(name, term.key, segment.run)] = True
            if not segment.static:
                active[
                    calibration_parameters.place(clock_of(experiment, name), "delay", segment.run)
                ] = True
                if latency := calibration_parameters.place_of_latency(name):
                    active[latency] = True
    active[calibration_parameters.places[ROBOT, "gravity", None]] = True
    timed = ~untimed(experiment, calibration_parameters, segments)
    return active & (calibration_parameters.deviation > 0) & timed


def untimed(
    experiment: Experiment,
    calibration_parameters: CalibrationParameters,
    segments: Sequence[Segment],
) -> NDArray[np.bool_]:
    """Delays of clocks by which nothing moves, as that of the encoders of locked winches, shape
    (u,): no reading tells them, and what is left of the readings would be taken for a delay.
    """
    timed: dict[tuple[str, str], bool] = {}
    for segment in segments:
        if segment.static:
            continue
        run = next(each for each in experiment.runs if each.name == segment.run)
        force = experiment.force_instrument(run)
        if force is not None:
            timed[segment.run, clock_of(experiment, force)] = True
        for reading in segment.readings:
            place = segment.run, clock_of(experiment, reading.source[0])
            timed[place] = timed.get(place, False) or not reading.still
    found = np.zeros(len(calibration_parameters), dtype=bool)
    for (name, clock), moves in timed.items():
        if not moves:
            found[calibration_parameters.place(clock, "delay", name)] = True
    return found


def stated_noise(experiment: Experiment) -> frozenset[Source]:
    """Quantities whose noise is stated; that of a command that stands in for a measurement is no
    noise, and is not asked for either.

    Args:
        experiment: With its instruments.
    """
    return frozenset(
        (name, quantity.name + rest)
        for rest in ("", AT_REST)
        for name, instrument in experiment.instruments.items()
        for quantity in instrument.quantities(experiment.robot.m)
        if quantity.noise or instrument.commanded
    )
