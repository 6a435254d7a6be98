"""What goes on for a while and the model does not know: an unmodelled wrench on the platform, and
errors of instruments that follow themselves.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from steelyard.digits import figures, fixed
from steelyard.instruments.unread_cables import PER_CABLE
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
from steelyard.report.blocks.shown import Unit, scaled, shown_unit, slug, words
from steelyard.report.evidence.summary import Summary
from steelyard.report.evidence.values import DisturbanceTrack

_CAUSES: Mapping[str, str] = {
    "colored": "coloured noise",
    "drift": "drift",
    "reacquired": "shift after the target was lost",
    "filter": "filter that follows the accelerometer",
}
_AXES = ("x", "y", "z")


def disturbances(summary: Summary) -> Section | None:
    """All of them; None where there is none."""
    found = summary.evidence.disturbances
    if not found:
        return None
    blocks: list[Block] = []
    if any(_is_wrench(each) for each in found):
        text = (
            "A wrench acts on the platform that neither the body nor anything else of the model"
            " explains. It is estimated beside the body, and what it can imitate is uncertain by"
            " as much. Look at when it is large: a hose, a cable that rubs, a guide, a load that"
            " moves."
        )
        blocks.append(Statements((Statement(text, "note"),)))
    blocks.append(_table(found))
    runs = dict.fromkeys(each.run for each in found)
    blocks += by_choice(
        "Run", [(run, tuple(_figure(each) for each in found if each.run == run)) for run in runs]
    )
    return Section("disturbances", "What the model does not know", tuple(blocks))


def _unit(each: DisturbanceTrack) -> Unit:
    """Errors of places in millimetres, the rest as everywhere."""
    return shown_unit(each.unit, "error" if each.unit == "m" else each.quantity)


def _is_wrench(each: DisturbanceTrack) -> bool:
    return each.quantity.startswith("unmodelled")


def _table(found: tuple[DisturbanceTrack, ...]) -> Grid:
    """Size and correlation time, a row each."""
    rows = []
    for each in found:
        unit = _unit(each)
        rows.append(
            (
                each.run,
                "platform" if _is_wrench(each) else each.owner,
                words(each.quantity),
                "wrench" if _is_wrench(each) else _CAUSES.get(each.cause, each.cause),
                "stated" if each.stated else "found",
                unit.name,
                ", ".join(figures(scaled(rms, unit.factor)) for rms in each.rms),
                figures(scaled(max(each.deviation), unit.factor)),
                figures(each.correlation_time),
            )
        )
    head = (
        "run",
        "of",
        "quantity",
        "what",
        "known by",
        "unit",
        "rms by axis or cable",
        "1-sigma",
        "correlation time [s]",
    )
    return Grid("Size over the run", head, tuple(rows), frozenset({7, 8}))


def _figure(each: DisturbanceTrack) -> Figure:
    """One of them over time."""
    unit = _unit(each)
    values = np.array(each.values) * unit.factor
    per_cable = each.quantity in PER_CABLE
    names = [f"cable {i + 1}" for i in range(len(values))] if per_cable else _AXES[: len(values)]
    who = "platform" if _is_wrench(each) else each.owner
    quantity = words(each.quantity)
    instant = int(np.argmax(np.abs(values).max(axis=0)))
    axes_of = "the platform" if _is_wrench(each) else "the instrument"
    text = (
        f"{quantity} of {who} in run {each.run} over time,"
        f" {'by cable' if per_cable else f'in the axes of {axes_of}'}; largest"
        f" {figures(np.abs(values).max(), 3)} {unit.name} at {fixed(each.time[instant], 1)} s."
    )
    return Figure(
        slug("disturbance", each.run, each.owner, each.quantity, each.cause),
        f"Run {each.run}: {who}, {quantity}",
        text,
        tuple(
            line(name, each.time, column, {"width": 1.5})
            for name, column in zip(names, values, strict=True)
        ),
        axes("time [s]", f"{quantity} [{unit.name}]"),
    )
