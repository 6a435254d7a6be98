"""Calibration parameters in the shape of the contract."""

from __future__ import annotations

from typing import Any

from steelyard.arrays import Array
from steelyard.experiment.model import Experiment
from steelyard.identification.model.calibration_parameters.keys import ROBOT
from steelyard.identification.model.calibration_parameters.of_instruments import clock_of
from steelyard.identification.model.calibration_parameters.vector import (
    CalibrationParameter,
    CalibrationParameters,
)


def as_tree(
    experiment: Experiment,
    calibration_parameters: CalibrationParameters,
    values: Array,
    deviations: Array,
) -> dict[str, Any]:
    """Values with their 1-sigma in the shape of ``calibration`` in ``estimate.json``; errors known
    exactly are left out.
    """
    tree: dict[str, Any] = {}
    for unknown in calibration_parameters.entries:
        place = calibration_parameters.places[unknown.full_key]
        if unknown.owner == ROBOT or not unknown.deviation.any():
            continue
        single = len(unknown.mean) == 1
        pair = {
            "value": float(values[place][0]) if single else values[place],
            "standard_deviation": float(deviations[place][0]) if single else deviations[place],
        }
        for owner in instruments_of(experiment, unknown):
            *path, last = unknown.key.split(".")
            entry = tree.setdefault(owner, {})
            for part in path:
                entry = entry.setdefault(part, {})
            if unknown.run is None:
                entry[last] = pair
            else:
                entry.setdefault(last, {})[unknown.run] = pair
    return tree


def instruments_of(experiment: Experiment, unknown: CalibrationParameter) -> list[str]:
    """The instrument of an error; of a delay all that share the clock."""
    if unknown.key != "delay":
        return [unknown.owner]
    run = next(run for run in experiment.runs if run.name == unknown.run)
    return [name for name in run.streams if clock_of(experiment, name) == unknown.owner]
