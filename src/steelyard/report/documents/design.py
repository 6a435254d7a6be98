"""A planned experiment for people: its expected uncertainty, the use of the robot's limits, and
when each parameter is excited.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from steelyard.arrays import Array
from steelyard.digits import LABELS, between, deviation, figures, fixed, per_cent
from steelyard.excitation.evaluation import InformationShares, MotionEvaluation
from steelyard.excitation.limits.verification import Verified
from steelyard.inertia import BODY_PARAMETERS
from steelyard.motion.limits import Use
from steelyard.report.blocks.document import Grid, Statement
from steelyard.report.blocks.parameter_grid import ParameterTexts, parameter_grid
from steelyard.report.blocks.shown import shown_unit

_BARS = "▁▂▃▄▅▆▇█"
_DEGREES = {"deg": "°"}
"""Units of limits that the robot file has as they are shown."""
_PARTS = 40
"""Parts of a run whose share is drawn."""
_RATES = ("speed", "acceleration", "angular_speed", "angular_acceleration")
"""Limits that a design should have."""
_NEAR = 0.3
"""Part of the lowest natural frequency that a motion should stay below: there an undamped platform
moves a tenth more than it is commanded to."""


def grids(evaluation: MotionEvaluation) -> tuple[Grid, ...]:
    """What is shown, as tables."""
    return (
        _precision(evaluation),
        *(_use(name, each, evaluation) for name, each in evaluation.verified.items()),
    )


def _precision(evaluation: MotionEvaluation) -> Grid:
    """1-sigma of the ten against their targets, and when the motion informs about each."""
    runs = list(evaluation.trajectories)
    alone, total = evaluation.each[runs[0]], evaluation.standard_deviation
    wanted = evaluation.target.each
    if len(runs) > 1 or not np.allclose(alone, total, equal_nan=True):
        columns = [
            ParameterTexts("one run", _sigmas(alone)),
            ParameterTexts("all runs", _sigmas(total)),
        ]
    else:
        columns = [ParameterTexts("1-sigma", _sigmas(total))]
    shares = ["" if np.isnan(share) else fixed(share, 2) for share in total / wanted]
    over_time = [
        "  ".join(drawn_over_time(evaluation.information_shares[run], parameter) for run in runs)
        for parameter in range(len(LABELS))
    ]
    columns += [
        ParameterTexts("target", _sigmas(wanted)),
        ParameterTexts("1-sigma / target", shares),
        ParameterTexts("information over time", over_time, right=False),
    ]
    motions = "a motion" if len(runs) == 1 else f"{len(runs)} motions"
    return parameter_grid(
        f"Expected uncertainty after {motions} of {_seconds(evaluation)}", columns
    )


def _sigmas(deviations: Array) -> list[str]:
    """1-sigma of the ten in the units of :data:`LABELS`, from SI, shape (10,)."""
    factors = [factor for _, _, factor in LABELS]
    return [
        "not identifiable" if np.isnan(v) else deviation(float(v)) for v in deviations * factors
    ]


def drawn_over_time(shares: InformationShares, parameter: int) -> str:
    """Information on a parameter from each part of a run, as a row of bars."""
    edges = np.linspace(0, len(shares.time), min(_PARTS, len(shares.time)) + 1).astype(int)
    parts = np.array([shares.share[a:b, parameter].mean() for a, b in pairwise(edges)])
    largest = parts.max()
    if not np.isfinite(largest) or largest <= 0:
        return ""
    return "".join(_BARS[min(int(8 * each / largest), 7)] for each in parts)


def _use(name: str, verified: Verified, evaluation: MotionEvaluation) -> Grid:
    """What a run takes of each limit, as commanded and, where it is known, on elastic cables."""
    elastic = {use.name: use for use in verified.elastic}
    head = ["", "unit", "commanded"]
    if elastic:
        head.append("on elastic cables")
    head += ["allowed", "used"]
    rows: list[tuple[str, ...]] = []
    for use in verified.commanded:
        rows += _rows_of(use, elastic.get(use.name))
        if use.name == "tension" and verified.bodies is not None:
            bodies, share = verified.bodies, per_cent(evaluation.margin.share)
            extremes, limit = _shown(bodies.extremes)[0], _shown(use.limit)[0]
            middle = ("",) if elastic else ()
            label = f"tension, body within {share}"
            rows.append((label, bodies.unit, extremes, *middle, limit, ""))
    title = "Use of the robot's limits"
    if len(evaluation.verified) > 1:
        title += f" by '{name}'"
    return Grid(title, tuple(head), tuple(rows), frozenset(range(2, len(head))))


def _rows_of(use: Use, real: Use | None) -> Iterator[tuple[str, ...]]:
    """A row for each axis of a limit; ``real``: on elastic cables."""
    unit = shown_unit(_DEGREES.get(use.unit, use.unit))
    columns = [_shown(use.extremes, unit.factor)]
    most = use.fraction
    if real is not None:
        columns.append(_shown(real.extremes, unit.factor))
        most = max(most, real.fraction)
    columns.append(_shown(use.limit, unit.factor))
    used = "" if use.limit is None else per_cent(most)
    labels = use.name.split(", ")
    if use.name == "position":
        labels = [f"position {axis}" for axis in "xyz"]
    for i, label in enumerate(labels):
        cells = [column[i] if column else "" for column in columns]
        yield (label, unit.name, *cells, used if i == 0 else "")


def _shown(values: Sequence[object] | None, factor: float = 1.0) -> list[str]:
    """One text for each axis, in another unit; none where there are no values."""
    if values is None:
        return []
    if len(values) == 1:
        return [figures(float(np.asarray(values[0])) * factor, 3)]
    low, high = (np.atleast_1d(np.asarray(each, dtype=np.float64)) for each in values)
    return [between(factor * a, factor * b) for a, b in zip(low, high, strict=True)]


def _seconds(evaluation: MotionEvaluation) -> str:
    lengths = sorted({each.duration for each in evaluation.trajectories.values()})
    return " and ".join(f"{length:g} s" for length in lengths)


def statements(evaluation: MotionEvaluation) -> Iterator[Statement]:
    """What there is to say about it, one sentence each."""
    yield from _reached(evaluation)
    for name, verified in evaluation.verified.items():
        for text in verified.violations:
            yield Statement(f"'{name}': the robot cannot do it: {text}", "bad")
    yield from _ringing(evaluation)
    limits = evaluation.experiment.robot.limits
    free = [name.replace("_", " ") for name in _RATES if getattr(limits, name) is None]
    if free:
        yield Statement(
            f"the robot file does not limit {', '.join(free)}: check that the robot can do what the"
            " table says, or add 'limits' to it"
        )
    if evaluation.experiment.robot.m:
        text = f"tensions are those nearest to {evaluation.level:g} N"
        if evaluation.feasible:
            text += (
                "; they stay within the limits for a body up to"
                f" {per_cent(evaluation.margin.share)} lighter or heavier with its centre of"
                f" gravity up to {fixed(evaluation.margin.cog_offset * 1e3, 0)} mm off"
            )
        yield Statement(text)


def _reached(evaluation: MotionEvaluation) -> Iterator[Statement]:
    """The least certain parameter, and those that are not identifiable."""
    labels = [label for label, *_ in LABELS]
    parameter, ratio = evaluation.worst
    if np.isfinite(ratio):
        verdict = "not all targets are reached; a longer motion or more runs would"
        if ratio <= 1:
            verdict = "all targets are reached"
        label = labels[BODY_PARAMETERS.index(parameter)]
        yield Statement(
            f"least certain: {label}, {fixed(ratio, 2)} of its target 1-sigma: {verdict}"
        )
    lacking = np.isnan(evaluation.standard_deviation)
    unidentifiable = [label for label, lacks in zip(labels, lacking, strict=True) if lacks]
    if unidentifiable:
        names = ", ".join(unidentifiable)
        text = f"not identifiable: {names}: the motion has no information on"
        yield Statement(f"{text} {'it' if len(unidentifiable) == 1 else 'them'}", "bad")


def _ringing(evaluation: MotionEvaluation) -> Iterator[Statement]:
    """How near the motion comes to the natural frequencies of the platform on its cables."""
    highest = evaluation.highest_frequency
    if len(evaluation.natural_frequencies):
        swings = ", ".join(figures(each, 2) for each in evaluation.natural_frequencies[:3])
        yield Statement(
            f"the platform swings on its cables at {swings} Hz and above (where it begins; the"
            f" stiffness is known to a factor only), the motion is below {figures(highest, 2)} Hz"
        )
        if highest > _NEAR * evaluation.natural_frequencies[0]:
            yield Statement("that is near: the platform may ring on its cables")
    elif evaluation.experiment.robot.m:
        yield Statement(
            "the stiffness of the cables is not known: how the platform swings on them was not"
            f" looked at; the motion is below {figures(highest, 2)} Hz (add 'cable:"
            " {axial_stiffness: …}' to the robot file)"
        )
