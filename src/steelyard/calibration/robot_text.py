"""The robot file of a calibration, each point with its 1-sigma."""

from __future__ import annotations

import re

import numpy as np

from steelyard.arrays import Array
from steelyard.calibration.geometry_calibration import GeometryCalibration
from steelyard.files.yaml_file import to_yaml
from steelyard.robot.covariance import POINTS
from steelyard.robot.file import robot_file

COVARIANCE = "robot.covariance.csv"
"""Table that the robot file names."""
_AS_DESCRIBED = (
    "# The fit did not converge: this is the robot as it was described, nothing was found."
)
_DIGITS = 7
"""Of a coordinate [m]: a tenth of a micrometre."""


def robot_text(found: GeometryCalibration) -> str:
    """The robot file as found, each point with its 1-sigma in a comment."""
    values = robot_file(found.robot)
    for cable in values["cables"]:
        for key in POINTS:
            cable[key] = [round(v, _DIGITS) for v in cable[key]]
        if "pulley" in cable:
            cable["pulley"]["radius"] = round(cable["pulley"]["radius"], _DIGITS)
    if found.stiffness is not None:
        values["cable"]["axial_stiffness"] = float(f"{found.stiffness[0]:.7g}")
    values["covariance"] = COVARIANCE
    lines: list[str] = []
    counts = dict.fromkeys((*POINTS, "radius", "axis"), 0)
    for line in to_yaml(values).splitlines():
        point = next((each for each in POINTS if re.match(rf"\s*(- )?{each}:", line)), None)
        if point is None:
            lines.append(line + _beside(found, line, counts))
            continue
        i = counts[point]
        counts[point] += 1
        said = _said(found.deviations[point][i], found.told[point][i])
        lines.append(f"{line}  # {said}")
    experiment = found.experiment.name
    head = [
        f"# Calibrated from '{' '.join(experiment.split())}' by 'steelyard calibrate'.",
        *(f"# Gauge: {words}." for words in found.frames),
        *(() if found.arrived else (_AS_DESCRIBED,)),
    ]
    return "\n".join([*head, *lines]) + "\n"


def _beside(found: GeometryCalibration, line: str, counts: dict[str, int]) -> str:
    """1-sigma of radius and axis of a roller and of the stiffness of the cables, as a comment."""
    if re.match(r"\s*radius:", line):
        i = np.flatnonzero(found.robot.pulley_radius)[counts["radius"]]
        counts["radius"] += 1
        sigma = None if found.rollers is None else found.rollers[1][i]
        return (
            "  # not told"
            if sigma is None or np.isnan(sigma)
            else f"  # 1-sigma {1000 * sigma:.2g} mm"
        )
    if re.match(r"\s*axis:", line):
        i = np.flatnonzero(found.robot.pulley_radius)[counts["axis"]]
        counts["axis"] += 1
        lean = np.full(2, np.nan) if found.roller_axes is None else found.roller_axes[1][i]
        if np.isnan(lean).any():
            return "  # not told"
        said = ", ".join(f"{each:.2g}" for each in np.degrees(lean))
        return f"  # 1-sigma {said} deg"
    if "axial_stiffness:" in line:
        told = found.stiffness
        said = "not told" if told is None else f"1-sigma {told[1]:.2g} N"
        return f"  # axial stiffness: {said}"
    return ""


def _said(sigma: Array, told: Array) -> str:
    """1-sigma of a point in words."""
    parts = [
        f"{1000 * s:.2g}" if known else "not told" for s, known in zip(sigma, told, strict=True)
    ]
    return f"1-sigma {', '.join(parts)} mm"
