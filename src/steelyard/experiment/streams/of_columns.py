"""From columns as the contract has them, which nobody has to look for, to the stream of an
instrument.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import InputError
from steelyard.experiment.recording import Stream
from steelyard.experiment.streams.log_columns import listed
from steelyard.experiment.streams.orientations import rotations_of
from steelyard.instruments import Instrument


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
                values[quantity.name] = rotations_of(where, form, raw) if quantity.rotation else raw
                left -= set(form)
                break
        else:
            if quantity.required:
                raise InputError(
                    f"{name}: expected columns {', '.join(quantity.forms[0])}, found"
                    f" {listed(sorted(columns))}; name them as the kind '{instrument.kind}' does"
                )
    if left or not values:
        raise InputError(
            f"{name}: expected columns of the kind '{instrument.kind}', found"
            f" {listed(sorted(left))}; leave out what it does not have"
        )
    return Stream(time, values, name)
