"""A document in a terminal: its result, its tables, its sentences; pictures belong to the page."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence
from itertools import chain

from rich.cells import cell_len
from rich.console import Console
from rich.table import Table
from rich.text import Text

from steelyard.display import printable
from steelyard.report.blocks.document import Document, Grid, Statement, Statements

_PIPED_WIDTH = 160
"""Characters; nothing is cut where a file or a pipe reads along."""
_FRAME = 3
"""Characters beside the text of a column."""
_SHORT_HEADING = 12
"""Characters; headings up to this length are never broken."""
_LONGEST_NAME = 40
"""Characters; names of rows up to this length are never broken."""
_STYLES = {"good": "green", "bad": "red", "note": "yellow", "": ""}
"""Tone of a statement -> style."""


def show(document: Document) -> None:
    """Print to standard output: the result, then all tables, then all other sentences, so that what
    is to be done stands where a reader looks at last.
    """
    screen = Console(highlight=False)
    if not screen.is_terminal:
        screen = Console(width=_PIPED_WIDTH, highlight=False)
    blocks = [block for section in document.sections for block in section.blocks]
    screen.print(_sentence(document.lead))
    for block in blocks:
        if isinstance(block, Grid) and block.rows:
            for columns in _parts(block, screen.width):
                screen.print(drawn_grid(block, columns))
    for block in blocks:
        if isinstance(block, Statements):
            for each in block.items:
                screen.print(_sentence(each))


def _sentence(statement: Statement) -> Text:
    return Text(printable(statement.text), style=_STYLES[statement.tone])


def _parts(grid: Grid, width: int) -> Iterator[Sequence[int]]:
    """Columns of the tables that a wide table is split into: as few tables as fit, and about as
    many columns in each.
    """
    if not grid.repeated:
        yield range(len(grid.head))
        return
    groups: list[list[int]] = []
    for column in range(grid.repeated, len(grid.head)):
        if column in grid.secondary:
            groups[-1].append(column)
        else:
            groups.append([column])
    names = list(range(grid.repeated))
    parts = [names]
    for count in range(1, len(groups) + 1):
        size = -(-len(groups) // count)
        starts = range(0, len(groups), size)
        chosen = [groups[start : start + size] for start in starts]
        parts = [[*names, *chain.from_iterable(each)] for each in chosen]
        if all(_width(grid, part) <= width for part in parts):
            break
    yield from parts


def _width(grid: Grid, columns: Sequence[int]) -> int:
    """Characters of a table whose headings are broken as :func:`_heading` does."""
    texts = 0
    for column in columns:
        lines = _heading(grid, column).split("\n")
        texts += max(cell_len(line) for line in lines + _cells(grid, column))
    return texts + _FRAME * len(columns) + 1


def _heading(grid: Grid, column: int) -> str:
    """A heading in lines about as long as what stands below it."""
    text = printable(grid.head[column])
    if not grid.repeated:
        return text
    longest = max((cell_len(each) for each in _cells(grid, column)), default=0)
    width = max(longest, _SHORT_HEADING)
    lines = textwrap.wrap(text, width, break_long_words=False, break_on_hyphens=False)
    return "\n".join(lines)


def _cells(grid: Grid, column: int) -> list[str]:
    return [printable(row[column]) for row in grid.rows]


def drawn_grid(grid: Grid, columns: Sequence[int] | None = None) -> Table:
    """A table for a terminal.

    Args:
        grid: The whole one.
        columns: Those that are drawn; None: all.
    """
    if columns is None:
        columns = range(len(grid.head))
    drawn = Table(
        title=Text(printable(grid.caption)),
        title_justify="left",
        title_style="bold",
        header_style="bold",
    )
    short = all(cell_len(name) <= _LONGEST_NAME for name in _cells(grid, 0))
    for column in columns:
        drawn.add_column(
            Text(_heading(grid, column)),
            justify="right" if column in grid.right else "left",
            style="dim" if column in grid.secondary else "",
            no_wrap=column == 0 and short,
        )
    for row, texts in enumerate(grid.rows):
        cells = []
        for column in columns:
            style = "red" if (row, column) in grid.marked else ""
            cells.append(Text(printable(texts[column]), style=style))
        drawn.add_row(*cells, end_section=row in grid.ruled)
    return drawn
