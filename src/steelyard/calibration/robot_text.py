"""The robot file of a calibration, each point with its 1-sigma."""

from __future__ import annotations

import re

from steelyard.arrays import Array
from steelyard.calibration.calibrate import GeometryCalibration
from steelyard.robot.covariance import POINTS
from steelyard.robot.file import robot_file
from steelyard.yaml_file import to_yaml

COVARIANCE = "robot.covariance.csv"
"""Table that the robot file names."""
_DIGITS = 7
"""Of a coordinate [m]: a tenth of a micrometre."""


def robot_text(found: GeometryCalibration) -> str:
    """The robot file as found, each point with its 1-sigma in a comment."""
    values = robot_file(found.robot)
    for cable in values["cables"]:
        for key in POINTS:
            cable[key] = [round(v, _DIGITS) for v in cable[key]]
    values["covariance"] = COVARIANCE
    lines: list[str] = []
    counts = dict.fromkeys(POINTS, 0)
    for line in to_yaml(values).splitlines():
        point = next((each for each in POINTS if re.match(rf"\s*(- )?{each}:", line)), None)
        if point is None:
            lines.append(line)
            continue
        i = counts[point]
        counts[point] += 1
        said = _said(found.deviations[point][i], found.told[point][i])
        lines.append(f"{line}  # {said}")
    experiment = found.experiment.name
    head = [
        f"# Calibrated from '{' '.join(experiment.split())}' by 'steelyard calibrate'.",
        *(f"# Gauge: {gauge}." for gauge in found.gauges.values()),
    ]
    return "\n".join([*head, *lines]) + "\n"


def _said(sigma: Array, told: Array) -> str:
    """1-sigma of a point in words."""
    parts = [
        f"{1000 * s:.2g}" if known else "not told" for s, known in zip(sigma, told, strict=True)
    ]
    return f"1-sigma {', '.join(parts)} mm"
