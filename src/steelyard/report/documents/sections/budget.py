"""The uncertainty budget: what brings the variance of each of the ten."""

from __future__ import annotations

from steelyard.digits import LABELS, SHORT_LABELS, fixed
from steelyard.report.blocks.document import Figure, Grid, Section, Statement, Statements
from steelyard.report.blocks.plot import NAMES_DOWNWARDS
from steelyard.report.evidence.summary import Summary
from steelyard.report.evidence.values import UncertaintySource

_LEAST = 0.01
"""Part of the variance of a parameter from which its source has a row of its own."""
_LARGEST = 0.25
"""From which it is marked."""


def budget(summary: Summary) -> Section | None:
    """The section; None where it is not known."""
    sources = _shown(summary)
    if not sources:
        return None
    known = [i for i, value in enumerate(summary.best.value) if value is not None]
    names = [LABELS[i][0] for i in known]
    data = tuple(
        {
            "type": "bar",
            "orientation": "h",
            "name": each.name,
            "y": names,
            "x": [100 * (each.shares[i] or 0.0) for i in known],
        }
        for each in sources
    )
    layout = {
        "barmode": "stack",
        "yaxis": NAMES_DOWNWARDS,
        "xaxis": {"title": {"text": "share of the variance [%]"}, "range": [0, 100]},
    }
    figure = Figure(
        "budget",
        f"Uncertainty budget, {summary.result}",
        "The same shares as in the table below, as stacked bars.",
        data,
        layout,
        height=420,
    )
    text = (
        "What the 1-sigma of each parameter comes from, as shares of its variance. The largest"
        " share is where better knowledge helps: a calibrated sensor, a measured anchor, a longer"
        " recording."
    )
    return Section(
        "budget",
        "Uncertainty budget",
        (Statements((Statement(text),)), figure, budget_grid(summary)),
    )


def budget_grid(summary: Summary) -> Grid:
    """Shares in per cent."""
    sources = _shown(summary)
    known = [i for i, value in enumerate(summary.best.value) if value is not None]
    rows = tuple((each.name, *(_per_cent(each.shares[i]) for i in known)) for each in sources)
    marked = frozenset(
        (row, 1 + column)
        for row, each in enumerate(sources)
        for column, i in enumerate(known)
        if (each.shares[i] or 0.0) >= _LARGEST
    )
    head = ("share of the variance [%]", *(SHORT_LABELS[i] for i in known))
    return Grid("Uncertainty budget", head, rows, frozenset(range(1, len(head))), marked=marked)


def _shown(summary: Summary) -> list[UncertaintySource]:
    """Sources that matter, the largest first, and what all others bring together."""
    found = sorted(
        summary.evidence.budget, key=lambda each: -sum(share or 0.0 for share in each.shares)
    )
    large = [each for each in found if max(share or 0.0 for share in each.shares) >= _LEAST]
    small = [each for each in found if each not in large]
    if small:
        rest = [sum((each.shares[i] or 0.0) for each in small) for i in range(len(LABELS))]
        if max(rest) >= _LEAST / 2:
            large.append(UncertaintySource("all others", tuple(rest)))
    return large


def _per_cent(share: float | None) -> str:
    """A share as people read it."""
    value = 100 * (share or 0.0)
    return "-" if value < 0.05 else fixed(value, 1)
