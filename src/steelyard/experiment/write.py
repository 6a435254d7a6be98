"""From an :class:`Experiment` to its file and its streams."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from steelyard.arrays import Array
from steelyard.experiment.form import FORMAT
from steelyard.experiment.model import Experiment, Stream
from steelyard.instruments import Instrument
from steelyard.robot.file import bundled_names, read_robot, robot_file


def write_experiment(experiment: Experiment, folder: Path) -> None:
    """Write ``experiment.yaml``, a CSV file per stream in a folder per run, and the robot file unless it is a bundled one.

    Args:
        experiment: What to write.
        folder: An empty folder that exists.
    """
    description = robot_file(experiment.robot)
    bundled = experiment.robot.name in bundled_names() and description == robot_file(read_robot(experiment.robot.name))
    if not bundled:
        write_yaml(description, folder / "robot.yaml")
    runs = []
    for i, run in enumerate(experiment.runs):
        place = run.name if re.fullmatch(r"\w[\w .\-]{0,100}", run.name) else f"run-{i + 1}"
        (folder / place).mkdir()
        entry: dict[str, Any] = {"name": run.name}
        if run.static:
            entry["static"] = True
        for name, stream in run.streams.items():
            file = f"{place}/{name}.csv"
            write_stream(stream, experiment.instruments[name], experiment.robot.m, folder / file, timed=not run.static)
            entry[name] = file
        if run.sync:
            entry["sync"] = dict(run.sync)
        if run.window:
            entry["window"] = list(run.window)
        runs.append(entry)
    values = {
        "format": FORMAT,
        "name": experiment.name,
        "robot": experiment.robot.name if bundled else "robot.yaml",
        **({"known": _known(experiment.known)} if experiment.known else {}),
        "uncertainty": dict(experiment.uncertainty),
        "instruments": {
            name: instrument.model_dump(mode="json", exclude_unset=True)
            for name, instrument in experiment.instruments.items()
        },
        "runs": runs,
    }
    write_yaml(values, folder / "experiment.yaml")


def _known(known: Mapping[str, tuple[float, float]]) -> dict[str, Any]:
    """Values known beforehand under the names of the file."""
    nested: dict[str, Any] = {}
    for name, (value, sigma) in known.items():
        entry = {"value": value, "sigma": sigma}
        if name == "mass":
            nested["mass"] = entry
        else:
            group = "center_of_gravity" if name.startswith("c") else "inertia"
            nested.setdefault(group, {})[name[1:]] = entry
    return nested


def write_yaml(values: Mapping[str, Any], path: Path) -> None:
    """Write plain values as YAML 1.2, lists of numbers in one line."""
    from ruamel.yaml import YAML

    yaml = YAML(typ="safe", pure=True)
    yaml.default_flow_style = None
    yaml.sort_base_mapping_type_on_output = False  # type: ignore[assignment]
    yaml.width = 120
    with path.open("w", encoding="utf-8", newline="\n") as file:
        yaml.dump(values, file)


def write_stream(stream: Stream, instrument: Instrument, m: int, path: Path, *, timed: bool = True) -> None:
    """Write a stream as CSV with the columns of its kind, full precision, empty cells where there is no sample."""
    import polars as pl

    columns: dict[str, Array] = {"t": stream.time} if timed else {}
    for quantity in instrument.quantities(m):
        if quantity.name not in stream.values:
            continue
        values = stream.values[quantity.name]
        form = quantity.forms[0]
        if quantity.rotation:
            values = _as_columns(values, form)
        columns.update({name: values[:, i] for i, name in enumerate(form)})
    with path.open("wb") as file:
        pl.DataFrame(columns).fill_nan(None).write_csv(file)


def _as_columns(rotations: Array, form: tuple[str, ...]) -> Array:
    """Quaternions (w, x, y, z) with w >= 0, or roll, pitch, yaw [rad], of rotation matrices of shape (n, 3, 3)."""
    valid = np.isfinite(rotations).all(axis=(1, 2))
    values = np.full((len(rotations), len(form)), np.nan)
    turned = Rotation.from_matrix(rotations[valid])
    if len(form) == 4:
        values[valid] = turned.as_quat(canonical=True, scalar_first=True)
    else:
        values[valid] = turned.as_euler("ZYX")[:, ::-1]
    return values
