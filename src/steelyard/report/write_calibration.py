"""The folder of a calibration: robot file, covariance, all that was found, and the report."""

from __future__ import annotations

from pathlib import Path

from steelyard.calibration.calibrate import GeometryCalibration
from steelyard.calibration.robot_text import COVARIANCE, robot_text
from steelyard.output import results_folder, write_file, write_json
from steelyard.report.documents.calibration import calibration_document
from steelyard.report.write import write_document
from steelyard.robot.covariance import write_covariance

CALIBRATED = ("robot.yaml", "calibration.json")
"""What stands beside the covariance and the pages."""


def write_calibration(
    found: GeometryCalibration, folder: str | Path, *, force: bool = False
) -> Path:
    """Write the robot file, its covariance, ``calibration.json`` and the report; all or nothing.

    Args:
        found: As :func:`steelyard.calibrate` gives it.
        folder: New or empty.
        force: Whether to replace files of the same names.

    Returns:
        The path of the robot file.

    Raises:
        InputError: The folder cannot be written to, or has files.
    """
    with results_folder(Path(folder), force=force) as fresh:
        write_file(fresh / CALIBRATED[0], robot_text(found))
        write_covariance(found.covariance, found.robot.m, fresh / COVARIANCE)
        write_json(found.to_dict(), fresh / CALIBRATED[1])
        write_document(calibration_document(found), fresh, "calibration")
    return Path(folder) / CALIBRATED[0]
