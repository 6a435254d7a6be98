"""Derivatives of readings by border parameters: body, calibration parameters and what else is
shared by all of a motion.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array

ByParameters = Iterator[tuple[slice, Array]]
"""Where calibration parameters stand, and the derivative of n samples of k numbers by them, shape
(n, k, c)."""


def has_column(column_of: NDArray[np.intp], place: slice) -> bool:
    """Whether any of some systematic errors is in the border.

    Args:
        column_of: Column of each systematic error in the border; -1: not there; shape (u,).
        place: Of these.
    """
    return max(column_of[place].tolist(), default=-1) >= 0


class Border:
    """Derivatives by some of the border parameters, collected column by column."""

    def __init__(self, column_of: NDArray[np.intp], n: int, k: int) -> None:
        self._column_of, self._n, self._k = column_of, n, k
        self._columns: list[NDArray[np.intp]] = []
        self._values: list[Array] = []

    def put(self, place: slice | NDArray[np.intp], derivative: Array) -> None:
        """Derivative by systematic errors, shape (n, k, c); those that have no column are left
        out.
        """
        columns = self._column_of[place]
        use = columns >= 0
        if not use.any():
            return
        whole = (self._n, self._k, len(columns))
        if derivative.shape != whole:
            derivative = np.broadcast_to(derivative, whole)
        every = bool(use.all())
        self._columns.append(columns if every else columns[use])
        self._values.append(derivative if every else derivative[:, :, use])

    def extend(self, columns: NDArray[np.intp], derivative: Array) -> None:
        """Derivative by border parameters that are no systematic errors."""
        self._columns.append(columns)
        self._values.append(derivative)

    def collected(self) -> tuple[Array, NDArray[np.intp]]:
        """Derivatives, shape (n, k, c), and their columns, each once, shape (c,)."""
        if not self._columns:
            return np.zeros((self._n, self._k, 0)), np.zeros(0, dtype=np.intp)
        columns = np.concatenate(self._columns)
        unique = np.unique(columns)
        if len(unique) == len(columns):
            return np.concatenate(self._values, axis=2), columns
        # Few stand there twice: delays of two clocks that are one.
        found = np.zeros((self._n, self._k, len(unique)))
        for own, values in zip(self._columns, self._values, strict=True):
            place = np.searchsorted(unique, own)
            if len(own) and np.all(np.diff(place) == 1):
                found[:, :, place[0] : place[-1] + 1] += values
            else:
                for column, each in zip(place, np.moveaxis(values, 2, 0), strict=True):
                    found[:, :, column] += each
        return found, unique
