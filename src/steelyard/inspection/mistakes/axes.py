"""Ways to exchange axes and signs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import permutations, product

import numpy as np

from steelyard.arrays import Array
from steelyard.inspection.mistakes.amendment import AXES, SIMPLE, columns_key, scale_key

_EACH = 0.1
"""What each axis that is moved or turned round costs beyond a simple mistake."""


@dataclass(frozen=True, eq=False)
class AxisChange:
    """Axes exchanged and turned round."""

    matrix: Array
    """What is true is this times what was read, shape (k, k)."""
    order: tuple[int, ...]
    signs: tuple[int, ...]
    proper: bool
    """Whether it is a rotation."""

    @property
    def keeps_order(self) -> bool:
        """Whether only signs change."""
        return self.order == tuple(range(len(self.order)))

    @property
    def kind(self) -> str:
        """What sort of mistake it takes back."""
        return "sign of an axis" if self.keeps_order else "order of axes"

    @property
    def cost(self) -> float:
        """A sign or two axes are simple, the rest is not."""
        moved = sum(i != k for i, k in enumerate(self.order))
        flipped = sum(s < 0 for s in self.signs)
        return SIMPLE + _EACH * moved + _EACH * flipped

    @property
    def words(self) -> str:
        """Where the axes go."""
        parts = []
        for i, k in enumerate(self.order):
            sign = "-" if self.signs[i] < 0 else ""
            parts.append(f"{AXES[i]} = {sign}{AXES[k]}")
        return ", ".join(parts)

    @property
    def angle(self) -> int:
        """Of a rotation [deg]."""
        cosine = np.clip((np.trace(self.matrix) - 1) / 2, -1, 1)
        return round(float(np.degrees(np.arccos(cosine))))

    def of_columns(self, names: Sequence[str]) -> tuple[str, tuple[str, ...]]:
        """The mistake of columns in words, and the keys of the instrument that take it back.

        Args:
            names: Of k columns.
        """
        exchanged = {names[i]: names[k] for i, k in enumerate(self.order) if i != k}
        flipped = [names[k] for i, k in enumerate(self.order) if self.signs[i] < 0]
        words, keys = [], []
        if exchanged:
            words.append(f"{', '.join(sorted(exchanged))} are exchanged (sign or order of axes)")
            keys.append(columns_key(exchanged))
        if flipped:
            have = "has" if len(flipped) == 1 else "have"
            words.append(f"{', '.join(flipped)} {have} the wrong sign")
            turned = {names[i]: -1.0 for i, sign in enumerate(self.signs) if sign < 0}
            keys.append(scale_key(turned))
        return " and ".join(words), tuple(keys)


@cache
def axis_changes(k: int = 3) -> tuple[AxisChange, ...]:
    """All ways to exchange k axes and signs, but for none; the simple ones first."""
    found = []
    for order in permutations(range(k)):
        for signs in product((1, -1), repeat=k):
            matrix = np.zeros((k, k))
            matrix[np.arange(k), list(order)] = signs
            if not np.array_equal(matrix, np.eye(k)):
                proper = bool(np.linalg.det(matrix) > 0)
                found.append(AxisChange(matrix, order, signs, proper))
    return tuple(sorted(found, key=lambda change: change.cost))


def rotations_by_right_angles() -> list[AxisChange]:
    """Those that a rigid body can be turned by."""
    return [change for change in axis_changes() if change.proper]
