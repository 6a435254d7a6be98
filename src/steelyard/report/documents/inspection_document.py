"""What was found in recordings as a document with pictures."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from steelyard.arrays import Array
from steelyard.digits import figures
from steelyard.experiment.model import Run
from steelyard.inspection.agreements.agreement import InstrumentAgreement
from steelyard.inspection.contact import Residual
from steelyard.inspection.inspect import Inspection
from steelyard.inspection.streams import StreamReport
from steelyard.report.blocks.document import Document, Figure, Section, Statement, Statements
from steelyard.report.blocks.plot import axes, line, stretch
from steelyard.report.blocks.shown import line_colour, words
from steelyard.report.documents.inspection import grids, statements

_MOST_POINTS = 3000
"""Of a line: more than a screen has columns of pixels."""
_MOST_RUNS = 4
"""Runs that are drawn, to keep the page small."""
_LEAST_DENSITY = 1e-12
"""Logarithmic axes need more than zero."""
_MARKS = {"gap": "var(--muted)", "stuck": "var(--bad)"}


def inspection_document(found: Inspection) -> Document:
    """Everything that there is to say and to see."""
    sections = []
    if said := tuple(statements(found)):
        sections.append(Section("found", "What was found", (Statements(said),)))
    tables = tuple(grid for grid in grids(found) if grid.rows)
    sections += [Section("numbers", "Numbers", tables), *_pictures(found)]
    title = f"{found.experiment.name}: what is in the recordings"
    return Document(title, _lead(found), tuple(sections))


def _lead(found: Inspection) -> Statement:
    """Whether the description agrees with the recordings."""
    if found.mistakes:
        count = len(found.mistakes)
        which = "a mistake" if count == 1 else f"{count} mistakes"
        return Statement(f"The description has {which}; see below what to change.", "bad")
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
    balances = [_balance(found, each, i) for i, each in enumerate(found.residuals[:_MOST_RUNS])]
    pairs = [_agreement(name, each, i) for i, (name, each) in enumerate(agreements)]
    over_time = [_stream(found, by_name[each.run], each, i) for i, each in enumerate(streams)]
    has_spectra = any(len(q.frequency) for each in streams for q in each.quantities)
    shown = (
        ("attainable", "Identifiability", [_bars(found)] if found.excitation else []),
        ("balance", "Residuals of the force balance", balances),
        ("agreements", "Measured against predicted", pairs),
        ("streams", "Streams", over_time),
        ("spectra", "Spectra", [_spectra(streams)] if has_spectra else []),
    )
    for name, title, pictures in shown:
        if pictures:
            yield Section(name, title, tuple(pictures))


def _lines(
    x: Array, columns: Array, names: list[str], *, dash: str = "solid"
) -> Iterator[dict[str, Any]]:
    """A line a column of shape (n, k) over x of shape (n,), thinned evenly."""
    few = slice(None, None, -(-len(x) // _MOST_POINTS) or 1)
    for i, name in enumerate(names):
        style = {"color": line_colour(i), "width": 1.2, "dash": dash}
        yield line(name, x[few], columns[few, i], style)


def _bars(found: Inspection) -> Figure:
    """How much of the prior uncertainty of each calibration parameter is left at best."""
    assert found.excitation is not None
    shares: dict[str, list[float]] = {}
    for each in found.excitation.calibration:
        if each.prior:
            shares.setdefault(each.group, []).append(max(each.sigma / each.prior, 1e-6))
    # Of all axes or cables of an error the middle one.
    bar = {"type": "bar", "x": list(shares), "y": [float(np.median(of)) for of in shares.values()]}
    return Figure(
        "attainable",
        "Smallest 1-sigma of the calibration parameters, as a part of their prior 1-sigma",
        "A bar per calibration parameter: at one the recording has no information on it.",
        (bar,),
        {"yaxis": {"type": "log"}},
    )


def _balance(found: Inspection, residual: Residual, place: int) -> Figure:
    """Residuals of the force balance over time, contacts marked."""
    contacts = [each for each in found.contacts if each.run == residual.run]
    return Figure(
        f"balance-{place + 1}",
        f"run {residual.run}: {residual.instrument}",
        f"Residuals of forces and torques over time; {len(contacts)} contacts are marked.",
        tuple(_lines(residual.time, residual.left, list(residual.names))),
        {
            **axes("common time [s]", "force [N], torque [N m]"),
            "shapes": [stretch(each.start, each.end, "var(--bad)") for each in contacts],
        },
    )


def _agreement(run: str, agreement: InstrumentAgreement, place: int) -> Figure:
    """What one instrument measured over what the others predict."""
    width = agreement.measured.shape[1]
    names = list(agreement.channels[:width])
    if len(names) < width:
        names = [str(i + 1) for i in range(width)]
    at = np.arange(len(agreement.measured), dtype=np.float64)
    lines = [*_lines(at, agreement.measured, names)]
    if agreement.predicted.shape == agreement.measured.shape:
        predicted = [f"{name}, predicted" for name in names]
        lines += _lines(at, agreement.predicted, predicted, dash="dot")
    return Figure(
        f"agreement-{place + 1}",
        f"run {run}: {agreement.name}",
        f"Measured lines and, dotted, as predicted by the others; the residual is at most"
        f" {figures(agreement.worst, 2)} of what is allowed.",
        tuple(lines),
        axes("instant", agreement.unit),
    )


def _stream(found: Inspection, run: Run, report: StreamReport, place: int) -> Figure:
    """All channels of a stream over time, gaps and stuck stretches marked."""
    stream = run.streams[report.instrument]
    time = found.experiment.common_time(run, report.instrument)
    lines: list[dict[str, Any]] = []
    for q in report.quantities:
        values = stream.values[q.name]
        flat = values.reshape(len(values), -1)
        lines += _lines(time, flat, [f"{words(q.name)} {i + 1}" for i in range(flat.shape[1])])
    shift = float(time[0] - stream.time[0])
    marked = [fault for fault in report.faults if fault.kind in _MARKS]
    units = "; ".join(dict.fromkeys(q.unit for q in report.quantities))
    shapes = [stretch(f.start + shift, f.end + shift, _MARKS[f.kind]) for f in marked]
    return Figure(
        f"stream-{place + 1}",
        f"run {run.name}: {report.instrument}",
        f"All channels over time; {len(marked)} gaps and stuck stretches are marked.",
        tuple(lines),
        {**axes("common time [s]", units), "shapes": shapes},
    )


def _spectra(streams: list[StreamReport]) -> Figure:
    """Amplitude densities of all quantities."""
    lines = []
    for report in streams:
        if report.commanded:
            continue
        for q in report.quantities:
            if len(q.frequency):
                name = f"{report.run}: {report.instrument}, {words(q.name)} [{q.unit}]"
                density = np.maximum(q.density[1:], _LEAST_DENSITY)
                lines.append(line(name, q.frequency[1:], density, {}))
    return Figure(
        "spectra",
        "Amplitude density",
        "A line per quantity, over frequency.",
        tuple(lines),
        axes("frequency [Hz]", "unit / √Hz", "log"),
        480,
    )
