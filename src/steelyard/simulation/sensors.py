"""Virtual sensors: the instruments of the paper, ideal ones, or those of a file."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from steelyard.errors import InputError, WrongValueError
from steelyard.experiment.checks import check_instruments
from steelyard.files.document import YamlDocument, require_printable
from steelyard.files.file_model import FileModel, validate
from steelyard.files.yaml_file import read_yaml
from steelyard.instruments import AnyInstrument, Instrument
from steelyard.instruments.base import exact, is_absent, sigma
from steelyard.robot.model import Robot


class SensorsForm(FileModel):
    """A file of sensors to simulate."""

    instruments: dict[str, AnyInstrument] = Field(min_length=1)
    sync: Annotated[float, Field(ge=0)] = 0.0
    """1-sigma of every clock against the one of the forces [s]."""


CALIBRATION_SENSORS = "calibration"
"""Name of the sensors that a calibration needs."""
SWING_SENSORS = "swings"
"""Name of the sensors that free swings need."""


@dataclass(frozen=True)
class Sensors:
    """Instruments to simulate."""

    instruments: Mapping[str, Instrument]
    """With rate, noise and calibration; each error is drawn with its sigma."""


def _mounted(robot: Robot) -> tuple[list[float], list[float]]:
    """Where an IMU and a tracker's target might sit on a platform [m]."""
    corners = robot.attachments if robot.m else np.array([[-0.05] * 3, [0.05] * 3])
    low, size = corners.min(axis=0), np.ptp(corners, axis=0)
    return (
        np.round(low + size * [0.55, 0.46, 0.3], 3).tolist(),
        np.round(low + size * [0.6, 0.7, 1.1], 3).tolist(),
    )


def _suite(robot: Robot, sync: float, values: Mapping[str, Mapping[str, Any]]) -> Sensors:
    """Instruments of the paper with given rates, noise and calibration."""
    imu, target = _mounted(robot)
    forces = (
        {"cables": {"kind": "tension", **values["tension"]}}
        if robot.m
        else {"sensor": {"kind": "wrench", "clock": "recorder", "rate": values["tension"]["rate"]}}
    )
    document = YamlDocument(
        Path("sensors"),
        {
            "sync": sync,
            "instruments": {
                **forces,
                "imu": {"kind": "imu", "position": imu, **values["imu"]},
                "tracker": {"kind": "position", "target": target, **values["position"]},
                "command": {"kind": "command", **values["command"]},
            },
        },
        {},
    )
    return sensors_of(document, robot)


def paper_sensors(robot: Robot) -> Sensors:
    """The sensors of the paper, with errors of the size that its discussion and the data sheets
    suggest.
    """
    return _suite(
        robot,
        0.012,
        {
            "tension": {
                "clock": "recorder",
                "rate": 25.0,
                "noise": 5.0,
                "calibration": {"offset": 5.0, "gain": 0.0, "common_gain": 0.0},
            },
            "imu": {
                "clock": "recorder",
                "rate": 25.0,
                "noise": {
                    "angular_velocity": float(np.radians(0.1)),
                    "specific_force": 0.03,
                    "orientation": float(np.radians(0.2)),
                },
                "calibration": {
                    "gyro_bias": float(np.radians(0.3)),
                    "accelerometer_bias": 0.05,
                    "position": 0.0,
                    "misalignment": float(np.radians(0.6)),
                    "reference": 0.0,
                },
            },
            "position": {
                "rate": 238.0,
                "noise": 0.0005,
                "calibration": {"target": 0.0, "frame": {"position": 0.0, "rotation": 0.0}},
            },
            "command": {"rate": 833.0},
        },
    )


def ideal_sensors(robot: Robot) -> Sensors:
    """The same instruments at 250 Hz without any error."""
    none = {"position": 0.0, "rotation": 0.0}
    return _suite(
        robot,
        0.0,
        {
            "tension": {
                "clock": "recorder",
                "rate": 250.0,
                "calibration": {"offset": 0.0, "gain": 0.0, "common_gain": 0.0},
            },
            "imu": {
                "clock": "recorder",
                "rate": 250.0,
                "calibration": dict.fromkeys(
                    ("gyro_bias", "accelerometer_bias", "position", "misalignment", "reference"),
                    0.0,
                ),
            },
            "position": {"rate": 250.0, "calibration": {"target": 0.0, "frame": none}},
            "command": {"rate": 250.0},
        },
    )


def calibration_sensors() -> Sensors:
    """A tracker and the winches' encoders, as a calibration needs them."""
    none = {"position": 0.0, "rotation": 0.0}
    instruments = {
        "tracker": {
            "kind": "position",
            "target": (0.0, 0.0, 0.0),
            "rate": 25.0,
            "noise": 0.0005,
            "calibration": {"target": 0.1, "frame": none},
        },
        "lengths": {"kind": "length", "rate": 25.0, "noise": 0.0005},
    }
    form = SensorsForm.model_validate({"instruments": instruments})
    return Sensors(form.instruments)


def swing_sensors() -> Sensors:
    """Motion capture, as free swings need it."""
    instruments = {
        "pose": {
            "kind": "pose",
            "rate": 100.0,
            "noise": {"position": 0.0003, "rotation": 0.0005},
            "calibration": {
                "misalignment": 0.003,
                "target": 0.002,
                "frame": {"position": 0.005, "rotation": 0.003},
            },
        },
    }
    return Sensors(SensorsForm.model_validate({"instruments": instruments}).instruments)


def read_sensors(which: str, robot: Robot) -> Sensors:
    """Sensors by name (``paper``, ``ideal``, ``calibration``, ``swings``) or from a file.

    Raises:
        InputError: No such name, or the file is wrong.
    """
    if not isinstance(which, str | os.PathLike):
        raise WrongValueError(
            "--sensors: expected Sensors, a name or the path of a YAML file, found"
            f" {type(which).__name__}; correct it"
        )
    which = os.fspath(which)
    if which == "paper":
        return paper_sensors(robot)
    if which == "ideal":
        return ideal_sensors(robot)
    if which == CALIBRATION_SENSORS:
        return calibration_sensors()
    if which == SWING_SENSORS:
        return swing_sensors()
    if not which.endswith((".yaml", ".yml")):
        raise InputError(
            "--sensors: expected 'paper', 'ideal', 'calibration', 'swings' or the path of a YAML"
            f" file, found '{which}'; correct it"
        )
    document = read_yaml(Path(which))
    require_printable(document)
    return sensors_of(document, robot)


def sensors_of(document: YamlDocument, robot: Robot) -> Sensors:
    """The sensors of a document, with every systematic error stated.

    Raises:
        InputError: The document is wrong.
    """
    data, own_sync = _without_own_sync(document)
    form = validate(SensorsForm, document, data)
    if not any(i.is_force for i in form.instruments.values()):
        raise document.error(
            ("instruments",),
            "expected an instrument of kind 'tension' or 'wrench', found none; add one",
        )
    check_instruments(form.instruments, robot, document)
    for name, instrument in form.instruments.items():
        if instrument.tabular:
            raise document.error(
                ("instruments", name, "kind"),
                f"expected an instrument that records over time, found '{instrument.kind}', whose"
                " rows have none; leave it out and write its table by hand",
            )
        if instrument.rate is None:
            raise document.error(
                ("instruments", name),
                "expected the key 'rate', found it missing; add the samples per second",
            )
    return Sensors(_stated(form, own_sync, robot.m))


def _without_own_sync(document: YamlDocument) -> tuple[Any, dict[str, float]]:
    """The document without the ``sync`` of single instruments, which know nothing of simulation,
    and these [s].
    """
    data = document.data
    if not isinstance(data, dict) or not isinstance(data.get("instruments"), dict):
        return data, {}
    own: dict[str, float] = {}
    instruments = dict(data["instruments"])
    for name, keys in data["instruments"].items():
        if not isinstance(keys, dict) or "sync" not in keys:
            continue
        value = keys["sync"]
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        if not is_number or not 0 <= value < float("inf"):
            raise document.error(
                ("instruments", name, "sync"),
                f"expected a number at least 0, found {value}; correct it",
            )
        own[name] = float(value)
        instruments[name] = {key: keys[key] for key in keys if key != "sync"}
    return {**data, "instruments": instruments}, own


def _stated(form: SensorsForm, own_sync: Mapping[str, float], m: int) -> dict[str, Instrument]:
    """State every systematic error as it will be drawn, defaults too, so that the experiment file
    needs no guessing.

    What would be taken from data has none to be taken from, and is not drawn. The clock that
    defines the time has no error, the others have that of the synchronisation.
    """
    instruments: Mapping[str, Instrument] = form.instruments
    reference = next(i for i in instruments.values() if i.is_force)
    stated = {}
    for name, instrument in instruments.items():
        delay = instrument.calibration.delay
        if delay is None:
            same = instrument is reference or (
                instrument.clock is not None and instrument.clock == reference.clock
            )
            delay = sigma(0.0 if same else own_sync.get(name, form.sync))
        terms = {term.key for term in instrument.terms(m)}
        calibration: dict[str, Any] = {
            key: getattr(instrument.calibration, key)
            for key in instrument.calibration.model_fields_set
            if not any(each == key or each.startswith(f"{key}.") for each in terms)
        }
        for term in instrument.terms(m):
            if is_absent(term):
                continue
            put_nested(calibration, term.key, exact() if term.deviation is None else term.prior)
        calibration["delay"] = delay
        keys = {key: getattr(instrument, key) for key in instrument.model_fields_set}
        stated[name] = type(instrument).model_validate({**keys, "calibration": calibration})
    return stated


def put_nested(entry: dict[str, Any], key: str, value: Any) -> None:
    """Set a key whose parts stand between dots."""
    *path, last = key.split(".")
    for part in path:
        entry = entry.setdefault(part, {})
    entry[last] = value
