"""What was found in recordings as a document with pictures."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from steelyard.arrays import Array
from steelyard.digits import figures
from steelyard.experiment.recording import Run
from steelyard.inspection.agreements.agreement import InstrumentAgreement
from steelyard.inspection.contact import Residual
from steelyard.inspection.inspect import Inspection
from steelyard.inspection.streams import StreamReport
from steelyard.report.blocks.document import (
    Block,
    Document,
    Figure,
    Section,
    Statement,
    Statements,
    by_choice,
)
from steelyard.report.blocks.plot import Panel, axes, line, stacked, stretch
from steelyard.report.blocks.shown import line_colour, shown_unit, words
from steelyard.report.documents.inspection import grids, statements

_MOST_POINTS = 3000
"""Of a line: more than a screen has columns of pixels."""
_MOST_RUNS = 4
"""Runs that are drawn, to keep the page small."""
_LEAST_DENSITY = 1e-12
"""Logarithmic axes need more than zero."""
_TIME = "time [s]"
_MATRIX = 9
"""Numbers of a rotation matrix, which nobody reads as such."""
_WRENCH = ("fx", "fy", "fz", "tx", "ty", "tz")
_PANEL, _MARGINS = 190, 130
"""Heights of a panel, and of what is above and below all of them [px]."""
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
    if found.misplaced is not None:
        return Statement(f"{found.misplaced.remark}.", "bad")
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
    balances = [
        (each.run, _balance(found, each, i)) for i, each in enumerate(found.residuals[:_MOST_RUNS])
    ]
    pairs = [(name, _agreement(name, each, i)) for i, (name, each) in enumerate(agreements)]
    over_time = [
        (each.run, _stream(found, by_name[each.run], each, i)) for i, each in enumerate(streams)
    ]
    has_spectra = any(len(q.frequency) for each in streams for q in each.quantities)
    shown = (
        ("attainable", "Identifiability", [_bars(found)] if found.excitation else []),
        ("balance", "Residuals of the force balance", _each_run(balances)),
        ("agreements", "Measured against predicted", _each_run(pairs)),
        ("streams", "Streams", _each_run(over_time)),
        ("spectra", "Spectra", [_spectra(streams)] if has_spectra else []),
    )
    for name, title, blocks in shown:
        if blocks:
            yield Section(name, title, tuple(blocks))


def _each_run(pictures: Sequence[tuple[str, Figure]]) -> list[Block]:
    """Pictures by their runs; of several one is chosen."""
    runs = dict.fromkeys(run for run, _ in pictures)
    return by_choice(
        "Run", [(name, tuple(each for run, each in pictures if run == name)) for name in runs]
    )


def _lines(
    x: Array, columns: Array, names: Sequence[str], *, dash: str = "solid"
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
    panels = _wrench_panels(residual.time, residual.left, list(residual.names))
    lines, layout = stacked(_TIME, panels)
    marked = [stretch(each.start, each.end, "var(--bad)") for each in contacts]
    return Figure(
        f"balance-{place + 1}",
        f"Run {residual.run}: {residual.instrument}",
        f"Residuals of forces and torques over time; {len(contacts)} contacts are marked.",
        tuple(lines),
        {**layout, "shapes": marked},
        _height(panels),
    )


def _height(panels: Sequence[Panel]) -> int:
    """Of a picture of panels above each other [px]."""
    return _PANEL * len(panels) + _MARGINS


def _wrench_panels(time: Array, values: Array, names: Sequence[str], **style: Any) -> list[Panel]:
    """Forces and torques, each in its unit; shape (n, k), names as `fx` and `tz`, or of cables."""
    torques = [i for i, name in enumerate(names) if name.startswith(("t", "torque"))]
    forces = [i for i in range(len(names)) if i not in torques]
    panels = []
    for title, places in (("force [N]", forces), ("torque [N m]", torques)):
        if places:
            own = [_axis_of(names[i]) for i in places]
            panels.append(Panel(title, list(_lines(time, values[:, places], own, **style))))
    return panels


def _axis_of(name: str) -> str:
    """Of a component of a wrench, such as `fx` or "force x of the platform"; other names as they
    are.
    """
    found = re.fullmatch(r"[ft]([xyz])|(?:force|torque) ([xyz])\b.*", name)
    return (found[1] or found[2]) if found else name


def _as_shown(values: Array, unit: str, name: str = "") -> tuple[Array, list[str], str]:
    """Values of shape (n, …) as people read them: columns, their names, and the unit. Rotation
    matrices are angles.
    """
    flat = values.reshape(len(values), -1)
    width = flat.shape[1]
    if width == _MATRIX:
        return _angles(flat.reshape(-1, 3, 3)), ["roll", "pitch", "yaw"], "°"
    shown = shown_unit(unit)
    names = ["x", "y", "z"] if width == len("xyz") else [f"cable {i + 1}" for i in range(width)]
    return flat * shown.factor, [name] if width == 1 and name else names, shown.name


def _angles(matrices: Array) -> Array:
    """Roll, pitch and yaw without jumps [deg], shape (n, 3); NaN where there is no rotation."""
    angles = np.full((len(matrices), 3), np.nan)
    known = np.asarray(np.isfinite(matrices).all(axis=(1, 2)))
    known[known] &= np.linalg.det(matrices[known]) > 0
    if known.any():
        turned = Rotation.from_matrix(matrices[known]).as_euler("ZYX")[:, ::-1]
        angles[known] = np.degrees(np.unwrap(turned, axis=0))
    return angles


def _agreement(run: str, agreement: InstrumentAgreement, place: int) -> Figure:
    """What one instrument measured over what the others predict."""
    n = len(agreement.measured)
    has_time = agreement.time is not None and len(agreement.time) == n
    time = agreement.time if has_time and agreement.time is not None else np.arange(n, dtype=float)
    measured, names, unit = _as_shown(agreement.measured, agreement.unit, "length")
    accounts = [(measured, "solid")]
    if agreement.predicted.shape == agreement.measured.shape:
        accounts.append((_as_shown(agreement.predicted, agreement.unit)[0], "dot"))
    if tuple(agreement.channels[: len(_WRENCH)]) == _WRENCH:
        each = [_wrench_panels(time, v, list(_WRENCH), dash=dash) for v, dash in accounts]
        panels = [
            Panel(of[0].title, [line for panel in of for line in panel.lines])
            for of in zip(*each, strict=True)
        ]
    else:
        drawn = [line for v, dash in accounts for line in _lines(time, v, names, dash=dash)]
        panels = [Panel(f"[{unit}]", drawn)]
    lines, layout = stacked(_TIME if has_time else "instant", panels)
    return Figure(
        f"agreement-{place + 1}",
        f"Run {run}: {agreement.name} (measured solid, predicted dotted)",
        f"Measured lines and, dotted, as predicted by the others; the residual is at most"
        f" {figures(agreement.worst, 2)} of what is allowed.",
        tuple(lines),
        layout,
        _height(panels),
    )


def _stream(found: Inspection, run: Run, report: StreamReport, place: int) -> Figure:
    """All channels of a stream over time, a panel a quantity, gaps and stuck stretches marked."""
    stream = run.streams[report.instrument]
    time = found.experiment.common_time(run, report.instrument)
    panels = []
    for q in report.quantities:
        values, names, unit = _as_shown(stream.values[q.name], q.unit, words(q.name))
        panels.append(Panel(f"{words(q.name)} [{unit}]", list(_lines(time, values, names))))
    shift = float(time[0] - stream.time[0])
    marked = [fault for fault in report.faults if fault.kind in _MARKS]
    shapes = [stretch(f.start + shift, f.end + shift, _MARKS[f.kind]) for f in marked]
    lines, layout = stacked(_TIME, panels)
    return Figure(
        f"stream-{place + 1}",
        f"Run {run.name}: {report.instrument}",
        f"All channels over time; {len(marked)} gaps and stuck stretches are marked.",
        tuple(lines),
        {**layout, "shapes": shapes},
        _height(panels),
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
