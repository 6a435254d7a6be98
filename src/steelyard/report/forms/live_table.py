"""What is known at an instant, as a table that follows in a terminal."""

from __future__ import annotations

from rich.console import Group
from rich.text import Text

from steelyard.digits import ten_numbers
from steelyard.live.record import Record
from steelyard.report.blocks.parameter_grid import ParameterTexts, parameter_grid
from steelyard.report.forms.terminal import drawn_grid

_WIDTH = 80
"""Characters; the table of one estimate is narrower."""


def live_table(record: Record) -> Group:
    """A table of the ten with their 1-sigma, and whether they can be relied on."""
    column = ParameterTexts("value ± 1-sigma", ten_numbers(record.value, record.deviation))
    table = drawn_grid(parameter_grid(f"{record.load}, {record.time:.1f} s", [column]), _WIDTH)
    if record.accepted is None:
        verdict = Text("not judged yet")
    elif record.accepted:
        verdict = Text("accepted", style="green")
    else:
        verdict = Text(f"not accepted: {'; '.join(record.reasons)}", style="red")
    return Group(table, verdict)
