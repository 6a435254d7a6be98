"""Tables of observations that belong to no motion: natural frequencies, dead weights on cells."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.instruments.weight import Weight


@dataclass(frozen=True, eq=False)
class SeenFrequencies:
    """Natural frequencies with which the platform has been seen to swing on cables of constant
    length.
    """

    run: str
    instrument: str
    row: int
    """Of the table, from 1."""
    pose: Array | None
    """x, y, z [m], roll, pitch, yaw [rad], shape (6,); None: the lengths are given."""
    lengths: Array | None
    """Of the cables, unstrained [m], shape (m,); None: the pose is given."""
    frequency: Array
    """Ascending [Hz], shape (k,)."""
    sigma: Array
    """1-sigma [Hz], shape (k,)."""
    noise: float | None
    """The same as it was stated of the table [Hz]; None: it was not."""


@dataclass(frozen=True, eq=False)
class DeadWeights:
    """Readings of single force sensors under dead weights, a table of a run."""

    run: str
    instrument: str
    description: Weight
    """Its entry under ``instruments``."""
    cable: NDArray[np.intp]
    """Number of the cable whose cell bears the weight, from 1, shape (n,)."""
    mass: Array
    """Of the weight [kg], shape (n,)."""
    reading: Array
    """Of the cell [N], NaN where there is none, shape (n,)."""

    @property
    def of(self) -> str:
        """The force instrument that it is about."""
        return self.description.of

    def __len__(self) -> int:
        return len(self.mass)

    def where(self, row: int) -> str:
        """A row by its number from 0, for messages."""
        return f"run '{self.run}': row {row + 1} of '{self.instrument}'"
