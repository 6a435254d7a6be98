"""What there is to show about an identification, as one value that every form of output is drawn
from.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from steelyard.arrays import Array
from steelyard.clocks.offsets import Offset
from steelyard.digits import LABELS, figures
from steelyard.estimates.estimate import Estimate, Verdict, per_mass_rows
from steelyard.identification.identification import Identification
from steelyard.inertia import Inertia
from steelyard.report.evidence.gather import body_of, evidence_of, offset_in_words
from steelyard.report.evidence.made import steelyard_version
from steelyard.report.evidence.values import EstimatedBody, Evidence, Made, Ten, numbers

ATTAINABLE = "attainable 1-sigma"
"""Heading of the column of the smallest ones."""


@dataclass(frozen=True)
class ParameterColumn:
    """Ten values under one heading, in the units of :data:`LABELS`."""

    heading: str
    values: Ten
    deviations: Ten | None
    """1-sigma; None where they are given without."""
    errors: Ten | None = None
    """Difference from the truth, where that is known."""


@dataclass(frozen=True)
class ParameterTable:
    """Columns of ten values."""

    title: str
    columns: tuple[ParameterColumn, ...]


@dataclass(frozen=True)
class PerMassTable:
    """Inertia over the mass by several methods, as text."""

    headings: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    """Name, unit, and a text under each heading."""


@dataclass(frozen=True)
class Summary:
    """Everything that is shown."""

    table: ParameterTable
    runs: tuple[ParameterTable, ...]
    """What each run says alone, a table per method."""
    statements: tuple[str, ...]
    """Verdicts, then remarks, one sentence each."""
    result: str
    """Heading of the best estimate, which the report is about."""
    bodies: tuple[EstimatedBody, ...]
    """All that are shown."""
    nominal: Ten | None
    """The ten of :data:`steelyard.inertia.BODY_PARAMETERS`, SI."""
    truth: Ten | None
    attainable: Ten | None
    """The smallest 1-sigma that any method could have."""
    per_mass: PerMassTable | None
    """Where nothing weighs the platform."""
    evidence: Evidence
    made: Made
    loads: tuple[ParameterTable, ...] = ()
    """What the loads are and by what they differ by the best method, where there are several."""

    @property
    def best(self) -> EstimatedBody:
        """The estimate that the report is about."""
        return next(body for body in self.bodies if body.name == self.result)


def summarise(
    identification: Identification,
    truth: Inertia | None = None,
    beside: Mapping[str, Estimate] | None = None,
    title: str | None = None,
    suffix: str = "",
    made: Made | None = None,
    *,
    with_evidence: bool = True,
    truth_of_loads: Mapping[str, Inertia] | None = None,
) -> Summary:
    """Gather all that a report shows.

    Args:
        identification: Of one experiment.
        truth: Where it is known.
        beside: Further estimates to show in the table, heading -> estimate.
        title: Heading; None: the name of the experiment.
        suffix: What to add to the names of the methods, where others stand beside them.
        made: How the result was made; None: by this version, nothing else is known.
        with_evidence: Whether to gather what the numbers rest on, too.
        truth_of_loads: Name -> what it really is, where there are several and that is known.
    """
    nominal = None if identification.nominal is None else identification.nominal.body_parameters
    true = None if truth is None else truth.body_parameters
    bound = None if identification.bound is None else identification.bound.standard_deviation
    # The result first, then what it is compared with: where a window or a terminal is narrow, the
    # first columns are those that are seen.
    result = f"{identification.result}{suffix}"
    shown = {result: identification.estimate} | dict(beside or {})
    for name, estimate in identification.estimates.items():
        shown.setdefault(f"{name}{suffix}", estimate)
    estimated = [_estimated(name, estimate, true) for name, estimate in shown.items()]
    columns = [estimated[0], *_beforehand(nominal, true)]
    if bound is not None:
        columns.append(_attainable(bound, shown))
    columns += estimated[1:]
    return Summary(
        table=ParameterTable(
            f"{title or identification.experiment}{_first_load(identification.estimate)}",
            tuple(columns),
        ),
        loads=tuple(
            _each_load(identification.result, identification.estimate, truth_of_loads or {})
        ),
        runs=tuple(_each_run(identification)),
        statements=(
            *_statements(shown, result),
            *identification.left_out,
            *_clocks(identification),
            *(str(prediction) for prediction in identification.predictions),
        ),
        result=result,
        bodies=tuple(body_of(name, estimate) for name, estimate in shown.items()),
        nominal=None if nominal is None else numbers(nominal),
        truth=None if true is None else numbers(true),
        attainable=None if bound is None else numbers(bound, 3),
        per_mass=_per_mass(shown, truth),
        evidence=evidence_of(identification) if with_evidence else Evidence(),
        made=made or Made((("steelyard", steelyard_version()),), ()),
    )


def _beforehand(nominal: Array | None, truth: Array | None) -> Iterator[ParameterColumn]:
    """Columns of the bodies that are known without the recordings."""
    if nominal is not None and truth is not None and np.array_equal(nominal, truth):
        yield _given("nominal = truth", truth)
        return
    for heading, values in (("nominal", nominal), ("truth", truth)):
        if values is not None:
            yield _given(heading, values)


def _each_run(identification: Identification) -> Iterator[ParameterTable]:
    """What each run says alone, a table a method that has that."""
    for name, estimate in identification.estimates.items():
        if estimate.runs:
            columns = (_estimated(run, each, None) for run, each in estimate.runs.items())
            yield ParameterTable(f"{name}, each run alone", tuple(columns))


def _each_load(
    name: str, estimate: Estimate, truth: Mapping[str, Inertia]
) -> Iterator[ParameterTable]:
    """What the loads are, and by what they differ, by one method."""
    if estimate.loads is None:
        return
    true = {load: body.body_parameters for load, body in truth.items()}
    for (a, before), (b, after) in combinations(truth.items(), 2):
        more = after.parameters - before.parameters
        if more[0]:
            true[f"{b} - {a}"] = Inertia.from_parameters(more).body_parameters
    for title, found in (
        ("each load", estimate.loads.estimates),
        ("differences of loads", estimate.loads.differences),
    ):
        columns = tuple(_estimated(load, each, true.get(load)) for load, each in found.items())
        if columns:
            yield ParameterTable(f"{title} by {name}", columns)


def _first_load(estimate: Estimate) -> str:
    """What the title of the ten says of several loads."""
    return "" if estimate.loads is None else f", load '{next(iter(estimate.loads.estimates))}'"


def _scaled(values: Array | Sequence[float]) -> Ten:
    return numbers([v * factor for v, (_, _, factor) in zip(values, LABELS, strict=True)])


def _given(heading: str, values: Array) -> ParameterColumn:
    return ParameterColumn(heading, _scaled(values), None)


def _attainable(deviations: Array, shown: Mapping[str, Estimate]) -> ParameterColumn:
    """The smallest 1-sigma that any method could have, of what is identifiable; three digits are
    plenty in the file.
    """
    identifiable = np.any([np.isfinite(estimate.value) for estimate in shown.values()], axis=0)
    pairs = zip(deviations, identifiable, strict=True)
    rounded = [float(f"{d:.3g}") if known else np.nan for d, known in pairs]
    return ParameterColumn(ATTAINABLE, _scaled(rounded), None)


def _estimated(heading: str, estimate: Estimate, truth: Array | None) -> ParameterColumn:
    errors = None if truth is None else _scaled(estimate.value - truth)
    return ParameterColumn(
        heading, _scaled(estimate.value), _scaled(estimate.standard_deviation), errors
    )


def _clocks(identification: Identification) -> Iterator[str]:
    """Clocks that were found from the data, relative to that of the forces."""
    for run, (first, *others) in identification.clocks.items():
        found = [_offset(each) for each in others]
        if found:
            yield (
                f"run '{run}': clocks found from the data, against"
                f" {' and '.join(first.instruments)}: {', '.join(found)}"
            )


def _offset(clock: Offset) -> str:
    """A clock in words: whose it is, how late, and how fast it runs."""
    text = f"{' and '.join(clock.instruments)} {offset_in_words(clock)}"
    if clock.drift:
        text += f" (runs {clock.drift * 1e6:+.0f} parts per million fast)"
    return text


def _statements(estimates: Mapping[str, Estimate], result: str) -> list[str]:
    """Verdicts, then notes, each once: the reasons against the result stand in the first sentence
    of a report, and are not said again of it and of all that share them.
    """
    verdicts = []
    first = estimates[result].verdict
    said = frozenset((*first.reasons, first.disagreement))
    for name, estimate in estimates.items():
        if estimate.loads is None:
            verdicts.append(f"{name}: {_beside_first(estimate.verdict, said)}")
        else:
            of_loads = estimate.loads.estimates.items()
            verdicts += [f"{name}, load '{load}': {each.verdict}" for load, each in of_loads]
    notes: dict[str, dict[str, None]] = {}
    for estimate in estimates.values():
        for note in estimate.notes:
            notes.setdefault(note, {})[estimate.method] = None
    return [*verdicts, *(f"{', '.join(methods)}: {note}" for note, methods in notes.items())]


def _beside_first(verdict: Verdict, said: Set[str]) -> str:
    """A verdict in words, without reasons that have been said."""
    if verdict.accepted is not False or not said & set(verdict.reasons):
        return str(verdict)
    own = "; ".join(r for r in (*verdict.reasons, verdict.disagreement) if r and r not in said)
    return f"not accepted, as said above; also: {own}" if own else "not accepted, as said above"


def _per_mass(shown: Mapping[str, Estimate], truth: Inertia | None) -> PerMassTable | None:
    """Inertia over the mass; None: no method has it."""
    columns = {
        f"{name} ± 1-sigma": per_mass_rows(estimate.per_mass)
        for name, estimate in shown.items()
        if estimate.per_mass is not None
    }
    if not columns:
        return None
    first = next(iter(columns.values()))
    texts = [[row[2] for row in rows] for rows in columns.values()]
    headings = tuple(columns)
    if truth is not None:
        texts.insert(0, [figures(v, 6) for v in truth.body_parameters[4:] / truth.mass])
        headings = ("truth", *headings)
    cells = zip(first, zip(*texts, strict=True), strict=True)
    return PerMassTable(headings, tuple((name, unit, *own) for (name, unit, _), own in cells))
