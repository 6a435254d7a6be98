"""The ten parameters of every method as intervals: ten panels, a method a row."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from steelyard.digits import LABELS
from steelyard.report.blocks.document import Figure, Narrow
from steelyard.report.blocks.plot import line, points
from steelyard.report.blocks.shown import deviations_of, line_colour, scaled
from steelyard.report.evidence.summary import Summary
from steelyard.report.evidence.values import EstimatedBody, Number, Ten

COVERED = 1.96
"""Of a normal distribution: 95 % within so many 1-sigma."""
_WIDEST = 8.0
"""Intervals of other methods are shown up to so many times the best one; wider ones run out of the
picture."""
_COLUMNS = 2
"""Of panels, where the window is wide."""
_LEFT = (0.0, 0.62)
"""Where they begin, as parts of the width: before each there is room for the names of its rows."""
_WIDE = 0.38
"""Of one, likewise."""
_LINE, _TITLE, _TICKS = 17, 22, 30
"""Heights of a row of a panel, of its title, and of what is below it [px]."""
_TOP, _BOTTOM = 34, 8
"""Margins [px]; the legend is at the top."""
_ATTAINABLE = "smallest possible"


@dataclass(frozen=True)
class SideBySide:
    """Estimates and what they are held against, SI."""

    bodies: tuple[EstimatedBody, ...]
    best: EstimatedBody
    """Whose interval decides how much a panel shows."""
    attainable: Ten | None = None
    """The smallest 1-sigma that any method could have."""
    nominal: Ten | None = None
    truth: Ten | None = None
    whole: bool = False
    """Whether all of every interval is shown, however wide others are than the best one."""


def intervals(summary: Summary) -> Figure:
    """95 % intervals against nominal, truth and the smallest possible ones."""
    return intervals_of(
        SideBySide(summary.bodies, summary.best, summary.attainable, summary.nominal, summary.truth)
    )


def intervals_of(compared: SideBySide) -> Figure:
    """95 % intervals of estimates, a panel a parameter and a row an estimate."""
    bodies = [body for body in compared.bodies if any(v is not None for v in body.value)]
    names = [body.name for body in bodies]
    if compared.attainable is not None:
        names.append(_ATTAINABLE)
    data: list[dict[str, Any]] = []
    for i in range(len(LABELS)):
        data += _panel(compared, bodies, i, len(names))
    wide = _layout(compared, bodies, names, _COLUMNS)
    narrow = _layout(compared, bodies, names, 1)
    text = (
        "95 % intervals of the ten parameters by every method, against nominal, truth and the"
        " smallest possible where known; lines that run out of the picture are wider. The numbers"
        " are in the table above."
    )
    return Figure(
        "intervals",
        "The ten parameters with their 95 % intervals",
        text,
        tuple(data),
        wide,
        height=_height(len(names), _COLUMNS),
        narrow=Narrow(narrow, _height(len(names), 1)),
    )


def _height(lines: int, columns: int) -> int:
    """Of the whole picture [px]."""
    return len(LABELS) // columns * (_TITLE + _LINE * lines + _TICKS) + _TOP + _BOTTOM


def _layout(
    compared: SideBySide, bodies: Sequence[EstimatedBody], names: Sequence[str], columns: int
) -> dict[str, Any]:
    """Panels in so many columns, each with the names of its rows."""
    layout: dict[str, Any] = {
        "annotations": [],
        "legend": {
            "orientation": "h",
            "xref": "container",
            "x": 0,
            "yref": "container",
            "y": 1,
            "yanchor": "top",
        },
        "margin": {"t": _TOP, "b": _BOTTOM},
    }
    for i in range(len(LABELS)):
        _lay_out(layout, compared, bodies, names, i, columns)
    return layout


def _lay_out(
    layout: dict[str, Any],
    compared: SideBySide,
    bodies: Sequence[EstimatedBody],
    names: Sequence[str],
    i: int,
    columns: int,
) -> None:
    """Add axes and title of the panel of a parameter."""
    label, unit, factor = LABELS[i]
    suffix, lines = _suffix(i), len(names)
    rows = len(LABELS) // columns
    left, width = (_LEFT[i // rows], _WIDE) if columns > 1 else (0.0, 1.0)
    pixel = 1 / (rows * (_TITLE + _LINE * lines + _TICKS))
    top = 1 - i % rows / rows
    identifiable = any(body.value[i] is not None for body in bodies)
    layout[f"xaxis{suffix}"] = {
        "visible": identifiable,
        "domain": [left, left + width],
        "anchor": f"y{suffix}",
        "nticks": 5,
        "range": _range(compared, bodies, i, factor),
    }
    layout[f"yaxis{suffix}"] = {
        "domain": [top - (_TITLE + _LINE * lines) * pixel, top - _TITLE * pixel],
        "anchor": f"x{suffix}",
        "range": [-0.7, lines - 0.3],
        "tickmode": "array",
        "tickvals": list(range(lines - 1, -1, -1)),
        "ticktext": list(names),
        "tickfont": {"size": 11},
        "ticks": "",
        "visible": identifiable,
        "zeroline": False,
        "showgrid": False,
    }
    title = {
        "text": f"{label} [{unit}]" if identifiable else f"{label}: not identifiable",
        "x": left,
        "y": top - _TITLE * pixel,
        "xref": "paper",
        "yref": "paper",
        "showarrow": False,
        "xanchor": "left",
        "yanchor": "bottom",
    }
    layout["annotations"].append(title)


def _panel(
    compared: SideBySide, bodies: Sequence[EstimatedBody], i: int, lines: int
) -> Iterator[dict[str, Any]]:
    """What the panel of a parameter shows, the first method at the top."""
    factor = LABELS[i][2]
    for j, body in enumerate(bodies):
        value, deviation = scaled(body.value[i], factor), scaled(deviations_of(body)[i], factor)
        yield _interval(body.name, line_colour(j), value, deviation, lines - 1 - j, i)
    if compared.attainable is not None:
        best = scaled(compared.best.value[i], factor)
        attainable = None if best is None else scaled(compared.attainable[i], factor)
        yield _interval(_ATTAINABLE, "var(--muted)", best, attainable, 0, i)
    for name, given, dash in (
        ("nominal", compared.nominal, "dot"),
        ("truth", compared.truth, "solid"),
    ):
        if given is not None:
            yield _line(name, scaled(given[i], factor), dash, lines, i)


def _range(
    compared: SideBySide, bodies: Sequence[EstimatedBody], i: int, factor: float
) -> list[float] | None:
    """What a panel shows: the best interval well, others as far as that allows; None: all there
    is.
    """
    centre, sigma = compared.best.value[i], deviations_of(compared.best)[i]
    if centre is None or not sigma:
        return None
    given = [ten[i] for ten in (compared.nominal, compared.truth) if ten is not None]
    known = [abs(value - centre) for value in given if value is not None]
    others = [0.0]
    for body in bodies:
        value, deviation = body.value[i], deviations_of(body)[i]
        if value is not None:
            others.append(abs(value - centre) + COVERED * (deviation or 0.0))
    best = COVERED * sigma
    farthest = max(others) if compared.whole else min(max(others), _WIDEST * best)
    reach = 1.1 * max(1.5 * best, *known, farthest)
    return [(centre - reach) * factor, (centre + reach) * factor]


def _interval(
    name: str, colour: str, value: Number, deviation: Number, y: float, i: int
) -> dict[str, Any]:
    """A value with its 95 % interval in the i-th panel."""
    bar = {"type": "data", "array": [COVERED * (deviation or 0.0)], "color": colour}
    error = {**bar, "thickness": 2, "width": 5}
    return points(
        name,
        [value],
        [y],
        {"size": 8, "color": colour},
        error_x=error,
        **_placed(name, i),
        showlegend=False,
    )


def _line(name: str, value: Number, dash: str, lines: int, i: int) -> dict[str, Any]:
    """A line across all rows of the i-th panel."""
    style = {"dash": dash, "width": 1.5, "color": "var(--ink)"}
    return line(
        name, [value, value], [-0.6, lines - 0.4], style, **_placed(name, i), showlegend=i == 0
    )


def _placed(name: str, i: int) -> dict[str, Any]:
    """The i-th panel."""
    axes = {"xaxis": f"x{_suffix(i)}", "yaxis": f"y{_suffix(i)}"}
    return {"legendgroup": name, **axes}


def _suffix(i: int) -> str:
    """As Plotly numbers its axes."""
    return "" if i == 0 else str(i + 1)
