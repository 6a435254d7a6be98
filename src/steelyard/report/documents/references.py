"""Reference bodies and poses at rest that would help an experiment, as a document: the most helpful
first.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from steelyard.arrays import Array
from steelyard.digits import LABELS, deviation, fixed
from steelyard.excitation.references.reference_design import ReferenceDesign, ReferencePrediction
from steelyard.inertia import BODY_PARAMETERS
from steelyard.report.blocks.document import Document, Grid, Section, Statement, Statements
from steelyard.report.blocks.parameter_grid import ParameterTexts, parameter_grid

_SHOWN = 3
"""Of which all ten are shown."""
_GROUPS = (("mass", "kg", slice(0, 1), 1.0), ("centre of gravity", "mm", slice(1, 4), 1e3))
_MOMENTS = (("moments", "kg m²", slice(4, 7), 1.0), ("products", "kg m²", slice(7, 10), 1.0))
_NOT_TOLD = "not identifiable"


def reference_document(design: ReferenceDesign) -> Document:
    """Everything that there is to say of them."""
    return Document(
        f"{design.experiment.name}: which references would help",
        _lead(design),
        (
            Section("order", "In the order in which they help", (_order(design), _said(design))),
            Section("parameters", "All ten parameters", (_ten(design),)),
        ),
    )


def _lead(design: ReferenceDesign) -> Statement:
    """What helps most, and how much."""
    best = design.predictions[0]
    ratios = design.ratios(best)
    if not np.isfinite(ratios).any():
        return Statement(f"Nothing is told of the body without them; most by: {best.addition}.")
    most = int(np.nanargmin(ratios))
    name, unit, factor = LABELS[most]
    before = design.without.standard_deviation[most] * factor
    after = best.standard_deviation[most] * factor
    return Statement(
        f"Most helps: {best.addition}; the 1-sigma of {name} falls from {deviation(before)} to"
        f" {deviation(after)} {unit}.",
        "good",
    )


def _order(design: ReferenceDesign) -> Grid:
    """All of them; of each group of parameters the least certain."""
    groups = (*_GROUPS, *_MOMENTS)
    rows = [("", "nothing", *_sizes(design.without), "1.00" if design.target is None else "")]
    for i, each in enumerate(design.predictions):
        score = fixed(design.score(each), 2)
        rows.append((str(i + 1), str(each.addition), *_sizes(each), score))
    head = (
        "",
        "what is recorded beside it",
        *(f"{name} [{unit}]" for name, unit, _, _ in groups),
        "mean ratio" if design.target is None else "worst / target",
    )
    return Grid(
        "1-sigma with one recording more; the largest of each group",
        head,
        tuple(rows),
        frozenset({0, 2, 3, 4, 5, 6}),
        repeated=2,
        ruled=frozenset({0}),
    )


def _sizes(prediction: ReferencePrediction) -> Iterator[str]:
    """Largest 1-sigma of each group."""
    sigma = prediction.standard_deviation
    for _, _, place, factor in (*_GROUPS, *_MOMENTS):
        own = sigma[place] * factor
        yield _NOT_TOLD if np.isnan(own).any() else deviation(own.max())


def _ten(design: ReferenceDesign) -> Grid:
    """1-sigma of the ten with the most helpful ones."""
    columns = [ParameterTexts("nothing", _texts(design.without.standard_deviation))]
    for i, each in enumerate(design.predictions[:_SHOWN]):
        columns.append(ParameterTexts(f"{i + 1}", _texts(each.standard_deviation)))
        ratios = ["" if np.isnan(ratio) else fixed(ratio, 2) for ratio in design.ratios(each)]
        columns.append(ParameterTexts("ratio", ratios, secondary=True))
    return parameter_grid("1-sigma of the ten, with the first of the table", columns)


def _texts(deviations: Array) -> list[str]:
    """1-sigma of the ten in the units of :data:`LABELS`."""
    factors = [factor for _, _, factor in LABELS]
    return [_NOT_TOLD if np.isnan(v) else deviation(v) for v in deviations * factors]


def _said(design: ReferenceDesign) -> Statements:
    """How they are ordered, what was taken, and how to state the best of them."""
    return Statements(tuple(_statements(design)))


def _statements(design: ReferenceDesign) -> Iterator[Statement]:
    """One after the other."""
    yield Statement(f"{design.criterion[:1].upper()}{design.criterion[1:]}.")
    what = "recordings" if design.recorded else "planned recordings"
    load = f" of load '{design.experiment.loads[0].name}'" if design.experiment.loads else ""
    yield Statement(
        f"1-sigma{load} are those of the Cramer-Rao bound: of the {what} with the noise and the"
        " systematic errors that the instruments state, and of one recording more by the same"
        " instruments, one row a pose."
    )
    if design.not_at_rest is not None:
        yield Statement(f"Poses at rest are left out: {design.not_at_rest}.", "note")
    untold = [
        LABELS[i][0] for i in range(len(BODY_PARAMETERS)) if not design.without.identifiable[i]
    ]
    if untold:
        yield Statement(f"Without anything added not identifiable: {', '.join(untold)}.", "note")
    best = next((each.addition for each in design.predictions if each.addition.load), None)
    if best is not None and best.load is not None:
        first = "" if design.experiment.loads else "as-it-is: {}, "
        yield Statement(
            "The experiment file states the best of them, with what it really weighs and where it"
            f" really is, as 'loads: {{{first}{best.load.name}:"
            f" {_as_stated(best.load.added or best.load.known, best.kind)}}}' and 'load:"
            f" {best.load.name}' in its run."
        )


def _as_stated(known: object, kind: str) -> str:
    """What is known of a load, as the experiment file has it."""
    assert isinstance(known, dict)
    value, sigma = known["mass"]
    parts = [f"mass: {{value: {value:.4g}, sigma: {sigma:g}}}"]
    places = [
        f"{axis}: {{value: {known[f'c{axis}'][0]:.4g}, sigma: {known[f'c{axis}'][1]:g}}}"
        for axis in "xyz"
        if f"c{axis}" in known
    ]
    if places:
        parts.append(f"center_of_gravity: {{{', '.join(places)}}}")
    return f"{{{'added' if kind == 'added' else 'known'}: {{{', '.join(parts)}}}}}"
