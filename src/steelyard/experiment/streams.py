"""From a table of numbers to the stream of an instrument: columns by name, SI units, axes as the contract has them."""

from __future__ import annotations

from collections.abc import Mapping, Set
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from steelyard.arrays import Array
from steelyard.errors import InputError
from steelyard.experiment.model import Stream
from steelyard.experiment.tables import read_columns, read_names
from steelyard.instruments import Instrument, Quantity
from steelyard.units import FACTORS

_UNIT_OF_ANGLE_FREE = "1"
_SHORTEST_STEP, _LONGEST_STEP = 1e-5, 10.0
"""Median time between samples of any instrument [s]."""
_LARGEST_SHEAR = 0.05
"""How far nine numbers may be from a rotation matrix; a log with few digits is well below, a wrong matrix far above."""


def read_stream(
    path: Path,
    instrument: Instrument,
    m: int,
    *,
    columns: Mapping[str, str],
    units: Mapping[str, str],
    static: bool,
    claimed: Set[str] = frozenset(),
) -> Stream:
    """Read the stream of an instrument.

    Args:
        path: Log file.
        instrument: What recorded it.
        m: Number of cables of the robot.
        columns: Names of the contract -> names in the log, where they differ.
        units: Names in the log (or of the contract) -> unit, where it differs from SI.
        static: Whether its rows are poses at rest, which need no time.
        claimed: Columns of this file that another instrument needs; an optional quantity that stands there is not this one's.

    Raises:
        InputError: A column is missing, a unit is unknown, a cell is no number, or time runs backwards.
    """
    present = read_names(path)
    needed = needed_columns(instrument, m, columns)
    free = [name for name in present if name in needed or name not in claimed]
    quantities = _present_quantities(path, instrument, m, columns, free)
    time_column = columns.get("t", "t")
    timed = not static or time_column in present
    if not static and time_column not in present:
        raise InputError(
            f"{path}: expected a column '{time_column}' with the time, found {_listed(present)}; name it under 'columns'"
        )
    wanted = {name: columns.get(name, name) for _, form in quantities for name in form}
    for name in columns:
        if name not in wanted and name != "t":
            raise InputError(
                f"{path}: 'columns': expected names of the kind '{instrument.kind}', found '{name}'; known here: {', '.join(wanted)}"
            )
    named = {*wanted, *wanted.values(), "t", time_column}
    for name in units:
        if name not in named:
            raise InputError(
                f"{path}: 'units': expected a column that is read, found '{name}'; known here: {', '.join(sorted(named))}"
            )
    table = read_columns(path, sorted({*wanted.values(), *([time_column] if timed and not static else [])}))
    n = len(next(iter(table.values())))

    def column(name: str, unit: str) -> Array:
        in_log = wanted.get(name, time_column)
        # Where axes are exchanged, a name of the contract may be another column of the log.
        given = units.get(in_log, unit if name in wanted.values() else units.get(name, unit))
        factors = FACTORS[unit]
        if given not in factors:
            raise InputError(
                f"{path}: unit of column '{in_log}': expected one of {', '.join(factors)}, found '{given}'; correct it"
            )
        return table[in_log] * factors[given]

    time = np.arange(n, dtype=np.float64) if static else column("t", "s")
    if not static:
        _check_time(path, time_column, time)
        _check_rate(path, time_column, time)
    values = {
        quantity.name: _rotations(path, form, [column(c, _column_unit(c, quantity)) for c in form])
        if quantity.rotation
        else np.column_stack([column(c, quantity.unit) for c in form])
        for quantity, form in quantities
    }
    return Stream(time, values, str(path))


def _column_unit(column: str, quantity: Quantity) -> str:
    """Angles have a unit; quaternions and matrices have none."""
    return quantity.unit if column in {"roll", "pitch", "yaw"} else _UNIT_OF_ANGLE_FREE


def _present_quantities(
    path: Path, instrument: Instrument, m: int, columns: Mapping[str, str], present: list[str]
) -> list[tuple[Quantity, tuple[str, ...]]]:
    """Which quantities a log has, and in which form."""
    found = []
    for quantity in instrument.quantities(m):
        have = {form: [c for c in form if columns.get(c, c) in present] for form in quantity.forms}
        complete = next((form for form in quantity.forms if len(have[form]) == len(form)), None)
        if complete:
            found.append((quantity, complete))
            continue
        partial = max(quantity.forms, key=lambda form: len(have[form]))
        if quantity.required or have[partial]:
            missing = [columns.get(c, c) for c in partial if c not in have[partial]]
            per_cable = f" for the {m} cables of the robot" if instrument.kind in {"tension", "length"} else ""
            other = " (or another form of the orientation)" if quantity.rotation and not have[partial] else ""
            raise InputError(
                f"{path}: expected columns {', '.join(columns.get(c, c) for c in partial)}{per_cable}{other}, found no "
                f"{', '.join(missing)} among {_listed(present)}; name them under 'columns'"
            )
    if not found:
        wanted = ", or ".join(" ".join(form) for q in instrument.quantities(m) for form in q.forms)
        raise InputError(
            f"{path}: expected at least one group of columns of kind '{instrument.kind}' ({wanted}), found {_listed(present)}; "
            "name them under 'columns'"
        )
    return found


def _check_time(path: Path, name: str, time: Array) -> None:
    gaps = np.flatnonzero(np.isnan(time))
    if len(gaps):
        raise InputError(f"{path}:{gaps[0] + 2}: column '{name}': expected a time, found none; every row needs one")
    back = np.flatnonzero(np.diff(time) < 0)
    if len(back):
        i = back[0] + 1
        raise InputError(
            f"{path}:{i + 2}: column '{name}': expected time that never decreases, found {time[i]:.9g} s after {time[i - 1]:.9g} s; "
            "sort the rows or correct the clock"
        )


def _check_rate(path: Path, name: str, time: Array) -> None:
    """A unit that was forgotten shows in the rate."""
    steps = np.diff(time)
    steps = steps[steps > 0]
    if len(steps) and not _SHORTEST_STEP <= float(np.median(steps)) <= _LONGEST_STEP:
        raise InputError(
            f"{path}: column '{name}': expected a rate between {1 / _LONGEST_STEP:g} and {1 / _SHORTEST_STEP:g} Hz, found steps of "
            f"{np.median(steps):.3g} s; state the unit of time under 'units', such as {{{name}: us}}"
        )


def _rotations(path: Path, form: tuple[str, ...], columns: list[Array]) -> Array:
    """Rotation matrices, shape (n, 3, 3), from any form of columns; NaN where a cell is empty."""
    raw = np.column_stack(columns)
    matrices = np.full((len(raw), 3, 3), np.nan)
    valid: NDArray[np.bool_] = np.asarray(np.isfinite(raw).all(axis=1))
    given = raw[valid]
    if len(form) == 3:
        matrices[valid] = Rotation.from_euler("ZYX", given[:, ::-1]).as_matrix()
    elif len(form) == 4:
        norm = np.linalg.norm(given, axis=1)
        _check_rotation(path, form, valid, np.abs(norm - 1), "unit quaternions")
        matrices[valid] = Rotation.from_quat(given, scalar_first=True).as_matrix()
    else:
        square = given.reshape(-1, 3, 3)
        shear = np.abs(square @ square.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2), initial=0.0)
        mirrored = np.where(np.linalg.det(square) > 0, 0.0, 1.0)
        _check_rotation(path, form, valid, shear + mirrored, "rotation matrices")
        # The nearest rotation: logs carry few digits.
        matrices[valid] = Rotation.from_matrix(square).as_matrix()
    return matrices


def _check_rotation(path: Path, form: tuple[str, ...], valid: NDArray[np.bool_], error: Array, what: str) -> None:
    wrong = np.flatnonzero(error > _LARGEST_SHEAR)
    if len(wrong):
        row = int(np.flatnonzero(valid)[wrong[0]])
        raise InputError(
            f"{path}:{row + 2}: columns {form[0]} to {form[-1]}: expected {what}, found one that is off by {error[wrong[0]]:.2g}; "
            "check the order and the signs of the columns"
        )


def _listed(names: list[str]) -> str:
    shown = ", ".join(name if len(name) <= 30 else name[:29] + "…" for name in names[:20])
    return (shown + (", …" if len(names) > 20 else "")) or "no columns"


def needed_columns(instrument: Instrument, m: int, columns: Mapping[str, str]) -> set[str]:
    """Columns of a log that an instrument cannot do without, in any of their forms."""
    return {columns.get(c, c) for q in instrument.quantities(m) if q.required for form in q.forms for c in form}
