"""Poses to record at rest as files: a table for a controller, and what they promise."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from steelyard.calibration.geometry_calibration import GeometryCalibration
from steelyard.estimates.estimate import plain
from steelyard.excitation.poses.pose_design import PoseDesign
from steelyard.experiment.recording import Stream
from steelyard.experiment.write import write_stream
from steelyard.identification.model.calibration_parameters import as_tree
from steelyard.instruments import Command
from steelyard.output import write_json

FORMAT = "steelyard-poses/1"
POSES = "poses.csv"
RESULT = "poses.json"


def write_poses(design: PoseDesign, folder: str | Path) -> None:
    """Write the poses, one row each, and ``poses.json``.

    Args:
        design: What was found.
        folder: An empty folder that exists.
    """
    folder, poses = Path(folder), design.poses
    orientation = Rotation.from_euler("ZYX", poses[:, :2:-1]).as_matrix()
    values = {"position": poses[:, :3], "orientation": orientation}
    stream = Stream(np.arange(len(poses), dtype=np.float64), values, POSES)
    write_stream(stream, Command(kind="command"), 0, folder / POSES, timed=False)
    write_json(poses_dict(design), folder / RESULT)


def poses_dict(design: PoseDesign) -> dict[str, Any]:
    """A design in the shape of the contract; null where nothing is told."""
    predicted = design.predicted
    return {
        "format": FORMAT,
        "robot": design.experiment.robot.name,
        "experiment": design.experiment.name,
        "poses": [
            {"position": pose[:3].tolist(), "rpy_deg": np.degrees(pose[3:]).tolist()}
            for pose in design.poses
        ],
        "standard_deviation": _points(predicted),
        "calibration": plain(
            as_tree(
                predicted.experiment,
                predicted.found.parameters,
                predicted.found.calibration.values,
                predicted.found.deviations,
            )
        ),
        "gauge": [str(gauge) for gauge in predicted.gauges.values()],
        "unobservable": predicted.unobservable,
        "over_regular_grid": {f"{key}s": ratio for key, ratio in design.over_grid.items()} or None,
        "candidates": design.candidates,
        "tension_level": design.level,
        "seed": design.seed,
    }


def _points(predicted: GeometryCalibration) -> dict[str, Any]:
    """1-sigma of anchors and attachments [m]."""
    told = predicted.told
    return {
        f"{key}s": plain(np.where(told[key], sigma, np.nan))
        for key, sigma in predicted.deviations.items()
    }
