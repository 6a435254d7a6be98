"""From a table of numbers to the stream of an instrument: columns by name, SI units, axes as the
contract has them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence, Set
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from steelyard.arrays import Array
from steelyard.errors import InputError
from steelyard.experiment.fields import column_in
from steelyard.experiment.model import Stream
from steelyard.instruments import Instrument, Quantity
from steelyard.logs.formats import open_log
from steelyard.logs.log import Log, RowRange
from steelyard.units import FACTORS, canonical_unit

_UNIT_OF_NO_ANGLE = "1"
_BLOCK = 1 << 14
"""Rows that are turned to rotations at once."""
_SHORTEST_STEP, _LONGEST_STEP = 1e-5, 10.0
"""Median time between samples of any instrument [s]."""
_LARGEST_SHEAR = 0.05
"""How far nine numbers may be from a rotation matrix; a log with few digits is well below, a wrong
matrix far above."""


@dataclass(frozen=True)
class StreamPlace:
    """Where the stream of an instrument is, and how its log writes it."""

    path: Path
    """Of the log."""
    topic: str | None = None
    """Of a log that holds several."""
    columns: Mapping[str, str] = field(default_factory=dict)
    """Names of the contract -> names in the log, where they differ."""
    units: Mapping[str, str] = field(default_factory=dict)
    """Names in the log (or of the contract) -> unit, where neither SI nor what the log itself
    states."""
    scale: Mapping[str, float] = field(default_factory=dict)
    """The same -> what they are multiplied by, after their unit."""
    log: Log | None = None
    """Where it is no file: what has been handed over in memory."""

    def opened(self) -> AbstractContextManager[Log]:
        """The log, open for reading.

        Raises:
            InputError: It cannot be opened.
        """
        return open_log(self.path, self.topic) if self.log is None else nullcontext(self.log)

    def of_all_runs(self, instrument: Instrument) -> StreamPlace:
        """With the columns that the instrument says are exchanged in all runs."""
        exchanged = {c: self.columns.get(name, name) for c, name in instrument.columns}
        return replace(self, columns={**self.columns, **exchanged})


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
        place = _as_named(log, place)
        claimed = {log.spellings.get(name, name) for name in claimed}
        needed = needed_columns(instrument, m, place.columns)
        names = _Names(
            log, place, [name for name in log.names if name in needed or name not in claimed]
        )
        quantities, unread = _present_quantities(names, instrument, m), instrument.unread
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
        values[quantity.name] = _rotations(where, form, raw) if quantity.rotation else raw
        if quantity.rotation and len(form) == 3:
            angles[quantity.name] = raw
        elif quantity.rotation and not static:
            off[quantity.name] = _off_rotation(raw)
    return Stream(time, values, str(path), angles, forms, str(path), off)


def stream_of_columns(
    name: str, instrument: Instrument, m: int, time: Array, columns: Mapping[str, Array]
) -> Stream:
    """The stream of an instrument whose columns are those of the contract in SI.

    Args:
        name: Of the instrument, for messages.
        instrument: What recorded it.
        m: Number of cables of the robot.
        time: [s], shape (n,).
        columns: Column -> values, NaN where there is no sample, shape (n,) each.

    Raises:
        InputError: A column is missing or unknown, or a rotation is none.
    """

    def where(row: int) -> str:
        return f"{name}, sample {row + 1}"

    left, values = set(columns), dict[str, Array]()
    for quantity in instrument.quantities(m):
        for form in quantity.forms:
            there = [c for c in form if c in columns or c in instrument.unread]
            if len(there) == len(form):
                nothing = np.full(len(time), np.nan)
                raw = np.column_stack([columns.get(c, nothing) for c in form])
                values[quantity.name] = _rotations(where, form, raw) if quantity.rotation else raw
                left -= set(form)
                break
        else:
            if quantity.required:
                raise InputError(
                    f"{name}: expected columns {', '.join(quantity.forms[0])}, found"
                    f" {_listed(sorted(columns))}; name them as the kind '{instrument.kind}' does"
                )
    if left or not values:
        raise InputError(
            f"{name}: expected columns of the kind '{instrument.kind}', found"
            f" {_listed(sorted(left))}; leave out what it does not have"
        )
    return Stream(time, values, name)


def first_time(place: StreamPlace) -> float:
    """Time of the first row of a log, on its own clock [s].

    Raises:
        InputError: See :func:`read_stream`.
    """
    with place.opened() as log:
        names = _Names(log, _as_named(log, place), list(log.names))
        timed = names.time()
        return float(log.read([timed], rows=1)[timed][0] * names.factor("t", "s"))


def _as_named(log: Log, place: StreamPlace) -> StreamPlace:
    """A place whose columns are called as the log calls them, not as it spells them."""
    columns = {column: log.spellings.get(name, name) for column, name in place.columns.items()}
    units = {log.spellings.get(name, name): unit for name, unit in place.units.items()}
    return replace(place, columns=columns, units=units)


class _Names:
    """Columns of the contract in one log."""

    def __init__(self, log: Log, place: StreamPlace, free: Sequence[str]) -> None:
        self.log, self.place = log, place
        self.free = dict.fromkeys(free)

    def of(self, column: str) -> str | None:
        """Name in the log of a column of the contract; None where it is not there."""
        return column_in(
            self.log.names if column == "t" else self.free, column, self.place.columns.get(column)
        )

    def time(self) -> str:
        """Name in the log of the column with the time.

        Raises:
            InputError: There is none.
        """
        found = self.of("t")
        if found is None:
            raise InputError(
                f"{self.log.path}: expected a column '{self.asked('t')}' with the time, found"
                f" {_listed(self.log.names)}; name it under 'columns'"
            )
        return found

    def asked(self, column: str) -> str:
        """What the experiment file calls it."""
        return self.place.columns.get(column, column)

    def check(self, contract: Sequence[str], kind: str) -> None:
        """See that ``columns`` and ``units`` speak of columns that are read."""
        path = self.log.path
        for name in self.place.columns:
            if name not in contract and name != "t":
                raise InputError(
                    f"{path}: 'columns': expected names of the kind '{kind}', found '{name}'; known"
                    f" here: {', '.join(contract)}"
                )
        named = {
            name
            for c in (*contract, "t")
            for name in (c, self.asked(c), self.of(c))
            if name is not None
        }
        for key, stated in (("units", self.place.units), ("scale", self.place.scale)):
            for name in stated:
                if name not in named:
                    raise InputError(
                        f"{path}: '{key}': expected a column that is read, found '{name}'; known"
                        f" here: {', '.join(sorted(named))}"
                    )

    def scale(self, column: str) -> float:
        """What a column of the contract is multiplied by, after its unit."""
        scale, in_log = self.place.scale, str(self.of(column))
        return scale.get(in_log, scale.get(self.asked(column), scale.get(column, 1.0)))

    def factor(self, column: str, unit: str) -> float:
        """From the unit of a column in the log to an SI unit."""
        units, in_log = self.place.units, str(self.of(column))
        # Where axes are exchanged, a name of the contract may be another column of the log.
        taken = column in {self.of(c) for c in self.place.columns} and self.of(column) != column
        stated = units.get(
            in_log, units.get(self.asked(column), None if taken else units.get(column))
        )
        given = stated if stated is not None else self.log.units.get(in_log, unit)
        factors = FACTORS[unit]
        known = given if given in factors else canonical_unit(given)
        if known not in factors:
            cure = (
                "correct it"
                if stated is not None
                else "the log says so itself; state the right one under 'units'"
            )
            raise InputError(
                f"{self.log.path}: unit of column '{in_log}': expected one of {', '.join(factors)},"
                f" found '{given}'; {cure}"
            )
        return factors[known]


def _present_quantities(
    names: _Names, instrument: Instrument, m: int
) -> list[tuple[Quantity, tuple[str, ...]]]:
    """Which quantities a log has, and in which form."""
    found = []
    path, present = names.log.path, list(names.free)
    for quantity in instrument.quantities(m):
        have = {
            form: [c for c in form if c in instrument.unread or names.of(c) is not None]
            for form in quantity.forms
        }
        complete = next((form for form in quantity.forms if len(have[form]) == len(form)), None)
        if complete:
            found.append((quantity, complete))
            continue
        partial = max(quantity.forms, key=lambda form: len(have[form]))
        if quantity.required or have[partial] or any(c in names.place.columns for c in partial):
            missing = [names.asked(c) for c in partial if c not in have[partial]]
            per_cable = f" for the {m} cables of the robot" if instrument.per_cable else ""
            other = (
                " (or another form of the orientation)"
                if quantity.rotation and not have[partial]
                else ""
            )
            raise InputError(
                f"{path}: expected columns"
                f" {', '.join(names.asked(c) for c in partial)}{per_cable}{other}, found no"
                f" {', '.join(missing)} among {_listed(present)}; name them under 'columns'"
            )
    if not found:
        wanted = ", or ".join(" ".join(form) for q in instrument.quantities(m) for form in q.forms)
        raise InputError(
            f"{path}: expected at least one group of columns of kind '{instrument.kind}'"
            f" ({wanted}), found {_listed(present)}; name them under 'columns'"
        )
    return found


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


def _rotations(where: Callable[[int], str], form: tuple[str, ...], raw: Array) -> Array:
    """Rotation matrices, shape (n, 3, 3), from any form of columns, shape (n, k); NaN where a cell
    is empty.
    """
    matrices = np.full((len(raw), 3, 3), np.nan)
    # A few rows at a time: what an hour of them needs in between is a multiple of what comes out.
    for first in range(0, len(raw), _BLOCK):
        block = raw[first : first + _BLOCK]
        rows = np.flatnonzero(np.isfinite(block).all(axis=1))
        given = block[rows]
        if len(form) == 3:
            turned = Rotation.from_euler("ZYX", given[:, ::-1])
        elif len(form) == 4:
            norm = np.linalg.norm(given, axis=1)
            _check_rotation(where, form, first + rows, np.abs(norm - 1), "unit quaternions")
            turned = Rotation.from_quat(given, scalar_first=True)
        else:
            square = given.reshape(-1, 3, 3)
            shear = np.abs(square @ square.transpose(0, 2, 1) - np.eye(3)).max(
                axis=(1, 2), initial=0.0
            )
            mirrored = np.where(np.linalg.det(square) > 0, 0.0, 1.0)
            _check_rotation(where, form, first + rows, shear + mirrored, "rotation matrices")
            # The nearest rotation: logs carry few digits.
            turned = Rotation.from_matrix(square)
        matrices[first + rows] = turned.as_matrix()
    return matrices


def _off_rotation(raw: Array) -> Array:
    """How far quaternions, shape (n, 4), or matrices, shape (n, 9), are from rotations, shape (n,)."""
    if raw.shape[1] == 4:
        return np.asarray(np.abs(np.linalg.norm(raw, axis=1) - 1))
    off = np.empty(len(raw))
    for first in range(0, len(raw), _BLOCK):
        square = raw[first : first + _BLOCK].reshape(-1, 3, 3)
        product = square @ square.transpose(0, 2, 1)
        off[first : first + _BLOCK] = np.abs(product - np.eye(3)).max(axis=(1, 2))
    return off


def _check_rotation(
    where: Callable[[int], str],
    form: tuple[str, ...],
    rows: NDArray[np.intp],
    error: Array,
    what: str,
) -> None:
    """Refuse rotations that are further off than few digits make them."""
    wrong = np.flatnonzero(error > _LARGEST_SHEAR)
    if len(wrong):
        raise InputError(
            f"{where(int(rows[wrong[0]]))}: columns {form[0]} to {form[-1]}: expected {what}, found"
            f" one that is off by {error[wrong[0]]:.2g}; check the order and the signs of the"
            " columns"
        )


def _listed(names: Sequence[str]) -> str:
    shown = ", ".join(name if len(name) <= 30 else name[:29] + "…" for name in names[:20])
    return (shown + (", …" if len(names) > 20 else "")) or "no columns"


def needed_columns(instrument: Instrument, m: int, columns: Mapping[str, str]) -> set[str]:
    """Columns of a log that an instrument cannot do without, in any of their forms."""
    return {
        columns.get(c, c)
        for q in instrument.quantities(m)
        if q.required
        for form in q.forms
        for c in form
        if c not in instrument.unread
    }
