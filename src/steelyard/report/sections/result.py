"""The result: in one sentence, verdicts and remarks, the ten of every method as a table and as
intervals.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from steelyard.digits import LABELS, number
from steelyard.report.document import Figure, Grid, Section, Statement, Statements, Tone
from steelyard.report.evidence import EstimatedBody, Number
from steelyard.report.parameter_grid import ParameterTexts, parameter_grid
from steelyard.report.sections.shown import line_colour, scaled
from steelyard.report.summary import ParameterTable, Summary

COVERED = 1.96
"""Of a normal distribution: 95 % within so many 1-sigma."""
_WIDEST = 8.0
"""Intervals of other methods are shown up to so many times the best one; wider ones run out of the
picture."""
_ROW, _ENTRY = 118, 18
"""Height of a row of panels, and of an entry of the legend, which has a line of its own where the
window is narrow [px]."""
_PARTS = (
    ("mass", slice(0, 1)),
    ("centre of gravity", slice(1, 4)),
    ("moments of inertia", slice(4, 7)),
    ("products", slice(7, 10)),
)


def lead(summary: Summary) -> Statement:
    """The result in one sentence."""
    best = summary.best
    known = ", ".join(_said(best, name, place) for name, place in _PARTS)
    if not best.accepted:
        return Statement(
            f"Not accepted: {'; '.join(best.reasons)}. As estimated by {best.name}: {known}.", "bad"
        )
    return Statement(f"{known[:1].upper()}{known[1:]} (1-sigma), by {best.name}: accepted.", "good")


def _said(body: EstimatedBody, name: str, place: slice) -> str:
    values, deviations = body.value[place], deviations_of(body)[place]
    unit, factor = LABELS[place.start][1:]
    if all(value is None for value in values):
        return f"{name} not identifiable"
    texts = [
        number(scaled(v, factor), scaled(d, factor)) if v is not None else "not identifiable"
        for v, d in zip(values, deviations, strict=True)
    ]
    return f"{name} {texts[0]} {unit}" if len(texts) == 1 else f"{name} ({', '.join(texts)}) {unit}"


def deviations_of(body: EstimatedBody) -> list[Number]:
    """1-sigma of the ten."""
    return [
        None if row[i] is None else max(row[i] or 0.0, 0.0) ** 0.5
        for i, row in enumerate(body.covariance)
    ]


def result(summary: Summary) -> Section:
    """The section."""
    best = summary.best
    blocks: list[Any] = [Statements(tuple(_verdicts(summary)))]
    blocks.append(grid_of(summary.table))
    if any(value is not None for body in summary.bodies for value in body.value):
        blocks.append(_intervals(summary))
    unidentifiable = _labelled(best, "unidentifiable")
    prior = _labelled(best, "prior")
    remarks = []
    if unidentifiable:
        remarks.append(
            Statement(
                "Not identifiable from these data, and therefore left out:"
                f" {', '.join(unidentifiable)}. Another motion would excite them: see 'steelyard"
                " design'.",
                "note",
            )
        )
    if prior:
        remarks.append(
            Statement(
                f"Determined by prior knowledge rather than by the data: {', '.join(prior)}.",
                "note",
            )
        )
    if remarks:
        blocks.append(Statements(tuple(remarks)))
    blocks += [grid_of(table) for table in summary.runs]
    return Section("result", "Result", tuple(blocks))


def _labelled(body: EstimatedBody, label: str) -> list[str]:
    """Names of the parameters that were determined in one way."""
    return [name for (name, *_), each in zip(LABELS, body.labels, strict=True) if each == label]


def _verdicts(summary: Summary) -> Iterator[Statement]:
    for text in summary.statements:
        tone: Tone = (
            "bad" if ": not accepted" in text else "good" if text.endswith(": accepted") else "note"
        )
        yield Statement(text, tone)


def grid_of(table: ParameterTable) -> Grid:
    """A table of ten parameters, with the difference from the truth where that is known."""
    columns = []
    for column in table.columns:
        deviations = column.deviations
        if deviations is None:
            columns.append(ParameterTexts(column.heading, [_given(v) for v in column.values]))
        else:
            pairs = zip(column.values, deviations, strict=True)
            texts = [number(value, deviation) for value, deviation in pairs]
            columns.append(ParameterTexts(f"{column.heading} ± 1-sigma", texts))
        if column.errors is not None:
            errors = zip(column.errors, deviations or (None,) * len(LABELS), strict=True)
            texts = [_error(error, deviation) for error, deviation in errors]
            columns.append(ParameterTexts("error", texts, secondary=True))
    return parameter_grid(table.title, columns)


def _given(value: Number) -> str:
    return "-" if value is None else f"{value:.6g}"


def _error(value: Number, deviation: Number) -> str:
    """A difference from the truth with the digits that its 1-sigma leaves."""
    text, _, _ = number(value, deviation, sign=True).partition(" ± ")
    return text


def _intervals(summary: Summary) -> Figure:
    """Ten panels, a method a row: 95 % intervals against nominal, truth and the smallest possible
    ones.
    """
    data: list[dict[str, Any]] = []
    layout: dict[str, Any] = {
        "annotations": [],
        "legend": {"orientation": "h", "y": 1.06, "yanchor": "bottom"},
    }
    bodies = [body for body in summary.bodies if any(v is not None for v in body.value)]
    most = len(bodies) + (summary.attainable is not None)
    rows = 5
    for i, (label, unit, factor) in enumerate(LABELS):
        suffix = "" if i == 0 else str(i + 1)
        column, row = i // rows, i % rows
        top = 1 - row / rows
        identifiable = any(body.value[i] is not None for body in bodies)
        layout[f"xaxis{suffix}"] = {
            "visible": identifiable,
            "domain": [0.54 * column, 0.46 + 0.54 * column],
            "anchor": f"y{suffix}",
            "nticks": 5,
            "range": _range(summary, bodies, i, factor),
        }
        layout[f"yaxis{suffix}"] = {
            "domain": [top - 0.125, top - 0.02],
            "anchor": f"x{suffix}",
            "range": [-0.7, most - 0.3],
            "showticklabels": False,
            "visible": identifiable,
            "zeroline": False,
            "showgrid": False,
        }
        layout["annotations"].append(
            {
                "text": f"{label} [{unit}]" if identifiable else f"{label}: not identifiable",
                "x": 0.54 * column,
                "y": top - 0.02,
                "xref": "paper",
                "yref": "paper",
                "showarrow": False,
                "xanchor": "left",
                "yanchor": "bottom",
            }
        )
        for j, body in enumerate(bodies):
            value, deviation = scaled(body.value[i], factor), scaled(deviations_of(body)[i], factor)
            data.append(
                _interval(
                    body.name, line_colour(j), value, deviation, most - 1 - j, suffix, first=i == 0
                )
            )
        if summary.attainable is not None:
            best = scaled(summary.best.value[i], factor)
            at_best = scaled(summary.attainable[i], factor) if best is not None else None
            data.append(
                _interval(
                    "smallest possible", "var(--muted)", best, at_best, 0, suffix, first=i == 0
                )
            )
        for name, given, dash in (
            ("nominal", summary.nominal, "dot"),
            ("truth", summary.truth, "solid"),
        ):
            if given is not None:
                data.append(_line(name, scaled(given[i], factor), most, dash, suffix, first=i == 0))
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
        layout,
        height=_ROW * rows + 90 + _ENTRY * (most + 2),
    )


def _range(
    summary: Summary, bodies: Sequence[EstimatedBody], i: int, factor: float
) -> list[float] | None:
    """What a panel shows: the best interval well, others as far as that allows; None: all there
    is.
    """
    centre, sigma = summary.best.value[i], deviations_of(summary.best)[i]
    if centre is None or not sigma:
        return None
    given = [ten[i] for ten in (summary.nominal, summary.truth) if ten is not None]
    known = [abs(value - centre) for value in given if value is not None]
    others = [
        abs(value - centre) + COVERED * (deviations_of(body)[i] or 0.0)
        for body in bodies
        if (value := body.value[i]) is not None
    ]
    best = COVERED * sigma
    reach = 1.1 * max(1.5 * best, *known, min(max(others), _WIDEST * best))
    return [(centre - reach) * factor, (centre + reach) * factor]


def _interval(
    name: str, colour: str, value: Number, deviation: Number, y: float, suffix: str, *, first: bool
) -> dict[str, Any]:
    """A value with its 95 % interval, in one of the ten panels."""
    shown = [] if value is None else [value]
    return {
        "type": "scatter",
        "mode": "markers",
        "name": name,
        "legendgroup": name,
        "showlegend": first,
        "x": shown or [None],
        "y": [y],
        "xaxis": f"x{suffix}",
        "yaxis": f"y{suffix}",
        "marker": {"size": 8, "color": colour},
        "error_x": {
            "type": "data",
            "array": [COVERED * (deviation or 0.0)],
            "thickness": 2,
            "width": 5,
            "color": colour,
        },
    }


def _line(
    name: str, value: Number, most: int, dash: str, suffix: str, *, first: bool
) -> dict[str, Any]:
    """A line across all rows of a panel."""
    x: Sequence[Number] = [value, value]
    return {
        "type": "scatter",
        "mode": "lines",
        "name": name,
        "legendgroup": name,
        "showlegend": first,
        "x": x,
        "y": [-0.6, most - 0.4],
        "xaxis": f"x{suffix}",
        "yaxis": f"y{suffix}",
        "line": {"dash": dash, "width": 1.5, "color": "var(--ink)"},
    }
