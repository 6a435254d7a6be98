"""One page for the file of an integrator: what was measured with which instruments, how well, what
the uncertainty comes from, and whether it can be relied on.
"""

from __future__ import annotations

from collections.abc import Iterator

from steelyard.digits import LABELS, figures, fixed, number
from steelyard.report.blocks.document import Block, Document, Grid, Section, Statement, Statements
from steelyard.report.blocks.shown import deviations_of, scaled
from steelyard.report.documents.sections.budget import budget_grid
from steelyard.report.documents.sections.result import lead
from steelyard.report.evidence.summary import ParameterColumn, Summary

_COVERAGE = 2.0
"""Factor of the expanded uncertainty [GUM2008]_: 95 % of a normal distribution."""


def certificate_of(summary: Summary) -> Document:
    """The certificate as values; it has no pictures, so that it prints on one page."""
    sections = [
        Section("result", "Result", tuple(_result(summary))),
        Section("instruments", "Measured with", tuple(_measured(summary))),
    ]
    if summary.evidence.budget:
        sections.append(Section("budget", "Uncertainty budget", (budget_grid(summary),)))
    if summary.evidence.known:
        sections.append(Section("reference", "Check against reference", tuple(_checked(summary))))
    sections.append(Section("made", "Provenance", (Statements(tuple(_made(summary))),)))
    title = f"Certificate: {summary.table.title}"
    return Document(title, lead(summary), tuple(sections), one_page=True, facts=summary.made.facts)


def _result(summary: Summary) -> Iterator[Block]:
    """The ten with 1-sigma and expanded uncertainty, of several loads all of them."""
    yield from _each_load(summary) if summary.loads else _body(summary)
    yield Statements(
        (
            Statement(
                "Centre of gravity in the platform frame; inertia about the centre of gravity,"
                " along the axes of the platform; products are elements of the matrix."
            ),
        )
    )


def _body(summary: Summary) -> Iterator[Block]:
    """The ten of one body."""
    best = summary.best
    rows = []
    values = zip(LABELS, best.value, deviations_of(best), best.labels, strict=True)
    for (name, unit, factor), value, deviation, label in values:
        sigma = scaled(deviation, factor)
        known = value is not None and sigma is not None
        rows.append(
            (
                name,
                unit,
                number(scaled(value, factor), sigma) if known else "not identifiable",
                figures(_COVERAGE * sigma, 2) if known and sigma is not None else "-",
                label,
            )
        )
    head = ("parameter", "unit", "value ± 1-sigma", "expanded (k = 2)", "determined by")
    yield Grid(
        f"Platform with what it carried, by {best.name}", head, tuple(rows), frozenset({2, 3})
    )


def _each_load(summary: Summary) -> Iterator[Block]:
    """The ten of all loads and of their differences."""
    columns = [column for table in summary.loads for column in table.columns]
    head = ("parameter", "unit", *(f"{each.heading} ± 1-sigma" for each in columns))
    rows = tuple(
        (name, unit, *(_number(each, i) for each in columns))
        for i, (name, unit, _) in enumerate(LABELS)
    )
    title = f"All loads, platform included, and their differences, by {summary.best.name}"
    yield Grid(title, head, rows, frozenset(range(2, len(head))))


def _number(column: ParameterColumn, i: int) -> str:
    """One of the ten with its 1-sigma."""
    if column.values[i] is None or column.deviations is None:
        return "not identifiable"
    return number(column.values[i], column.deviations[i])


def _measured(summary: Summary) -> Iterator[Block]:
    """Runs and instruments."""
    evidence = summary.evidence
    runs = [
        f"{each.name}{f' (load {each.load})' if each.load else ''}:"
        f" {'poses at rest' if each.static else f'{each.duration:g} s in motion'}"
        for each in evidence.recorded
    ]
    if runs:
        yield Statements((Statement(f"Runs: {'; '.join(runs)}."),))
    noise = {(each.instrument, each.quantity): each for each in evidence.noise}
    rows = []
    for each in evidence.instruments:
        levels = [
            f"{quantity.replace('_', ' ')} {figures(own.used, 2)} {own.unit}"
            for (name, quantity), own in noise.items()
            if name == each.name and own.used is not None
        ]
        rate = "-" if each.rate is None else f"{each.rate:g}"
        rows.append((each.name, each.kind, str(each.samples), rate, ", ".join(levels) or "-"))
    head = ("instrument", "kind", "samples", "rate [Hz]", "noise of a sample, 1-sigma")
    yield Grid("Instruments", head, tuple(rows), frozenset({2, 3}))


def _checked(summary: Summary) -> Iterator[Block]:
    """What was known beforehand, against the readings alone."""
    rows = tuple(
        (
            f"{each.name}{f' of {each.load}' if each.load else ''}",
            each.unit,
            number(each.stated, each.sigma),
            number(each.found, each.deviation),
            fixed(each.z, 1, sign=True),
        )
        for each in summary.evidence.known
    )
    head = (
        "reference",
        "unit",
        "stated ± 1-sigma",
        "by the readings alone",
        "difference in sigmas",
    )
    yield Grid("Reference", head, rows, frozenset({2, 3, 4}))


def _made(summary: Summary) -> Iterator[Statement]:
    """By which program from which files: the experiment file names all others."""
    made = summary.made
    yield Statement(", ".join(f"{name} {version}" for name, version in made.versions) + ".")
    if made.options:
        yield Statement("; ".join(f"{name}: {value}" for name, value in made.options) + ".")
    if made.inputs:
        first, others = made.inputs[0], len(made.inputs) - 1
        named = f", and {others} files that it names (report.json has theirs)" if others else ""
        yield Statement(f"{first.name}, SHA-256 {first.sha256}{named}.")
