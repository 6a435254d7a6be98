"""What is known at an instant, as a table that follows in a terminal."""

from __future__ import annotations

from rich.console import Group
from rich.text import Text

from steelyard.digits import SHORT_LABELS, figures, ten_numbers
from steelyard.inertia import BODY_PARAMETERS
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
    known = (Text(_until(name, seconds)) for name, seconds in record.until.items())
    return Group(table, verdict, *known)


def _until(name: str, seconds: float | None) -> str:
    """When a parameter is known as well as is wanted, in words."""
    short = SHORT_LABELS[BODY_PARAMETERS.index(name)]
    if seconds is None:
        return f"{short}: not known as well as is wanted by this motion"
    if not seconds:
        return f"{short}: known as well as is wanted"
    return f"{short}: known as well as is wanted after {figures(seconds, 2)} s more of this motion"
