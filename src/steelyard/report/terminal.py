"""The summary as tables in a terminal."""

from __future__ import annotations

from collections.abc import Iterator

from rich.console import Console
from rich.table import Table as RichTable
from rich.text import Text

from steelyard.digits import LABELS, number
from steelyard.report.document import Grid
from steelyard.report.summary import Column, Summary, Table, cell

_PIPED_WIDTH = 160
_COLUMNS_AT_ONCE = 5


def console() -> Console:
    """Standard output; nothing is cut where a file or a pipe reads along."""
    found = Console(highlight=False)
    return found if found.is_terminal else Console(width=_PIPED_WIDTH, highlight=False)


def drawn_grid(grid: Grid, *, whole_names: bool = False) -> RichTable:
    """A table of text for a terminal.

    Args:
        grid: The table.
        whole_names: Whether the first column is never broken.
    """
    drawn = RichTable(
        title=Text(grid.caption), title_justify="left", title_style="bold", header_style="bold"
    )
    for i, heading in enumerate(grid.head):
        drawn.add_column(
            Text(heading),
            justify="right" if i in grid.right else "left",
            no_wrap=whole_names and i == 0,
        )
    for row in grid.rows:
        drawn.add_row(*(Text(each) for each in row))
    return drawn


def show(summary: Summary, *, each_run: bool = True) -> None:
    """Print to standard output."""
    screen = console()
    for table in (summary.table, *(summary.runs if each_run else ())):
        for part in _parts(table):
            screen.print(_drawn(part))
    for text in summary.statements:
        style = (
            "red" if ": not accepted" in text else "green" if text.endswith(": accepted") else ""
        )
        screen.print(Text(text, style=style))


def _parts(table: Table) -> Iterator[Table]:
    # As many as fit, and about as many in each.
    count = (
        -(-len(table.columns) // -(-len(table.columns) // _COLUMNS_AT_ONCE)) if table.columns else 1
    )
    for start in range(0, len(table.columns), count):
        yield Table(table.title, table.columns[start : start + count])


def _drawn(table: Table) -> RichTable:
    drawn = RichTable(
        title=Text(table.title), title_justify="left", title_style="bold", header_style="bold"
    )
    drawn.add_column("")
    drawn.add_column("unit")
    with_errors = [c.errors is not None for c in table.columns]
    for column, errors in zip(table.columns, with_errors, strict=True):
        drawn.add_column(Text(column.heading), justify="right")
        if errors:
            drawn.add_column("error", justify="right", style="dim")
    for row, (label, unit, _) in enumerate(LABELS):
        cells: list[str] = []
        for column in table.columns:
            cells.append(cell(column, row))
            if column.errors is not None:
                cells.append(_error(column, row))
        drawn.add_row(label, unit, *cells, end_section=row in (0, 3))
    return drawn


def _error(column: Column, row: int) -> str:
    assert column.errors is not None
    error = column.errors[row]
    deviation = column.deviations[row] if column.deviations else None
    text = number(error, deviation, sign=True)
    return text.split(" ± ")[0]
