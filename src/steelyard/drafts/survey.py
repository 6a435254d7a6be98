"""What is in many logs: every stream that an instrument may have recorded, read once, and all
that is none.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import TypeAdapter

from steelyard.arrays import Array
from steelyard.drafts.columns import Claim, claims_of
from steelyard.drafts.scales import scale_of, time_unit
from steelyard.drafts.vectors import GRAVITY_OR_GYRO
from steelyard.drafts.words import words_of
from steelyard.errors import InputError
from steelyard.experiment.recording import Stream
from steelyard.experiment.streams.fields import column_in
from steelyard.experiment.streams.log_columns import needed_columns
from steelyard.experiment.streams.place import StreamPlace
from steelyard.experiment.streams.read_stream import read_stream
from steelyard.instruments import AnyInstrument, Instrument
from steelyard.logs.formats import open_log
from steelyard.logs.log import Log
from steelyard.robot.model import Robot

_MOST_INSTRUMENTS = 64
"""Of one table."""
_INSTRUMENT: TypeAdapter[Instrument] = TypeAdapter(AnyInstrument)


@dataclass(frozen=True)
class Unused:
    """A log, or columns of one, that no instrument has."""

    log: str
    what: str
    """Why, or which columns."""


@dataclass(frozen=True, eq=False)
class DraftStream:
    """A stream, as far as it is known what it is."""

    place: StreamPlace
    kind: str
    label: tuple[str, ...]
    """Words that distinguish its instrument from others of its kind."""
    settings: Mapping[str, Any]
    """Keys of its instrument that the values show."""
    static: bool
    stream: Stream
    used: tuple[str, ...]
    """Columns of the log that it has."""
    stated: Mapping[str, str] = field(default_factory=dict)
    """Column of the log -> unit that the log states."""
    why: tuple[str, ...] = ()
    checks: tuple[str, ...] = ()

    @property
    def times(self) -> Array:
        """Of rows with a sample: tables that hold several instruments have gaps [s], shape (n,)."""
        there = np.zeros(len(self.stream), dtype=bool)
        for values in self.stream.values.values():
            there |= np.isfinite(values).reshape(len(values), -1).any(axis=1)
        return self.stream.time[there]

    @property
    def span(self) -> tuple[float, float]:
        """Beginning and end on the clock of the log [s]."""
        return float(self.stream.time[0]), float(self.stream.time[-1])

    @property
    def clock(self) -> tuple[Path, str | None, str]:
        """File, topic and column that its time stands in."""
        return self.place.path, self.place.topic, self.place.columns.get("t", "t")

    @property
    def rate(self) -> float | None:
        """Median rate [Hz]; None: of poses at rest."""
        steps = np.diff(self.times)
        steps = steps[steps > 0]
        return None if self.static or not len(steps) else 1 / float(np.median(steps))

    @property
    def instrument(self) -> Instrument:
        """With all that is known of it."""
        return instrument_of(self.kind, self.settings)

    def because(self, reason: str, **settings: Any) -> DraftStream:
        """With settings that its values show, and why."""
        return replace(self, settings={**self.settings, **settings}, why=(*self.why, reason))

    def unused(self, why: str) -> Unused:
        """It is left out, and why."""
        return Unused(name_of(self.place.path, self.place.topic), f"{self.kind}: {why}")

    def to_check(self, check: str) -> DraftStream:
        """With something more that a person should look at."""
        return replace(self, checks=(*self.checks, check))


def instrument_of(kind: str, settings: Mapping[str, Any]) -> Instrument:
    """An instrument of a kind with some of its keys."""
    return _INSTRUMENT.validate_python({"kind": kind, **settings})


def name_of(path: Path, topic: str | None) -> str:
    """A log and its topic, for people."""
    return f"{path}" if topic is None else f"{path} {topic}"


def streams_in(
    path: Path, topic: str | None, robot: Robot
) -> tuple[list[DraftStream], list[Unused]]:
    """Look through one topic of one log.

    Args:
        path: Of the log.
        topic: Which of its topics; None: it has but one.
        robot: What the instruments are on.
    """
    log_name = name_of(path, topic)
    try:
        with open_log(path, topic) as log:
            names = log.names
            hints = [*words_of(topic or ""), *words_of(path.name.split(".")[0])]
            claims = claims_of(names, robot.m, hints)
            if len(claims) > _MOST_INSTRUMENTS:
                raise InputError(
                    f"columns of {len(claims)} instruments, where at most {_MOST_INSTRUMENTS} are"
                    " looked at"
                )
            if not claims:
                raise InputError(f"no instrument has columns like {_some(names)}")
            drafts, unused = _drafts(log, topic, claims, robot)
    except InputError as error:
        return [], [Unused(log_name, error.on_command_line)]
    found = []
    for draft, claimed in drafts:
        try:
            found.append(read_again(draft, robot.m, claimed=claimed))
        except InputError as error:
            unused.append(draft.unused(error.on_command_line))
    used = {column for each in found for column in each.used}
    free = [name for name in names if name not in used]
    if found and free:
        unused.append(Unused(log_name, f"columns {_some(free)}"))
    return found, unused


def _drafts(
    log: Log, topic: str | None, claims: Sequence[Claim], robot: Robot
) -> tuple[list[tuple[DraftStream, frozenset[str]]], list[Unused]]:
    """Streams as claims describe them, each with the columns that others need, and claims that the
    values contradict.
    """
    drafts, unused = [], []
    for claim in claims:
        claimed: set[str] = set()
        for other in claims:
            if other is not claim:
                claimed |= needed_columns(instrument_of(other.kind, {}), robot.m, other.columns)
        try:
            drafts.append((_draft(log, topic, claim, robot), frozenset(claimed)))
        except InputError as error:
            unused.append(Unused(name_of(log.path, topic), f"{claim.kind}: {error}"))
    return drafts, unused


def read_again(
    found: DraftStream, m: int, *, claimed: frozenset[str] = frozenset(), **changes: Any
) -> DraftStream:
    """A stream read as it is described now.

    Raises:
        InputError: It cannot be read so.
    """
    found = replace(found, **changes)
    stream = read_stream(found.place, found.instrument, m, static=found.static, claimed=claimed)
    return replace(found, stream=stream)


def _draft(log: Log, topic: str | None, claim: Claim, robot: Robot) -> DraftStream:
    """What a claim comes to, once its values have been looked at; the stream is still to be
    read.
    """
    table = log.read([*claim.columns.values()])
    columns, checks = dict(claim.columns), list(claim.checks)
    if GRAVITY_OR_GYRO in checks and _is_gravity(table, columns):
        columns = {name: column for name, column in columns.items() if name[0] != "w"}
        checks.remove(GRAVITY_OR_GYRO)
        if not columns:
            raise InputError("expected rates of a gyro, found gravity; nothing needs it")
    timed, time = _time(log, claim, len(next(iter(table.values()))))
    own = {*columns.values(), timed}
    stated = {column: unit for column, unit in log.units.items() if column in own}
    named = {c: unit for c, unit in claim.units.items() if c in own and c not in stated}
    open_ones = {n: table[c] for n, c in columns.items() if c not in stated and c not in named}
    scale = scale_of(claim.kind, open_ones, robot)
    units = {**named, **{columns[name]: unit for name, unit in scale.units.items()}}
    why = list(scale.why)
    if timed is not None and time is not None and timed not in stated and timed not in units:
        unit, reason = time_unit(time)
        if unit != "s":
            units[timed] = unit
            why.append(reason)
    columns, turned = _quaternion(columns, table)
    if timed is not None:
        columns = {"t": timed, **columns}
    other = {n: c for n, c in columns.items() if column_in(log.names, n, None) != c}
    return DraftStream(
        place=StreamPlace(log.path, topic, other, units),
        kind=claim.kind,
        label=claim.label,
        settings=scale.settings,
        static=timed is None,
        stream=Stream(np.zeros(0), {}, str(log.path)),
        used=tuple(columns.values()),
        stated=stated,
        why=tuple(why),
        checks=(*checks, *turned, *scale.checks),
    )


def _time(log: Log, claim: Claim, rows: int) -> tuple[str | None, Array | None]:
    """The first column that can be the time of a claim: every row has one, and it never
    decreases.
    """
    problem: InputError | None = None
    for column in claim.times:
        try:
            return column, _read_time(log, column, rows)
        except InputError as error:
            problem = error
    if problem is not None:
        raise problem
    return None, None


def _read_time(log: Log, column: str, rows: int) -> Array:
    """A column of times, shape (rows,); refused where it cannot be one."""
    time = log.read([column])[column]
    if len(time) != rows:
        raise InputError(
            f"expected a time in every row, found column '{column}' with {len(time)} of {rows}"
        )
    if np.isnan(time).any():
        raise InputError(f"expected a time in every row, found column '{column}' with gaps")
    back = np.flatnonzero(np.diff(time) < 0)
    if len(back):
        raise InputError(
            f"{log.place(int(back[0]) + 1)}: expected time that never decreases, found column"
            f" '{column}' going back"
        )
    return time


def _is_gravity(table: Mapping[str, Array], columns: Mapping[str, str]) -> bool:
    """Whether what may be a gyro reads the same size all the time, that of gravity."""
    rows = np.column_stack([table[columns[f"w{axis}"]] for axis in "xyz"])
    norms = np.linalg.norm(rows, axis=1)
    typical = float(np.nanmedian(norms))
    is_constant = bool(np.nanstd(norms) < 0.05 * typical)
    return is_constant and (9.5 < typical < 10.1 or 0.95 < typical < 1.05)


def _quaternion(
    columns: Mapping[str, str], table: Mapping[str, Array]
) -> tuple[dict[str, str], tuple[str, ...]]:
    """Numbered quaternions with their scalar part where the values say it is."""
    named = [columns.get(f"q{axis}", "") for axis in "wxyz"]
    if not all(named) or not all(column.rstrip("])").endswith(tuple("01234")) for column in named):
        return dict(columns), ()
    parts = [float(np.nanmedian(np.abs(table[column]))) for column in named]
    if parts[3] > 0.7 > parts[0]:
        order = dict(zip(("qx", "qy", "qz", "qw"), named, strict=True))
        return {**columns, **order}, ("that the scalar part of the quaternion comes last",)
    return dict(columns), ()


def _some(names: Sequence[str]) -> str:
    shown = ", ".join(name if len(name) <= 40 else name[:39] + "…" for name in names[:8])
    return shown + (f" and {len(names) - 8} more" if len(names) > 8 else "")
