"""Estimates side by side, and what was added between two of them, as documents."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from steelyard.digits import fixed, ten_numbers
from steelyard.estimates.chi_square import ChiSquareTest
from steelyard.estimates.comparison import Comparison, Pair
from steelyard.estimates.named_estimate import NamedEstimate
from steelyard.estimates.payload import Payload
from steelyard.report.blocks.document import (
    Block,
    Document,
    Grid,
    Section,
    Statement,
    Statements,
    Tone,
)
from steelyard.report.blocks.parameter_grid import ParameterTexts, parameter_grid
from steelyard.report.documents.sections.intervals import SideBySide, intervals_of
from steelyard.report.evidence.gather import body_of

_TONES: dict[bool | None, Tone] = {True: "good", False: "bad", None: "note"}
"""Verdict -> tone."""


def comparison_document(comparison: Comparison, *, fail_above: float | None = None) -> Document:
    """Estimates, their differences from the first, and whether they agree.

    Args:
        comparison: Of two or more estimates.
        fail_above: Sigmas above which differences are named; None: none are.
    """
    first, *others = comparison.estimates
    of_first = comparison.pairs[: len(others)]
    grids = [_difference(first, other, pair) for other, pair in zip(others, of_first, strict=True)]
    statements = Statements(tuple(comparison_statements(comparison, fail_above)))
    section = Section("differences", "Differences", (*grids, statements))
    return Document("Estimates side by side", _lead(comparison), (section,))


def comparison_page(comparison: Comparison, *, fail_above: float | None = None) -> Document:
    """The same with all estimates beside each other, as numbers and as intervals, for a page."""
    document = comparison_document(comparison, fail_above=fail_above)
    bodies = tuple(body_of(each.name, each.estimate) for each in comparison.estimates)
    blocks: list[Block] = []
    known = [body for body in bodies if any(value is not None for value in body.value)]
    if known:
        blocks.append(intervals_of(SideBySide(bodies, known[0], whole=True)))
    blocks.append(parameter_grid("value ± 1-sigma", [_column(e) for e in comparison.estimates]))
    section = Section("values", "Side by side", tuple(blocks))
    return replace(document, sections=(section, *document.sections))


def _lead(comparison: Comparison) -> Statement:
    """Whether all of them agree, by the pair that differs most."""
    found = [pair.agreement for pair in comparison.pairs]
    if comparison.whole is not None:
        found.append(comparison.whole)
    tested = [each for each in found if not np.isnan(each.sigmas)]
    if not tested:
        return Statement("The estimates have no parameters in common that can be compared.", "note")
    worst = max(tested, key=lambda each: each.sigmas)
    return Statement(f"The estimates {worst.outcome}.", _tone(worst))


def comparison_statements(
    comparison: Comparison, fail_above: float | None = None
) -> Iterator[Statement]:
    """Sentences under the tables."""
    yield from _doubted(comparison.estimates)
    for pair in comparison.pairs:
        yield Statement(f"{pair.first} and {pair.second}: {pair.agreement}", _tone(pair.agreement))
    if comparison.whole is not None:
        names = "; ".join(comparison.whole_of)
        text = f"all of different recordings ({names}): {comparison.whole}"
        yield Statement(text, _tone(comparison.whole))
    for note in comparison.notes:
        yield Statement(f"note: {note}")
    if fail_above is not None:
        exceeding = comparison.exceeding(fail_above)
        for text in exceeding:
            yield Statement(f"above {fail_above:g} sigmas: {text}", "bad")
        if not exceeding:
            yield Statement(f"nothing differs by more than {fail_above:g} sigmas", "good")


def payload_document(payload: Payload) -> Document:
    """What was added between two estimates."""
    added = NamedEstimate("added", payload.estimate)
    columns = [_column(payload.before), _column(payload.after), _column(added)]
    grid = parameter_grid("payload: what was added", columns)
    statements = Statements(tuple(payload_statements(payload)))
    verdict = payload.estimate.verdict
    lead = Statement(
        f"The payload between {payload.before.name} and {payload.after.name}: {verdict.short}.",
        _TONES[verdict.accepted],
    )
    return Document("Payload", lead, (Section("payload", "Payload", (grid, statements)),))


def payload_statements(payload: Payload) -> Iterator[Statement]:
    """Sentences under the table."""
    yield from _doubted((payload.before, payload.after))
    verdict, physical = payload.estimate.verdict, payload.estimate.physical
    if verdict.accepted:
        can = f"; a body that can exist lies within {payload.settings.significant:g} sigmas of it"
        if physical:
            can = ", of a body that can exist"
        elif physical is None:
            can = "; whether such a body can exist is not known"
        yield Statement(f"payload: accepted{can}", "good")
    for reason in verdict.reasons:
        yield Statement(f"payload: {verdict.short}: {reason}", _TONES[verdict.accepted])
    for note in payload.estimate.notes:
        yield Statement(f"note: {note}")


def _difference(first: NamedEstimate, second: NamedEstimate, pair: Pair) -> Grid:
    """Two estimates and their difference, also in units of its 1-sigma."""
    difference = ten_numbers(pair.difference, pair.standard_deviation, sign=True)
    sigmas = [_sigmas(float(z)) for z in pair.z]
    far = [bool(abs(z) > pair.agreement.settings.significant) for z in pair.z]
    columns = [
        _column(first),
        _column(second),
        ParameterTexts("difference", difference),
        ParameterTexts("in sigmas", sigmas, marked=far),
    ]
    return parameter_grid(f"{second.name}, compared with {first.name}", columns)


def _column(named: NamedEstimate) -> ParameterTexts:
    estimate = named.estimate
    return ParameterTexts(named.name, ten_numbers(estimate.value, estimate.standard_deviation))


def _sigmas(z: float) -> str:
    if np.isnan(z):
        return "-"
    return "exact" if np.isinf(z) else fixed(z, 1, sign=True)


def _doubted(estimates: Sequence[NamedEstimate]) -> Iterator[Statement]:
    """Those that were not accepted, with the reasons, and baselines that nothing was tested of."""
    for each in estimates:
        verdict = each.estimate.verdict
        if verdict.accepted is None:
            yield Statement(f"{each.name}: {verdict.short}", "note")
        elif not verdict.accepted:
            reasons = "; ".join(verdict.reasons) or "no reason given"
            text = f"{each.name}: was not accepted when it was made: {reasons}"
            yield Statement(text, "bad")
        elif verdict.disagreement:
            yield Statement(f"{each.name}: {verdict.disagreement}", "note")


def _tone(found: ChiSquareTest) -> Tone:
    if np.isnan(found.p_value):
        return ""
    if found.sigmas <= found.settings.usual:
        return "good"
    return "note" if found.sigmas <= found.settings.significant else "bad"
