"""What is known at an instant, as a table that follows in a terminal."""

from __future__ import annotations

from rich.console import Group
from rich.table import Table
from rich.text import Text

from steelyard.digits import LABELS, ten_numbers
from steelyard.live.record import Record


def live_table(record: Record) -> Group:
    """A table of the ten with their 1-sigma, and whether they can be relied on."""
    table = Table(title=f"{record.load}, {record.time:.1f} s", title_justify="left")
    table.add_column("parameter")
    table.add_column("value ± 1-sigma", justify="right")
    table.add_column("unit")
    for (name, unit, _), cell in zip(
        LABELS, ten_numbers(record.value, record.deviation), strict=True
    ):
        table.add_row(name, cell, unit)
    if record.accepted is None:
        verdict = Text("not judged yet")
    elif record.accepted:
        verdict = Text("accepted", style="green")
    else:
        verdict = Text(f"not accepted: {'; '.join(record.reasons)}", style="red")
    return Group(table, verdict)
