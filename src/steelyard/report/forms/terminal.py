"""A document in a terminal: its result, its tables, its sentences; pictures belong to the page.

No number is ever cut: texts are broken between words, tables that are too wide are split between
columns, and where even one column is too wide its rows become blocks.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import chain, zip_longest

from rich.cells import cell_len
from rich.console import Console
from rich.text import Text

from steelyard.display import in_ascii, printable
from steelyard.report.blocks.document import Document, Grid, Statement, Statements, flat

_GAP = 2
"""Characters between columns."""
_LONGEST_WORD = 24
"""Characters; longer words (paths, names) may be broken where a column must be narrow."""
_SHORT = 12
"""Characters; texts up to this length are never broken, headings not where there is room."""
_STYLES = {"good": "green", "bad": "red", "note": "yellow", "": ""}
"""Tone of a statement -> style."""
_HELD = (" ± ", " +/- ", ") mm", ") kg")
"""What lines do not end at: a number stays beside its uncertainty and its unit."""


def show(document: Document) -> None:
    """Print to standard output: the result, then all tables, then all other sentences, so that what
    is to be done stands where a reader looks at last.

    As wide as ``COLUMNS`` says, else as the terminal; 80 characters where there is none.
    """
    screen = Console(highlight=False)
    plain = not screen.encoding.lower().startswith("utf")
    screen.print(_sentence(document.lead, screen.width, plain=plain))
    blocks = flat(block for section in document.sections for block in section.blocks)
    for block in blocks:
        if isinstance(block, Grid) and block.rows:
            screen.print()
            screen.print(drawn_grid(block, screen.width, plain=plain))
    said = [each for block in blocks if isinstance(block, Statements) for each in block.items]
    if said:
        screen.print()
    for each in said:
        screen.print(_sentence(each, screen.width, plain=plain))


def _sentence(statement: Statement, width: int, *, plain: bool) -> Text:
    text = _fitted(statement.text, plain=plain)
    return Text("\n".join(_wrapped(text, width)), style=_STYLES[statement.tone])


def _fitted(text: str, *, plain: bool) -> str:
    """In one line, of characters that the terminal has."""
    return in_ascii(printable(text)) if plain else printable(text)


def _wrapped(text: str, width: int) -> list[str]:
    """Lines of words."""
    for each in _HELD:
        text = text.replace(each, each.replace(" ", "\xa0"))
    lines = textwrap.wrap(text, width, break_on_hyphens=False)
    return [line.replace("\xa0", " ") for line in lines] or [""]


def drawn_grid(grid: Grid, width: int, *, plain: bool = False) -> Text:
    """A table for a terminal, in parts below each other where it is too wide.

    Args:
        grid: The whole one.
        width: Of the terminal [characters].
        plain: Whether the terminal has ASCII only.
    """
    grid = replace(
        grid,
        head=tuple(_fitted(cell, plain=plain) for cell in grid.head),
        rows=tuple(tuple(_fitted(cell, plain=plain) for cell in row) for row in grid.rows),
    )
    drawn = []
    if grid.caption:
        caption = _wrapped(_fitted(grid.caption, plain=plain), width)
        drawn.append(Text("\n".join(caption), style="bold"))
    for i, (columns, widths) in enumerate(_parts(grid, width)):
        if i:
            drawn.append(Text())
        if widths is None:
            drawn.append(_as_blocks(grid, columns, width))
        else:
            drawn += _as_table(grid, columns, widths, rule="-" if plain else "─")
    return Text("\n").join(drawn)


def _parts(grid: Grid, width: int) -> Iterator[tuple[Sequence[int], Sequence[int] | None]]:
    """Columns of the tables that a wide table is split into, the first as full as it can be, with
    their widths; no widths where even one column does not fit.
    """
    # Columns of words before the first numbers say what a row is about.
    names = list(range(grid.repeated or min(grid.right, default=0) or 1))
    groups: list[list[int]] = []
    for column in range(len(names), len(grid.head)):
        if column in grid.secondary and groups:
            groups[-1].append(column)
        else:
            groups.append([column])
    if not groups:
        yield names, _widths(grid, names, width)
    while groups:
        count = len(groups)
        while count > 1 and _widths(grid, [*names, *chain(*groups[:count])], width) is None:
            count -= 1
        columns = [*names, *chain(*groups[:count])]
        yield columns, _widths(grid, columns, width)
        groups = groups[count:]


def _widths(grid: Grid, columns: Sequence[int], width: int) -> list[int] | None:
    """Widths of columns on a line of the terminal; None where they do not fit."""
    spare = width - _GAP * (len(columns) - 1)
    least, wanted = [], []
    for column in columns:
        cells = [row[column] for row in grid.rows]
        longest = max(map(cell_len, cells), default=0)
        heading = max(map(cell_len, _heading(grid.head[column], 1)), default=0)
        if column not in grid.right:
            pieces = chain(
                *([cell] if cell_len(cell) <= _SHORT else cell.split() for cell in cells)
            )
            least.append(max(heading, min(max(map(cell_len, pieces), default=0), _LONGEST_WORD)))
        else:
            # Numbers are never broken.
            least.append(max(heading, longest))
        heading = max(map(cell_len, _heading(grid.head[column], _SHORT)))
        wanted.append(max(longest, heading, least[-1]))
    spare -= sum(least)
    if spare < 0:
        return None
    found = list(least)
    for _ in range(min(spare, sum(wanted) - sum(least))):
        lacking = [want - has for want, has in zip(wanted, found, strict=True)]
        found[lacking.index(max(lacking))] += 1
    return found


def _heading(text: str, width: int) -> list[str]:
    """Lines of a heading; methods may be broken at their hyphens."""
    held = text.replace("± 1", "±\xa01")
    lines = textwrap.wrap(held, width, break_long_words=False) or [""]
    return [line.replace("\xa0", " ") for line in lines]


def _as_table(
    grid: Grid, columns: Sequence[int], widths: Sequence[int], *, rule: str
) -> Iterator[Text]:
    """Lines of a table of some columns of given widths."""
    right = [column in grid.right for column in columns]
    heads = [_heading(grid.head[c], width) for c, width in zip(columns, widths, strict=True)]
    above = max(map(len, heads))
    yield from _row(
        [[""] * (above - len(h)) + h for h in heads], widths, right, ["bold"] * len(heads)
    )
    ruled = Text((" " * _GAP).join(rule * width for width in widths), style="dim")
    yield ruled
    for i, row in enumerate(grid.rows):
        styles = [
            "red" if (i, c) in grid.marked else "dim" if c in grid.secondary else ""
            for c in columns
        ]
        cells = [_wrapped(row[c], width) for c, width in zip(columns, widths, strict=True)]
        yield from _row(cells, widths, right, styles)
        if i in grid.ruled:
            yield ruled


def _row(
    cells: Sequence[Sequence[str]],
    widths: Sequence[int],
    right: Sequence[bool],
    styles: Sequence[str],
) -> Iterator[Text]:
    """Lines of a row, whose cells have one or several lines each; no blanks at the ends."""
    for texts in zip_longest(*cells, fillvalue=""):
        line, blanks = Text(), 0
        for text, width, is_number, style in zip(texts, widths, right, styles, strict=True):
            free = width - cell_len(text)
            if text:
                line.append(" " * (blanks + (free if is_number else 0)))
                line.append(text, style=style)
                blanks = _GAP + (0 if is_number else free)
            else:
                blanks += _GAP + width
        yield line


def _as_blocks(grid: Grid, columns: Sequence[int], width: int) -> Text:
    """Some columns as lines "heading: value", a block a row."""
    lines = []
    for row in grid.rows:
        for column in columns:
            if row[column]:
                head = f"{grid.head[column]}: " if grid.head[column] else ""
                first = "" if column == columns[0] else "  "
                lines += textwrap.wrap(
                    head + row[column], width, initial_indent=first, subsequent_indent="    "
                )
    return Text("\n".join(lines))
