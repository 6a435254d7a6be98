"""What an experiment file and its streams must fulfil before anything can be estimated from
them.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping

import numpy as np

from steelyard.arrays import Array
from steelyard.experiment.form import (
    RUN_KEYS,
    ExperimentForm,
    RunForm,
)
from steelyard.experiment.loads import (
    NO_WALK,
    check_loads,
    known_values,
    mass_walk,
)
from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run
from steelyard.experiment.unread import is_unread
from steelyard.files.document import YamlDocument
from steelyard.instruments import Instrument
from steelyard.robot.model import DIRECTIONS, Robot

_FEWEST_SAMPLES = 10
"""Force samples in the common time of a run: fewer determine no body."""
_ON_A_LINE = 0.01
"""Spread of points across a line over that along it, below which they are on it."""
_NAME = re.compile(r"\w[\w \-]*")
"""Names of instruments: they name files and columns of tables."""


def check_described(form: ExperimentForm, robot: Robot, document: YamlDocument) -> None:
    """See that instruments and runs go with the robot."""
    _check_names(form, document)
    _check_datum(form, robot, document)
    check_instruments(form.instruments, robot, document)


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
            "expected at least three anchors that are on no line, since others leave a rotation"
            f" of the world open, found {', '.join(map(str, numbers)) or 'none'}; name others",
        )


def _are_on_a_line(points: Array) -> bool:
    """Whether points leave a rotation about themselves open, shape (n, 3)."""
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(spread[1] <= _ON_A_LINE * spread[0])


def check_carried(form: ExperimentForm, document: YamlDocument) -> None:
    """Refuse loads that are not there, what they cannot be, and runs that tell nothing of
    theirs.
    """
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


def check_length_noise(form: ExperimentForm, document: YamlDocument) -> None:
    """Refuse a noise of constant lengths where no winches are locked."""
    noise = form.uncertainty.length_noise
    if noise is not None and not any(run.winches for run in form.runs):
        raise document.error(
            ("uncertainty", "length_noise"),
            "expected a run with 'winches: locked', in which cables keep their lengths to"
            f" {noise:g} m, found none; add it to these runs, or remove the key",
        )


def check_known_or_weighed(experiment: Experiment, document: YamlDocument) -> None:
    """Refuse several loads of which nothing tells one's mass: what damps swings and stretches
    cables is the same for all, and none of it can be told in multiples of two masses.
    """
    for load in experiment.loads if len(experiment.loads) > 1 else ():
        if "mass" not in load.known and is_unread(experiment.alone(load)):
            raise document.error(
                ("loads", load.name),
                f"expected the mass of load '{load.name}', whose runs read no forces, found none;"
                f" weigh it and add 'known: {{mass: {{value: …, sigma: …}}}}', or add the forces",
            )


def check_moves_within(
    experiment: Experiment, run: Run, document: YamlDocument, where: tuple[str | int, ...]
) -> None:
    """Refuse a motion of a load in which something moves where forces do not tell the whole wrench:
    what pulls along the rest goes with the motion of the platform, and so does not average out.
    """
    if not experiment.moves_within(run.name):
        return
    name, m = experiment.force_instrument(run), experiment.robot.m
    cells = 0
    if name is not None and not experiment.instruments[name].stands_in(m):
        own = experiment.instruments[name]
        cells = len({c for q in own.quantities(m) for c in q.forms[0]} - own.unread)
    if cells < DIRECTIONS:
        raise document.error(
            (*where, "load"),
            f"run '{run.name}': expected poses at rest of a load in which something moves, or"
            f" {DIRECTIONS} forces that tell the whole wrench on the platform, found a run in"
            f" motion with {cells}; record poses at rest ('static: true'), or leave the run out",
        )


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


def check_run(
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
            f"run '{run.name}': expected a stream that measures the motion (imu, attitude,"
            " position, pose, length), found none; add one",
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
