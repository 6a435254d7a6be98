"""From a log to the stream of an instrument: SI units, axes as the contract has them, times that
can be.
"""

from __future__ import annotations

from collections.abc import Callable, Set
from pathlib import Path

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import InputError
from steelyard.experiment.recording import Stream
from steelyard.experiment.streams.log_columns import LogColumns, needed_columns, present_quantities
from steelyard.experiment.streams.orientations import off_rotation, rotations_of
from steelyard.experiment.streams.place import StreamPlace, as_named
from steelyard.instruments import Instrument
from steelyard.logs.log import RowRange

_UNIT_OF_NO_ANGLE = "1"
_SHORTEST_STEP, _LONGEST_STEP = 1e-5, 10.0
"""Median time between samples of any instrument [s]."""


def read_stream(
    place: StreamPlace,
    instrument: Instrument,
    m: int,
    *,
    static: bool,
    claimed: Set[str] = frozenset(),
    span: tuple[float, float] | None = None,
) -> Stream:
    """Read the stream of an instrument.

    Args:
        place: Where it is.
        instrument: What recorded it.
        m: Number of cables of the robot.
        static: Whether its rows are poses at rest, which need no time.
        claimed: Columns of this log that another instrument needs; an optional quantity that stands
            there is not this one's.
        span: Part to read [s], on the clock of the log; None: all.

    Raises:
        InputError: A column is missing, a unit is unknown, a cell is no number, or time runs
            backwards.
    """
    path = place.path
    with place.opened() as log:
        place = as_named(log, place)
        claimed = {log.spellings.get(name, name) for name in claimed}
        needed = needed_columns(instrument, m, place.columns)
        names = LogColumns(
            log, place, [name for name in log.names if name in needed or name not in claimed]
        )
        quantities, unread = present_quantities(names, instrument, m), instrument.unread
        timed = None if static else names.time()
        contract = [name for _, form in quantities for name in form if name not in unread]
        names.check(contract, instrument.kind)
        wanted = {name: str(names.of(name)) for name in contract}
        if timed is not None:
            wanted["t"] = timed
        part = None
        if span is not None and timed is not None:
            seconds = names.factor("t", "s")
            part = RowRange(timed, span[0] / seconds, span[1] / seconds)
        table = log.read(list(dict.fromkeys(wanted.values())), part)
    n = len(table.cells)

    def where(row: int) -> str:
        return log.place(row, part)

    time = np.arange(n, dtype=np.float64)
    if timed is not None:
        time = table[timed] * names.factor("t", "s")
        _check_time(where, timed, time)
        _check_rate(path, timed, time)
    values: dict[str, Array] = {}
    angles: dict[str, Array] = {}
    off: dict[str, Array] = {}
    forms: dict[str, tuple[str, ...]] = {}
    for quantity, form in quantities:
        forms[quantity.name] = form
        # Quaternions and matrices have no unit.
        unit = _UNIT_OF_NO_ANGLE if quantity.rotation and len(form) != 3 else quantity.unit
        there = [c for c in form if c not in unread]
        factors = np.array(
            [names.factor(c, unit) * names.scale(c) * instrument.factor(c) for c in there]
        )
        raw = table.beside([wanted[c] for c in there])
        raw = raw if np.all(factors == 1) else raw * factors
        if len(there) < len(form):
            whole = np.full((n, len(form)), np.nan)
            whole[:, [c not in unread for c in form]] = raw
            raw = whole
        values[quantity.name] = rotations_of(where, form, raw) if quantity.rotation else raw
        if quantity.rotation and len(form) == 3:
            angles[quantity.name] = raw
        elif quantity.rotation and not static:
            off[quantity.name] = off_rotation(raw)
    return Stream(time, values, str(path), angles, forms, str(path), off)


def first_time(place: StreamPlace) -> float:
    """Time of the first row of a log, on its own clock [s].

    Raises:
        InputError: See :func:`read_stream`.
    """
    with place.opened() as log:
        names = LogColumns(log, as_named(log, place), list(log.names))
        timed = names.time()
        return float(log.read([timed], rows=1)[timed][0] * names.factor("t", "s"))


def _check_time(where: Callable[[int], str], name: str, time: Array) -> None:
    """Refuse times that are missing or decrease."""
    gaps = np.flatnonzero(np.isnan(time))
    if len(gaps):
        raise InputError(
            f"{where(int(gaps[0]))}: column '{name}': expected a time, found none; every row"
            " needs one"
        )
    back = np.flatnonzero(np.diff(time) < 0)
    if len(back):
        i = int(back[0]) + 1
        raise InputError(
            f"{where(i)}: column '{name}': expected time that never decreases, found {time[i]:.9g}"
            f" s after {time[i - 1]:.9g} s; sort the rows or correct the clock"
        )


def _check_rate(path: Path, name: str, time: Array) -> None:
    """A unit that was forgotten shows in the rate."""
    steps = np.diff(time)
    steps = steps[steps > 0]
    if len(steps) and not _SHORTEST_STEP <= float(np.median(steps)) <= _LONGEST_STEP:
        raise InputError(
            f"{path}: column '{name}': expected a rate between {1 / _LONGEST_STEP:g} and"
            f" {1 / _SHORTEST_STEP:g} Hz, found steps of {np.median(steps):.3g} s; state the unit"
            f" of time under 'units', such as {{{name}: us}}"
        )
