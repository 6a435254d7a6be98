"""The folder of a calibration: robot file, covariance, all that was found, and the report."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from steelyard.calibration.geometry_calibration import GeometryCalibration
from steelyard.calibration.robot_text import COVARIANCE, robot_text
from steelyard.output import results_folder, write_file, write_json
from steelyard.provenance.record import origin, write_provenance
from steelyard.report.documents.calibration import calibration_document
from steelyard.report.write import write_document
from steelyard.robot.covariance import write_covariance

CALIBRATED = ("robot.yaml", "calibration.json")
"""What stands beside the covariance and the pages."""


def write_calibration(
    found: GeometryCalibration,
    folder: str | Path,
    *,
    force: bool = False,
    inputs: Sequence[Path] = (),
    command: Sequence[str] = (),
) -> Path:
    """Write the robot file, its covariance, ``calibration.json`` and the report; all or nothing.

    Args:
        found: As :func:`steelyard.calibrate` gives it.
        folder: New or empty.
        force: Whether to replace files of the same names.
        inputs: Files that it was made of, the experiment file first.
        command: Words after ``steelyard``, where it was made by a command.

    Returns:
        The path of the robot file.

    Raises:
        InputError: The folder cannot be written to, or has files.
    """
    home = inputs[0].parent if inputs else None
    with results_folder(Path(folder), force=force) as fresh:
        write_file(fresh / CALIBRATED[0], robot_text(found))
        write_covariance(found.covariance, found.robot.m, fresh / COVARIANCE)
        values = {**found.to_dict(), **({"provenance": origin(inputs, home)} if home else {})}
        write_json(values, fresh / CALIBRATED[1])
        write_document(calibration_document(found), fresh, "calibration")
        write_provenance(fresh, Path(folder), inputs, command)
    return Path(folder) / CALIBRATED[0]
