"""A frame or arrays in memory as a log: named columns of numbers."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import InputError
from steelyard.experiment.recording import Stream
from steelyard.instruments import Instrument
from steelyard.logs.log import Log, RowRange

Frame: TypeAlias = Any
"""A frame of Polars or pandas, a mapping of names to arrays, a structured array of NumPy, or a
:class:`.Stream`."""

_NANOSECONDS = 1_000_000_000
"""In a second."""
_KINDS = "a frame of Polars or pandas, a mapping of names to arrays, or a structured array of NumPy"


def frame_log(place: str, frame: Frame, instruments: Iterable[Instrument], m: int) -> Log:
    """What was handed over as a log, which is read as a file would be.

    An array of several columns may stand under the name of a quantity of an instrument
    (``tension``, shape (n, m); ``orientation``, shape (n, 3, 3), (n, 4) or (n, 3)): its columns are
    then those of the contract. Under any other name its columns are ``name[0]``, ``name[1]``, ….

    Args:
        place: What it is called in messages.
        frame: What was handed over.
        instruments: Those that read it.
        m: Number of cables of the robot.

    Raises:
        InputError: It is nothing of the kind, a column holds no numbers, or lengths differ.
    """
    columns: dict[str, Array] = {}
    for name, values in _columns(place, frame).items():
        array = _numbers(f"{place}: column '{name}'", values)
        if array.ndim == 1:
            columns[name] = array
        else:
            flat = array.reshape(len(array), -1)
            columns |= dict(zip(_names(name, array, instruments, m), flat.T, strict=True))
    lengths = {name: len(column) for name, column in columns.items()}
    if len(set(lengths.values())) > 1:
        first = next(iter(lengths))
        other = next(name for name in lengths if lengths[name] != lengths[first])
        raise InputError(
            f"{place}: expected columns of one length, found {lengths[first]} rows of '{first}'"
            f" and {lengths[other]} of '{other}'; hand over what was recorded at other times as a"
            " stream of its own"
        )

    def load(names: Sequence[str], part: RowRange | None, rows: int | None) -> Mapping[str, Array]:
        use = slice(rows)
        chosen = {name: columns[name][use] for name in names}
        if part is not None:
            by = columns[part.column][use]
            inside = (by >= part.start) & (by <= part.end)
            chosen = {name: column[inside] for name, column in chosen.items()}
        return chosen

    return Log(Path(place), tuple(columns), load)


def _columns(place: str, frame: Frame) -> dict[str, Any]:
    """Name -> column of whatever was handed over."""
    import polars as pl

    from steelyard.logs.frames import as_array

    if isinstance(frame, Stream):
        return {"t": frame.time, **frame.values}
    if isinstance(frame, pl.LazyFrame):
        frame = frame.collect()
    if isinstance(frame, pl.DataFrame):
        numeric = (pl.Array, pl.List)
        return {
            each.name: each.to_list()
            if isinstance(each.dtype, numeric)
            else _of_polars(place, each, as_array)
            for each in frame.iter_columns()
        }
    if isinstance(frame, Mapping):
        return {str(name): values for name, values in frame.items()}
    if isinstance(frame, np.ndarray) and frame.dtype.names:
        return {name: frame[name] for name in frame.dtype.names}
    # Only who has it loaded can have handed one over.
    pandas = sys.modules.get("pandas")
    if pandas is not None and isinstance(frame, pandas.DataFrame):
        return {str(name): frame[name] for name in frame.columns}
    raise InputError(
        f"{place}: expected {_KINDS}, found {type(frame).__name__}; name its columns as those of"
        " the kind of the instrument"
    )


def _of_polars(place: str, column: Any, as_array: Any) -> Array:
    """A column of Polars; text is no number, whatever it looks like."""
    import polars as pl

    if column.dtype == pl.String or column.dtype == pl.Object:
        raise InputError(
            f"{place}: column '{column.name}': expected numbers, found {column.dtype}; convert it,"
            " or leave it out"
        )
    return np.asarray(as_array(column))


def _numbers(place: str, values: Any) -> Array:
    """Numbers, instants [s since 1970] or durations [s], NaN where there is none; shape (n, …).

    Raises:
        InputError: They are none.
    """
    pandas = sys.modules.get("pandas")
    if pandas is not None and isinstance(values, pandas.Series):
        dtype = values.dtype
        if getattr(dtype, "tz", None) is not None:
            values = values.dt.tz_convert("UTC").dt.tz_localize(None)
        values = (
            values.to_numpy()
            if dtype.kind in "Mm"
            else values.to_numpy(dtype=None if dtype.kind == "O" else np.float64, na_value=np.nan)
        )
    if isinstance(values, np.ma.MaskedArray):
        values = np.ma.filled(values.astype(np.float64), np.nan)
    try:
        array = np.asarray(values)
        if array.dtype.kind in "Mm":
            return _seconds(array)
        if array.dtype.kind in "USO" and any(isinstance(each, str) for each in array.flat):
            raise ValueError
        array = array.astype(np.float64)
    except (TypeError, ValueError):
        raise InputError(
            f"{place}: expected numbers, found {_type_of(values)}; convert it, or leave it out"
        ) from None
    if array.ndim == 0:
        raise InputError(
            f"{place}: expected one number for each sample, found a single one; hand over an array"
        )
    return array


def _type_of(values: Any) -> str:
    """What something is, in a word."""
    first = next((each for each in np.ravel(np.asarray(values, dtype=object))), None)
    return f"'{first}'" if isinstance(first, str) else type(first).__name__


def _seconds(array: Any) -> Array:
    """Instants or durations of NumPy; NaN where there is none."""
    kind = "datetime64[ns]" if array.dtype.kind == "M" else "timedelta64[ns]"
    ticks = array.astype(kind).astype(np.int64)
    # As one number, nanoseconds since 1970 would be rounded before they are divided.
    whole, rest = np.divmod(ticks, _NANOSECONDS)
    return np.where(np.isnat(array), np.nan, whole + rest / _NANOSECONDS)


def _names(name: str, array: Array, instruments: Iterable[Instrument], m: int) -> Sequence[str]:
    """Names of the columns of an array of several."""
    size = array[0].size if len(array) else int(np.prod(array.shape[1:]))
    for instrument in instruments:
        for quantity in instrument.quantities(m):
            form = next((f for f in quantity.forms if len(f) == size), None)
            if quantity.name == name and form is not None:
                return form
    return [f"{name}[{i}]" for i in range(size)]
