"""A planned experiment for people: what it will tell, what it takes of the robot, and when it tells
what.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from rich.console import Console
from rich.text import Text

from steelyard.digits import LABELS
from steelyard.excitation.evaluation import InformationShares, MotionEvaluation
from steelyard.excitation.limits.verification import Verified
from steelyard.inertia import BODY_PARAMETERS
from steelyard.motion.limits import Use
from steelyard.report.document import Grid
from steelyard.report.terminal import console, drawn_grid

_BARS = "▁▂▃▄▅▆▇█"
_PARTS = 40
"""Parts of a run whose share is drawn."""
_RATES = ("speed", "acceleration", "angular_speed", "angular_acceleration")
"""Limits that a design should have."""
_NEAR = 0.3
"""Lowest natural frequency over which a motion should not come near, as a part of it."""


def grids(evaluation: MotionEvaluation) -> tuple[Grid, ...]:
    """What is shown, as tables."""
    return (
        _precision(evaluation),
        *(_use(name, each, evaluation) for name, each in evaluation.verified.items()),
    )


def _precision(evaluation: MotionEvaluation) -> Grid:
    runs = list(evaluation.trajectories)
    several = len(runs) > 1 or not np.allclose(
        evaluation.each[runs[0]], evaluation.standard_deviation, equal_nan=True
    )
    heading = [
        "",
        "unit",
        *(("one run", "in all") if several else ("1-sigma",)),
        "wanted",
        "share",
        "told over time",
    ]
    rows = []
    for i, (label, unit, factor) in enumerate(LABELS):
        alone, total = float(evaluation.each[runs[0]][i]), float(evaluation.standard_deviation[i])
        wanted = float(evaluation.target.each[i])
        values = (alone, total) if several else (total,)
        share = "" if np.isnan(total) else f"{total / wanted:.2f}"
        drawn = "  ".join(drawn_over_time(evaluation.information_shares[run], i) for run in runs)
        shown = ("not told" if np.isnan(v) else f"{v * factor:.3g}" for v in values)
        rows.append((label, unit, *shown, f"{wanted * factor:.3g}", share, drawn))
    title = (
        f"What {'a motion' if len(runs) == 1 else f'{len(runs)} motions'} of {_seconds(evaluation)}"
        " will tell"
    )
    return Grid(title, tuple(heading), tuple(rows), frozenset(range(2, len(heading) - 1)))


def drawn_over_time(shares: InformationShares, parameter: int) -> str:
    """Share of a parameter that each part of a run tells, as a row of bars."""
    edges = np.linspace(0, len(shares.time), min(_PARTS, len(shares.time)) + 1).astype(int)
    parts = np.array([shares.share[a:b, parameter].mean() for a, b in pairwise(edges)])
    largest = parts.max()
    if not np.isfinite(largest) or largest <= 0:
        return ""
    return "".join(_BARS[min(int(8 * each / largest), 7)] for each in parts)


def _use(name: str, verified: Verified, evaluation: MotionEvaluation) -> Grid:
    elastic = {use.name: use for use in verified.elastic}
    heading = (
        "",
        "unit",
        "commanded",
        *(("on elastic cables",) if elastic else ()),
        "allowed",
        "used",
    )
    rows: list[tuple[str, ...]] = []
    for use in verified.commanded:
        real = elastic.get(use.name)
        most = max(use.fraction, real.fraction if real else 0.0)
        used = "" if use.limit is None else f"{most:.0%}"
        columns = [
            _shown(use.extremes),
            *([_shown(real.extremes)] if real else []),
            _shown(use.limit),
        ]
        labels = [use.name] if len(columns[0]) == 1 else _axes(use)
        for i, label in enumerate(labels):
            rows.append(
                (
                    label,
                    use.unit,
                    *(column[i] if column else "" for column in columns),
                    used if not i else "",
                )
            )
        if use.name == "tension" and verified.bodies is not None:
            share = f"tension, body within {evaluation.margin.share:.0%}"
            bodies = verified.bodies
            rows.append(
                (
                    share,
                    bodies.unit,
                    _shown(bodies.extremes)[0],
                    *(("",) if elastic else ()),
                    columns[-1][0],
                    "",
                )
            )
    title = (
        "What it takes of the robot"
        if len(evaluation.verified) == 1
        else f"What '{name}' takes of the robot"
    )
    return Grid(title, heading, tuple(rows), frozenset(range(2, len(heading))))


def _axes(use: Use) -> list[str]:
    return (
        [f"position {axis}" for axis in "xyz"] if use.name == "position" else use.name.split(", ")
    )


def _shown(values: Sequence[object] | None) -> list[str]:
    """One text for each axis; none where there are no values."""
    if values is None:
        return []
    if len(values) == 1:
        return [f"{values[0]:.3g}"]
    low, high = (np.atleast_1d(np.asarray(each, dtype=np.float64)) for each in values)
    return [f"{a:.3g} to {b:.3g}" for a, b in zip(low, high, strict=True)]


def _seconds(evaluation: MotionEvaluation) -> str:
    lengths = sorted({each.duration for each in evaluation.trajectories.values()})
    return " and ".join(f"{length:g} s" for length in lengths)


def statements(evaluation: MotionEvaluation) -> Iterator[str]:
    """What there is to say about it, one sentence each."""
    parameter, ratio = evaluation.worst
    label = dict(zip(BODY_PARAMETERS, (label for label, *_ in LABELS), strict=True))[parameter]
    if np.isfinite(ratio):
        verdict = (
            "reaches all that is wanted"
            if ratio <= 1
            else "does not reach what is wanted; a longer motion or more runs would"
        )
        yield f"worst known: {label}, {ratio:.2f} of the wanted 1-sigma: {verdict}"
    untold = [
        name
        for name, told in zip(
            (label for label, *_ in LABELS), np.isnan(evaluation.standard_deviation), strict=True
        )
        if told
    ]
    if untold:
        yield (
            f"cannot tell {', '.join(untold)}: the motion does not show"
            f" {'it' if len(untold) == 1 else 'them'}"
        )
    for name, verified in evaluation.verified.items():
        for text in verified.violations:
            yield f"'{name}': the robot cannot do it: {text}"
    if len(evaluation.natural_frequencies):
        swings = ", ".join(f"{each:.2g}" for each in evaluation.natural_frequencies[:3])
        yield (
            f"the platform swings on its cables at {swings} Hz and above (where it begins; the"
            " stiffness is known to a factor only), the motion is below"
            f" {evaluation.highest_frequency:.2g} Hz"
        )
        if evaluation.highest_frequency > _NEAR * evaluation.natural_frequencies[0]:
            yield "that is near: the platform may ring on its cables"
    elif evaluation.experiment.robot.m:
        yield (
            "the stiffness of the cables is not known: how the platform swings on them was not"
            f" looked at; the motion is below {evaluation.highest_frequency:.2g} Hz (add 'cable:"
            " {axial_stiffness: …}' to the robot file)"
        )
    limits = evaluation.experiment.robot.limits
    free = [name.replace("_", " ") for name in _RATES if getattr(limits, name) is None]
    if free:
        yield (
            f"the robot file does not limit {', '.join(free)}: check that the robot can do what the"
            " table says, or add 'limits' to it"
        )
    if evaluation.experiment.robot.m:
        yield (
            f"tensions are those nearest to {evaluation.level:g} N; they stay within the limits for"
            f" a body up to {evaluation.margin.share:.0%} lighter or heavier with its centre of"
            f" gravity up to {evaluation.margin.cog_offset * 1e3:.0f} mm off"
            if evaluation.feasible
            else f"tensions are those nearest to {evaluation.level:g} N"
        )


def show_design(evaluation: MotionEvaluation) -> None:
    """Print to standard output."""
    screen: Console = console()
    for grid in grids(evaluation):
        screen.print(drawn_grid(grid, whole_names=True))
    for text in statements(evaluation):
        screen.print(Text(text, style="red" if "cannot" in text else ""))
