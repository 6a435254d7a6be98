"""Every systematic error that the description of an experiment allows for."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from steelyard.experiment.model import Experiment
from steelyard.identification.model.calibration_parameters.further_loads import (
    apparent,
    apparent_loads,
    carried,
    further_loads,
)
from steelyard.identification.model.calibration_parameters.keys import DRAG, ROBOT
from steelyard.identification.model.calibration_parameters.of_instruments import (
    before_weighing,
    errors_of_clocks,
    errors_of_instruments,
    errors_within_clocks,
)
from steelyard.identification.model.calibration_parameters.surroundings import surroundings
from steelyard.identification.model.calibration_parameters.vector import (
    FRAME,
    CalibrationParameter,
    CalibrationParameters,
)
from steelyard.identification.weighing.tables import WeighedCells
from steelyard.identification.weighing.weighed_cells import weighed_cells
from steelyard.robot.covariance import POINTS

_DRAGGED = 0.5
"""Its mean and its 1-sigma: cables that swing, creep over rollers or are simulated without inertia
feel less than theory says."""


def gather(experiment: Experiment) -> CalibrationParameters:
    """Every systematic error that the description of an experiment allows for, exact ones too."""
    entries = (
        *errors_of_instruments(experiment),
        *errors_of_clocks(experiment),
        *errors_within_clocks(experiment),
        *_of_robot(experiment),
        *surroundings(experiment),
        *further_loads(experiment),
        *apparent_loads(experiment),
    )
    robot = experiment.robot
    found = CalibrationParameters(
        entries, robot.m, robot.covariance, carried(experiment), apparent(experiment)
    )
    if not experiment.weights:
        return found
    gravity = (ROBOT, "gravity", None)
    beforehand = before_weighing(experiment)
    beforehand[gravity] = robot.gravity, found.deviation[found.places[gravity]]
    return _with_weighed(found, weighed_cells(experiment, gravity, beforehand))


def _of_robot(experiment: Experiment) -> Iterator[CalibrationParameter]:
    """Errors of the robot file: where cables are fixed, gravity, and the inertia of the cables."""
    robot, uncertainty = experiment.robot, experiment.uncertainty
    deviations = {
        key: np.full(size, uncertainty.get(key, 0.0))
        for key, size in (("anchor", 3 * robot.m), ("attachment", 3 * robot.m), ("gravity", 3))
    }
    if robot.covariance is not None:
        calibrated = np.sqrt(np.maximum(np.diag(robot.covariance), 0.0) + FRAME**2)
        deviations |= zip(POINTS, np.split(calibrated, 2), strict=True)
    for key, unit, value in (
        ("anchor", "m", robot.anchors.ravel()),
        ("attachment", "m", robot.attachments.ravel()),
        ("gravity", "m/s^2", robot.gravity),
    ):
        yield CalibrationParameter(ROBOT, key, None, unit, np.array(value), deviations[key])
    drags = robot.m > 0 and bool(robot.cable.linear_density)
    share = np.full(1, _DRAGGED if drags else 0.0)
    yield CalibrationParameter(ROBOT, DRAG, None, "1", share, share)


def _with_weighed(found: CalibrationParameters, weighed: WeighedCells) -> CalibrationParameters:
    """The same with what dead weights tell in place of what was known before; an offset that was
    another in each run is of no use in others.
    """
    told = weighed.of([place for place in weighed.places if place in found.places])
    values = told.each
    entries = tuple(
        replace(u, mean=values[key][0], deviation=values[key][1])
        if (key := u.full_key) in values
        else u
        for u in found.entries
    )
    return replace(found, entries=entries, weighed=told)
