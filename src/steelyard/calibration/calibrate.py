"""The robot's own calibration: anchors, attachments, drums and sensors from poses at rest and from
recordings in motion.
"""

from __future__ import annotations

from steelyard.calibration.datum import check_datum
from steelyard.calibration.fit import Progress, fit_geometry
from steelyard.calibration.geometry_calibration import GeometryCalibration
from steelyard.calibration.settings import CALIBRATION, CalibrationSettings
from steelyard.experiment.given import GivenExperiment, experiment_of


def calibrate(
    experiment: GivenExperiment,
    progress: Progress = None,
    settings: CalibrationSettings = CALIBRATION,
) -> GeometryCalibration:
    """Find the geometry of a robot from poses at rest, recordings in motion, or both.

    Args:
        experiment: An experiment, or the path of its file, with runs in which lengths or tensions
            were read, and what tells how the platform stands or moves; its ``uncertainty`` says how
            far anchors and attachments may be off, its ``datum`` what the world frame is.
        progress: Is called with what is being done and the fraction that is done.
        settings: Levels.

    Raises:
        InputError: No run tells the geometry, there are too few readings for the unknowns, or the
            datum cannot define the world.
    """
    experiment = experiment_of(experiment, weighed=False)
    check_datum(experiment)
    return GeometryCalibration(fit_geometry(experiment, progress, settings), settings)
