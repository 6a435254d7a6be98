"""Measured against predicted: the wrench on the platform, then every instrument, with residuals and
their spectra.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from steelyard.digits import alike, figures, fixed
from steelyard.identification.residuals import PLATFORM
from steelyard.report.blocks.document import (
    Block,
    Figure,
    Grid,
    Section,
    Statement,
    Statements,
    by_choice,
)
from steelyard.report.blocks.plot import axes, line, points
from steelyard.report.blocks.shown import Unit, line_colour, scaled, shown_unit, slug, words
from steelyard.report.evidence.summary import Summary
from steelyard.report.evidence.values import Number, Trace

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
        (Statements((Statement(text),)), *_each_run(traces, lambda of: map(_figure, of))),
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
    if evidence.noise:
        blocks.append(_noise(summary))
    blocks += _each_run(evidence.traces, _of_run)
    return Section("residuals", "Measurements and residuals", tuple(blocks))


def _each_run(
    traces: Sequence[Trace], drawn: Callable[[Sequence[Trace]], Iterable[Block]]
) -> list[Block]:
    """Blocks of every run; of several one is chosen."""
    runs: dict[str, list[Trace]] = {}
    for each in traces:
        runs.setdefault(each.run, []).append(each)
    return by_choice("Run", [(run, tuple(drawn(of))) for run, of in runs.items()])


def _of_run(traces: Sequence[Trace]) -> Iterator[Block]:
    """What there is to say of one run."""
    yield _table(traces)
    yield from (_figure(each) for each in traces if each.instrument != PLATFORM)
    yield from _spectra(traces)


def _expected(traces: Sequence[Trace]) -> Iterator[Statement]:
    """How large residuals of tensions may be: they enter fewer equations than there are cables."""
    m = max((len(each.channels) for each in traces if each.quantity == "tension"), default=0)
    if m > _EQUATIONS:
        yield Statement(
            "Predicted tensions are those nearest to the measured ones that balance the platform."
            f" {m} cables enter {_EQUATIONS} equations: where all assumptions hold, the residuals"
            f" of tensions have {fixed(np.sqrt(_EQUATIONS / m), 2)} of the size of their noise,"
            " those of the other instruments its full size."
        )


def _remarks(summary: Summary, traces: Sequence[Trace]) -> Iterator[Statement]:
    """Contacts, outliers, and residuals that exceed the noise."""
    evidence = summary.evidence
    for run, start, end in evidence.contacts:
        yield Statement(
            f"Run '{run}': something touched the platform from {fixed(start, 2)} to"
            f" {fixed(end, 2)} s; its forces are left out there.",
            "note",
        )
    for each in traces:
        what = f"Run '{each.run}', {each.instrument}, {words(each.quantity)}"
        if each.outliers:
            yield Statement(
                f"{what}: {each.outliers} sample{'s' if each.outliers > 1 else ''} beyond 5 sigma"
                f" or left out, of {each.samples * len(each.channels)}.",
                "note",
            )
        ratio = _ratio(each)
        if ratio is not None and ratio > _HIGH:
            text = f"{what}: the residuals are {fixed(ratio, 1)} times the assumed noise."
            yield Statement(text, "bad")
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
        unit = shown_unit(each.unit, "error")
        ratio = _ratio(each)
        rows.append(
            (
                each.run,
                each.instrument,
                words(each.quantity),
                unit.name,
                str(each.samples),
                ", ".join(alike([scaled(rms, unit.factor) for rms in each.rms])),
                "-" if ratio is None else fixed(ratio, 2),
                "-" if each.worst is None else fixed(each.worst, 1),
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
    title = "Residuals: measured minus predicted"
    return Grid(title, head, tuple(rows), frozenset({4, 6, 7, 8}))


def _noise(summary: Summary) -> Grid:
    """Noise as stated, as the fit assumes it, and as estimated from the data."""
    rows = []
    for each in summary.evidence.noise:
        unit = shown_unit(each.unit, "error")
        values = [figures(scaled(v, unit.factor)) for v in (each.stated, each.used, each.found)]
        rows.append((each.instrument, words(each.quantity), unit.name, *values))
    head = ("instrument", "quantity", "unit", "stated", "assumed", "estimated")
    return Grid("Noise of single samples, 1-sigma", head, tuple(rows), frozenset({3, 4, 5}))


def _figure(each: Trace) -> Figure:
    """Measured and predicted over time, and below their residuals."""
    unit = shown_unit(each.unit, each.quantity)
    measured = np.array(each.measured, dtype=np.float64) * unit.factor
    residual = np.array(each.residual, dtype=np.float64)
    predicted = measured - residual * unit.factor
    if each.sigma is None:
        shown, residual_unit = residual * unit.factor, unit.name
    else:
        shown, residual_unit = residual / np.array(each.sigma)[:, None], "1-sigma"
    quantity = words(each.quantity)
    across = "number of the pose" if each.static else "time [s]"
    layout = {
        "xaxis": {"title": {"text": across}, "anchor": "y2"},
        "yaxis": {"title": {"text": f"{quantity} [{unit.name}]"}, "domain": [0.4, 1.0]},
        "yaxis2": {"title": {"text": f"residual [{residual_unit}]"}, "domain": [0.0, 0.32]},
    }
    who = "the platform" if each.instrument == PLATFORM else each.instrument
    drawn = "points measured, rings predicted" if each.static else "measured thin, predicted dashed"
    if len(each.time) < each.samples:
        drawn += f", {len(each.time)} of {each.samples} samples"
    text = (
        f"{quantity} of {who} in run {each.run}, channels {', '.join(each.channels)},"
        f" measured and predicted, and below their residuals; {_summed(each, unit)}"
    )
    return Figure(
        slug("trace", each.run, each.instrument, each.quantity),
        f"Run {each.run}: {who}, {quantity} ({drawn})",
        text,
        (*_lines(each, measured, predicted), *_residual_lines(each, shown)),
        layout,
        height=440,
    )


def _summed(each: Trace, unit: Unit) -> str:
    """The largest root mean square of the residuals."""
    rms = [r for r in each.rms if r is not None]
    if not rms:
        return "nothing was measured."
    return f"root mean square {figures(max(rms) * unit.factor, 3)} {unit.name} at most."


def _lines(each: Trace, measured: Any, predicted: Any) -> Iterator[dict[str, Any]]:
    """Measured and predicted, shape (k, n); poses at rest have nothing between them: points, and
    rings about them.
    """
    for i, (name, values) in enumerate(zip(each.channels, measured, strict=True)):
        yield {**_drawn(each, name, values, i, size=5, width=1), "opacity": 0.75}
    for i, (name, values) in enumerate(zip(each.channels, predicted, strict=True)):
        drawn = _drawn(each, f"{name}, predicted", values, i, size=11, width=1.5)
        if each.static:
            drawn["marker"]["symbol"] = "circle-open"
        else:
            drawn["line"]["dash"] = "dash"
        yield {**drawn, "legendgroup": name, "showlegend": False}


def _drawn(
    each: Trace, name: str, values: Any, channel: int, *, size: int, width: float
) -> dict[str, Any]:
    """A channel as a line, or as points where the platform rests."""
    colour = line_colour(channel)
    drawn = line(name, each.time, values, {"width": width, "color": colour}, legendgroup=name)
    if each.static:
        del drawn["line"]
        drawn |= {"mode": "markers", "marker": {"size": size, "color": colour}}
    return drawn


def _residual_lines(each: Trace, residual: Any) -> Iterator[dict[str, Any]]:
    """Residuals below the measurements, shape (k, n); those that the fit leaves out are marked."""
    out = np.zeros(residual.shape, dtype=bool)
    for channel, sample in each.left_out:
        out[channel, sample] = True
    used = np.where(out, np.nan, residual)
    for i, (name, values) in enumerate(zip(each.channels, used, strict=True)):
        drawn = _drawn(each, f"{name}, residual", values, i, size=5, width=1)
        yield {**drawn, "legendgroup": name, "showlegend": False, "yaxis": "y2"}
    if out.any():
        channels, samples = np.nonzero(out)
        # What is left out may be far off the scale: it is marked where it happened.
        limit = float(np.nanmax(np.abs(used), initial=1.0))
        cross = {"size": 7, "symbol": "x-thin-open", "color": "var(--bad)"}
        at = np.array(each.time)[samples]
        values = np.clip(residual[channels, samples], -limit, limit)
        yield points("left out", at, values, cross, yaxis="y2")


def _spectra(traces: Sequence[Trace]) -> Iterator[Figure]:
    """Of every run one figure."""
    by_run: dict[str, list[dict[str, Any]]] = {}
    for each in traces:
        if each.spectrum is not None:
            name, spectrum = f"{each.instrument}, {words(each.quantity)}", each.spectrum
            drawn = line(name, spectrum.frequency, spectrum.power, {"width": 1.5})
            by_run.setdefault(each.run, []).append(drawn)
    for run, data in by_run.items():
        text = (
            f"Spectra of the residuals in run {run}. White noise of the assumed size is flat at 1;"
            " a peak is a motion or a vibration that the model does not follow. Cables enter six"
            " equations together, so that theirs are below 1."
        )
        yield Figure(
            slug("spectra", run),
            f"Run {run}: spectra of the residuals (1: white noise of the assumed size)",
            text,
            tuple(data),
            axes("frequency [Hz]", "power over that of white noise", "log"),
            height=380,
        )
