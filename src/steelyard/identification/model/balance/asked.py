"""By which parameters of robot and surroundings the balance is to have derivatives."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from steelyard.experiment.model import Experiment
from steelyard.identification.model.border import has_column
from steelyard.identification.model.calibration_parameters import (
    AIR,
    ATTACHED,
    DRAG,
    ROBOT,
    SWIVEL,
    CalibrationValues,
    hose_keys,
)

_GEOMETRY = (("anchor", "anchor"), ("attachment", "attachment"))


def pulling(
    experiment: Experiment, calibration: CalibrationValues, run: str
) -> dict[str, list[slice]]:
    """What pulls at the platform beside cables and body -> where what is known of it stands, as it
    acts in a run.
    """
    parameters, m = calibration.calibration_parameters, experiment.robot.m
    parts = {"hoses": [key for key, _ in hose_keys(parameters)]}
    if m:
        parts["attached"], parts["air"] = ([key for key, _ in each] for each in (ATTACHED, AIR))
        parts["swivel"] = [SWIVEL] if calibration.swivel().size else []
    return {name: [parameters.place(ROBOT, k, run) for k in keys] for name, keys in parts.items()}


def derivatives_asked(
    experiment: Experiment, calibration: CalibrationValues, run: str, column_of: NDArray[np.intp]
) -> Iterator[str]:
    """By what the balance is to have derivatives beside the motion, see
    :func:`.derivatives_of_balance`.
    """
    parameters = calibration.calibration_parameters
    yield "parameters"
    moves = parameters.place_of_apparent(run)
    if moves is not None and has_column(column_of, moves):
        yield "weight"
    for key, error in (("drag", DRAG), ("gravity", "gravity"), *_GEOMETRY):
        place = parameters.places.get((ROBOT, error, None))
        if place is not None and has_column(column_of, place):
            yield key
    for name, places in pulling(experiment, calibration, run).items():
        if any(has_column(column_of, place) for place in places):
            yield name
