"""What there is to show about an identification, as one value that every form of output is drawn
from.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from steelyard.arrays import Array
from steelyard.digits import LABELS
from steelyard.estimates.estimate import Estimate
from steelyard.identification.identify import Identification
from steelyard.inertia import Inertia
from steelyard.report.evidence import EstimatedBody, Evidence, Made, Number, numbers
from steelyard.report.gather import body_of, evidence_of
from steelyard.report.made import steelyard_version


@dataclass(frozen=True)
class ParameterColumn:
    """Ten values under one heading, in the units of :data:`LABELS`."""

    heading: str
    values: tuple[Number, ...]
    deviations: tuple[Number, ...] | None
    """1-sigma; None where they are given without."""
    errors: tuple[Number, ...] | None = None
    """Difference from the truth, where that is known."""


@dataclass(frozen=True)
class ParameterTable:
    """Columns of ten values."""

    title: str
    columns: tuple[ParameterColumn, ...]


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
    nominal: tuple[Number, ...] | None
    """The ten of :data:`steelyard.inertia.BODY_PARAMETERS`, SI."""
    truth: tuple[Number, ...] | None
    attainable: tuple[Number, ...] | None
    """The smallest 1-sigma that any method could have."""
    evidence: Evidence
    made: Made

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
) -> Summary:
    """Gather all that a report shows.

    Args:
        identification: Of one experiment.
        truth: Where it is known.
        beside: Further estimates to show in the table, heading -> estimate.
        title: Heading; None: the name of the experiment.
        suffix: What to add to the names of the methods, where others stand beside them.
        made: How the result was made; None: by this version, nothing else is known.
    """
    shown = tabulate(identification, truth, beside, title, suffix)
    return replace(shown, evidence=evidence_of(identification), made=made or shown.made)


def tabulate(
    identification: Identification,
    truth: Inertia | None = None,
    beside: Mapping[str, Estimate] | None = None,
    title: str | None = None,
    suffix: str = "",
) -> Summary:
    """The numbers and sentences alone, without what they rest on; arguments as of
    :func:`summarise`.
    """
    columns = []
    nominal = None if identification.nominal is None else identification.nominal.body_parameters
    true = None if truth is None else truth.body_parameters
    if nominal is not None and true is not None and np.array_equal(nominal, true):
        columns.append(_given("nominal = truth", true))
    else:
        columns += [
            _given(heading, v)
            for heading, v in (("nominal", nominal), ("truth", true))
            if v is not None
        ]
    shown = {
        **(beside or {}),
        **{f"{name}{suffix}": e for name, e in identification.estimates.items()},
    }
    columns += [_estimated(name, estimate, true) for name, estimate in shown.items()]
    if identification.bound is not None:
        columns.append(_attainable(identification.bound.standard_deviation, shown))
    runs = tuple(
        ParameterTable(
            f"{name}, each run alone",
            tuple(_estimated(run, e, None) for run, e in estimate.runs.items()),
        )
        for name, estimate in identification.estimates.items()
        if estimate.runs
    )
    return Summary(
        table=ParameterTable(title or identification.experiment, tuple(columns)),
        runs=runs,
        statements=(
            *_statements(shown),
            *identification.left_out,
            *_clocks(identification),
            *(str(p) for p in identification.predictions),
        ),
        result=f"{identification.result}{suffix}",
        bodies=tuple(body_of(name, estimate) for name, estimate in shown.items()),
        nominal=None if nominal is None else numbers(nominal),
        truth=None if true is None else numbers(true),
        attainable=(
            None
            if identification.bound is None
            else numbers(identification.bound.standard_deviation, 3)
        ),
        evidence=Evidence(),
        made=Made((("steelyard", steelyard_version()),), ()),
    )


def _scaled(values: Array | Sequence[float]) -> tuple[float | None, ...]:
    return tuple(
        float(value) * factor if np.isfinite(value) else None
        for value, (_, _, factor) in zip(values, LABELS, strict=True)
    )


def _given(heading: str, values: Array) -> ParameterColumn:
    return ParameterColumn(heading, _scaled(values), None)


def _attainable(deviations: Array, shown: Mapping[str, Estimate]) -> ParameterColumn:
    """The smallest 1-sigma that any method could have, of what is identifiable; three digits are
    plenty.
    """
    identifiable = np.any([np.isfinite(estimate.value) for estimate in shown.values()], axis=0)
    pairs = zip(deviations, identifiable, strict=True)
    rounded = [float(f"{d:.3g}") if known else np.nan for d, known in pairs]
    return ParameterColumn("attainable 1-sigma", _scaled(rounded), None)


def _estimated(heading: str, estimate: Estimate, truth: Array | None) -> ParameterColumn:
    errors = None if truth is None else _scaled(estimate.value - truth)
    return ParameterColumn(
        heading, _scaled(estimate.value), _scaled(estimate.standard_deviation), errors
    )


def _clocks(identification: Identification) -> Iterator[str]:
    """Clocks that were found from the data, against that of the forces."""
    for run, (first, *others) in identification.clocks.items():
        found = [
            f"{' and '.join(o.instruments)} {o.value:+.4f} s ± {o.sigma * 1e3:.1f} ms"
            + (f" (runs {o.drift * 1e6:+.0f} parts per million fast)" if o.drift else "")
            for o in others
        ]
        if found:
            yield (
                f"run '{run}': clocks found from the data, against"
                f" {' and '.join(first.instruments)}: {', '.join(found)}"
            )


def _statements(estimates: Mapping[str, Estimate]) -> list[str]:
    lines = []
    for name, estimate in estimates.items():
        lines.append(f"{name}: {estimate.verdict}")
    notes = [
        f"{estimate.method}: {note}" for estimate in estimates.values() for note in estimate.notes
    ]
    lines += dict.fromkeys(notes)
    return lines
