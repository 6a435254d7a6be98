"""Stretches in which a tracker shows another place: a reflection, another target, a beam that was
lost and found.

From one sample to the next the readings jump, and jump back some tenths of a second later. What
lies between is no reading of the place. Nothing here knows the motion: straight lines through the
readings just before and just after meet where a platform moves, and do not where the readings jump.
Lines through few samples find where; those through all of some hundredths of a second also find
what noise hides, or time stamps that scatter, so that samples of both places come by turns.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d

from steelyard.arrays import Array
from steelyard.experiment.faults.running import running_percentile


@dataclass(frozen=True)
class JumpSettings:
    """When readings of a place have jumped."""

    short: int = 4
    """Samples of short lines at most."""
    long: int = 50
    """Samples of long ones at most."""
    scatter: float = 0.3
    """Usual scatter of the steps of time, in their middle one, from which on short lines tell
    nothing: samples around a jump come by turns."""
    straight: float = 0.05
    """Time [s] for which a motion is nearly straight, which lines of more than two samples keep
    to."""
    around: int = 51
    """Differences around one that show what is usual: tenths of a second of a tracker."""
    usual: float = 80.0
    """Percentile of them that is usual: neighbouring jumps are beyond it."""
    edge: float = 5.0
    """Difference in units of the usual, over all axes, that is a jump: six 1-sigma of white
    noise."""
    least: float = 0.002
    """Jump [m] below which it is noise: one that robust weights cope with."""
    sudden: float = 10.0
    """Change of the acceleration [m/s^2] that is none: lines do not meet where a motion bends."""
    longest: float = 1.0
    """Time [s] after which a place that has not jumped back is another one."""
    back: float = 0.5
    """Part of a jump by which the way back may differ from it: noise, and what else moves."""
    gap: float = 3.0
    """Step of time in units of the usual across which a change is no jump."""
    rule: float = 0.25
    """Part of the readings beyond which jumps are the rule, and no fault to leave out."""


JUMPS = JumpSettings()
_AT_ONCE = 4096
"""Lines through samples at once, so that memory stays small."""


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
    elsewhere, found = np.zeros(len(values), dtype=bool), list[Jump]()
    steps = np.diff(time[there])
    usual = max(float(np.median(steps)), 1e-9)
    for width in _widths(steps, usual, settings):
        own = there[~elsewhere[there]]
        for first, end, size in _pairs(time[own], values[own], usual, width, settings):
            found.append(Jump(int(own[first]), int(own[end - 1]) + 1, size))
            elsewhere[found[-1].first : found[-1].end] = True
    left_out = int(np.sum(elsewhere[there]))
    return list(_apart(found)) if left_out <= settings.rule * len(there) else []


def _widths(steps: Array, usual: float, settings: JumpSettings) -> list[int]:
    """Samples of short and long lines; of slow trackers both are the same.

    Args:
        steps: From each sample to the next [s], shape (n - 1,).
        usual: Their middle one [s].
        settings: How long lines are.
    """
    straight = int(settings.straight / usual)
    short, long = (max(2, min(straight, most)) for most in (settings.short, settings.long))
    scatters = float(np.median(np.abs(steps - usual))) > settings.scatter * usual
    return [long] if scatters or long == short else [short, long]


def _apart(found: Sequence[Jump]) -> Iterator[Jump]:
    """The same in order, those that reach into each other as one."""
    last: Jump | None = None
    for each in sorted(found):
        if last is not None and each.first <= last.end:
            last = Jump(last.first, max(last.end, each.end), max(last.size, each.size))
            continue
        if last is not None:
            yield last
        last = each
    if last is not None:
        yield last


def _pairs(
    time: Array, values: Array, usual: float, width: int, settings: JumpSettings
) -> Iterator[tuple[int, int, float]]:
    """First sample, the one after the last, and size of every stretch."""
    if len(time) < 2 * width:
        return
    changes, lever = _across(time, values, width, settings.gap * width * usual)
    edges = list(_edges(changes, lever, width, settings))
    # Around an edge that short lines do not see samples of both places may come by turns.
    blurred = width // 4 if width > settings.short else 0
    least = max(settings.least, settings.sudden * (width * usual) ** 2 / 12)
    while edges:
        start = edges.pop(0)
        size = float(np.linalg.norm(changes[start]))
        inside = [end for end in edges if time[end] - time[start] <= settings.longest]
        end = _way_back(changes, start, inside, settings) if size > least else None
        if end is not None:
            yield max(start + 1 - blurred, 0), min(end + 1 + blurred, len(time)), size
            edges = [each for each in edges if each > end]


def _way_back(
    changes: Array, start: int, edges: Sequence[int], settings: JumpSettings
) -> int | None:
    """The edge after which a place that has jumped is back, or None: jumps may reach into each
    other.

    Args:
        changes: At all edges, shape (n, 3).
        start: Where it has jumped.
        edges: After that, in order.
        settings: What is back.
    """
    off, smallest = changes[start], float(np.linalg.norm(changes[start]))
    for end in edges:
        off = off + changes[end]
        smallest = min(smallest, float(np.linalg.norm(changes[end])))
        if np.linalg.norm(off) < settings.back * smallest:
            return end
    limit = settings.back * float(np.linalg.norm(changes[start]))
    alone = (end for end in edges if np.linalg.norm(changes[start] + changes[end]) < limit)
    return next(alone, None)


def _across(time: Array, values: Array, width: int, longest: float) -> tuple[Array, Array]:
    """Differences between lines through some samples after and before the middle of two, there,
    shape (n - 1, 3), and what they make of noise, shape (n - 1,); zero and one where no such
    samples lie within so long [s].
    """
    found, lever = np.zeros((len(time) - 1, values.shape[1])), np.ones(len(time) - 1)
    middle = (time[1:] + time[:-1]) / 2
    times = np.lib.stride_tricks.sliding_window_view(time, width)
    places = np.lib.stride_tricks.sliding_window_view(values, width, axis=0)
    for begin in range(0, len(time) + 1 - 2 * width, _AT_ONCE):
        before = slice(begin, min(begin + _AT_ONCE, len(time) + 1 - 2 * width))
        after = slice(before.start + width, before.stop + width)
        at = slice(before.start + width - 1, before.stop + width - 1)
        (there, far), (here, near) = (
            _line(times[own], places[own], middle[at]) for own in (after, before)
        )
        close = times[after][:, -1] - times[before][:, 0] <= longest
        found[at] = np.where(close[:, None], there - here, 0.0)
        lever[at] = np.where(close, np.sqrt(far + near), 1.0)
    return found, lever


def _line(times: Array, places: Array, at: Array) -> tuple[Array, Array]:
    """Straight lines through samples, shapes (c, w) and (c, 3, w), at other times, shape (c, 3),
    and the variance there in that of a sample, shape (c,).
    """
    off = times - times.mean(axis=1, keepdims=True)
    ahead = at - times.mean(axis=1)
    # Stamps that scatter may fall together.
    square = np.maximum(np.sum(off**2, axis=1), 1e-12 * (1 + ahead**2))
    weights = 1 / times.shape[1] + off * (ahead / square)[:, None]
    return np.asarray(np.einsum("cw,ckw->ck", weights, places)), np.sum(weights**2, axis=1)


def _edges(changes: Array, lever: Array, width: int, settings: JumpSettings) -> NDArray[np.intp]:
    """Samples after which the place jumps."""
    size = np.abs(changes) / lever[:, None]
    # Neighbours of long lines are hardly others.
    apart = max(1, width // 4)
    usual = running_percentile(size[::apart], settings.around, settings.usual)
    usual = np.repeat(usual, apart, axis=0)[: len(size)]
    smallest = max(1e-12 * float(np.max(size, initial=0.0)), 1e-300)
    far = np.linalg.norm(size / np.maximum(usual, smallest), axis=1) > settings.edge
    # The largest of those that lie together.
    length = np.where(far, np.sum(size**2, axis=1), 0.0)
    return np.flatnonzero(far & (length >= maximum_filter1d(length, 2 * width - 1)))
