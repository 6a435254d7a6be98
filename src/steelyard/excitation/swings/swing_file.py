"""Free swings to record as files: where to go and how to push, and what they promise."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from steelyard.estimates.estimate import plain
from steelyard.estimates.per_mass import PER_MASS_PARAMETERS, PerMass
from steelyard.excitation.swings.candidate_swings import Swing
from steelyard.excitation.swings.swing_design import CableSet, SwingDesign
from steelyard.files.yaml_file import to_yaml
from steelyard.output import write_file, write_json
from steelyard.robot.file import robot_file

FORMAT = "steelyard-swings/1"
RESULT = "swings.json"
ROBOT = "robot.yaml"
"""The robot with the cables on which the platform hangs; `identify` of the swings wants it."""


def write_swings(design: SwingDesign, folder: str | Path) -> None:
    """Write ``swings.json`` and the robot file of the cables that stay.

    Args:
        design: What was found.
        folder: An empty folder that exists.
    """
    folder = Path(folder)
    write_file(folder / ROBOT, to_yaml(robot_file(design.experiment.robot)))
    write_json(swings_dict(design), folder / RESULT)


def swings_dict(design: SwingDesign) -> dict[str, Any]:
    """A design as plain values; null where nothing is told."""
    found = design.predicted.per_mass
    return {
        "format": FORMAT,
        "robot": design.experiment.robot.name,
        "experiment": design.experiment.name,
        "cables": list(design.cables),
        "duration": design.duration,
        "swings": [
            {**_swing(each), "standard_deviation": _deviation(step)}
            for each, step in zip(design.swings, design.best.steps, strict=True)
        ],
        "standard_deviation": None if found is None else _deviation(found),
        "sets": [_set(each) for each in design.sets],
        "candidates": design.candidates,
    }


def _swing(swing: Swing) -> dict[str, Any]:
    """Where, and how it is pushed."""
    return {
        "position": swing.pose[:3].tolist(),
        "rpy_deg": np.degrees(swing.pose[3:]).tolist(),
        "lengths": swing.modes.lengths.tolist(),
        "frequencies": swing.modes.frequencies.tolist(),
        "mode": None if swing.pushed is None else swing.pushed + 1,
        "push": swing.push,
        "amplitude": swing.amplitude,
        "least_tension": swing.least_tension,
    }


def _set(found: CableSet) -> dict[str, Any]:
    """What there is to compare of some of the cables."""
    return {
        "cables": list(found.cables),
        "swings": len(found.swings),
        "standard_deviation": _deviation(found.steps[-1]),
    }


def _deviation(found: PerMass) -> dict[str, Any]:
    """1-sigma of centre of gravity [m] and inertia over mass [m^2]."""
    return dict(zip(PER_MASS_PARAMETERS, plain(found.standard_deviation), strict=True))
