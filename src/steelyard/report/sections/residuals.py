"""Measured against predicted: the wrench on the platform, then every instrument, with residuals and
their spectra.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from steelyard.identification.residuals import PLATFORM
from steelyard.report.document import Block, Figure, Grid, Section, Statement, Statements
from steelyard.report.evidence import Number, Trace
from steelyard.report.sections.shown import Unit, line_colour, shown_unit, slug, words
from steelyard.report.summary import Summary

_EQUATIONS = 6
"""Of motion of a body."""
_HIGH = 1.5
"""Root mean square of residuals in 1-sigma from which on they are said to exceed the noise: twice
its variance."""


def wrench(summary: Summary) -> Section | None:
    """Force and torque on the platform; None where none is predicted."""
    traces = [each for each in summary.evidence.traces if each.instrument == PLATFORM]
    if not traces:
        return None
    text = (
        "Force and torque on the platform about its origin, in the platform frame: measured by the"
        " force sensors with their estimated calibration, and predicted from the estimated body and"
        " motion (Newton-Euler)."
    )
    return Section(
        "wrench",
        "Wrench on the platform",
        (Statements((Statement(text),)), *map(_figure, traces)),
    )


def residuals(summary: Summary) -> Section | None:
    """Every instrument; None where there is none to show."""
    evidence = summary.evidence
    traces = [each for each in evidence.traces if each.instrument != PLATFORM]
    if not evidence.traces:
        return None
    blocks: list[Block] = []
    remarks = [*_expected(traces), *_remarks(summary, traces)]
    if remarks:
        blocks.append(Statements(tuple(remarks)))
    blocks.append(_table(evidence.traces))
    if evidence.noise:
        blocks.append(_noise(summary))
    blocks += [_figure(each) for each in traces]
    blocks += list(_spectra(evidence.traces))
    return Section("residuals", "Measurements and residuals", tuple(blocks))


def _expected(traces: Sequence[Trace]) -> Iterator[Statement]:
    """How large residuals of tensions may be: they enter fewer equations than there are cables."""
    m = max((len(each.channels) for each in traces if each.quantity == "tension"), default=0)
    if m > _EQUATIONS:
        yield Statement(
            "Predicted tensions are those nearest to the measured ones that balance the platform."
            f" {m} cables enter {_EQUATIONS} equations: where all assumptions hold, the residuals of"
            f" tensions have {np.sqrt(_EQUATIONS / m):.2f} of the size of their noise, those of the"
            " other instruments its full size."
        )


def _remarks(summary: Summary, traces: Sequence[Trace]) -> Iterator[Statement]:
    """Contacts, outliers, and residuals that exceed the noise."""
    evidence = summary.evidence
    for run, start, end in evidence.contacts:
        yield Statement(
            f"Run '{run}': something touched the platform from {start:.2f} to {end:.2f} s; its"
            " forces are left out there.",
            "note",
        )
    for each in traces:
        if each.outliers:
            yield Statement(
                f"Run '{each.run}', {each.instrument}, {words(each.quantity)}: {each.outliers}"
                f" sample{'s' if each.outliers > 1 else ''} beyond 5 sigma or left out, of"
                f" {each.samples * len(each.channels)}.",
                "note",
            )
        ratio = _ratio(each)
        if ratio is not None and ratio > _HIGH:
            yield Statement(
                f"Run '{each.run}', {each.instrument}, {words(each.quantity)}: the"
                f" residuals are {ratio:.1f} times the assumed noise.",
                "bad",
            )
    if evidence.not_drawn:
        yield Statement(
            f"{evidence.not_drawn} further runs took part in the estimate; only the first ones are"
            " drawn, to keep this page small.",
            "note",
        )


def _ratio(each: Trace) -> Number:
    """Root mean square over all channels, in 1-sigma."""
    found = [r / s for r, s in zip(each.rms, each.sigma or (), strict=False) if r is not None and s]
    return float(np.sqrt(np.mean(np.square(found)))) if found else None


def _table(traces: Sequence[Trace]) -> Grid:
    """Sizes of the residuals, a row a quantity."""
    rows = []
    for each in traces:
        unit = shown_unit(each.unit, each.quantity)
        ratio = _ratio(each)
        left = [f"{r * unit.factor:.3g}" if r is not None else "-" for r in each.rms]
        rows.append(
            (
                each.run,
                each.instrument,
                words(each.quantity),
                unit.name,
                str(each.samples),
                ", ".join(left),
                "-" if ratio is None else f"{ratio:.2f}",
                "-" if each.worst is None else f"{each.worst:.1f}",
                str(each.outliers),
            )
        )
    head = (
        "run",
        "instrument",
        "quantity",
        "unit",
        "samples",
        "rms of the residuals by channel",
        "in 1-sigma",
        "largest, in 1-sigma",
        "outliers",
    )
    return Grid("Residuals: measured minus predicted", head, tuple(rows), frozenset({4, 6, 7, 8}))


def _noise(summary: Summary) -> Grid:
    """Noise as stated, as the fit assumes it, and as estimated from the data."""
    rows = []
    for each in summary.evidence.noise:
        unit = shown_unit(each.unit, each.quantity)
        values = [
            ("-" if v is None else f"{v * unit.factor:.3g}")
            for v in (each.stated, each.used, each.found)
        ]
        rows.append((each.instrument, words(each.quantity), unit.name, *values))
    return Grid(
        "Noise of single samples, 1-sigma",
        ("instrument", "quantity", "unit", "stated", "assumed", "estimated"),
        tuple(rows),
        frozenset({3, 4, 5}),
    )


def _figure(each: Trace) -> Figure:
    """Measured and predicted over time, and below their residuals."""
    unit = shown_unit(each.unit, each.quantity)
    measured = np.array(each.measured, dtype=np.float64) * unit.factor
    over = np.array(each.residual, dtype=np.float64)
    predicted = measured - over * unit.factor
    scale = np.array(each.sigma)[:, None] if each.sigma is not None else 1.0 / unit.factor
    data = [*_lines(each, measured, predicted), *_residual_lines(each, over / scale)]
    what = "number of the pose" if each.static else "time [s]"
    layout = {
        "xaxis": {"title": {"text": what}, "anchor": "y2"},
        "yaxis": {"title": {"text": f"{words(each.quantity)} [{unit.name}]"}, "domain": [0.4, 1.0]},
        "yaxis2": {
            "title": {
                "text": (
                    "residual [1-sigma]" if each.sigma is not None else f"residual [{unit.name}]"
                )
            },
            "domain": [0.0, 0.32],
        },
    }
    who = "the platform" if each.instrument == PLATFORM else each.instrument
    drawn = "points measured, rings predicted" if each.static else "measured thin, predicted dashed"
    thin = f", {len(each.time)} of {each.samples} samples" if len(each.time) < each.samples else ""
    title = f"Run {each.run}: {who}, {words(each.quantity)} ({drawn}{thin})"
    text = (
        f"{words(each.quantity)} of {who} in run {each.run}, channels {', '.join(each.channels)},"
        f" measured and predicted, and below their residuals; {_summed(each, unit)}"
    )
    return Figure(
        slug("trace", each.run, each.instrument, each.quantity),
        title,
        text,
        tuple(data),
        layout,
        height=440,
    )


def _summed(each: Trace, unit: Unit) -> str:
    rms = [r for r in each.rms if r is not None]
    return (
        f"root mean square {max(rms) * unit.factor:.3g} {unit.name} at most."
        if rms
        else "nothing was measured."
    )


def _lines(each: Trace, measured: Any, predicted: Any) -> Iterator[dict[str, Any]]:
    """Poses at rest have nothing between them: points, and rings about them."""
    for i, (name, values) in enumerate(zip(each.channels, measured, strict=True)):
        colour = line_colour(i)
        drawn = (
            {"mode": "markers", "marker": {"size": 5, "color": colour}}
            if each.static
            else {"mode": "lines", "line": {"width": 1, "color": colour}}
        )
        yield {
            "type": "scatter",
            "name": name,
            "legendgroup": name,
            "x": each.time,
            "y": values,
            "opacity": 0.75,
            **drawn,
        }
    for i, (name, values) in enumerate(zip(each.channels, predicted, strict=True)):
        colour = line_colour(i)
        drawn = (
            {"mode": "markers", "marker": {"size": 11, "symbol": "circle-open", "color": colour}}
            if each.static
            else {"mode": "lines", "line": {"width": 1.5, "dash": "dash", "color": colour}}
        )
        yield {
            "type": "scatter",
            "name": f"{name}, predicted",
            "legendgroup": name,
            "showlegend": False,
            "x": each.time,
            "y": values,
            **drawn,
        }


def _residual_lines(each: Trace, over: Any) -> Iterator[dict[str, Any]]:
    """Residuals below the readings; those that the fit leaves out are marked."""
    time = np.array(each.time)
    out = np.zeros(over.shape, dtype=bool)
    for channel, sample in each.left_out:
        out[channel, sample] = True
    for i, (name, values, lost) in enumerate(zip(each.channels, over, out, strict=True)):
        yield {
            "type": "scatter",
            "mode": "markers" if each.static else "lines",
            "name": f"{name}, residual",
            "legendgroup": name,
            "showlegend": False,
            "x": each.time,
            "y": np.where(lost, np.nan, values),
            "yaxis": "y2",
            "line": {"width": 1, "color": line_colour(i)},
            "marker": {"size": 5, "color": line_colour(i)},
        }
    if out.any():
        channels, samples = np.nonzero(out)
        # What is left out may be far off the scale: it is marked where it happened.
        limit = float(np.nanmax(np.abs(np.where(out, np.nan, over)), initial=1.0))
        yield {
            "type": "scatter",
            "mode": "markers",
            "name": "left out",
            "x": time[samples],
            "y": np.clip(over[channels, samples], -limit, limit),
            "yaxis": "y2",
            "marker": {"size": 7, "symbol": "x-thin-open", "color": "var(--bad)"},
        }


def _spectra(traces: Sequence[Trace]) -> Iterator[Figure]:
    """Of every run one figure."""
    for run in dict.fromkeys(each.run for each in traces):
        own = [each for each in traces if each.run == run and each.spectrum is not None]
        if not own:
            continue
        data = [
            {
                "type": "scatter",
                "mode": "lines",
                "name": f"{each.instrument}, {words(each.quantity)}",
                "x": each.spectrum.frequency,
                "y": each.spectrum.power,
                "line": {"width": 1.5},
            }
            for each in own
            if each.spectrum is not None
        ]
        layout = {
            "xaxis": {"title": {"text": "frequency [Hz]"}, "type": "log"},
            "yaxis": {"title": {"text": "power over that of white noise"}, "type": "log"},
        }
        text = (
            f"Spectra of the residuals in run {run}. White noise of the assumed size is flat at 1; a"
            " peak is a motion or a vibration that the model does not follow. Cables enter six"
            " equations together, so that theirs are below 1."
        )
        yield Figure(
            slug("spectra", run),
            f"Run {run}: spectra of the residuals (1: white noise of the assumed size)",
            text,
            tuple(data),
            layout,
            height=380,
        )
