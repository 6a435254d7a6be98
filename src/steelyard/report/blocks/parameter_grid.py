"""The ten parameters of a body as a table: the one shape that every report of them has."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from steelyard.digits import LABELS, SHORT_LABELS
from steelyard.report.blocks.document import Grid

_NAMES = ("", "unit")
_LAST_OF_GROUP = frozenset({0, 3})
"""Mass, centre of gravity and inertia are three groups of rows."""


@dataclass(frozen=True)
class ParameterTexts:
    """A column: a text for each of the ten."""

    heading: str
    texts: Sequence[str]
    secondary: bool = False
    """Whether it belongs to the column before."""
    right: bool = True
    """Whether these are numbers."""
    marked: Sequence[bool] = (False,) * len(LABELS)
    """Which of them a reader should look at."""


def parameter_grid(caption: str, columns: Sequence[ParameterTexts]) -> Grid:
    """A table of ten rows.

    Args:
        caption: What it shows.
        columns: Beside the names and units of the ten.
    """
    first = len(_NAMES)
    rows = [[name, unit] for name, (_, unit, _) in zip(SHORT_LABELS, LABELS, strict=True)]
    right, secondary, marked = set(), set(), set()
    for place, column in enumerate(columns, start=first):
        for row, text in enumerate(column.texts):
            rows[row].append(text)
            if column.marked[row]:
                marked.add((row, place))
        if column.right:
            right.add(place)
        if column.secondary:
            secondary.add(place)
    return Grid(
        caption,
        (*_NAMES, *(column.heading for column in columns)),
        tuple(tuple(row) for row in rows),
        right=frozenset(right),
        repeated=first,
        secondary=frozenset(secondary),
        ruled=_LAST_OF_GROUP,
        marked=frozenset(marked),
    )
