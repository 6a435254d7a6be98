"""A recording of the public benchmark as files that steelyard reads."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
from recording import Array, read_description

from steelyard.experiment.read import read_experiment
from steelyard.identification.identify import identify

_RECORDER = {"clock": "recorder"}


def _robot(about: dict[str, Any], *, cables: bool) -> dict[str, Any]:
    pairs = zip(about["anchors"], about["attachments"], strict=True) if cables else ()
    cable = {key: about[key] for key in ("axial_stiffness", "linear_density") if key in about}
    roller = {"radius": about["roller_radius"]} if "roller_radius" in about else {}
    over = {"pulley": {**roller, "axis": [0, 0, 1]}} if roller else {}
    return {
        "name": about["robot"],
        "gravity": about["gravity"],
        "cables": [{"anchor": a, "attachment": b, **over} for a, b in pairs],
        **({"cable": {"diameter": 0.003, **cable}} if cables else {}),
    }


def _imu(sigma: dict[str, Any], **exact: float) -> dict[str, Any]:
    noise = {key: sigma[key] for key in ("angular_velocity", "specific_force", "orientation")}
    stated = {
        "gyro_bias": sigma["gyro_bias"],
        "accelerometer_bias": sigma["accelerometer_bias"],
        "misalignment": sigma["misalignment"],
        "reference": sigma["reference"],
        "position": sigma["imu_position"],
    }
    return {"kind": "imu", **_RECORDER, "noise": noise, "calibration": {**stated, **exact}}


def full(about: dict[str, Any], folder: Path) -> dict[str, Any]:
    """The raw streams, each on its own clock."""
    sigma = about["sigma"]
    frame = {"position": sigma["frame_position"], "rotation": sigma["frame_rotation"]}
    cells = {key: sigma[key] for key in ("offset", "gain", "common_gain")}
    return {
        "uncertainty": {"anchor": sigma["geometry"], "attachment": sigma["geometry"], "gravity": 0},
        "instruments": {
            "cables": {
                "kind": "tension",
                **_RECORDER,
                "noise": sigma["tension"],
                "end": about["force_cells"],
                "calibration": cells,
            },
            "imu": {**_imu(sigma), "position": about["imu_position"]},
            "tracker": {
                "kind": "position",
                "target": about["target"],
                "noise": sigma["tracker"],
                "calibration": {"target": sigma["target"], "frame": frame, "delay": sigma["delay"]},
            },
        },
        "runs": [
            {
                "name": "run",
                **{name: str(folder / f"{name}.csv") for name in ("cables", "imu", "tracker")},
                "sync": about["sync"],
            }
        ],
    }


def friendlier(about: dict[str, Any], folder: Path) -> dict[str, Any]:
    """The friendlier version: a body on a wrench sensor, all on one clock."""
    sigma = about["sigma"]
    none = {"position": 0, "rotation": 0}
    file = str(folder / "platform.csv")
    # Offsets of all cells together, and what they make of torques.
    m, arm = len(about["anchors"]), float(np.abs(about["attachments"]).max())
    offset = sigma["offset"] * float(np.sqrt(m))
    return {
        "uncertainty": {"anchor": 0, "attachment": 0, "gravity": 0},
        "instruments": {
            "sensor": {
                "kind": "wrench",
                **_RECORDER,
                "calibration": {"offset": {"force": offset, "torque": offset * arm}},
            },
            "imu": _imu(sigma, misalignment=0, reference=0, position=0),
            "tracker": {
                "kind": "position",
                **_RECORDER,
                "noise": sigma["tracker"],
                "calibration": {"target": 0, "frame": none},
            },
        },
        "runs": [{"name": "run", "sensor": file, "imu": file, "tracker": file}],
    }


def written(folder: Path, scratch: Path, *, wrench: bool = False) -> Path:
    """The experiment file of a recording, written into an empty folder with all that it names;
    arguments as of :func:`identified`.
    """
    about = read_description(folder)
    own = scratch / "recording"
    own.mkdir()
    for file in folder.glob("*.csv"):
        shutil.copy(file, own / file.name)
    made = (friendlier if wrench else full)(about, Path("recording"))
    # JSON is YAML.
    robot = json.dumps(_robot(about, cables=not wrench))
    (scratch / "robot.yaml").write_text(robot, encoding="utf-8")
    document = {"format": "steelyard/1", "name": about["recording"], "robot": "robot.yaml", **made}
    (scratch / "experiment.yaml").write_text(json.dumps(document), encoding="utf-8")
    return scratch / "experiment.yaml"


def identified(folder: Path, method: str, scratch: Path, *, wrench: bool = False) -> dict[str, Any]:
    """The result of one of steelyard's methods.

    Args:
        folder: Of the recording.
        method: Name.
        scratch: Empty folder for its files.
        wrench: Whether to take the friendlier version.
    """
    experiment = read_experiment(written(folder, scratch, wrench=wrench))
    estimate = identify(experiment, [method]).estimate
    value, covariance = np.array(estimate.value), np.array(estimate.covariance)
    return {
        "value": value,
        "covariance": _nulls(value, covariance),
        "accepted": estimate.verdict.accepted,
    }


def _nulls(value: Array, covariance: Array) -> Array:
    """What has no value has no covariance."""
    known = np.isfinite(value)
    return np.where(known[:, None] & known, covariance, np.nan)
