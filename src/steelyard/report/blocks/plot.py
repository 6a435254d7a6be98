"""Lines and axes as Plotly takes them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

_GAP = 0.12
"""Between panels, as a part of their height."""
NAMES_DOWNWARDS = {"autorange": "reversed", "automargin": True, "type": "category"}
"""A vertical axis of names, the first one at the top."""


def line(name: str, x: Any, y: Any, style: dict[str, Any], **further: Any) -> dict[str, Any]:
    """A line.

    Args:
        name: In the legend.
        x: Shape (n,).
        y: Shape (n,).
        style: Colour, width and dash.
        further: Whatever else Plotly knows of it.
    """
    drawn = {"type": "scatter", "mode": "lines", "name": name, "x": x, "y": y, "line": style}
    return {**drawn, **further}


def points(name: str, x: Any, y: Any, marker: dict[str, Any], **further: Any) -> dict[str, Any]:
    """Marks at points; arguments as of :func:`line`."""
    drawn = {"type": "scatter", "mode": "markers", "name": name, "x": x, "y": y, "marker": marker}
    return {**drawn, **further}


def axes(x: str, y: str, kind: str = "linear") -> dict[str, Any]:
    """Both axes of a picture.

    Args:
        x: Title of the first one, with its unit.
        y: Of the second one.
        kind: ``linear`` or ``log``.
    """
    return {
        name: {"title": {"text": title}, "type": kind}
        for name, title in (("xaxis", x), ("yaxis", y))
    }


@dataclass(frozen=True)
class Panel:
    """Lines of one unit."""

    title: str
    """With its unit."""
    lines: Sequence[dict[str, Any]]


def stacked(across: str, panels: Sequence[Panel]) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """Panels above each other over one axis, since lines of several units on one scale say nothing:
    lines and layout. Of one name there is one entry in the legend, for all panels.

    Args:
        across: Title of the common axis, with its unit.
        panels: The first at the top.
    """
    count, known, lines = len(panels), set(), []
    last = "" if count == 1 else str(count)
    layout: dict[str, Any] = {"xaxis": {"title": {"text": across}, "anchor": f"y{last}"}}
    for i, panel in enumerate(panels):
        suffix = "" if not i else str(i + 1)
        bottom = 1 - (i + 1) / count
        gap = 0.0 if i == count - 1 else _GAP / count
        layout[f"yaxis{suffix}"] = {
            "title": {"text": panel.title},
            "domain": [bottom + gap, 1 - i / count],
        }
        for each in panel.lines:
            first = each["name"] not in known
            known.add(each["name"])
            own = {"yaxis": f"y{suffix}", "legendgroup": each["name"], "showlegend": first}
            lines.append({**each, **own})
    return lines, layout


def stretch(start: float, end: float, colour: str) -> dict[str, Any]:
    """A shape that marks a time, from start to end."""
    return {
        "type": "rect",
        "x0": start,
        "x1": end,
        "y0": 0,
        "y1": 1,
        "yref": "paper",
        "fillcolor": colour,
        "opacity": 0.18,
        "line": {"width": 0},
    }
