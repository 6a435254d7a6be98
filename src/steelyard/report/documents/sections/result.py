"""The result: in one sentence, verdicts and remarks, the ten of every method as a table and as
intervals.
"""

from __future__ import annotations

from collections.abc import Iterator

from steelyard.digits import LABELS, deviation, figures, number
from steelyard.report.blocks.document import Block, Fold, Grid, Section, Statement, Statements, Tone
from steelyard.report.blocks.parameter_grid import ParameterTexts, parameter_grid
from steelyard.report.blocks.shown import deviations_of, scaled
from steelyard.report.documents.sections.intervals import intervals
from steelyard.report.evidence.summary import ATTAINABLE, ParameterTable, Summary
from steelyard.report.evidence.values import EstimatedBody, Number

_PARTS = (
    ("mass", slice(0, 1)),
    ("centre of gravity", slice(1, 4)),
    ("moments of inertia", slice(4, 7)),
    ("products", slice(7, 10)),
)


def lead(summary: Summary) -> Statement:
    """The result in one sentence."""
    best = summary.best
    parts = [_said(best, name, place) for name, place in _PARTS]
    ratios = _of_best(summary)
    if ratios:
        parts = [each for each in parts if not each.endswith(" not identifiable")]
        parts.append(f"moments of inertia over the mass ({', '.join(ratios[:3])}) m²")
    known = ", ".join(parts)
    if not best.accepted:
        tone: Tone = "bad" if best.accepted is False else ""
        said = "Not accepted" if best.accepted is False else "Baseline, not assessed"
        why = "; ".join((*best.reasons, *([best.disagreement] if best.disagreement else [])))
        return Statement(f"{said}: {why}. As estimated by {best.name}: {known}.", tone)
    told = f"{known[:1].upper()}{known[1:]} (1-sigma), by {best.name}: accepted"
    if best.disagreement:
        return Statement(f"{told}; {best.disagreement}.", "note")
    return Statement(f"{told}.", "good")


def _of_best(summary: Summary) -> list[str]:
    """Inertia over the mass of the best method, where that is all it has; six texts."""
    table = summary.per_mass
    heading = f"{summary.best.name} ± 1-sigma"
    if table is None or heading not in table.headings or summary.best.value[0] is not None:
        return []
    column = 2 + table.headings.index(heading)
    return [row[column] for row in table.rows]


def _said(body: EstimatedBody, name: str, place: slice) -> str:
    """Parameters of one kind with their 1-sigma."""
    _, unit, factor = LABELS[place.start]
    values, deviations = body.value[place], deviations_of(body)[place]
    if all(value is None for value in values):
        return f"{name} not identifiable"
    texts = []
    for value, sigma in zip(values, deviations, strict=True):
        shown = number(scaled(value, factor), scaled(sigma, factor))
        texts.append("not identifiable" if value is None else shown)
    return f"{name} {texts[0]} {unit}" if len(texts) == 1 else f"{name} ({', '.join(texts)}) {unit}"


def result(summary: Summary) -> Section:
    """The section."""
    said = list(_verdicts(summary))
    verdicts = [each for each in said if _is_verdict(each, summary)]
    blocks: list[Block] = [Statements(tuple(verdicts)), grid_of(summary.table)]
    blocks += [grid_of(table) for table in summary.loads]
    if summary.per_mass is not None:
        head = ("parameter", "unit", *summary.per_mass.headings)
        numbers = frozenset(range(2, len(head)))
        blocks.append(
            Grid("inertia over the mass", head, summary.per_mass.rows, numbers, repeated=2)
        )
    if any(value is not None for body in summary.bodies for value in body.value):
        blocks.append(intervals(summary))
    own = tuple(_remarks(summary.best, weighed=not _of_best(summary)))
    if own:
        blocks.append(Statements(own))
    others = tuple(each for each in said if each not in verdicts)
    if others:
        count = f"{len(others)} remarks" if len(others) > 1 else "One remark"
        blocks.append(Fold(count, (Statements(others),)))
    if summary.runs:
        blocks.append(Fold("Each run alone", tuple(map(grid_of, summary.runs))))
    return Section("result", "Result", tuple(blocks))


def _is_verdict(said: Statement, summary: Summary) -> bool:
    """Whether it stands before the numbers: a verdict, or what was predicted of runs left out."""
    verdicts = ("accepted", "not accepted", "not assessed", "baseline")
    names = [body.name for body in summary.bodies]
    rest = next((said.text[len(name) :] for name in names if said.text.startswith(name)), "")
    return said.tone in {"good", "bad"} or rest.partition(": ")[2].startswith(verdicts)


def _remarks(best: EstimatedBody, *, weighed: bool) -> Iterator[Statement]:
    """Parameters that the data did not determine; what a scale would tell has been said."""
    unidentifiable = _labelled(best, "unidentifiable")
    if not weighed:
        unidentifiable = [each for each in unidentifiable if each.startswith("centre")]
    if unidentifiable:
        better = "Another motion would excite them: see 'steelyard design'."
        if best.moves_within:
            better = "Something moves in it, so that no motion tells them; poses at rest tell where"
            better += " its centre of gravity is."
        yield Statement(
            "Not identifiable from these data, and therefore left out:"
            f" {', '.join(unidentifiable)}. {better}",
            "note",
        )
    prior = _labelled(best, "prior")
    if prior:
        text = f"Determined by prior knowledge rather than by the data: {', '.join(prior)}."
        yield Statement(text, "note")


def _labelled(body: EstimatedBody, label: str) -> list[str]:
    """Names of the parameters that were determined in one way."""
    return [name for (name, *_), each in zip(LABELS, body.labels, strict=True) if each == label]


def _verdicts(summary: Summary) -> Iterator[Statement]:
    """Verdicts and remarks with the tone that they are meant in."""
    for text in summary.statements:
        tone: Tone = "note"
        if ": not accepted" in text:
            tone = "bad"
        elif text.endswith(": accepted"):
            tone = "good"
        elif text.endswith(": baseline, not assessed"):
            # Neither good nor bad, and nothing to heed.
            tone = ""
        yield Statement(text, tone)


def grid_of(table: ParameterTable) -> Grid:
    """A table of ten parameters, with the difference from the truth where that is known."""
    columns = []
    for i, column in enumerate(table.columns):
        if i and column.deviations is not None and not any(v is not None for v in column.values):
            # What has no numbers is said in words.
            continue
        deviations = column.deviations
        if column.heading == ATTAINABLE:
            columns.append(ParameterTexts(column.heading, [deviation(v) for v in column.values]))
        elif deviations is None:
            columns.append(ParameterTexts(column.heading, [figures(v, 6) for v in column.values]))
        else:
            pairs = zip(column.values, deviations, strict=True)
            texts = [number(*pair) for pair in pairs]
            columns.append(ParameterTexts(f"{column.heading} ± 1-sigma", texts))
        if column.errors is not None:
            errors = zip(column.errors, deviations or (None,) * len(LABELS), strict=True)
            texts = [_error(*pair) for pair in errors]
            columns.append(ParameterTexts("error", texts, secondary=True))
    return parameter_grid(table.title, columns)


def _error(value: Number, sigma: Number) -> str:
    """A difference from the truth with the digits that its 1-sigma leaves."""
    text, _, _ = number(value, sigma, sign=True).partition(" ± ")
    return text
