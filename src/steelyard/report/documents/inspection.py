"""What was found in recordings, for people: tables and sentences."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import groupby

import numpy as np

from steelyard.digits import LABELS, deviation, figures, fixed, milliseconds, number
from steelyard.inspection.contact import Contact
from steelyard.inspection.inspect import Inspection
from steelyard.inspection.streams import StreamReport
from steelyard.report.blocks.document import Grid, Statement
from steelyard.report.blocks.parameter_grid import ParameterTexts, parameter_grid
from steelyard.report.blocks.shown import scaled, shown_unit, words

_MOST_FAULTS = 12
"""Faults of one stream that are listed one by one."""
_WORDS = {
    "gap": "gap",
    "dropped": "dropped samples",
    "late": "late samples",
    "repeated": "samples at the time of the one before",
    "doubled": "samples written twice, left out",
    "spike": "readings that stand alone, left out",
    "stuck": "stuck, left out",
    "dead": "never changes, left out",
    "clipped": "at the end of its range",
    "held": "readings written again before the next one, left out",
    "missing": "empty cells",
    "set": "samples since the clock was set, put back in time",
}


def grids(found: Inspection) -> tuple[Grid, ...]:
    """What is shown, as tables."""
    tables = [_streams(found), _noise(found)]
    if found.modes:
        tables.append(_modes(found))
    if found.delays:
        tables.append(_delays(found))
    if found.agreements:
        tables.append(_agreements(found))
    if found.excitation is not None:
        tables += [_body(found), _calibration(found)]
    return tuple(tables)


def _streams(found: Inspection) -> Grid:
    """Rates and faults, a row a stream."""
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
        timing: tuple[str, ...] = ("at rest", "", "", "", "", "")
        if (t := each.timing) is not None:
            counts = (t.dropped, t.late, t.repeated, len(t.gaps))
            timing = (figures(t.rate, 4), milliseconds(t.jitter), *map(_count, counts))
        faults = sum(
            f.kind in {"doubled", "spike", "stuck", "dead", "clipped", "held", "set"}
            for f in each.faults
        )
        first = (each.run, each.instrument, str(each.samples))
        rows.append((*first, *timing, _count(faults)))
    return Grid("Streams", head, tuple(rows), frozenset(range(2, 10)))


def _count(number: int) -> str:
    return str(number) if number else "-"


def _noise(found: Inspection) -> Grid:
    """Noise of every quantity as estimated and as stated."""
    head = ("run", "instrument", "quantity", "unit", "at rest", "in motion", "stated")
    rows = []
    for each in found.streams:
        for q in each.quantities:
            if q.noise_at_rest is not None or q.noise_in_motion is not None:
                unit = shown_unit(q.unit, "error")
                levels = (q.noise_at_rest, q.noise_in_motion, q.stated)
                numbers = (figures(scaled(level, unit.factor)) for level in levels)
                rows.append((each.run, each.instrument, words(q.name), unit.name, *numbers))
    return Grid("Noise of a sample, 1-sigma", head, tuple(rows), frozenset(range(4, 7)))


def _modes(found: Inspection) -> Grid:
    """Natural modes that the pushes have excited."""
    rows = tuple(
        (
            each.run,
            number(each.frequency, each.sigma),
            fixed(1e3 * each.amplitude, 0),
            fixed(each.damping_ratio, 4),
        )
        for each in found.modes
    )
    head = ("run", "frequency [Hz]", "amplitude [mm]", "damping ratio")
    return Grid("Natural modes that the pushes excited", head, rows, frozenset({1, 2, 3}))


def _delays(found: Inspection) -> Grid:
    """Delays of the clocks as the recordings say, beside their priors."""
    head = ("run", "clock of", "delay [ms]", "1-sigma [ms]", "prior [ms]", "from")
    rows = []
    for each in found.delays:
        value = (
            tuple(number(each.value * 1e3, each.sigma * 1e3).split(" ± "))
            if each.told
            else ("not identifiable", "")
        )
        prior = number(each.prior[0] * 1e3, each.prior[1] * 1e3)
        rows.append((each.run, ", ".join(each.instruments), *value, prior, each.how))
    return Grid("Clock delays relative to the force clock", head, tuple(rows), frozenset({2, 3, 4}))


def _agreements(found: Inspection) -> Grid:
    """What instruments say of each other, a row a pair."""
    head = ("run", "between", "worst channel", "residual / allowed", "")
    rows = []
    for run, each in found.agreements:
        i = int(np.argmax(each.ratio))
        verdict = "agree" if each.agrees else "contradict each other"
        rows.append((run, each.name, each.channels[i], fixed(each.worst, 2), verdict))
    return Grid("Agreement of the instruments, as described", head, tuple(rows), frozenset({3}))


def _body(found: Inspection) -> Grid:
    """How well the ten parameters can be known from the recording."""
    assert found.excitation is not None
    body = found.excitation.body
    factors = [factor for _, _, factor in LABELS]
    scales = [(each.value * f, each.sigma * f) for each, f in zip(body, factors, strict=True)]
    values = [number(value, sigma).partition(" ± ")[0] for value, sigma in scales]
    sigmas = [deviation(sigma) for _, sigma in scales]
    columns = [
        ParameterTexts("rough estimate", values),
        ParameterTexts("smallest 1-sigma", sigmas),
        ParameterTexts("determined by", [each.told for each in body], right=False),
    ]
    return parameter_grid("Identifiability of the body from this recording", columns)


def _calibration(found: Inspection) -> Grid:
    """How well calibration parameters can be known, a row for those of one kind."""
    assert found.excitation is not None
    head = ("parameter", "unit", "smallest 1-sigma", "prior 1-sigma", "determined by")
    rows = []
    for name, each in groupby(found.excitation.calibration, key=lambda finding: finding.group):
        group = list(each)
        count = f" ({len(group)})" if len(group) > 1 else ""
        unit = shown_unit(group[0].unit, "error")
        sigma = _range((scaled(f.sigma, unit.factor) for f in group), deviation)
        prior = _range((scaled(f.prior, unit.factor) for f in group), figures)
        by = _counted([finding.told for finding in group])
        rows.append((name + count, unit.name, sigma, prior, by))
    title = "Identifiability of the calibration parameters"
    return Grid(title, head, tuple(rows), frozenset({2, 3}))


def _counted(texts: Sequence[str]) -> str:
    """Texts with how often they stand; one alone without."""
    counts = Counter(texts)
    if len(counts) == 1:
        return texts[0]
    return ", ".join(f"{count} {word}" for word, count in counts.items())


def _range(values: Iterable[float | None], text: Callable[[float | None], str]) -> str:
    """One number, or the least and the largest of several."""
    shown = [text(value) for value in sorted(v for v in values if v is not None)]
    return "-" if not shown else shown[0] if shown[0] == shown[-1] else f"{shown[0]} to {shown[-1]}"


def statements(found: Inspection) -> Iterator[Statement]:
    """What there is to say, one sentence each: first what is wrong."""
    yield from _mistakes(found)
    for contact in found.contacts:
        yield Statement(contact_words(contact), "note")
    for remark in found.remarks:
        yield Statement(remark, "note")
    for each in found.streams:
        for text in fault_words(each):
            yield Statement(text, "note")
    if (
        not found.mistakes
        and found.misplaced is None
        and all(a.agrees for _, a in found.agreements)
    ):
        yield Statement(
            "no mistake of sign, unit, axis or order was found: all instruments agree as described",
            "good",
        )
    yield from _unidentifiable(found)


def _mistakes(found: Inspection) -> Iterator[Statement]:
    """What to change in the description, and why."""
    several = len({each.run for each in found.streams}) > 1
    for mistake, runs in zip(found.mistakes, found.runs_of, strict=True):
        amendment = mistake.amendment
        where = f" (run{'s' if len(runs) > 1 else ''} {', '.join(runs)})" if several else ""
        others = f"; it may also be: {' / '.join(mistake.others)}" if mistake.others else ""
        yield Statement(
            f"mistake: {amendment.subject}: {amendment.what}{where}. Change: {amendment.proposal}."
            f" Evidence: {mistake.evidence}{others}",
            "bad",
        )


def _unidentifiable(found: Inspection) -> Iterator[Statement]:
    """Parameters of the body that the motion does not excite."""
    if found.excitation is None:
        return
    labels = [
        label
        for each, (label, *_) in zip(found.excitation.body, LABELS, strict=True)
        if each.told == "not at all" and not (found.experiment.mass_assumed and label == "mass")
    ]
    loads = found.experiment.loads
    if labels and loads and not loads[0].rigid:
        yield Statement(
            f"not identifiable from this motion: {', '.join(labels)}; something moves in the load,"
            " so that its motion tells its mass alone"
        )
    elif labels:
        yield Statement(
            f"not identifiable from this motion: {', '.join(labels)}; `steelyard design` finds one"
            " from which they are"
        )


def contact_words(contact: Contact) -> str:
    """A contact as a sentence."""
    return (
        f"run '{contact.run}': something else than the body pulled or pushed from"
        f" {fixed(contact.start, 2)} to {fixed(contact.end, 2)} s, up to"
        f" {figures(contact.force, 2)} N and {figures(contact.torque, 2)} N m; most in"
        f" {', '.join(contact.channels)} of {contact.instrument}"
    )


def fault_words(report: StreamReport) -> Iterator[str]:
    """Faults of a stream as sentences."""
    for fault in report.faults[:_MOST_FAULTS]:
        what = f" {fault.channel}" if fault.channel else ""
        when = f"{fixed(fault.start, 2)} to {fixed(fault.end, 2)} s of its clock"
        yield (
            f"run '{report.run}': {report.instrument}{words(what)}:"
            f" {_WORDS[fault.kind]}, {fault.count} samples, {when}"
        )
    if len(report.faults) > _MOST_FAULTS:
        yield (
            f"run '{report.run}': {report.instrument}: {len(report.faults) - _MOST_FAULTS} further"
            " faults"
        )
