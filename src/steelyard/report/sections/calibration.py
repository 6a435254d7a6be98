"""Clocks and systematic errors of the instruments as they were found, and what the description
might get wrong.
"""

from __future__ import annotations

from steelyard.digits import number
from steelyard.report.document import Block, Figure, Grid, Section, Statement, Statements
from steelyard.report.evidence import Error
from steelyard.report.sections.shown import shown_unit
from steelyard.report.summary import Summary

_LEARNED = 0.5
"""Part of its prior 1-sigma below which an error was told by the data."""
_FAR = 3.0
"""Prior 1-sigma."""
_LARGEST_FIGURE = 60
"""Errors that are drawn."""


def calibration(summary: Summary) -> Section | None:
    """The section; None where no error was looked for."""
    evidence = summary.evidence
    blocks: list[Block] = []
    if evidence.clocks:
        blocks.append(_clocks(summary))
    if evidence.errors:
        far = [
            e
            for e in evidence.errors
            if e.value is not None
            and e.prior
            and abs(e.value - (e.expected or 0.0)) > _FAR * e.prior
        ]
        text = (
            "What was not known exactly was estimated along with the body; where the data say"
            " nothing, the value known beforehand stays."
        )
        statements = [Statement(text)]
        for each in far:
            statements.append(
                Statement(
                    f"{each.instrument}, {each.name}: {_value(each)} is more than {_FAR:g} 1-sigma"
                    " from what the experiment file says; look at it.",
                    "bad",
                )
            )
        blocks.append(Statements(tuple(statements)))
        blocks.append(_learned(evidence.errors[:_LARGEST_FIGURE]))
        blocks.append(_errors(evidence.errors))
    if evidence.tests:
        blocks.append(_tests(summary))
    return Section("calibration", "Clocks and calibration", tuple(blocks)) if blocks else None


def _clocks(summary: Summary) -> Grid:
    rows = []
    for each in summary.evidence.clocks:
        late = None if each.delay is None else each.delay * 1e3
        sigma = None if each.deviation is None else each.deviation * 1e3
        prior = "defines the time" if not each.prior else f"± {each.prior * 1e3:.3g}"
        rows.append(
            (
                each.run,
                each.instruments,
                number(late, sigma) if each.prior else "0",
                prior,
                each.found or "-",
            )
        )
    head = (
        "run",
        "instruments of the clock",
        "late by [ms]",
        "known beforehand [ms]",
        "found from the data before the fit",
    )
    return Grid("Clocks against that of the forces", head, tuple(rows), frozenset({2, 3}))


def _value(each: Error) -> str:
    unit = shown_unit(each.unit, "error")
    value = None if each.value is None else each.value * unit.factor
    deviation = None if each.deviation is None else each.deviation * unit.factor
    return (
        f"{number(value, deviation)} {unit.name}" if unit.name != "-" else number(value, deviation)
    )


def _errors(errors: tuple[Error, ...]) -> Grid:
    rows = []
    for each in errors:
        unit = shown_unit(each.unit, "error")
        value, deviation, expected, prior = (
            None if v is None else v * unit.factor
            for v in (each.value, each.deviation, each.expected, each.prior)
        )
        rows.append(
            (
                f"{each.instrument}, {each.name}",
                unit.name,
                number(value, deviation),
                "-" if expected is None else f"{expected:.4g} ± {prior:.3g}",
            )
        )
    return Grid(
        "Systematic errors of the instruments",
        ("error", "unit", "found ± 1-sigma", "known beforehand ± 1-sigma"),
        tuple(rows),
        frozenset({2, 3}),
    )


def _learned(errors: tuple[Error, ...]) -> Figure:
    """Errors in units of what was known beforehand: how far off, and how much was learned."""
    shown = [e for e in errors if e.value is not None and e.deviation is not None and e.prior]
    names = [f"{e.instrument}, {e.name}" for e in shown]
    off = [((e.value or 0.0) - (e.expected or 0.0)) / (e.prior or 1.0) for e in shown]
    left = [(e.deviation or 0.0) / (e.prior or 1.0) for e in shown]
    data = (
        {
            "type": "scatter",
            "mode": "markers",
            "name": "found, 1-sigma",
            "x": off,
            "y": names,
            "marker": {"size": 7},
            "error_x": {"type": "data", "array": left, "thickness": 1.5, "width": 4},
        },
    )
    layout = {
        "xaxis": {"title": {"text": "off by, in the 1-sigma known beforehand"}},
        "yaxis": {"autorange": "reversed", "automargin": True, "type": "category"},
        "shapes": [
            {
                "type": "rect",
                "xref": "x",
                "yref": "paper",
                "x0": -1,
                "x1": 1,
                "y0": 0,
                "y1": 1,
                "line": {"width": 0},
                "opacity": 0.12,
                "fillcolor": "#888888",
            }
        ],
        "showlegend": False,
    }
    told = sum(1 for each in left if each < _LEARNED)
    text = (
        f"{len(shown)} systematic errors in units of their 1-sigma known beforehand; {told} of them"
        " were told by the data to less than half of it."
    )
    return Figure(
        "learned",
        "What was learned about the instruments (shaded: 1-sigma known beforehand)",
        text,
        data,
        layout,
        height=150 + 20 * len(shown),
    )


def _tests(summary: Summary) -> Grid:
    rows = []
    for each in summary.evidence.tests:
        unit = shown_unit(each.unit, "error")
        rows.append(
            (each.name, f"{each.sigmas:+.1f}", f"{each.size * unit.factor:+.3g}", unit.name)
        )
    caption = (
        "What the description might get wrong: the errors that would explain most of what is left"
        " over (beyond 3 to 4 sigma the verdict names them)"
    )
    return Grid(
        caption,
        ("error of", "sigma", "if so, it is off by", "unit"),
        tuple(rows),
        frozenset({1, 2}),
    )
