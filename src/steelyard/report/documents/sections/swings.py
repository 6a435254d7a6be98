"""How the platform swings on locked winches, against the natural frequencies of the estimated
body.
"""

from __future__ import annotations

from steelyard.digits import fixed, number
from steelyard.report.blocks.document import (
    Block,
    Figure,
    Grid,
    Section,
    Statement,
    Statements,
    by_choice,
)
from steelyard.report.blocks.plot import axes, line
from steelyard.report.blocks.shown import slug
from steelyard.report.evidence.summary import Summary
from steelyard.report.evidence.values import SwingTrack


def swings(summary: Summary) -> Section | None:
    """Of every run with locked winches; None where there is none."""
    found = summary.evidence.swings
    if not found:
        return None
    text = (
        "Natural frequencies that the recordings show, and those of the estimated body about the"
        " middle of each swing. The larger a swing is, the lower its frequencies are than these."
    )
    blocks: list[Block] = [Statements((Statement(text),)), _table(found)]
    blocks += by_choice("Run", [(each.run, (_figure(each),)) for each in found])
    return Section("swings", "Natural frequencies", tuple(blocks))


def _table(found: tuple[SwingTrack, ...]) -> Grid:
    """A row a run."""
    rows = tuple(
        (
            each.run,
            ", ".join(number(*pair) for pair in each.seen) or "none",
            ", ".join(number(*pair) for pair in each.predicted) or "-",
        )
        for each in found
    )
    return Grid("Natural frequencies [Hz] ± 1-sigma", ("run", "seen", "predicted"), rows)


def _figure(each: SwingTrack) -> Figure:
    """The spectrum of a run with predicted lines."""
    values = [1e3 * v for v in each.amplitude]
    top = max(values, default=1.0)
    lines = [
        line(
            "predicted",
            [frequency, frequency],
            [0, top],
            {"width": 1, "dash": "dash", "color": "#c0392b"},
            showlegend=i == 0,
        )
        for i, (frequency, _) in enumerate(each.predicted)
    ]
    seen = ", ".join(fixed(frequency, 3) for frequency, _ in each.seen) or "none"
    predicted = ", ".join(fixed(frequency, 3) for frequency, _ in each.predicted) or "none"
    text = (
        f"Spectrum of the motion in run {each.run}, amplitude over frequency; seen at {seen} Hz,"
        f" predicted at {predicted} Hz (dashed)."
    )
    return Figure(
        slug("swings", each.run),
        f"Run {each.run}: spectrum of the motion",
        text,
        (line("motion", each.frequency, values, {"width": 1.5}), *lines),
        axes("frequency [Hz]", "amplitude [mm]"),
    )
