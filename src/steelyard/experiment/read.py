"""From an experiment file and its logs to an :class:`Experiment`."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from steelyard.arrays import Array
from steelyard.display import printable
from steelyard.experiment.faults.of_streams import without_doubles
from steelyard.experiment.faults.spikes import without_spikes
from steelyard.experiment.faults.stuck import without_stuck
from steelyard.experiment.form import (
    RUN_KEYS,
    ExperimentForm,
    PlanForm,
    RunForm,
)
from steelyard.experiment.loads import (
    NO_WALK,
    check_loads,
    known_values,
    loads_of_forms,
    mass_walk,
)
from steelyard.experiment.model import Datum, Experiment, Fault, Run
from steelyard.experiment.streams import StreamPlace, first_time, needed_columns, read_stream
from steelyard.experiment.tables.dead_weights import with_weights_apart
from steelyard.experiment.tables.seen_frequencies import with_frequencies_apart
from steelyard.experiment.unread import is_unread, with_unread_cables
from steelyard.instruments import Instrument
from steelyard.logs.log import Log, NoRowsError
from steelyard.processes.forked import check_not_forked
from steelyard.robot.file import read_robot
from steelyard.robot.model import DIRECTIONS, Robot
from steelyard.yaml_file import YamlDocument, read_yaml, require_printable, validate

_FEWEST_SAMPLES = 10
"""Force samples in the common time of a run: fewer determine no body."""
_BESIDE = 5.0
"""Of a stream beside the window of its run that is read along [s]: clocks may differ by their
delays, filters have edges."""
_ON_A_LINE = 0.01
"""Spread of points across a line over that along it, below which they are on it."""
_NAME = re.compile(r"\w[\w \-]*")
"""Names of instruments: they name files and columns of tables."""


def read_experiment(path: str | Path, *, weighed: bool = True) -> Experiment:
    """Read an experiment file with all its streams.

    Args:
        path: The file; streams and robot file stand relative to it.
        weighed: Whether a body is to be told by forces; else runs need none, and only what is stated
            of the robot's uncertainty counts: for its calibration.

    Raises:
        InputError: Anything that does not fit the contract; the sentence says where and what to do.
        SteelyardError: This process was forked from one that had read recordings.
    """
    check_not_forked()
    path = Path(path)
    document = read_yaml(path)
    require_printable(document)
    form = validate(ExperimentForm, document)
    robot = read_robot(form.robot, document.path.parent)
    experiment = assembled(form, robot, document, {}, weighed=weighed)
    # The name of a folder may be bytes that are no text.
    folder = printable(os.fsencode(path.parent.resolve().name).decode(errors="replace"))
    experiment = replace(experiment, name=form.name or folder, source=str(path))
    return experiment if weighed else _as_stated(experiment, form)


def assembled(
    form: ExperimentForm,
    robot: Robot,
    document: YamlDocument,
    logs: Mapping[str, Log],
    *,
    weighed: bool,
) -> Experiment:
    """The experiment that a form describes, once everything about it has been looked at.

    Args:
        form: What is said of instruments and runs.
        robot: That they were recorded on.
        document: Where the form comes from; logs stand beside it.
        logs: File of a stream -> log, where it is in memory.
        weighed: See :func:`read_experiment`.

    Raises:
        InputError: Anything that does not fit the contract.
    """
    _check_described(form, robot, document)
    _check_loads(form, document)
    runs = tuple(_read_run(i, run, form, robot, document, logs) for i, run in enumerate(form.runs))
    listed = _experiment(form, robot, runs)
    experiment = with_unread_cables(with_weights_apart(with_frequencies_apart(listed)))
    if experiment.weights and not (experiment.runs or experiment.frequencies):
        raise document.error(
            ("runs",),
            "expected a run of the platform beside the dead weights, found none; add one",
        )
    if weighed:
        _check_weighed(experiment, document)
    numbers = {run.name: i for i, run in enumerate(runs)}
    for run in experiment.runs:
        _check_run(experiment, run, document, ("runs", numbers[run.name]), weighed=weighed)
    return experiment


def _check_weighed(experiment: Experiment, document: YamlDocument) -> None:
    """Refuse several loads of which nothing tells one's mass: what damps swings and stretches cables
    is the same for all, and none of it can be told in multiples of two masses.
    """
    for load in experiment.loads if len(experiment.loads) > 1 else ():
        if "mass" not in load.known and is_unread(experiment.alone(load)):
            raise document.error(
                ("loads", load.name),
                f"expected the mass of load '{load.name}', whose runs read no forces, found none;"
                f" weigh it and add 'known: {{mass: {{value: …, sigma: …}}}}', or add the forces",
            )


def _as_stated(experiment: Experiment, form: ExperimentForm) -> Experiment:
    """The experiment with only what is stated of the robot's uncertainty."""
    stated = form.uncertainty.model_fields_set
    kept = {key: v for key, v in experiment.uncertainty.items() if key in stated}
    return replace(experiment, uncertainty=kept)


def read_plan(path: str | Path, *, weighed: bool = True) -> Experiment:
    """Read what an experiment file says of robot and instruments, recorded or not.

    Recordings are looked at only where an instrument states no rate and they have to show it.

    Args:
        path: The file.
        weighed: Whether a body is to be told by forces; else it is for a calibration, as in
            :func:`read_experiment`, and poses at rest need no rate.

    Raises:
        InputError: Anything that does not fit the contract; the sentence says where and what to do.
    """
    path = Path(path)
    document = read_yaml(path)
    require_printable(document)
    form = validate(PlanForm, document)
    if not weighed:
        return _as_stated(_planned(form, document), form)
    if form.runs and any(
        i.rate is None and not (i.commanded or i.tabular) for i in form.instruments.values()
    ):
        return read_experiment(path)
    listed = _planned(form, document)
    return with_weights_apart(with_frequencies_apart(listed))


def _check_described(form: ExperimentForm, robot: Robot, document: YamlDocument) -> None:
    """See that instruments and runs go with the robot."""
    _check_names(form, document)
    _check_datum(form, robot, document)
    check_instruments(form.instruments, robot, document)


def _planned(form: PlanForm, document: YamlDocument) -> Experiment:
    """Robot and instruments without recordings."""
    robot = read_robot(form.robot, document.path.parent)
    _check_described(form, robot, document)
    folder = os.fsencode(document.path.parent.resolve().name).decode(errors="replace")
    name, source = form.name or folder, str(document.path)
    return replace(_experiment(form, robot, ()), name=name, source=source)


def _experiment(form: ExperimentForm, robot: Robot, runs: tuple[Run, ...]) -> Experiment:
    """The experiment, once all of its parts are read."""
    loads = loads_of_forms(form.loads, robot.platform)
    if loads:
        robot = replace(robot, platform=loads[0].nominal)
    return Experiment(
        name=form.name or "experiment",
        robot=robot,
        instruments=form.instruments,
        runs=runs,
        known=loads[0].known if loads else known_values(form.known),
        mass_walk=mass_walk(form.known),
        loads=loads,
        uncertainty=form.uncertainty.of_robot,
        surroundings=form.surroundings,
        datum=None if form.datum is None else Datum(form.datum.anchors or (), form.datum.pose),
    )


def _check_names(form: ExperimentForm, document: YamlDocument) -> None:
    """Refuse two runs of one name, and streams or clocks of instruments that are not there."""
    names = [run.name for run in form.runs]
    for i, name in enumerate(names):
        if name in names[:i]:
            raise document.error(
                ("runs", i, "name"),
                f"expected names that differ, found '{name}' again; rename one run",
            )
    for i, run in enumerate(form.runs):
        synchronised = run.sync if isinstance(run.sync, dict) and not run.static else {}
        for key in [*((name,) for name in run.streams), *(("sync", name) for name in synchronised)]:
            if key == ("winches",) and "winches" not in form.instruments:
                raise document.error(
                    ("runs", i, "winches"),
                    "expected 'locked', or a run without this key where the winches turn, found"
                    " another value; correct it",
                )
            if key[-1] not in form.instruments:
                raise document.error(
                    ("runs", i, *key),
                    f"expected the name of an instrument, found '{key[-1]}'; known here:"
                    f" {', '.join(form.instruments)}",
                )


def _check_datum(form: ExperimentForm, robot: Robot, document: YamlDocument) -> None:
    """Refuse anchors and runs that are not there, and anchors that leave a rotation open."""
    if form.datum is None:
        return
    if form.datum.pose is not None:
        static = [run.name for run in form.runs if run.static]
        if form.runs and form.datum.pose not in static:
            known = f"; known here: {', '.join(static)}" if static else ""
            raise document.error(
                ("datum", "pose"),
                f"expected the name of a run of poses at rest, found '{form.datum.pose}'{known}",
            )
        return
    numbers = form.datum.anchors or ()
    key = ("datum", "anchors")
    for number in numbers:
        if not 1 <= number <= robot.m:
            raise document.error(
                key,
                f"expected numbers of the {robot.m} cables of the robot, from 1, found {number};"
                " correct it",
            )
    if len(set(numbers)) != len(numbers):
        twice = next(n for i, n in enumerate(numbers) if n in numbers[:i])
        raise document.error(key, f"expected each anchor once, found {twice} twice; correct it")
    points = robot.anchors[np.array(numbers, dtype=int) - 1]
    if len(numbers) < 3 or _are_on_a_line(points):
        raise document.error(
            key,
            "expected at least three anchors that are on no line, since others leave a rotation of the"
            f" world open, found {', '.join(map(str, numbers)) or 'none'}; name others",
        )


def _are_on_a_line(points: Array) -> bool:
    """Whether points leave a rotation about themselves open, shape (n, 3)."""
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(spread[1] <= _ON_A_LINE * spread[0])


def _check_loads(form: ExperimentForm, document: YamlDocument) -> None:
    """Refuse loads that are not there, what they cannot be, and runs that tell nothing of theirs."""
    if form.loads and mass_walk(form.known):
        raise document.error(("known", "mass", "walk"), NO_WALK)
    if form.loads and known_values(form.known):
        raise document.error(
            ("known",),
            "expected what is known under the load that it is about, found it for all of them; move"
            f" it to 'loads: {{{next(iter(form.loads))}: {{known: …}}}}'",
        )
    tables = [
        name for name, each in form.instruments.items() if each.tabular and not each.calibrates
    ]
    if len(form.loads) > 1 and tables:
        raise document.error(
            ("instruments", tables[0]),
            "expected no natural frequencies in an experiment with several loads, found a table of"
            " them; identify each load with its frequencies in an experiment of its own",
        )
    check_loads(form.loads, document)
    for i, run in enumerate(form.runs):
        if run.load is not None and run.load not in form.loads:
            known = f"; known here: {', '.join(form.loads)}" if form.loads else "; add 'loads'"
            raise document.error(
                ("runs", i, "load"), f"expected the name of a load, found '{run.load}'{known}"
            )
        carried = form.loads.get(run.load or next(iter(form.loads), ""))
        moves = not run.static and not _is_of_sensors(form, run)
        if carried is not None and not carried.rigid and moves:
            raise document.error(
                ("runs", i, "load"),
                f"run '{run.name}': expected poses at rest of a load in which something moves, found"
                " a run in motion; record poses at rest ('static: true'), or leave the run out",
            )
    unused = [name for name in form.loads if not _is_carried(form, name)]
    if unused and form.runs:
        raise document.error(
            ("loads", unused[0]),
            f"expected a run that carries '{unused[0]}', found none; add 'load: {unused[0]}' to its"
            " run, or leave the load out",
        )


def _is_carried(form: ExperimentForm, name: str) -> bool:
    """Whether a run carries a load."""
    first = next(iter(form.loads))
    return any((run.load or first) == name for run in form.runs if not _is_of_sensors(form, run))


def _is_of_sensors(form: ExperimentForm, run: RunForm) -> bool:
    """Whether a run is no recording of a body, but a table of what is known of sensors."""
    return bool(run.streams) and all(form.instruments[n].calibrates for n in run.streams)


def check_instruments(
    instruments: Mapping[str, Instrument], robot: Robot, document: YamlDocument
) -> None:
    """What the form of an instrument cannot say, because it depends on its name or on the robot."""
    for name, instrument in instruments.items():
        if not _NAME.fullmatch(name) or name in RUN_KEYS:
            raise document.error(
                ("instruments", name),
                "expected a name of letters, digits, '_', '-' and blanks that is no key of a run"
                f" ({', '.join(sorted(RUN_KEYS))}), found '{name}'; rename it",
            )
        told = instrument.calibrates
        if told is not None and (
            told not in instruments or instruments[told].measured_force != "tension"
        ):
            cells = [n for n, each in instruments.items() if each.measured_force == "tension"]
            raise document.error(
                ("instruments", name, "of"),
                f"expected the name of an instrument of kind 'tension', found '{told}'"
                + (f"; known here: {', '.join(cells)}" if cells else "; add one"),
            )
        if instrument.per_cable and not robot.m:
            raise document.error(
                ("instruments", name, "kind"),
                f"expected a robot with cables for an instrument of kind '{instrument.kind}', found"
                f" none in robot '{robot.name}'; use kind 'wrench' or another robot",
            )
        columns = {c for q in instrument.quantities(robot.m) for form in q.forms for c in form}
        for column in sorted(instrument.unread - columns):
            raise document.error(
                ("instruments", name, "without"),
                f"expected numbers of the {robot.m} cables of the robot, from 1, found"
                f" {column[1:]}; correct it",
            )
        if instrument.stands_in(robot.m):
            raise document.error(
                ("instruments", name, "without"),
                "expected a cable that has a sensor, found none; leave the instrument out of the"
                " file, or correct this",
            )
        _check_writing(name, instrument, robot, document)
        for column, _ in instrument.nodes:
            if column not in columns - instrument.unread:
                raise document.error(
                    ("instruments", name, "nodes", column),
                    f"expected a column of the kind '{instrument.kind}', found '{column}'; known"
                    f" here: {', '.join(sorted(columns - instrument.unread))}",
                )
        delay = instrument.calibration.delay
        priors = [(term.key, term.prior, term.size) for term in instrument.terms(robot.m)]
        for key, prior, size in [*priors, *([("delay", delay, 1)] if delay else [])]:
            for part in ("value", "sigma"):
                given = getattr(prior, part)
                if isinstance(given, tuple) and len(given) != size:
                    raise document.error(
                        ("instruments", name, "calibration", *key.split(".")),
                        f"expected one {part}{f' or {size} of them' if size > 1 else ''}, found"
                        f" {len(given)}; correct it",
                    )


def _check_writing(name: str, instrument: Instrument, robot: Robot, document: YamlDocument) -> None:
    """See that ``columns`` and ``scale`` of an instrument speak of columns that it has."""
    quantities = instrument.quantities(robot.m)
    columns = [c for q in quantities for form in q.forms for c in form]
    scale = instrument.scale
    one_factor = scale if isinstance(scale, float | int) else 1.0
    factors = () if isinstance(scale, float | int) else scale
    for key, named in (
        ("columns", [c for pair in instrument.columns for c in pair[:1]]),
        ("scale", [c for c, _ in factors]),
    ):
        for column in named:
            if column not in columns:
                raise document.error(
                    ("instruments", name, key),
                    f"expected columns of the kind '{instrument.kind}', found '{column}'; known"
                    f" here: {', '.join(dict.fromkeys(columns))}",
                )
    units = {q.unit for q in quantities}
    if one_factor != 1.0 and len(units) > 1:
        raise document.error(
            ("instruments", name, "scale"),
            f"expected a factor for each column, as its columns are in {', '.join(sorted(units))},"
            f" found {one_factor:g} for all; write 'scale: {{{columns[0]}: …}}'",
        )


def _read_run(
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
        timed, alone = without_spikes(timed, whole.instruments)
        timed, stuck = without_stuck(timed, whole.instruments)
        streams |= timed
        excluded = doubled + alone + stuck
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
        name: (event + start - _BESIDE, event + end + _BESIDE) for name, event in sync.items()
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


def _check_run(
    experiment: Experiment,
    run: Run,
    document: YamlDocument,
    key: tuple[str | int, ...],
    *,
    weighed: bool,
) -> None:
    """What one run needs before anything can be estimated from it.

    Args:
        experiment: With its instruments.
        run: One of its runs.
        document: The file.
        key: Where the run stands in it.
        weighed: Whether a body is to be told by forces, or by free swings.
    """
    force = experiment.force_instrument(run)
    m = experiment.robot.m
    if weighed and force is None and not run.locked:
        swings = (
            ", or write 'winches: locked' where the platform swung on cables of constant length"
            if 0 < m < DIRECTIONS and not run.static
            else ""
        )
        raise document.error(
            key,
            f"run '{run.name}': expected a stream of kind 'tension' or 'wrench', found none; add"
            f" the forces{swings}",
        )
    if run.locked and (not m or run.static):
        raise document.error(
            (*key, "winches"),
            f"run '{run.name}': expected 'winches: locked' of a robot with cables in a run in"
            f" motion, found {'poses at rest' if run.static else 'no cable'}; remove the key",
        )
    unread = force is None or experiment.instruments[force].stands_in(m)
    if weighed and unread and m >= DIRECTIONS:
        raise document.error(
            key,
            f"run '{run.name}': expected forces, or fewer than {DIRECTIONS} cables on which the"
            f" platform swings while the winches are locked, found {m} cables and no forces: it"
            " hangs still, which tells nothing; add the forces",
        )
    instruments = [experiment.instruments[name] for name in run.streams]
    if not any(each.is_motion or each.is_cable_motion for each in instruments):
        raise document.error(
            key,
            f"run '{run.name}': expected a stream that measures the motion (imu, attitude, position,"
            " pose, length), found none; add one",
        )
    if run.window and run.window[0] >= run.window[1]:
        raise document.error(
            (*key, "window"), f"expected start below end, found {list(run.window)}; exchange them"
        )
    if run.unsynchronised:
        # Where the clocks stand to each other is still to be found.
        return
    if run.static:
        lengths = {name: len(stream) for name, stream in run.streams.items()}
        if len(set(lengths.values())) > 1:
            raise document.error(
                key,
                f"run '{run.name}': expected the same poses row by row in all streams, found"
                f" {lengths} rows; align the files",
            )
        return
    span = {name: experiment.common_time(run, name) for name in run.streams}
    start, end = run.window or (-math.inf, math.inf)
    for name, time in span.items():
        start, end = max(start, float(time[0])), min(end, float(time[-1]))
        if start >= end:
            others = ", ".join(f"{n} {t[0]:.3f} to {t[-1]:.3f} s" for n, t in span.items())
            raise document.error(
                key,
                f"run '{run.name}': expected streams that overlap in time, found none of '{name}'"
                f" left ({others}, after sync{' and within the window' if run.window else ''});"
                " correct 'sync' or 'window'",
            )
    if force is None:
        return
    samples = int(np.sum((span[force] >= start) & (span[force] <= end)))
    if samples < _FEWEST_SAMPLES:
        raise document.error(
            key,
            f"run '{run.name}': expected at least {_FEWEST_SAMPLES} force samples in the common"
            f" part, found {samples}; widen it",
        )
