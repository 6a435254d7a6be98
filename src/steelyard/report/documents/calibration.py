"""From the calibration of a robot to its report."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from steelyard.calibration.first_poses import UPRIGHT
from steelyard.digits import deviation, figures, fixed, number
from steelyard.report.blocks.document import (
    Block,
    Document,
    Figure,
    Grid,
    Section,
    Statement,
    Statements,
)

if TYPE_CHECKING:
    from steelyard.calibration.geometry_calibration import GeometryCalibration

_MM = 1000.0
_AXES = "xyz"


def calibration_document(found: GeometryCalibration) -> Document:
    """The report as values."""
    moves = Section("moves", "What has moved", tuple(_moves(found)))
    sections = (
        Section("result", "Result", tuple(_result(found))),
        *((moves,) if found.arrived else ()),
        Section("residuals", "Residuals", tuple(_residuals(found))),
    )
    return Document(f"Calibration of {found.experiment.robot.name}", _lead(found), sections)


def _lead(found: GeometryCalibration) -> Statement:
    """The result in one sentence."""
    if found.reasons:
        return Statement(f"Not accepted: {'; '.join(found.reasons)}.", "bad")
    if all(each.all() for each in found.exact.values()):
        return Statement(
            "Anchors and attachments are stated as exact, so that nothing of them was looked for;"
            " say how well they are known, such as 'uncertainty: {anchor: 0.005, attachment:"
            " 0.002}'.",
            "note",
        )
    sigma = np.concatenate(
        [each[found.told[key] & ~found.exact[key]] for key, each in found.deviations.items()]
    )
    if not sigma.size:
        return Statement(
            "These recordings tell no coordinate better than it was known beforehand.", "note"
        )
    moved = [np.linalg.norm(each, axis=1).max() for each in found.moved.values()]
    text = (
        f"Anchors moved by up to {figures(_MM * moved[0], 3)} mm, attachments by up to"
        f" {figures(_MM * moved[1], 3)} mm; 1-sigma of a coordinate"
        f" {deviation(_MM * np.median(sigma))} mm in the median: accepted."
    )
    return Statement(text, "good")


def _result(found: GeometryCalibration) -> list[Block]:
    """Gauge, what is not told, wrong rows; the points."""
    weighed = found.found.parameters.weighed
    statements = [
        *(Statement(words[:1].upper() + words[1:] + ".") for words in found.frames),
        *(Statement(f"{table}.") for table in (weighed.tables if weighed else ())),
        *(Statement(str(each), "bad") for each in found.wrong),
        *(Statement(each, "note") for each in found.found.notes),
    ]
    if found.unobservable:
        statements.append(
            Statement(
                f"Not told by these recordings: {', '.join(found.unobservable)}. Poses farther"
                " apart, higher and lower, and turned would tell them.",
                "note",
            )
        )
    if not found.arrived:
        return [Statements(tuple(statements))]
    rows = []
    for key, value in found.points.items():
        told, sigma = found.told[key], found.deviations[key]
        for i, point in enumerate(value):
            pairs = zip(point, sigma[i], strict=True)
            texts = (number(float(_MM * v), float(_MM * s) if s else None) for v, s in pairs)
            cells = [
                f"{text} exact" if exact else text if known else "not told"
                for text, known, exact in zip(texts, told[i], found.exact[key][i], strict=True)
            ]
            rows.append((f"{key} {i + 1}", "mm", *cells))
    head = ("point", "unit", *(f"{axis} ± 1-sigma" for axis in _AXES))
    grid = Grid("Anchors and attachments", head, tuple(rows), frozenset({2, 3, 4}))
    others = _others(found)
    return [Statements(tuple(statements)), grid, *([others] if others.rows else [])]


def _others(found: GeometryCalibration) -> Grid:
    """Calibration parameters of the instruments."""
    parameters = found.reported
    sigma, values = found.parameter_deviations, found.placed.values
    rows = tuple(
        (
            parameters.names[place],
            entry.unit,
            number(float(values[place]), float(sigma[place])),
            deviation(found.found.parameters.deviation[place]),
        )
        for place, entry, i in parameters.components()
        if entry.owner not in {"robot", UPRIGHT} and entry.deviation[i] > 0 and entry.key != "delay"
    )
    head = ("instrument", "unit", "value ± 1-sigma", "prior 1-sigma")
    return Grid("Instruments", head, rows, frozenset({2, 3}))


def _moves(found: GeometryCalibration) -> list[Block]:
    """Moves of the points as bars."""
    data, rows = [], []
    for key, moved in found.moved.items():
        names = [f"{key} {i + 1}" for i in range(len(moved))]
        for axis, column in zip(_AXES, moved.T, strict=True):
            data.append(
                {
                    "type": "bar",
                    "name": f"{key}, {axis}",
                    "x": names,
                    "y": (_MM * column).tolist(),
                }
            )
        for name, row in zip(names, moved, strict=True):
            rows.append((name, *(fixed(_MM * v, 2, sign=True) for v in row)))
    layout = {"barmode": "group", "yaxis": {"title": {"text": "found less drawn [mm]"}}}
    figure = Figure(
        "moves",
        "Moves of anchors and attachments",
        "The same numbers as below.",
        tuple(data),
        layout,
    )
    head = ("point", *(f"{axis} [mm]" for axis in _AXES))
    return [figure, Grid("Found less drawn", head, tuple(rows), frozenset({1, 2, 3}))]


def _residuals(found: GeometryCalibration) -> list[Block]:
    """Residuals of lengths in each pose about the geometry that all others tell."""
    blocks: list[Block] = []
    if not found.arrived:
        return [_sizes(found)]
    text = (
        "Each pose and each tenth of a motion about the geometry that all others tell (leave one"
        " out): what a length will be off in a new pose, beside the noise of its reading."
    )
    blocks.append(Statements((Statement(text),)))
    for one in found.found.left_out:
        m = one.residual.shape[1]
        heat = {
            "type": "heatmap",
            "x": [int(part) + 1 for part in one.part],
            "y": [f"cable {i + 1}" for i in range(m)],
            "z": [[None if np.isnan(v) else float(_MM * v) for v in row] for row in one.residual.T],
            "colorscale": "RdBu",
            "zmid": 0,
            "colorbar": {"title": {"text": "mm"}},
        }
        what = "pose" if one.static else "tenth of the motion"
        name = f"residuals-{len(blocks)}"
        title = f"Residuals of {one.instrument} in run {one.run}, each {what} left out"
        layout = {"xaxis": {"title": {"text": what}}, "yaxis": {"type": "category"}}
        caption = "Residuals by pose and cable."
        if not one.static:
            caption = "Root mean square of the residuals by tenth and cable."
        blocks.append(Figure(name, title, caption, (heat,), layout))
    rms = found.leave_one_out
    if rms is not None:
        rows = tuple((f"cable {i + 1}", figures(_MM * v, 3)) for i, v in enumerate(rms))
        blocks.append(
            Grid(
                "Leave-one-out residual, root mean square", ("cable", "[mm]"), rows, frozenset({1})
            )
        )
    blocks.append(_sizes(found))
    return blocks


def _sizes(found: GeometryCalibration) -> Grid:
    """Residuals of each instrument where the fit ended: large ones show what contradicts the
    rest.
    """
    sizes = tuple(
        (name, quantity.removesuffix(" at rest").replace("_", " "), fixed(np.sqrt(ratio), 2))
        for (name, quantity), ratio in found.found.fit.ratios.items()
        if name != UPRIGHT
    )
    head = ("instrument", "quantity", "residual in units of its noise")
    return Grid("Residuals", head, sizes, frozenset({2}))
