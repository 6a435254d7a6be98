"""When an instrument's samples belong to the motion of a segment, by their clocks, and whose time
that motion is told in.
"""

from __future__ import annotations

from collections.abc import Mapping

from steelyard.arrays import Array
from steelyard.experiment.model import Experiment
from steelyard.identification.model.calibration_parameters import (
    CalibrationParameters,
    CalibrationValues,
    clock_of,
)
from steelyard.identification.model.motion_segment import Segment
from steelyard.instruments.base import TIME_CONSTANT


def time_of(
    experiment: Experiment,
    segment: Segment,
    calibration: CalibrationValues,
    references: Mapping[str, str],
    name: str,
    time: Array,
) -> tuple[Array, slice, slice]:
    """Times of an instrument's samples within a segment [s], and where the delays of its clock and
    of the reference stand.

    The motion is told in the time of one of the clocks that it was recorded by.
    """
    calibration_parameters = calibration.calibration_parameters
    own = clock_of(experiment, name)
    reference = segment.reference or references.get(own, next(iter(references.values()), own))
    clock, origin = (
        calibration_parameters.place(each, "delay", segment.run) for each in (own, reference)
    )
    delay = (
        calibration.values[clock] - calibration.values[origin] + calibration_parameters.mean[origin]
    )
    places = calibration_parameters.places
    filtered = places.get(
        (name, TIME_CONSTANT, segment.run), places.get((name, TIME_CONSTANT, None))
    )
    # A filtered force says what was a while ago, and so does what comes over a slow link.
    for place in (filtered, calibration_parameters.place_of_latency(name)):
        if place is not None:
            delay = delay + calibration.values[place]
    return time - delay[0], clock, origin


def reference_clocks(
    experiment: Experiment, calibration_parameters: CalibrationParameters, segment: Segment
) -> dict[str, str]:
    """Clock -> clock whose time the motion is told in, the best known one of those that can be
    compared.

    Motion and all clocks moved together read the same. Without a reference the knots, which stay,
    would seem to tell the time.
    """
    if segment.static:
        return {}
    if segment.reference is not None:
        # Where forces feel all of the motion, they tell its time.
        return {
            clock_of(experiment, reading.source[0]): segment.reference
            for reading in segment.readings
        }
    rotating, moving = dict[str, None](), dict[str, str]()
    for name, quantity in (reading.source for reading in segment.readings):
        clock = clock_of(experiment, name)
        instrument = experiment.instruments[name]
        if instrument.quantity(quantity, experiment.robot.m).determines == ("position",):
            moving[name] = clock
        else:
            rotating[clock] = None
    # Place and acceleration are compared, and attitude with both; one of them alone fits any
    # attitude.
    alone = len(moving) == 1 and not rotating.keys() & set(moving.values())
    groups = (
        [rotating.keys(), set(moving.values())]
        if alone
        else [dict.fromkeys([*rotating, *moving.values()]).keys()]
    )

    def known(clock: str) -> float:
        return float(
            calibration_parameters.deviation[
                calibration_parameters.place(clock, "delay", segment.run)
            ][0]
        )

    return {clock: min(group, key=known) for group in groups for clock in group}
