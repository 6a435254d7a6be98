"""What was found in recordings, for people: tables and sentences."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from itertools import groupby

import numpy as np
from rich.text import Text

from steelyard.digits import LABELS
from steelyard.inspection.contact import Contact
from steelyard.inspection.inspect import Inspection
from steelyard.inspection.streams import StreamReport
from steelyard.report.document import Grid
from steelyard.report.terminal import console, drawn_grid

_MOST_FAULTS = 12
"""Faults of one stream that are listed one by one."""
_WORDS = {
    "gap": "gap",
    "dropped": "dropped samples",
    "late": "late samples",
    "repeated": "samples at the time of the one before",
    "stuck": "stuck, left out",
    "clipped": "at the end of its range",
    "held": "readings written again before the next one",
    "missing": "empty cells",
}


def grids(found: Inspection) -> tuple[Grid, ...]:
    """What is shown, as tables."""
    tables = [_streams(found), _noise(found)]
    if found.delays:
        tables.append(_delays(found))
    if found.agreements:
        tables.append(_agreements(found))
    if found.excitation is not None:
        tables += [_body(found), _calibration(found)]
    return tuple(tables)


def _streams(found: Inspection) -> Grid:
    head = (
        "run",
        "instrument",
        "samples",
        "rate [Hz]",
        "jitter [ms]",
        "dropped",
        "late",
        "repeated",
        "gaps",
        "faults",
    )
    rows = []
    for each in found.streams:
        t = each.timing
        faults = sum(f.kind in {"stuck", "clipped", "held"} for f in each.faults)
        rows.append(
            (
                each.run,
                each.instrument,
                str(each.samples),
                *(
                    ("at rest", "", "", "", "", "")
                    if t is None
                    else (
                        f"{t.rate:.4g}",
                        f"{t.jitter * 1e3:.2g}",
                        _count(t.dropped),
                        _count(t.late),
                        _count(t.repeated),
                        _count(len(t.gaps)),
                    )
                ),
                _count(faults),
            )
        )
    return Grid("Streams", head, tuple(rows), frozenset(range(2, 10)))


def _count(number: int) -> str:
    return str(number) if number else "-"


def _noise(found: Inspection) -> Grid:
    head = ("run", "instrument", "quantity", "unit", "at rest", "in motion", "stated")
    rows = []
    for each in found.streams:
        for q in each.quantities:
            if q.noise_at_rest is not None or q.noise_in_motion is not None:
                numbers = (_number(q.noise_at_rest), _number(q.noise_in_motion), _number(q.stated))
                rows.append((each.run, each.instrument, q.name.replace("_", " "), q.unit, *numbers))
    return Grid("Noise of a sample, 1-sigma", head, tuple(rows), frozenset(range(4, 7)))


def _number(value: float | None) -> str:
    return "-" if value is None or not np.isfinite(value) else f"{value:.3g}"


def _delays(found: Inspection) -> Grid:
    head = ("run", "clock of", "late by [ms]", "1-sigma [ms]", "beforehand [ms]", "by")
    rows = []
    for each in found.delays:
        value = (
            (f"{each.value * 1e3:.2f}", f"{each.sigma * 1e3:.2g}")
            if each.told
            else ("not told", "")
        )
        prior = f"{each.prior[0] * 1e3:.3g} ± {each.prior[1] * 1e3:.3g}"
        rows.append((each.run, ", ".join(each.instruments), *value, prior, each.how))
    return Grid("Clocks against that of the forces", head, tuple(rows), frozenset({2, 3, 4}))


def _agreements(found: Inspection) -> Grid:
    head = ("run", "between", "worst", "left / allowed", "")
    rows = []
    for run, each in found.agreements:
        i = int(np.argmax(each.ratio))
        verdict = "agree" if each.agrees else "contradict each other"
        rows.append((run, each.name, each.channels[i], f"{each.worst:.2g}", verdict))
    return Grid(
        "What the instruments say of each other, as described", head, tuple(rows), frozenset({3})
    )


def _body(found: Inspection) -> Grid:
    assert found.excitation is not None
    head = ("", "unit", "about", "1-sigma at best", "told by")
    rows = []
    for finding, (label, unit, factor) in zip(found.excitation.body, LABELS, strict=True):
        rows.append(
            (
                label,
                unit,
                _number(finding.value * factor),
                _number(finding.sigma * factor),
                finding.told,
            )
        )
    return Grid("What this recording can tell of the body", head, tuple(rows), frozenset({2, 3}))


def _calibration(found: Inspection) -> Grid:
    assert found.excitation is not None
    head = ("systematic error", "unit", "1-sigma at best", "beforehand", "told by")
    rows = []
    for name, each in groupby(found.excitation.calibration, key=lambda finding: finding.group):
        group = list(each)
        told = Counter(finding.told for finding in group)
        count = f" ({len(group)})" if len(group) > 1 else ""
        by = (
            next(iter(told))
            if len(told) == 1
            else ", ".join(f"{number} {what}" for what, number in told.items())
        )
        rows.append(
            (
                name + count,
                group[0].unit,
                _range(f.sigma for f in group),
                _range(f.prior for f in group),
                by,
            )
        )
    return Grid("And of the systematic errors", head, tuple(rows), frozenset({2, 3}))


def _range(values: Iterable[float | None]) -> str:
    """One number, or the least and the largest of several."""
    shown = [_number(value) for value in sorted(v for v in values if v is not None)]
    return "-" if not shown else shown[0] if shown[0] == shown[-1] else f"{shown[0]} to {shown[-1]}"


def statements(found: Inspection) -> Iterator[tuple[str, str]]:
    """What there is to say, one sentence each, with its colour: first what is wrong."""
    runs = {each.run for each in found.streams}
    for mistake, where in zip(found.mistakes, found.runs_of, strict=True):
        a = mistake.amendment
        which = f" (run{'s' if len(where) > 1 else ''} {', '.join(where)})" if len(runs) > 1 else ""
        others = f"; it may also be: {' / '.join(mistake.others)}" if mistake.others else ""
        yield (
            (
                f"mistake: {a.subject}: {a.what}{which}. Change: {a.proposal}. Evidence:"
                f" {mistake.evidence}{others}"
            ),
            "red",
        )
    for contact in found.contacts:
        yield contact_words(contact), "yellow"
    for remark in found.remarks:
        yield remark, "yellow"
    for each in found.streams:
        yield from ((text, "yellow") for text in fault_words(each))
    if not found.mistakes and all(a.agrees for _, a in found.agreements):
        yield (
            "no mistake of sign, unit, axis or order was found: all instruments agree as described",
            "green",
        )
    if found.excitation is not None:
        untold = [
            label
            for f, (label, *_) in zip(found.excitation.body, LABELS, strict=True)
            if f.told == "not at all"
        ]
        if untold:
            yield (
                (
                    f"this motion does not tell {', '.join(untold)}; `steelyard design` finds one"
                    " that does"
                ),
                "",
            )


def contact_words(contact: Contact) -> str:
    """A contact as a sentence."""
    return (
        f"run '{contact.run}': something else than the body pulled or pushed from"
        f" {contact.start:.2f} to {contact.end:.2f} s, up to {contact.force:.2g} N and"
        f" {contact.torque:.2g} N m; most in {', '.join(contact.channels)} of {contact.instrument}"
    )


def fault_words(report: StreamReport) -> Iterator[str]:
    """Faults of a stream as sentences."""
    for fault in report.faults[:_MOST_FAULTS]:
        what = f" {fault.channel}" if fault.channel else ""
        when = f"{fault.start:.2f} to {fault.end:.2f} s of its clock"
        yield (
            f"run '{report.run}': {report.instrument}{what.replace('_', ' ')}:"
            f" {_WORDS[fault.kind]}, {fault.count} samples, {when}"
        )
    if len(report.faults) > _MOST_FAULTS:
        yield (
            f"run '{report.run}': {report.instrument}: {len(report.faults) - _MOST_FAULTS} further"
            " faults"
        )


def show_inspection(found: Inspection) -> None:
    """Print to standard output."""
    screen = console()
    for grid in grids(found):
        screen.print(drawn_grid(grid))
    for text, style in statements(found):
        screen.print(Text(text, style=style))
