"""Lines and axes as Plotly takes them."""

from __future__ import annotations

from typing import Any

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
