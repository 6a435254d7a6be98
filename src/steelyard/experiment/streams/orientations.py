"""Rotation matrices from the columns of a log: angles, quaternions or nine numbers."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from steelyard.arrays import Array
from steelyard.errors import InputError

_BLOCK = 1 << 14
"""Rows that are turned to rotations at once."""
_LARGEST_SHEAR = 0.05
"""How far nine numbers may be from a rotation matrix; a log with few digits is well below, a wrong
matrix far above."""


def rotations_of(where: Callable[[int], str], form: tuple[str, ...], raw: Array) -> Array:
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


def off_rotation(raw: Array) -> Array:
    """How far quaternions, shape (n, 4), or matrices, shape (n, 9), are from rotations, shape
    (n,).
    """
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
