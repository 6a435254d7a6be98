"""An experiment of frames and arrays: what an experiment file says, said in Python."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from steelyard.errors import InputError
from steelyard.experiment.form import FORMAT, RUN_KEYS, ExperimentForm
from steelyard.experiment.memory.frame_log import Frame, frame_log
from steelyard.experiment.model import Experiment
from steelyard.experiment.read import assembled
from steelyard.experiment.recording import Run
from steelyard.files.document import YamlDocument
from steelyard.files.file_model import FileModel, plain_values, validate
from steelyard.instruments import AnyInstrument, Instrument
from steelyard.logs.log import Log
from steelyard.robot.file import read_robot
from steelyard.robot.model import Robot

_PLACE = "from_frames"
"""What messages call the description."""
_WORDS = RUN_KEYS | {"winches"}
"""Keys of a run that say something of it; all others are instruments."""


@dataclass(frozen=True, eq=False)
class RecordedFrame:
    """A frame with what is said of its columns, as a stream of an experiment file has it."""

    frame: Frame
    """A frame of Polars or pandas, a mapping of names to arrays, or a structured array."""
    columns: Mapping[str, str] = field(default_factory=dict)
    """Column of the contract -> name in the frame, where they differ."""
    units: Mapping[str, str] = field(default_factory=dict)
    """Column -> unit, where it is not SI: g, deg, deg/s, mm, kN, us, …."""
    scale: Mapping[str, float] = field(default_factory=dict)
    """Column -> what it is multiplied by, after its unit: -1 where a sign is turned."""

    @property
    def words(self) -> dict[str, Any]:
        """What is said of the columns, as plain values."""
        given = {"columns": self.columns, "units": self.units, "scale": self.scale}
        return {key: plain_values(each) for key, each in given.items() if each}


class _InstrumentsForm(FileModel):
    """Instruments by name."""

    instruments: dict[str, AnyInstrument] = Field(min_length=1)


def experiment_from_frames(
    robot: Robot | str | Path,
    instruments: Mapping[str, Instrument | Mapping[str, Any]],
    runs: Mapping[str, Mapping[str, Any]],
    *,
    sync: Literal["auto"] | Mapping[str, float] | None = None,
    clocks: Mapping[str, str] | None = None,
    weighed: bool = True,
    **keys: Any,
) -> Experiment:
    """See :meth:`.Experiment.from_frames`."""
    owner = robot if isinstance(robot, Robot) else read_robot(robot)
    described = _instruments(instruments, _mapping(clocks or {}, "clocks"))
    entries: list[dict[str, Any]] = []
    logs: dict[str, Log] = {}
    for name, given in _mapping(runs, "runs").items():
        words = _words_of(given, name, described)
        if "sync" not in words and sync is not None and not words.get("static"):
            words["sync"] = sync if isinstance(sync, str) else _of_run(sync, given)
        frames = {str(key): value for key, value in given.items() if key not in words}
        entries.append(
            {"name": str(name), **words, **_streams(name, frames, described, owner, logs)}
        )
    values = {
        "format": FORMAT,
        "robot": owner.name,
        "instruments": described,
        "runs": entries,
        **{key: plain_values(value) for key, value in keys.items() if value is not None},
    }
    document = YamlDocument(Path(_PLACE), values, {})
    form = validate(ExperimentForm, document)
    experiment = assembled(form, owner, document, logs, weighed=weighed)
    return replace(experiment, runs=tuple(_on_clocks(run, clocks or {}) for run in experiment.runs))


def _mapping(value: Any, what: str) -> Mapping[Any, Any]:
    """A mapping.

    Raises:
        InputError: It is none.
    """
    if not isinstance(value, Mapping):
        raise InputError(
            f"{_PLACE}: '{what}': expected a mapping of names to values, found"
            f" {type(value).__name__}; name each of them"
        )
    return value


def _instruments(given: Any, clocks: Mapping[str, str]) -> dict[str, Instrument]:
    """Instruments as values, with the clocks that they share."""
    plain = {
        str(name): each if isinstance(each, Instrument) else plain_values(each)
        for name, each in _mapping(given, "instruments").items()
    }
    document = YamlDocument(Path(_PLACE), {"instruments": plain}, {})
    found = validate(_InstrumentsForm, document).instruments
    for name in clocks:
        if name not in found:
            raise InputError(
                f"{_PLACE}: 'clocks': expected one of {', '.join(found)}, found '{name}'; choose"
                " one of these"
            )
    return {
        name: each.model_copy(update={"clock": str(clocks[name])}) if name in clocks else each
        for name, each in found.items()
    }


def _words_of(given: Any, run: str, instruments: Mapping[str, Any]) -> dict[str, Any]:
    """What is said of a run beside its streams."""
    for key in _mapping(given, f"runs.{run}"):
        if key not in instruments and (key not in _WORDS or key == "name"):
            raise InputError(
                f"{_PLACE}: 'runs.{run}': expected the name of an instrument, found '{key}'; known"
                f" here: {', '.join(instruments)}"
            )
    return {
        key: plain_values(value)
        for key, value in given.items()
        if key in _WORDS and key not in instruments
    }


def _of_run(sync: Any, given: Mapping[str, Any]) -> dict[str, Any]:
    """Times of one event that are said for all runs, of the instruments that a run has."""
    return {
        str(name): plain_values(time)
        for name, time in _mapping(sync, "sync").items()
        if name in given
    }


def _streams(
    run: str,
    frames: Mapping[str, Any],
    instruments: Mapping[str, Instrument],
    robot: Robot,
    logs: dict[str, Log],
) -> dict[str, dict[str, Any]]:
    """Entries of a run, with what was handed over among the logs; one and the same frame is one
    log, as one file is.
    """
    held = {
        name: given if isinstance(given, RecordedFrame) else RecordedFrame(given)
        for name, given in frames.items()
    }
    shared: dict[int, list[str]] = {}
    for name, each in held.items():
        shared.setdefault(id(each.frame), []).append(name)
    places: dict[str, str] = {}
    for names in shared.values():
        place = f"run '{run}', {' and '.join(names)}"
        readers = [instruments[name] for name in names]
        logs[place] = frame_log(place, held[names[0]].frame, readers, robot.m)
        places |= dict.fromkeys(names, place)
    return {name: {"file": places[name], **each.words} for name, each in held.items()}


def _on_clocks(run: Run, clocks: Mapping[str, str]) -> Run:
    """A run whose streams say the clocks that they share."""
    streams = {
        name: replace(each, clock=f"clock {clocks[name]}") if name in clocks else each
        for name, each in run.streams.items()
    }
    return replace(run, streams=streams)
