"""What there is to say of natural frequencies."""

from __future__ import annotations

from steelyard.digits import figures, fixed, number
from steelyard.natural_frequencies.frequencies import Frequencies
from steelyard.report.blocks.document import Document, Grid, Section, Statement, Statements


def frequencies_document(found: Frequencies) -> Document:
    """Equilibrium, and the modes about it."""
    cables = "cables that stretch" if found.elastic else "cables of constant length"
    lead = Statement(
        f"{len(found.modes)} natural frequencies on {len(found.tension)} {cables}, from"
        f" {figures(found.modes[0].frequency, 4)} to {figures(found.modes[-1].frequency, 4)} Hz."
    )
    modes = Grid(
        "natural frequencies [Hz] and mode shapes: velocity of the platform origin [m] and turning"
        " [rad] along the axes of the world",
        ("mode", "frequency", "x", "y", "z", "about x", "about y", "about z"),
        tuple(
            (
                str(i + 1),
                number(each.frequency, each.standard_deviation),
                *(fixed(v, 3, sign=True) for v in each.shape),
            )
            for i, each in enumerate(found.modes)
        ),
        frozenset(range(1, 8)),
    )
    position, rpy = found.pose[:3], found.pose[3:]
    at_rest = Statement(
        "At rest the platform origin is at "
        + ", ".join(fixed(v, 4) for v in position)
        + " m, roll, pitch, yaw "
        + ", ".join(fixed(v, 4) for v in rpy)
        + " rad."
    )
    cable_rows = tuple(
        (str(i + 1), fixed(length, 4), "-" if not known else figures(tension, 4))
        for i, (length, tension, known) in enumerate(
            zip(found.lengths, found.tension, found.tension == found.tension, strict=True)
        )
    )
    rest = Grid(
        "cables: unstrained length, tension at rest",
        ("cable", "length [m]", "tension [N]"),
        cable_rows,
        frozenset({1, 2}),
    )
    notes = [at_rest]
    slack = [str(i + 1) for i, t in enumerate(found.tension) if t == 0]
    if slack:
        notes.append(Statement(f"slack at rest: cable {', '.join(slack)}", "note"))
    if all(each.standard_deviation is None for each in found.modes):
        notes.append(Statement("no 1-sigma: the body has no covariance"))
    return Document(
        "Natural frequencies",
        lead,
        (Section("frequencies", "Natural frequencies", (modes, rest, Statements(tuple(notes)))),),
    )
