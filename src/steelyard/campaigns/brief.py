"""A campaign in a few lines, for the terminal."""

from __future__ import annotations

from steelyard.campaigns.run import Campaign
from steelyard.report.blocks.document import Document, Grid, Section, Statement, Statements

_MOST = 20
"""Problems that are named one by one; all are in the table and on the page."""


def brief(found: Campaign) -> Document:
    """How many experiments ended how, and the first of those that need a look."""
    rows = [(what, str(count)) for what, count in found.counts.items()]
    grid = Grid("experiments by result", ("result", "experiments"), tuple(rows), frozenset({1}))
    items = [Statement(text, "bad") for text in found.problems[:_MOST]]
    further = len(found.problems) - _MOST
    if further > 0:
        items.append(Statement(f"… and {further} more, all in {found.table}", "bad"))
    return Document(
        "Campaign",
        Statement(_lead(found), "good" if found.sound else "bad"),
        (Section("experiments", "Experiments", (grid, Statements(tuple(items)))),),
    )


def _lead(found: Campaign) -> str:
    done = f", {found.unchanged} of them done before" if found.unchanged else ""
    plural = "" if found.experiments == 1 else "s"
    return (
        f"{found.experiments} experiment{plural}{done}; campaign.html and all results are in"
        f" {found.folder}."
    )
