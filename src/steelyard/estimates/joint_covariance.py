"""What estimates of several loads from one fit share: their joint covariance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array
from steelyard.inertia import TEN


@dataclass(frozen=True, eq=False)
class JointCovariance:
    """Covariance of the ten-vectors of several loads."""

    loads: tuple[str, ...]
    """Their names."""
    matrix: Array
    """Over the ten of :data:`steelyard.inertia.BODY_PARAMETERS` of each load, one load after the
    other; NaN where one is not identifiable, shape (10 l, 10 l)."""

    def of_pair(self, first: str, second: str) -> Array:
        """Of two of them, shape (20, 20).

        Args:
            first: Name of a load.
            second: Name of another one.
        """
        use = [np.arange(TEN) + TEN * self.loads.index(name) for name in (first, second)]
        columns = np.concatenate(use)
        return np.asarray(self.matrix[np.ix_(columns, columns)])
