"""Clocks and calibration parameters of the instruments, and directed tests of the description."""

from __future__ import annotations

from collections.abc import Iterator

from steelyard.digits import deviation, figures, fixed, number
from steelyard.report.blocks.document import Block, Figure, Grid, Section, Statement, Statements
from steelyard.report.blocks.plot import NAMES_DOWNWARDS, points, stretch
from steelyard.report.blocks.shown import Unit, scaled, shown_unit
from steelyard.report.evidence.summary import Summary
from steelyard.report.evidence.values import CalibrationEstimate

_DETERMINED = 0.5
"""Part of its prior 1-sigma below which a parameter is determined by the data."""
_FAR = 3.0
"""Prior 1-sigma: an estimate further off contradicts the experiment file."""
_MOST_DRAWN = 60
"""Parameters in the figure: a screen of rows."""


def calibration(summary: Summary) -> Section | None:
    """The section; None where no calibration parameter was estimated."""
    evidence = summary.evidence
    blocks: list[Block] = []
    if evidence.clocks:
        blocks.append(_clocks(summary))
    if evidence.errors:
        text = (
            "Calibration parameters are estimated together with the body; where the data have no"
            " information on one, its prior value stays."
        )
        blocks.append(Statements((Statement(text), *_far(evidence.errors))))
        blocks.append(_posteriors(evidence.errors[:_MOST_DRAWN]))
        blocks.append(_errors(evidence.errors))
    if evidence.tests:
        blocks.append(_tests(summary))
    return Section("calibration", "Clocks and calibration", tuple(blocks)) if blocks else None


def _far(errors: tuple[CalibrationEstimate, ...]) -> Iterator[Statement]:
    """Estimates that contradict their priors."""
    for each in errors:
        if each.value is None or not each.prior:
            continue
        if abs(each.value - (each.expected or 0.0)) > _FAR * each.prior:
            yield Statement(
                f"{each.instrument}, {each.name}: {_value(each)} is more than {_FAR:g} prior"
                " 1-sigma from the value of the experiment file; check it.",
                "bad",
            )


def _clocks(summary: Summary) -> Grid:
    """Delays of the clocks, with what was known of them before."""
    rows = []
    for each in summary.evidence.clocks:
        delay, prior = "0", "defines the time"
        if each.prior:
            delay = number(scaled(each.delay, 1e3), scaled(each.deviation, 1e3))
            prior = f"± {deviation(each.prior * 1e3)}"
        rows.append((each.run, each.instruments, delay, prior, each.found or "-"))
    head = (
        "run",
        "instruments of the clock",
        "delay [ms]",
        "prior [ms]",
        "synchronisation before the fit",
    )
    return Grid("Clock delays relative to the force clock", head, tuple(rows), frozenset({2, 3}))


def _value(each: CalibrationEstimate) -> str:
    """An estimate with its 1-sigma and unit."""
    text, unit = _estimate(each)
    return text if unit.name == "-" else f"{text} {unit.name}"


def _estimate(each: CalibrationEstimate) -> tuple[str, Unit]:
    """An estimate with its 1-sigma, and the unit that both are in."""
    unit = shown_unit(each.unit, "error")
    return number(scaled(each.value, unit.factor), scaled(each.deviation, unit.factor)), unit


def _errors(errors: tuple[CalibrationEstimate, ...]) -> Grid:
    """Estimates of all calibration parameters beside their priors."""
    rows = []
    for each in errors:
        found, unit = _estimate(each)
        prior = "-"
        if each.expected is not None and each.prior is not None:
            prior = number(each.expected * unit.factor, each.prior * unit.factor)
        rows.append((f"{each.instrument}, {each.name}", unit.name, found, prior))
    head = ("parameter", "unit", "estimate ± 1-sigma", "prior ± 1-sigma")
    title = "Calibration parameters of the instruments"
    return Grid(title, head, tuple(rows), frozenset({2, 3}))


def _posteriors(errors: tuple[CalibrationEstimate, ...]) -> Figure:
    """Estimates of calibration parameters in units of their prior 1-sigma."""
    shown = [e for e in errors if e.value is not None and e.deviation is not None and e.prior]
    names = [f"{e.instrument}, {e.name}" for e in shown]
    off = [((e.value or 0.0) - (e.expected or 0.0)) / (e.prior or 1.0) for e in shown]
    left = [(e.deviation or 0.0) / (e.prior or 1.0) for e in shown]
    bars = {"type": "data", "array": left, "thickness": 1.5, "width": 4}
    data = (points("estimate, 1-sigma", off, names, {"size": 7}, error_x=bars),)
    layout = {
        "xaxis": {"title": {"text": "estimate minus prior value, in prior 1-sigma"}},
        "yaxis": NAMES_DOWNWARDS,
        "shapes": [{**stretch(-1, 1, "#888888"), "opacity": 0.12}],
        "showlegend": False,
    }
    determined = sum(1 for each in left if each < _DETERMINED)
    text = (
        f"{len(shown)} calibration parameters in units of their prior 1-sigma; the data reduce that"
        f" of {determined} to less than half."
    )
    return Figure(
        "learned",
        "Calibration parameters against their priors (shaded: prior 1-sigma)",
        text,
        data,
        layout,
        height=150 + 20 * len(shown),
    )


def _tests(summary: Summary) -> Grid:
    """The directed tests that explain most."""
    rows = []
    for each in summary.evidence.tests:
        unit = shown_unit(each.unit, "error")
        rows.append(
            (
                each.name,
                fixed(each.sigmas, 1, sign=True),
                figures(each.size * unit.factor, 3, sign=True),
                unit.name,
            )
        )
    caption = (
        "Directed tests of the description: the single errors that would explain most of the"
        " residuals (beyond 3 to 4 sigma the verdict names them)"
    )
    return Grid(
        caption,
        ("error of", "sigma", "its size then", "unit"),
        tuple(rows),
        frozenset({1, 2}),
    )
