"""What a report says, as plain values that every form of it (HTML, Markdown, terminal) is drawn
from; nothing is computed after this.

All text is as people read it; the forms escape it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

from steelyard.arrays import Array

Tone = Literal["", "good", "bad", "note"]
"""How a statement is meant: for a colour and a sign beside it, never the only carrier of its
meaning."""


@dataclass(frozen=True)
class Statement:
    """One sentence or a few."""

    text: str
    tone: Tone = ""


@dataclass(frozen=True)
class Statements:
    """Sentences one below the other."""

    items: tuple[Statement, ...]


@dataclass(frozen=True)
class Grid:
    """A table of text."""

    caption: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    """Each as long as the head; the first cell names the row."""
    right: frozenset[int] = frozenset()
    """Columns of numbers."""
    repeated: int = 0
    """How many of the first columns stand in every part of a table that is too wide for a terminal;
    0: those before the first numbers."""
    secondary: frozenset[int] = frozenset()
    """Columns that stay beside the one before them and matter less."""
    ruled: frozenset[int] = frozenset()
    """Rows that a line is drawn under."""
    marked: frozenset[tuple[int, int]] = frozenset()
    """Row and column of cells that a reader should look at."""


@dataclass(frozen=True, eq=False)
class Narrow:
    """What is different about a picture in a narrow window."""

    layout: Mapping[str, Any]
    height: int
    """[px]"""


@dataclass(frozen=True, eq=False)
class Figure:
    """A picture for Plotly."""

    name: str
    """Unlike the others'; of letters, digits and hyphens."""
    title: str
    alternative: str
    """What it shows, for those who do not see it."""
    data: tuple[Mapping[str, Any], ...]
    """Traces, without colours where the order of the palette will do: plain values, NaN as None.
    Text in them is not yet escaped."""
    layout: Mapping[str, Any]
    """Axes and their titles; colours, fonts and margins belong to the page."""
    height: int = 360
    """[px]"""
    narrow: Narrow | None = None
    """None: the same."""


@dataclass(frozen=True, eq=False)
class Replay:
    """A motion to replay, n instants."""

    name: str
    time: Array
    """[s], shape (n,)."""
    position: Array
    """Of the platform origin in the world [m], shape (n, 3)."""
    rotation: Array
    """Quaternion (w, x, y, z) of R_world_platform, shape (n, 4)."""


@dataclass(frozen=True, eq=False)
class Scene:
    """A 3-D view that can be turned and, where there are courses, replayed.

    Traces of ``figure.data`` may have ``meta: {"moves": [true, false, …]}``, a flag per point:
    points that move are given in the platform frame, the others in the world frame.
    """

    figure: Figure
    courses: tuple[Replay, ...] = ()
    """None: all points are drawn as they are given."""


@dataclass(frozen=True, eq=False)
class Fold:
    """Blocks that a page shows on request."""

    title: str
    blocks: tuple[Block, ...]


@dataclass(frozen=True, eq=False)
class OneOf:
    """Blocks of which a page shows those of one run at a time; all choices of a page that know it
    follow.
    """

    label: str
    """What is chosen."""
    options: tuple[tuple[str, tuple[Block, ...]], ...]
    """Name and blocks of each."""


Block: TypeAlias = "Statements | Grid | Figure | Scene | Fold | OneOf"


def by_choice(label: str, options: Sequence[tuple[str, tuple[Block, ...]]]) -> list[Block]:
    """Blocks of one run as they are, those of several as a choice."""
    if len(options) < 2:
        return [block for _, blocks in options for block in blocks]
    return [OneOf(label, tuple(options))]


def flat(blocks: Iterable[Block]) -> list[Block]:
    """All blocks with those within others in their places."""
    found: list[Block] = []
    for block in blocks:
        if isinstance(block, Fold):
            found += flat(block.blocks)
        elif isinstance(block, OneOf):
            for _, inner in block.options:
                found += flat(inner)
        else:
            found.append(block)
    return found


@dataclass(frozen=True, eq=False)
class Section:
    """Blocks under one heading."""

    name: str
    """Unlike the others'; of letters, digits and hyphens."""
    title: str
    blocks: tuple[Block, ...]


@dataclass(frozen=True, eq=False)
class Document:
    """A whole report."""

    title: str
    lead: Statement
    """The result in one sentence."""
    sections: tuple[Section, ...]
    one_page: bool = False
    """Whether it is set closely where it is printed, so that it needs no second sheet."""
    facts: tuple[tuple[str, str], ...] = ()
    """What stands under the title: project, operator, date."""
