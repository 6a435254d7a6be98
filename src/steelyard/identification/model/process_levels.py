"""Levels and correlation times of disturbances, as the readings tell them: by marginal likelihood.

The readings stay as they are linearised; motion and processes are integrated out, which for a banded
matrix is a determinant [MacKay1992]_.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize

from steelyard.arrays import Array
from steelyard.identification.model.motion_residuals import Segment
from steelyard.identification.model.segment import NormalEquations
from steelyard.identification.model.settings import MOTION, MotionSettings
from steelyard.identification.model.sources import Source


class ProcessLevel(NamedTuple):
    """How large a disturbance is and how long it lasts."""

    level: float
    """1-sigma in units of its sizes."""
    time: float
    """Correlation time [s]."""
    gain: float
    """By how much it raises the log marginal likelihood."""


def likeliest(
    segments: Sequence[Segment],
    equations: Sequence[NormalEquations],
    settings: MotionSettings = MOTION,
) -> dict[Source, ProcessLevel]:
    """Likeliest level and correlation time of every process, one after the other.

    Args:
        segments: With present motion and processes; what disturbs the same has one level.
        equations: Of their readings alone.
        settings: Bounds and accuracy.
    """
    pairs = [
        (segment, each)
        for segment, each in zip(segments, equations, strict=True)
        if segment.processes
    ]
    found = {
        each.source: ProcessLevel(each.level, each.time, 0.0)
        for segment, _ in pairs
        for each in segment.processes
    }
    for _ in range(settings.level_sweeps if len(found) > 1 else 1):
        for source in found:
            found[source] = _search(pairs, found, source, settings)
    return found


def on_levels(segment: Segment, levels: Mapping[Source, ProcessLevel]) -> Segment:
    """A segment whose processes have these levels."""
    processes = tuple(
        each.at(levels[each.source].level, levels[each.source].time) for each in segment.processes
    )
    return replace(segment, processes=processes)


def _search(
    pairs: Sequence[tuple[Segment, NormalEquations]],
    levels: Mapping[Source, ProcessLevel],
    source: Source,
    settings: MotionSettings,
) -> ProcessLevel:
    """The likeliest level of one, the others held."""
    present = levels[source]

    def moved(logs: Array) -> ProcessLevel:
        level, time = np.exp(logs) * (present.level, present.time)
        least, most = settings.shortest_correlation, settings.longest_correlation
        return ProcessLevel(float(level), float(np.clip(time, least, most)), 0.0)

    def lack(logs: Array) -> float:
        return -_evidence(pairs, {**levels, source: moved(logs)})

    step = settings.level_step
    options = {
        "initial_simplex": [[0.0, 0.0], [step, 0.0], [0.0, step]],
        "xatol": settings.level_accuracy,
        "fatol": 0.1,
        "maxfev": settings.level_trials,
    }
    found = minimize(lack, np.zeros(2), method="Nelder-Mead", options=options)
    none = lack(np.array([np.log(settings.no_level), 0.0]))
    return moved(found.x)._replace(gain=none - float(found.fun))


def _evidence(
    pairs: Sequence[tuple[Segment, NormalEquations]], levels: Mapping[Source, ProcessLevel]
) -> float:
    """Log marginal likelihood but for a constant."""
    total = 0.0
    for segment, readings in pairs:
        own = on_levels(segment, levels)
        try:
            whole = own.smooth(readings)
            total += 0.5 * (float(whole.motion_gradient @ whole.settled) - whole.log_determinant)
        except np.linalg.LinAlgError:
            return -np.inf
        total += 0.5 * sum(each.log_determinant for each in own.processes) - 0.5 * own.prior_cost
    return total
