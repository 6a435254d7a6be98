"""The page of a campaign: parameters over time, control charts, scatter, verdicts, all
experiments.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from steelyard.campaigns.charts.control import Alarm, ParameterChart, intervals, parameter_chart
from steelyard.campaigns.charts.series import Series, series_of
from steelyard.campaigns.charts.settings import CHARTS
from steelyard.campaigns.results import best_rows, link
from steelyard.campaigns.rows import DONE
from steelyard.campaigns.work import INSPECT
from steelyard.digits import LABELS, SHORT_LABELS, figures, fixed, number
from steelyard.inertia import BODY_PARAMETERS
from steelyard.output import results_file, write_file
from steelyard.report.blocks.document import (
    Block,
    Document,
    Figure,
    Grid,
    Section,
    Statement,
    Statements,
)
from steelyard.report.blocks.plot import axes, line, points
from steelyard.report.blocks.shown import line_colour
from steelyard.report.forms.markdown import markdown
from steelyard.report.forms.page import page

if TYPE_CHECKING:
    import polars as pl

PAGE = "campaign"
"""Name of the files, without their endings."""
_MOST_DRAWN = 2000
"""Recordings in a picture, the latest ones; a page of more would be slow."""
_MOST_TICKS = 12
"""Numbers below a picture over recordings."""
_ROUND_SHARE = 0.01
"""Probability from which two digits behind the point say all."""
_MOST_LISTED = 1000
"""Rows of the table of all experiments; the rest is in the table on disk."""
_WORST = 10
"""Experiments that are named as the slowest, and as those farthest off."""


def write_page(table: pl.DataFrame, folder: Path) -> None:
    """Write ``campaign.html`` and ``campaign.md``, the same bytes for the same table."""
    document = campaign_document(table, folder)
    for ending, form in (("html", page), ("md", markdown)):
        with results_file(folder / f"{PAGE}.{ending}", force=True) as path:
            write_file(path, form(document))


def campaign_document(table: pl.DataFrame, folder: Path | None = None) -> Document:
    """What a table of a campaign says.

    Args:
        table: As in ``campaign.parquet``.
        folder: With the files that are led to; None: no links.
    """
    series = series_of(table)
    sections = [Section("verdicts", "Verdicts", tuple(_verdicts(table)))]
    alarms: list[Alarm] = []
    if series is not None and len(series.names) > 1:
        charts = [
            parameter_chart(series.values[:, p], series.sigmas[:, p], p)
            for p in range(len(BODY_PARAMETERS))
        ]
        alarms = sorted((a for c in charts for a in c.alarms), key=lambda a: (a.at, a.parameter))
        sections += [
            Section("changes", "Has the body changed?", tuple(_changes(series, charts, alarms))),
            Section("scatter", "Scatter between recordings", tuple(_scatter(series, charts))),
            Section("parameters", "Parameters over time", tuple(_parameters(series, charts))),
        ]
    sections.append(Section("experiments", "Experiments", tuple(_experiments(table, folder))))
    return Document("Campaign", _lead(table, series, alarms), tuple(sections))


def _lead(table: pl.DataFrame, series: Series | None, alarms: Sequence[Alarm]) -> Statement:
    """The result in one sentence."""
    count = table["experiment"].n_unique()
    said = f"{count} experiment{'' if count == 1 else 's'}"
    if series is None:
        return Statement(f"{said}, no estimate that is accepted.", "note")
    if len(series.names) < 2:
        return Statement(f"{said}; two estimates are needed to compare.")
    if not alarms:
        return Statement(f"{said}; no change of the body is seen.", "good")
    last = alarms[-1]
    return Statement(
        f"{said}; the body has changed: {_in_words(series, last)}"
        f"{'' if len(alarms) == 1 else f' (the last of {len(alarms)} alarms)'}.",
        "bad",
    )


def _in_words(series: Series, alarm: Alarm) -> str:
    """What changed, by how much, since when."""
    name, unit, factor = LABELS[alarm.parameter]
    change = number(alarm.change * factor, alarm.sigma * factor, sign=True)
    return f"{name} by {change} {unit} since {series.names[alarm.since]}"


def _verdicts(table: pl.DataFrame) -> Iterator[Block]:
    """How many ended how, by method, and how often each reason was given."""
    import polars as pl

    said = (
        pl.when(pl.col("status") != DONE)
        .then(pl.col("status"))
        .when(pl.col("method") == INSPECT)
        .then(pl.lit("inspected"))
        .otherwise(
            pl.col("accepted").replace_strict(
                {True: "accepted", False: "not accepted"},
                default="not assessed",
                return_dtype=pl.String,
            )
        )
    )
    counts = table.group_by("method", said.alias("result")).len().sort("method", "result")
    rows = tuple((m or "none", result, str(n)) for m, result, n in counts.iter_rows())
    yield Grid("results by method", ("method", "result", "experiments"), rows, frozenset({2}))


def _changes(
    series: Series, charts: Sequence[ParameterChart], alarms: Sequence[Alarm]
) -> Iterator[Block]:
    """Alarms and the charts themselves."""
    order = "of their times" if series.times is not None else "of their names (not all tell a time)"
    left = f"; {series.rejected} that were not accepted are left out" if series.rejected else ""
    h = ", ".join(
        f"{value:.2f} (allowance {k:g})"
        for k, value in zip(CHARTS.allowances, intervals(), strict=True)
    )
    statements = [
        Statement(f"{_in_words(series, each)}, seen at {series.names[each.at]}", "bad")
        for each in alarms
    ]
    if not alarms:
        statements.append(Statement("No change of any parameter.", "good"))
    statements += [
        Statement(f"{len(series.names)} estimates by {series.method} in the order {order}{left}."),
        Statement(
            "CUSUM: each recording is compared with the mean of all before it since the last"
            f" change. Decision intervals in sigmas: {h}. All charts of all parameters together"
            f" give one false alarm in {CHARTS.recordings_per_alarm:,.0f} recordings on average,"
            " where the stated sigmas are true and the recordings independent."
        ),
    ]
    yield Statements(tuple(statements))
    drawn = slice(max(0, len(series.names) - _MOST_DRAWN), None)
    for i, allowance in enumerate(CHARTS.allowances):
        x = _times(series, drawn)
        data = [
            line(SHORT_LABELS[p], x, chart.sums[i, drawn], {"color": line_colour(p), "width": 1.5})
            for p, chart in enumerate(charts)
        ]
        limit = {"color": "var(--bad)", "dash": "dash", "width": 1.5}
        data.append(line("alarm", [x[0], x[-1]], [1.0, 1.0], limit))
        kind = "sudden" if allowance >= 1 else "slow"
        yield Figure(
            f"cusum-{i}",
            f"Control chart for {kind} changes (allowance {allowance:g} sigmas)",
            f"the sums of all parameters in parts of the decision interval; alarms: {len(alarms)}",
            tuple(data),
            _axes(series, "sum / decision interval"),
        )


def _scatter(series: Series, charts: Sequence[ParameterChart]) -> Iterator[Block]:
    """Differences between recordings against the stated sigma."""
    level = CHARTS.scatter / len(charts)
    rows, marked = [], set()
    statements = []
    for p, chart in enumerate(charts):
        above, below = chart.p_values
        said = "as stated"
        share = fixed(above, 2) if above >= _ROUND_SHARE else figures(above, 2)
        if above < level:
            said = "larger than stated"
        elif below < level:
            said = "smaller than stated"
        if not chart.count:
            said = "-"
        elif said != "as stated":
            marked.add((p, 5))
        sizes = (fixed(chart.chi_square, 1), fixed(chart.ratio, 2)) if chart.count else ("-", "-")
        cells = (*sizes, share, said)
        rows.append((LABELS[p][0], str(chart.count), *cells))
        if above < level:
            statements.append(
                Statement(
                    f"{LABELS[p][0]}: recordings differ {figures(chart.ratio)} times as much as the"
                    " stated 1-sigma says: the estimates are less certain than they state, or the"
                    " body differs from recording to recording.",
                    "bad",
                )
            )
    if any(chart.count and chart.p_values[1] < level for chart in charts):
        statements.append(
            Statement(
                "Recordings differ less than stated where all of them share an error that is part"
                " of the stated 1-sigma, such as a gain of the force sensors; the charts then see"
                " changes later than they could, and false alarms are fewer.",
                "note",
            )
        )
    head = ("parameter", "differences", "chi-square", "scatter / stated", "p", "scatter is")
    yield Grid(
        "scatter between recordings and the stated sigma, changes left out",
        head,
        tuple(rows),
        frozenset({1, 2, 3, 4}),
        marked=frozenset(marked),
    )
    if statements:
        yield Statements(tuple(statements))


def _parameters(series: Series, charts: Sequence[ParameterChart]) -> Iterator[Block]:
    """A picture for each parameter: values with 1-sigma, and the mean before each."""
    drawn = slice(max(0, len(series.names) - _MOST_DRAWN), None)
    x = _times(series, drawn)
    for p, (name, unit, factor) in enumerate(LABELS):
        if not np.isfinite(series.values[drawn, p]).any():
            continue
        bars = {"type": "data", "array": series.sigmas[drawn, p] * factor, "thickness": 1}
        style = {"color": "var(--ink)", "dash": "dot", "width": 1.5}
        values = series.values[drawn, p] * factor
        mean = charts[p].mean[drawn] * factor
        hover = {"text": list(series.names[drawn]), "hovertemplate": "%{text}<br>%{y}"}
        yield Figure(
            f"parameter-{p}",
            f"{name} [{unit}]",
            f"{len(x)} estimates with 1-sigma, and the mean of those before each",
            (
                points("estimate, 1-sigma", x, values, {"size": 5}, error_y=bars, **hover),
                line("mean before", x, mean, style),
            ),
            _axes(series, f"{name} [{unit}]"),
            height=260,
        )


def _times(series: Series, drawn: slice) -> list[Any]:
    """Dates, or numbers from 1 on."""
    if series.times is None:
        return list(range(1, len(series.names) + 1))[drawn]
    return [_date(float(t)) for t in series.times[drawn]]


def _date(seconds: float) -> str:
    return datetime.fromtimestamp(seconds, UTC).strftime("%Y-%m-%d %H:%M:%S")


def _axes(series: Series, y: str) -> dict[str, Any]:
    """Axes of a picture over recordings."""
    found = axes("recording, in the order of names" if series.times is None else "recorded", y)
    if series.times is not None:
        found["xaxis"]["type"] = "date"
    else:
        # There is nothing between two recordings.
        found["xaxis"]["dtick"] = max(1, -(-min(len(series.names), _MOST_DRAWN) // _MOST_TICKS))
    return found


def _experiments(table: pl.DataFrame, folder: Path | None) -> Iterator[Block]:
    """The slowest, and all with their results and files."""
    import polars as pl

    slowest = table.filter(pl.col("seconds").is_not_null()).unique("experiment", keep="first")
    slowest = slowest.sort(["seconds", "experiment"], descending=[True, False]).head(_WORST)
    yield Grid(
        "slowest",
        ("experiment", "time [s]"),
        tuple((name, f"{s:.1f}") for name, s in slowest.select("experiment", "seconds").rows()),
        frozenset({1}),
    )
    best = best_rows(table)
    listed = best
    if len(best) > _MOST_LISTED:
        # What needs a look first.
        sound = ((pl.col("status") == DONE) & pl.col("accepted").fill_null(True)).cast(pl.Int8)
        listed = best.sort(sound, "experiment", maintain_order=True).head(_MOST_LISTED)
        yield Statements(
            (Statement(f"{_MOST_LISTED} of {len(best)}; all are in campaign.parquet.", "note"),)
        )
    rows, links = [], {}
    for i, row in enumerate(listed.iter_rows(named=True)):
        known = row["mass"] is not None
        result = row["status"] if row["status"] != DONE else _accepted(row)
        rows.append(
            (
                row["experiment"],
                row["method"],
                number(row["mass"], row["sigma_mass"]) if known else "-",
                result,
                row["reason"] or "",
            )
        )
        target = _file(row, folder)
        if target is not None:
            links[i, 0] = target
    yield Grid(
        "experiments, each with its best method",
        ("experiment", "method", "mass [kg]", "result", "reason"),
        tuple(rows),
        frozenset({2}),
        links=links,
    )


def _accepted(row: dict[str, Any]) -> str:
    if row["method"] == INSPECT:
        return "inspected"
    return {True: "accepted", False: "not accepted", None: "not assessed"}[row["accepted"]]


def _file(row: dict[str, Any], folder: Path | None) -> str | None:
    """Address of the report of an experiment, or of its numbers."""
    if folder is None or row["asked"] is None:
        return None
    for name in ("report.html", "inspection.html", "estimate.json", "inspection.json"):
        if (folder / row["asked"] / row["experiment"] / name).is_file():
            return link(row["asked"], row["experiment"], name)
    return None
