"""A stream as the columns of the contract."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.spatial.transform import Rotation

from steelyard.arrays import Array
from steelyard.instruments import Instrument
from steelyard.rotations import sign_continuous


def stream_columns(
    time: Array | None, values: Mapping[str, Array], instrument: Instrument, m: int
) -> dict[str, tuple[Array, str]]:
    """Columns of a stream in SI, in the order of its kind, and their units; shape (n,) each.

    Args:
        time: Column ``t`` [s], shape (n,); None: without it.
        values: Quantity -> vectors, shape (n, k), or rotations, shape (n, 3, 3); NaN where there is
            no sample.
        instrument: Whose stream it is.
        m: Number of cables.
    """
    columns = {} if time is None else {"t": (time, "s")}
    for quantity in instrument.quantities(m):
        if quantity.name not in values:
            continue
        numbers = values[quantity.name]
        form = next(
            (f for f in quantity.forms if quantity.rotation or len(f) == numbers.shape[1]),
            quantity.forms[0],
        )
        if quantity.rotation:
            numbers = _as_columns(numbers, form)
        unit = "1" if len(form) == 4 and quantity.rotation else quantity.unit
        columns.update({name: (numbers[:, i], unit) for i, name in enumerate(form)})
    return columns


def _as_columns(rotations: Array, form: tuple[str, ...]) -> Array:
    """Quaternions (w, x, y, z) without jumps of sign, the first with w >= 0, or roll, pitch, yaw
    [rad].

    Args:
        rotations: Matrices, NaN where there is no sample, shape (n, 3, 3).
        form: Columns.

    Returns:
        Shape (n, len(form)).
    """
    valid = np.isfinite(rotations).all(axis=(1, 2))
    values = np.full((len(rotations), len(form)), np.nan)
    turned = Rotation.from_matrix(rotations[valid])
    if len(form) == 4:
        values[valid] = sign_continuous(turned.as_quat(canonical=True, scalar_first=True))
    else:
        values[valid] = turned.as_euler("ZYX")[:, ::-1]
    return values
