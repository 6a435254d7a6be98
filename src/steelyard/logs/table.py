"""Columns of numbers side by side."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from steelyard.arrays import Array


class Table(Mapping[str, Array]):
    """Columns of numbers in one array, so that those of one quantity need no copy to stand side by
    side.
    """

    def __init__(self, names: Sequence[str], cells: Array) -> None:
        self.cells = cells
        """Shape (n, k)."""
        self._places = {name: j for j, name in enumerate(names)}

    def __getitem__(self, name: str) -> Array:
        return self.cells[:, self._places[name]]

    def __iter__(self) -> Iterator[str]:
        return iter(self._places)

    def __len__(self) -> int:
        return len(self._places)

    def beside(self, names: Sequence[str]) -> Array:
        """Columns side by side, shape (n, k): a view where they are neighbours."""
        places = [self._places[name] for name in names]
        first, last = places[0], places[-1]
        return (
            self.cells[:, first : last + 1]
            if places == [*range(first, last + 1)]
            else self.cells[:, places]
        )


def table_of(columns: Mapping[str, Array]) -> Table:
    """Columns of one length, shape (n,) each, as a table."""
    n = len(next(iter(columns.values()), ()))
    cells = np.empty((n, len(columns)))
    for j, column in enumerate(columns.values()):
        cells[:, j] = column
    return Table([*columns], cells)
