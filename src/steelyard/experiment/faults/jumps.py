"""Stretches in which a tracker shows another place: a reflection, another target, a beam that was
lost and found.

From one sample to the next the readings jump, and jump back some tenths of a second later. What lies
between is no reading of the place. Nothing here knows the motion: a platform never moves by many
times more from one sample to the next than from all others around.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.experiment.faults.running import running_percentile


@dataclass(frozen=True)
class JumpSettings:
    """When readings of a place have jumped."""

    around: int = 51
    """Samples that show how a place changes from one to the next: tenths of a second of a tracker."""
    straight: int = 5
    """Of these, those nearest by, whose median is what the motion does."""
    usual: float = 80.0
    """Percentile of the changes that is usual: neighbouring jumps are beyond it."""
    edge: float = 8.0
    """Change in units of the usual that is a jump: ten 1-sigma of white noise."""
    least: float = 0.002
    """Jump [m] below which it is noise: one that robust weights cope with."""
    longest: float = 1.0
    """Time [s] after which a place that has not jumped back is another one."""
    back: float = 0.5
    """Part of a jump by which the way back may differ from it: noise, and what else moves."""
    gap: float = 3.0
    """Step of time in units of the usual across which a change is no jump."""
    most: float = 0.25
    """Part of the readings beyond which jumps are the rule, and no fault to leave out."""


JUMPS = JumpSettings()


class Jump(NamedTuple):
    """A stretch that lies elsewhere."""

    first: int
    """Its first sample."""
    end: int
    """The first one after it."""
    size: float
    """How far it lies off, in the unit of the values."""


def jumps(time: Array, values: Array, settings: JumpSettings = JUMPS) -> list[Jump]:
    """Stretches that lie elsewhere than what is before and after them, in order.

    Args:
        time: Of the samples, in order [s], shape (n,).
        values: Place [m], shape (n, 3); rows with NaN are no samples.
        settings: When it has jumped.
    """
    there = np.flatnonzero(np.isfinite(values).all(axis=1))
    if len(there) < settings.around:
        return []
    found = [
        Jump(int(there[a]), int(there[b - 1]) + 1, size)
        for a, b, size in _pairs(time[there], values[there], settings)
    ]
    left_out = sum(each.end - each.first for each in found)
    return found if left_out <= settings.most * len(there) else []


def _pairs(time: Array, values: Array, settings: JumpSettings) -> Iterator[tuple[int, int, float]]:
    """First sample, the one after the last, and size of every stretch."""
    changes = _unusual(values, settings)
    edges = list(_edges(time, changes, settings))
    while edges:
        start = edges.pop(0)
        size = float(np.linalg.norm(changes[start]))
        for i, end in enumerate(edges):
            if time[end] - time[start] > settings.longest:
                break
            far = float(np.linalg.norm(changes[start] + changes[end]))
            if size > settings.least and far < settings.back * size:
                yield start + 1, end + 1, size
                del edges[: i + 1]
                break


def _unusual(values: Array, settings: JumpSettings) -> Array:
    """Changes from one sample to the next, but for what the motion does, shape (n - 1, 3)."""
    changes = np.diff(values, axis=0)
    return np.asarray(changes - running_percentile(changes, settings.straight, 50))


def _edges(time: Array, changes: Array, settings: JumpSettings) -> NDArray[np.intp]:
    """Samples after which the place jumps."""
    size = np.abs(changes)
    usual = running_percentile(size, settings.around, settings.usual)
    smallest = 1e-12 * float(np.max(size, initial=0.0))
    far = np.any(size > settings.edge * np.maximum(usual, smallest), axis=1) & np.any(
        size > 0, axis=1
    )
    step = np.diff(time)
    return np.flatnonzero(far & (step <= settings.gap * float(np.median(step))))
