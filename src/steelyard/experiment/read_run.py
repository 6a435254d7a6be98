"""The streams of a run from their logs, of a window only what it needs."""

from __future__ import annotations

from collections.abc import Mapping

from steelyard.experiment.faults.clock_steps import without_clock_steps
from steelyard.experiment.faults.fault import Fault
from steelyard.experiment.faults.held import without_held
from steelyard.experiment.faults.of_streams import without_doubles
from steelyard.experiment.faults.spikes import without_spikes
from steelyard.experiment.faults.stuck import without_stuck
from steelyard.experiment.form import (
    ExperimentForm,
    RunForm,
)
from steelyard.experiment.recording import BESIDE, Run
from steelyard.experiment.streams.log_columns import needed_columns
from steelyard.experiment.streams.place import StreamPlace
from steelyard.experiment.streams.read_stream import first_time, read_stream
from steelyard.files.document import YamlDocument
from steelyard.logs.log import Log, NoRowsError
from steelyard.robot.model import Robot


def read_run(
    i: int,
    form: RunForm,
    whole: ExperimentForm,
    robot: Robot,
    document: YamlDocument,
    logs: Mapping[str, Log],
) -> Run:
    """Read the streams of a run, of a window only what it needs."""
    key = ("runs", i)
    if not form.streams:
        raise document.error(
            key,
            f"expected streams of the instruments {', '.join(whole.instruments)}, found none; name"
            " their files",
        )
    places = {
        name: StreamPlace(
            document.path.parent / stream.file,
            stream.topic,
            stream.columns,
            stream.units,
            stream.scale,
            logs.get(stream.file),
        ).of_all_runs(whole.instruments[name])
        for name, stream in form.streams.items()
    }
    sync = _sync(form, whole, document, key)
    spans: dict[str, tuple[float, float]] = {}
    if form.window and not form.static:
        sync, spans = _spans(form, whole, places, sync)
    streams = {}
    for name, place in places.items():
        claimed: set[str] = set()
        for other, its in places.items():
            if other != name and (its.path, its.topic) == (place.path, place.topic):
                claimed |= needed_columns(whole.instruments[other], robot.m, its.columns)
        try:
            streams[name] = read_stream(
                place,
                whole.instruments[name],
                robot.m,
                static=form.static or whole.instruments[name].tabular,
                claimed=claimed,
                span=spans.get(name),
            )
        except NoRowsError as error:
            raise document.error(
                key,
                f"run '{form.name}': expected streams that overlap in time within the window, found"
                f" none of '{name}' left ({error}); correct 'sync' or 'window'",
            ) from None
    excluded: tuple[Fault, ...] = ()
    if not form.static:
        timed = {k: v for k, v in streams.items() if not whole.instruments[k].tabular}
        timed, doubled = without_doubles(timed)
        timed, held = without_held(timed, whole.instruments)
        timed, stepped = without_clock_steps(timed, whole.instruments, sync)
        timed, alone = without_spikes(timed, whole.instruments)
        timed, stuck = without_stuck(timed, whole.instruments)
        streams |= timed
        excluded = doubled + held + stepped + alone + stuck
    return Run(
        name=form.name,
        streams=streams,
        sync=sync,
        window=form.window,
        static=form.static,
        unsynchronised=form.sync == "auto" and not form.static,
        locked=form.winches == "locked",
        load=form.load,
        excluded=excluded,
    )


def _spans(
    form: RunForm, whole: ExperimentForm, places: Mapping[str, StreamPlace], sync: dict[str, float]
) -> tuple[dict[str, float], dict[str, tuple[float, float]]]:
    """What to read of each stream for a window, on its own clock [s], and the event that the window
    counts from.
    """
    assert form.window is not None
    force = next(
        (n for n in whole.instruments if n in places and whole.instruments[n].is_force), None
    )
    if not sync:
        if force is None:
            return sync, {}
        event = first_time(places[force])
        # Clocks that agree have their event at the same time; of others only the forces' is known
        # yet.
        timed = [name for name in places if not whole.instruments[name].tabular]
        sync = dict.fromkeys(timed if form.sync != "auto" else [force], event)
    start, end = form.window
    return sync, {
        name: (event + start - BESIDE, event + end + BESIDE) for name, event in sync.items()
    }


def _sync(
    form: RunForm, whole: ExperimentForm, document: YamlDocument, key: tuple[str | int, ...]
) -> dict[str, float]:
    """Event time of every stream; instruments of one file or one clock may share one entry."""
    if not form.sync or form.static or isinstance(form.sync, str):
        return {}
    given = dict(form.sync)
    for name, stream in form.streams.items():
        if name in given or whole.instruments[name].tabular:
            continue
        clock = whole.instruments[name].clock
        partners = [
            other
            for other in form.sync
            if (other in form.streams and form.streams[other].file == stream.file)
            or (clock is not None and whole.instruments[other].clock == clock)
        ]
        if not partners:
            raise document.error(
                (*key, "sync"),
                f"expected a time for every instrument, found none for '{name}'; add it",
            )
        given[name] = given[partners[0]]
    return given
