"""What was found in recordings as a document with pictures."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from steelyard.arrays import Array
from steelyard.experiment.model import Run
from steelyard.inspection.agreement import InstrumentAgreement
from steelyard.inspection.contact import Residual
from steelyard.inspection.inspect import Inspection
from steelyard.inspection.streams import StreamReport
from steelyard.report.document import Document, Figure, Section, Statement, Statements, Tone
from steelyard.report.inspection import grids, statements

_MOST_POINTS = 3000
"""Of a line."""
_MOST_RUNS = 4
"""That are drawn."""
_MARKS = {"gap": "var(--muted)", "stuck": "var(--bad)"}
_TONES: dict[str, Tone] = {"red": "bad", "yellow": "note", "green": "good"}


def inspection_document(found: Inspection) -> Document:
    """Everything that there is to say and to see."""
    said = Statements(
        tuple(Statement(text, _TONES.get(style, "")) for text, style in statements(found))
    )
    tables = tuple(grid for grid in grids(found) if grid.rows)
    return Document(
        f"{found.experiment.name}: what is in the recordings",
        _lead(found),
        (
            *((Section("found", "What was found", (said,)),) if said.items else ()),
            Section("numbers", "Numbers", tables),
            *_pictures(found),
        ),
    )


def _lead(found: Inspection) -> Statement:
    if found.mistakes:
        count = len(found.mistakes)
        which = "a mistake" if count == 1 else f"{count} mistakes"
        return Statement(f"The description has {which}; below stands what to change.", "bad")
    if not all(each.agrees for _, each in found.agreements):
        return Statement(
            "The instruments contradict each other, and no simple mistake explains it.", "bad"
        )
    if found.contacts:
        return Statement(
            "The instruments agree as described, but something else than the body pulled or"
            " pushed.",
            "note",
        )
    return Statement("The instruments agree as described.", "good")


def _pictures(found: Inspection) -> Iterator[Section]:
    """Sections of figures, of what there is."""
    runs = [run for run in found.experiment.runs if not run.static][:_MOST_RUNS]
    by_name = {run.name: run for run in runs}
    agreements = [(name, each) for name, each in found.agreements if name in by_name]
    streams = [report for report in found.streams if report.run in by_name]
    shown = (
        (
            "attainable",
            "How well it can be known",
            (_bars(found),) if found.excitation is not None else (),
        ),
        (
            "balance",
            "Forces that no body explains",
            tuple(_balance(found, each, i) for i, each in enumerate(found.residuals[:_MOST_RUNS])),
        ),
        (
            "agreements",
            "Measured against predicted",
            tuple(_agreement(name, each, i) for i, (name, each) in enumerate(agreements)),
        ),
        (
            "streams",
            "Streams",
            tuple(_stream(found, by_name[each.run], each, i) for i, each in enumerate(streams)),
        ),
        (
            "spectra",
            "Spectra",
            (
                (_spectra(streams),)
                if any(len(q.frequency) for r in streams for q in r.quantities)
                else ()
            ),
        ),
    )
    for name, title, figures in shown:
        if figures:
            yield Section(name, title, figures)


def _axes(x: str, y: str) -> dict[str, Any]:
    return {"xaxis": {"title": {"text": x}}, "yaxis": {"title": {"text": y}}}


def _lines(
    x: Array, columns: Array, names: list[str], *, dash: str = "solid"
) -> Iterator[dict[str, Any]]:
    few = slice(None, None, -(-len(x) // _MOST_POINTS) or 1)
    for i, name in enumerate(names):
        line = {"color": f"var(--line-{i % 8 + 1})", "width": 1.2, "dash": dash}
        yield {
            "type": "scatter",
            "mode": "lines",
            "name": name,
            "x": x[few],
            "y": columns[few, i],
            "line": line,
        }


def _stretch(start: float, end: float, colour: str) -> dict[str, Any]:
    """A shape that marks a time."""
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


def _bars(found: Inspection) -> Figure:
    assert found.excitation is not None
    shares: dict[str, list[float]] = {}
    for each in found.excitation.calibration:
        if each.prior:
            shares.setdefault(each.group, []).append(max(each.sigma / each.prior, 1e-6))
    # Of all axes or cables of an error the middle one.
    bar = {"type": "bar", "x": list(shares), "y": [float(np.median(of)) for of in shares.values()]}
    return Figure(
        "attainable",
        "1-sigma at best of the systematic errors, as a part of what was known beforehand",
        "A bar per systematic error: at one the recording tells nothing of it.",
        (bar,),
        {"yaxis": {"type": "log"}},
    )


def _balance(found: Inspection, residual: Residual, place: int) -> Figure:
    contacts = [each for each in found.contacts if each.run == residual.run]
    return Figure(
        f"balance-{place + 1}",
        f"run {residual.run}: {residual.instrument}",
        f"What is left of forces and torques over time; {len(contacts)} contacts are marked.",
        tuple(_lines(residual.time, residual.left, list(residual.names))),
        {
            **_axes("common time [s]", "force [N], torque [N m]"),
            "shapes": [_stretch(each.start, each.end, "var(--bad)") for each in contacts],
        },
    )


def _agreement(run: str, agreement: InstrumentAgreement, place: int) -> Figure:
    width = agreement.measured.shape[1]
    axes = (
        list(agreement.channels[:width])
        if len(agreement.channels) >= width
        else [str(i + 1) for i in range(width)]
    )
    at = np.arange(len(agreement.measured), dtype=np.float64)
    lines = [*_lines(at, agreement.measured, axes)]
    if agreement.predicted.shape == agreement.measured.shape:
        lines += _lines(
            at, agreement.predicted, [f"{axis}, predicted" for axis in axes], dash="dot"
        )
    return Figure(
        f"agreement-{place + 1}",
        f"run {run}: {agreement.name}",
        f"Measured lines and, dotted, what the others predict; at worst {agreement.worst:.2g} of"
        " what may be left between them.",
        tuple(lines),
        _axes("instant", agreement.unit),
    )


def _stream(found: Inspection, run: Run, report: StreamReport, place: int) -> Figure:
    stream = run.streams[report.instrument]
    time = found.experiment.common_time(run, report.instrument)
    lines: list[dict[str, Any]] = []
    for q in report.quantities:
        values = stream.values[q.name]
        flat = values.reshape(len(values), -1)
        lines += _lines(
            time, flat, [f"{q.name.replace('_', ' ')} {i + 1}" for i in range(flat.shape[1])]
        )
    shift = float(time[0] - stream.time[0])
    marked = [fault for fault in report.faults if fault.kind in _MARKS]
    return Figure(
        f"stream-{place + 1}",
        f"run {run.name}: {report.instrument}",
        f"All channels over time; {len(marked)} gaps and stuck stretches are marked.",
        tuple(lines),
        {
            **_axes("common time [s]", "; ".join(dict.fromkeys(q.unit for q in report.quantities))),
            "shapes": [
                _stretch(fault.start + shift, fault.end + shift, _MARKS[fault.kind])
                for fault in marked
            ],
        },
    )


def _spectra(streams: list[StreamReport]) -> Figure:
    lines = [
        {
            "type": "scatter",
            "mode": "lines",
            "name": f"{report.run}: {report.instrument}, {q.name.replace('_', ' ')} [{q.unit}]",
            "x": q.frequency[1:],
            "y": np.maximum(q.density[1:], 1e-12),
        }
        for report in streams
        for q in report.quantities
        if not report.commanded and len(q.frequency)
    ]
    axes = _axes("frequency [Hz]", "unit / √Hz")
    layout = {name: {**axis, "type": "log"} for name, axis in axes.items()}
    return Figure(
        "spectra",
        "Amplitude density",
        "A line per quantity, over frequency.",
        tuple(lines),
        layout,
        480,
    )
