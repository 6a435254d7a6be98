"""Levels and correlation times of disturbances, as the readings tell them: by marginal likelihood.

The readings stay as they are linearised; motion and processes are integrated out, which for a
banded matrix is a determinant [MacKay1992]_, and body and calibration with them, which else would
be held where a process that is too large has left them; by its gradient, with L-BFGS-B [Byrd1995]_.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize

from steelyard.arrays import Array
from steelyard.identification.banded import banded_square, banded_trace
from steelyard.identification.model.motion_segment import Segment
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


class ProcessLevels(NamedTuple):
    """Of all processes together."""

    of: dict[Source, ProcessLevel]
    evidence: float
    """Log marginal likelihood with them, but for a constant that is the same for all processes on
    the same readings."""


def likeliest(
    segments: Sequence[Segment],
    equations: Sequence[NormalEquations],
    settings: MotionSettings = MOTION,
    prior: tuple[Array, Array] | None = None,
    largest: Mapping[Source, float] | None = None,
) -> ProcessLevels:
    """Likeliest levels and correlation times of all processes together.

    Args:
        segments: With present motion and processes; what disturbs the same has one level.
        equations: Of their readings alone.
        settings: Bounds and accuracy.
        prior: Precision of the border and its pull, shapes (b, b) and (b,); None: the border is
            held.
        largest: Source -> level that it has at most; None: nothing bounds any.
    """
    largest = largest or {}
    pairs = [
        (segment, each)
        for segment, each in zip(segments, equations, strict=True)
        if segment.processes
    ]
    first = {
        each.source: ProcessLevel(each.level, each.time, 0.0)
        for segment, _ in pairs
        for each in segment.processes
    }
    if not first:
        return ProcessLevels({}, -np.inf)
    processes = [each for segment, _ in pairs for each in segment.processes]
    level_stated = {each.source for each in processes if each.level_stated}
    time_stated = {each.source for each in processes if each.time_stated}

    def lack(logs: Array) -> tuple[float, Array]:
        evidence, gradient = _evidence(pairs, _of_logs(first, logs), prior)
        return -evidence, -gradient

    least, most = settings.shortest_correlation, settings.longest_correlation
    wide = np.log(settings.level_range)
    found = minimize(
        lack,
        np.log([(each.level, each.time) for each in first.values()]).ravel(),
        jac=True,
        method="L-BFGS-B",
        bounds=[
            bound
            for source, each in first.items()
            for bound in (
                _around(each.level, wide, largest.get(source), source in level_stated),
                (np.log(each.time),) * 2
                if source in time_stated
                else (np.log(least), np.log(most)),
            )
        ],
        options={
            "maxfun": settings.level_trials,
            "gtol": settings.level_slope,
            "ftol": settings.level_gain,
        },
    )
    levels = _of_logs(first, found.x)
    gains = dict.fromkeys(level_stated | time_stated, np.inf)
    for source, level in levels.items():
        if source in gains:
            # It is there, whatever the readings say.
            continue
        none = level._replace(level=first[source].level * settings.no_level)
        gains[source] = -float(found.fun) - _evidence(pairs, {**levels, source: none}, prior)[0]
    return ProcessLevels(
        {source: each._replace(gain=gains[source]) for source, each in levels.items()},
        -float(found.fun),
    )


def _around(value: float, wide: float, largest: float | None, stated: bool) -> tuple[float, float]:
    """Bounds of the logarithm of a level."""
    if stated:
        return float(np.log(value)), float(np.log(value))
    most = np.log(value) + wide
    if largest is not None:
        most = min(most, np.log(largest))
    return float(min(np.log(value) - wide, most)), float(most)


def _of_logs(sources: Mapping[Source, ProcessLevel], logs: Array) -> dict[Source, ProcessLevel]:
    """Levels of logarithms of level and correlation time, shape (2 s,)."""
    return {
        source: ProcessLevel(float(level), float(time), 0.0)
        for source, (level, time) in zip(sources, np.exp(logs).reshape(-1, 2), strict=True)
    }


def on_levels(segment: Segment, levels: Mapping[Source, ProcessLevel]) -> Segment:
    """A segment whose processes have these levels."""
    processes = tuple(
        each.at(levels[each.source].level, levels[each.source].time) for each in segment.processes
    )
    return replace(segment, processes=processes)


def _evidence(
    pairs: Sequence[tuple[Segment, NormalEquations]],
    levels: Mapping[Source, ProcessLevel],
    prior: tuple[Array, Array] | None,
) -> tuple[float, Array]:
    """Log marginal likelihood but for a constant, and its gradient by the logarithms of level and
    correlation time of every source, shape (2 s,).

    By a number on which the precision P of the processes depends, it changes by half the trace of
    inv(P) dP less inv(K) dP, less half the cost dP of the likeliest coefficients; K is the matrix
    of motion and processes. The Schur complement S of the border changes by F' dP F, with F how the
    processes follow the border.
    """
    total, gradient = 0.0, {source: np.zeros(2) for source in levels}
    smoothed = []
    try:
        for segment, readings in pairs:
            own = on_levels(segment, levels)
            whole = own.smooth(readings)
            total += 0.5 * (float(whole.motion_gradient @ whole.settled) - whole.log_determinant)
            total += 0.5 * sum(each.log_determinant for each in own.processes)
            total -= 0.5 * own.prior_cost
            smoothed.append((own, whole))
        border = None if prior is None else _border([whole for _, whole in smoothed], *prior)
    except np.linalg.LinAlgError:
        return -np.inf, np.zeros(2 * len(levels))
    if border is not None:
        total += border.evidence
    for own, whole in smoothed:
        step = whole.settled if border is None else whole.motion_step(border.step)
        settled = own.coefficients + step.reshape(-1, own.block)
        root = None if border is None else whole.followed @ border.root
        for each in own.processes:
            place, width = own.process_places[each.source], len(each.precision)
            square = banded_square(settled[:, place], width)
            if root is not None:
                by_border = root.reshape(-1, own.block, root.shape[1])[:, place]
                square += banded_square(by_border.reshape(len(by_border), -1), width)
            for i in range(place.start, place.stop):
                square += whole.inverse[: width * own.block : own.block, i :: own.block]
            for i, change in enumerate(each.changes):
                free = each.components * each.log_determinant_changes[i]
                gradient[each.source][i] += 0.5 * (free - banded_trace(change, square))
    return total, np.concatenate(list(gradient.values()))


class _SettledBorder(NamedTuple):
    """Body and calibration, with motion and processes integrated out."""

    evidence: float
    """What they add to the log marginal likelihood."""
    step: Array
    """To where they are likeliest, shape (b,)."""
    root: Array
    """Of their covariance, whose product with its transpose it is, shape (b, b)."""


def _border(equations: Sequence[NormalEquations], precision: Array, pull: Array) -> _SettledBorder:
    """Of the equations of all segments, with what is known beforehand.

    Raises:
        numpy.linalg.LinAlgError: The readings do not determine them.
    """
    reduced = [each.reduced() for each in equations]
    matrix = np.sum([own for own, _ in reduced], axis=0) + precision
    right = np.sum([own for _, own in reduced], axis=0) + pull
    scale = 1 / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    factor = np.linalg.cholesky((matrix + matrix.T) / 2 * np.outer(scale, scale))
    root = scale[:, None] * np.linalg.inv(factor).T
    step = root @ (root.T @ right)
    determinant = 2 * float(np.sum(np.log(np.diag(factor))) - np.sum(np.log(scale)))
    return _SettledBorder(0.5 * (float(right @ step) - determinant), step, root)
