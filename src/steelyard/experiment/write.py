"""From an :class:`Experiment` to its file and its streams."""

from __future__ import annotations

import io
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any, Literal

from steelyard.experiment.columns import stream_columns
from steelyard.experiment.form import FORMAT
from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Stream
from steelyard.experiment.tables.dead_weights import with_weights_together
from steelyard.experiment.tables.seen_frequencies import with_frequencies_together
from steelyard.files.yaml_file import to_yaml
from steelyard.instruments import Instrument
from steelyard.output import write_file
from steelyard.robot.covariance import write_covariance
from steelyard.robot.file import bundled_names, platform_values, read_robot, robot_file
from steelyard.tables import to_polars

TableFormat = Literal["csv", "parquet"]
"""How streams are written."""
_LONGEST_NAME = 100
"""Characters of a file that is called after something in an experiment."""
_COVARIANCE = "robot.covariance.csv"
_OURS = frozenset({"experiment.yaml", "robot.yaml", _COVARIANCE, "truth.json"})
"""Names beside the folders of the runs."""
STREAM_FORMAT = "steelyard-stream/1"
"""In the footer of Parquet."""


def write_experiment(
    experiment: Experiment,
    folder: str | Path,
    *,
    tables: TableFormat = "csv",
    with_robot: bool = False,
) -> None:
    """Write ``experiment.yaml``, a table per stream in a folder per run, and the robot file unless
    it is a bundled one.

    Args:
        experiment: What to write; its clocks are known.
        folder: An empty folder that exists.
        tables: Format of the streams.
        with_robot: Whether to write the robot file of a bundled robot too, so that the folder says
            all by itself.
    """
    experiment = with_weights_together(with_frequencies_together(experiment))
    folder = Path(folder)
    description = robot_file(experiment.robot)
    bundled = (
        not with_robot
        and experiment.robot.covariance is None
        and experiment.robot.name in bundled_names()
        and description == robot_file(read_robot(experiment.robot.name))
    )
    if not bundled:
        if experiment.robot.covariance is not None:
            description["covariance"] = _COVARIANCE
            write_covariance(experiment.robot.covariance, experiment.robot.m, folder / _COVARIANCE)
        write_yaml(description, folder / "robot.yaml")
    places = _places([run.name for run in experiment.runs], "run")
    instruments = list(experiment.instruments)
    names = dict(zip(instruments, _places(instruments, "instrument"), strict=True))
    runs = []
    for run, place in zip(experiment.runs, places, strict=True):
        (folder / place).mkdir()
        entry: dict[str, Any] = {"name": run.name}
        if run.load is not None:
            entry["load"] = run.load
        if run.static:
            entry["static"] = True
        if run.locked:
            entry["winches"] = "locked"
        for name, stream in run.streams.items():
            if experiment.instruments[name].stands_in(experiment.robot.m):
                continue
            file = f"{place}/{names[name]}.{tables}"
            write = write_stream if tables == "csv" else write_parquet_stream
            instrument, m = experiment.instruments[name], experiment.robot.m
            timed = not (run.static or instrument.tabular)
            write(stream, instrument, m, folder / file, timed=timed)
            entry[name] = file
        if run.sync:
            entry["sync"] = {k: v for k, v in run.sync.items() if k in entry}
        if run.window:
            entry["window"] = list(run.window)
        runs.append(entry)
    values = {
        "format": FORMAT,
        "name": experiment.name,
        "robot": experiment.robot.name if bundled else "robot.yaml",
        **_bodies(experiment),
        "uncertainty": {
            **experiment.uncertainty,
            **_of_lengths(experiment),
            **_unmodelled(experiment),
        },
        **experiment.surroundings.model_dump(
            mode="json",
            include={"attached", "drag", "bending"},
            exclude_unset=True,
            exclude_none=True,
        ),
        **_datum(experiment),
        "instruments": {
            name: instrument.model_dump(
                mode="json", exclude_unset=True, exclude={"columns", "scale"}
            )
            for name, instrument in experiment.instruments.items()
            if not instrument.stands_in(experiment.robot.m)
        },
        "runs": runs,
    }
    write_yaml(values, folder / "experiment.yaml")


def _places(names: Sequence[str], what: str) -> list[str]:
    """A file name for each of several names: itself wherever it can be one, no two of them the same
    on any disk.
    """
    places: list[str] = []
    taken = {name.casefold() for name in _OURS}
    for i, name in enumerate(names):
        fits = re.fullmatch(r"\w([\w .\-]*[\w\-])?", name) and len(name.encode()) <= _LONGEST_NAME
        place = name if fits and name.casefold() not in taken else f"{what}-{i + 1}"
        while place.casefold() in taken or (place != name and place in names):
            place += "-"
        taken.add(place.casefold())
        places.append(place)
    return places


def _of_lengths(experiment: Experiment) -> dict[str, float]:
    """How constant lengths on locked winches are, where it is stated."""
    noise = experiment.length_noise
    return {} if noise is None else {"length_noise": noise}


def _unmodelled(experiment: Experiment) -> dict[str, Any]:
    """Of the wrench that nothing explains, where something is stated."""
    return experiment.surroundings.model_dump(
        mode="json", include={"unmodelled"}, exclude_unset=True, exclude_none=True
    )


def _stated(
    known: Mapping[str, tuple[float, float]], *, mass_assumed: bool
) -> dict[str, tuple[float, float]]:
    """What is known beforehand, without what is only assumed."""
    assumed = {"mass"} if mass_assumed else set[str]()
    return {name: value for name, value in known.items() if name not in assumed}


def _datum(experiment: Experiment) -> dict[str, Any]:
    """What the world frame is, where it is stated."""
    datum = experiment.datum
    if datum is None:
        return {}
    own = {"anchors": list(datum.anchors)} if datum.pose is None else {"pose": datum.pose}
    return {"datum": own}


def _bodies(experiment: Experiment) -> dict[str, Any]:
    """What is known beforehand of the body, or of each of several loads."""
    if not experiment.loads:
        known = _known(_stated(experiment.known, mass_assumed=experiment.mass_assumed))
        if experiment.mass_walk:
            known["mass"] = {**known.get("mass", {}), "walk": experiment.mass_walk}
        return {"known": known} if known else {}
    first, *further = experiment.loads
    # A mass is assumed of the first load alone.
    own = _stated(first.known, mass_assumed=experiment.mass_assumed)
    return {
        "loads": {
            load.name: {
                **({"known": _known(load.known)} if load.known else {}),
                **({"added": _known(load.added)} if load.added else {}),
                **({"nominal": platform_values(load.nominal)} if load.nominal else {}),
                **({} if load.rigid else {"rigid": False}),
            }
            for load in (replace(first, known=own), *further)
        }
    }


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
    write_file(path, to_yaml(values))


def write_stream(
    stream: Stream, instrument: Instrument, m: int, path: Path, *, timed: bool = True
) -> None:
    """Write a stream as CSV with the columns of its kind, full precision, empty cells where there
    is no sample.
    """
    columns = stream_columns(stream.time if timed else None, stream.values, instrument, m)
    table = to_polars({name: values for name, (values, _) in columns.items()})
    write_file(path, table.write_csv())


def write_parquet_stream(
    stream: Stream, instrument: Instrument, m: int, path: Path, *, timed: bool = True
) -> None:
    """Write a stream as Parquet with the columns of its kind, null where there is no sample.

    Under the key ``steelyard`` the footer has JSON: version, kind, unit of every column, and where
    the stream came from.
    """
    columns = stream_columns(stream.time if timed else None, stream.values, instrument, m)
    about = {
        "format": STREAM_FORMAT,
        "version": version("steelyard"),
        "kind": instrument.kind,
        "units": {name: unit for name, (_, unit) in columns.items()},
        "source": stream.source,
    }
    frame = to_polars({name: values for name, (values, _) in columns.items()})
    # Into memory first: names of files are bytes, which the library would have as text.
    buffer = io.BytesIO()
    frame.write_parquet(buffer, metadata={"steelyard": json.dumps(about)})
    write_file(path, buffer.getvalue())
