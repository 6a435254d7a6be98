"""What was found in recordings as one page with pictures, which needs nothing but itself."""

from __future__ import annotations

import html
from collections.abc import Iterator
from typing import Any

import numpy as np

from steelyard.arrays import Array
from steelyard.experiment.model import Run
from steelyard.inspection.agreement import Agreement
from steelyard.inspection.contact import Residual
from steelyard.inspection.inspect import Inspection
from steelyard.inspection.streams import StreamReport
from steelyard.report.inspection import grids, statements

_MOST_POINTS = 3000
"""Of a line."""
_MOST_RUNS = 4
"""That are drawn."""
_COLOURS = (
    "#1f77b4",
    "#ff7f0e",
    "#2ca02c",
    "#d62728",
    "#9467bd",
    "#8c564b",
    "#e377c2",
    "#7f7f7f",
    "#bcbd22",
    "#17becf",
)
_MARKS = {"gap": "#999999", "stuck": "#d62728", "clipped": "#ff7f0e"}
_STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; max-width: 1100px; margin: 2rem auto; padding: 0 1rem; color: #222; }
table { border-collapse: collapse; margin: .5rem 0 1.5rem; font-size: 13px; } th, td { padding: .2rem .6rem; border-bottom: 1px solid #ddd; text-align: left; }
td.r, th.r { text-align: right; font-variant-numeric: tabular-nums; } li.red { color: #b00020; } li.yellow { color: #8a5a00; } li.green { color: #1b7f3b; }
"""


def inspection_page(found: Inspection) -> str:
    """HTML of an inspection; the same bytes for the same input."""
    from plotly.offline import get_plotlyjs

    title = html.escape(found.experiment.name)
    parts = [
        "<!DOCTYPE html>", '<html lang="en"><head><meta charset="utf-8">', f"<title>{title}</title>", f"<style>{_STYLE}</style>",
        f"<script>{get_plotlyjs()}</script>", "</head><body>", f"<h1>{title}: what is in the recordings</h1>", "<ul>",
        *(f'<li class="{style}">{html.escape(text)}</li>' for text, style in statements(found)), "</ul>",
    ]  # fmt: skip
    for grid in grids(found):
        parts.append(f"<h2>{html.escape(grid.title)}</h2><table>")
        for i, row in enumerate(grid.rows):
            tag = "td" if i else "th"
            cells = "".join(
                f'<{tag} class="r">{html.escape(cell)}</{tag}>'
                if k in grid.right
                else f"<{tag}>{html.escape(cell)}</{tag}>"
                for k, cell in enumerate(row)
            )
            parts.append(f"<tr>{cells}</tr>")
        parts.append("</table>")
    for i, (heading, figure) in enumerate(_figures(found)):
        if heading:
            parts.append(f"<h2>{html.escape(heading)}</h2>")
        parts.append(figure.to_html(full_html=False, include_plotlyjs=False, div_id=f"figure-{i}"))
    return "\n".join([*parts, "</body></html>", ""])


def _figures(found: Inspection) -> Iterator[tuple[str, Any]]:
    runs = [run for run in found.experiment.runs if not run.static][:_MOST_RUNS]
    if found.excitation is not None:
        yield "How well it can be known", _bars(found)
    for i, residual in enumerate(found.residuals[:_MOST_RUNS]):
        yield "Forces that no body explains" if not i else "", _balance(found, residual)
    names = {run.name for run in runs}
    shown = [(run, each) for run, each in found.agreements if run in names]
    for i, (name, agreement) in enumerate(shown):
        yield "Measured against predicted" if not i else "", _agreement(name, agreement)
    for i, report in enumerate(r for r in found.streams if r.run in names):
        run = next(r for r in runs if r.name == report.run)
        yield "Streams" if not i else "", _stream(found, run, report)
    if any(len(q.frequency) for r in found.streams for q in r.quantities):
        yield "Spectra", _spectra(found, names)


def _figure(title: str, x: str, y: str, **axes: Any) -> Any:
    import plotly.graph_objects as go

    figure = go.Figure()
    figure.update_layout(
        title={"text": html.escape(title), "font": {"size": 14}}, template="plotly_white", height=320, xaxis_title=x, yaxis_title=y,
        margin={"l": 60, "r": 20, "t": 40, "b": 45}, **axes,
    )  # fmt: skip
    return figure


def _lines(figure: Any, x: Array, columns: Array, names: list[str], *, dash: str | None = None) -> None:
    import plotly.graph_objects as go

    few = slice(None, None, max(1, len(x) // _MOST_POINTS))
    for i, name in enumerate(names):
        line = {"color": _COLOURS[i % len(_COLOURS)], "width": 1.2, "dash": dash}
        y = np.where(np.isfinite(columns[few, i]), columns[few, i], np.nan)
        figure.add_trace(
            go.Scatter(
                x=[float(f"{v:.6g}") for v in x[few]], y=[None if np.isnan(v) else float(f"{v:.5g}") for v in y],
                name=html.escape(name), mode="lines", line=line,
            )
        )  # fmt: skip


def _bars(found: Inspection) -> Any:
    import plotly.graph_objects as go

    assert found.excitation is not None
    figure = _figure("1-sigma at best, as a part of what was known beforehand", "", "", yaxis_type="log")
    shares: dict[str, list[float]] = {}
    for each in found.excitation.calibration:
        if each.prior:
            shares.setdefault(each.group, []).append(max(each.sigma / each.prior, 1e-6))
    # Of all axes or cables of an error the middle one.
    middle = [float(f"{np.median(of):.4g}") for of in shares.values()]
    figure.add_trace(go.Bar(x=[html.escape(name) for name in shares], y=middle))
    return figure


def _balance(found: Inspection, residual: Residual) -> Any:
    figure = _figure(f"run {residual.run}: {residual.instrument}", "common time [s]", "force [N], torque [N m]")
    _lines(figure, residual.time, residual.left, list(residual.names))
    for contact in found.contacts:
        if contact.run == residual.run:
            figure.add_vrect(x0=contact.start, x1=contact.end, fillcolor="#d62728", opacity=0.12, line_width=0)
    return figure


def _agreement(run: str, agreement: Agreement) -> Any:
    figure = _figure(f"run {run}: {agreement.name}", "instant", agreement.unit)
    width = agreement.measured.shape[1]
    axes = list(agreement.channels[:width]) if len(agreement.channels) >= width else [str(i + 1) for i in range(width)]
    at = np.arange(len(agreement.measured), dtype=np.float64)
    _lines(figure, at, agreement.measured, axes)
    if agreement.predicted.shape == agreement.measured.shape:
        _lines(figure, at, agreement.predicted, [f"{axis}, predicted" for axis in axes], dash="dot")
    return figure


def _stream(found: Inspection, run: Run, report: StreamReport) -> Any:
    stream = run.streams[report.instrument]
    time = found.experiment.common_time(run, report.instrument)
    figure = _figure(
        f"run {run.name}: {report.instrument}",
        "common time [s]",
        "; ".join(dict.fromkeys(q.unit for q in report.quantities)),
    )
    for q in report.quantities:
        values = stream.values[q.name]
        flat = values.reshape(len(values), -1)
        _lines(figure, time, flat, [f"{q.name.replace('_', ' ')} {i + 1}" for i in range(flat.shape[1])])
    shift = float(time[0] - stream.time[0])
    for fault in report.faults:
        if fault.kind in _MARKS and fault.kind != "clipped":
            figure.add_vrect(
                x0=fault.start + shift, x1=fault.end + shift, fillcolor=_MARKS[fault.kind], opacity=0.2, line_width=0
            )
    return figure


def _spectra(found: Inspection, names: set[str]) -> Any:
    import plotly.graph_objects as go

    figure = _figure("amplitude density", "frequency [Hz]", "unit / √Hz", xaxis_type="log", yaxis_type="log")
    for report in found.streams:
        for q in report.quantities:
            if report.run in names and report.kind != "command" and len(q.frequency):
                name = f"{report.run}: {report.instrument}, {q.name.replace('_', ' ')} [{q.unit}]"
                x, y = q.frequency[1:], np.maximum(q.density[1:], 1e-12)
                figure.add_trace(
                    go.Scatter(
                        x=[float(f"{v:.5g}") for v in x],
                        y=[float(f"{v:.4g}") for v in y],
                        name=html.escape(name),
                        mode="lines",
                    )
                )
    return figure
