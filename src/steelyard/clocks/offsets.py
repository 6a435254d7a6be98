"""From pairs of clocks to the time of all of them against one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from steelyard.arrays import Array
from steelyard.clocks.clock_signals import LogClock
from steelyard.clocks.search import Candidate, candidates
from steelyard.clocks.shift import Shift, refined

_LEAST_GAIN = 8.0
"""Log likelihood that two clocks must share."""
_TRIED = 3
_CLOSE = 0.7
"""Part of the largest gain that others must have to be looked at closer."""
_ALIKE = 0.9
"""Part of it with which they are as likely."""
_MUCH = 0.2
"""Logarithm of the variance by which one must be better then."""
_APART = 0.3
"""Of shifts that are different ones [s]."""
_PART = 40.0
"""Of a recording that is looked at in detail at once [s]."""
_MOST_PARTS = 6
_LARGEST_SIGMA = 0.05
"""Of what still counts as told [s]."""
_LEAST_DRIFT = 5e-6
_FASTEST_DRIFT = 2e-4
"""No clock of an instrument is worse."""
_CLEAR = 4.0
"""1-sigmas by which a drift must stand out."""


@dataclass(frozen=True)
class Offset:
    """How a clock stands to that of the forces."""

    instruments: tuple[str, ...]
    """That share the clock."""
    value: float
    """Its time less that of the forces' clock at the same instant [s], where the recording
    begins."""
    sigma: float
    """1-sigma [s]."""
    told: bool
    """Whether the recording tells it."""
    reason: str = ""
    """Why it does not."""
    drift: float = 0.0
    """By how much the clock runs faster than that of the forces; 0 where none shows."""
    drift_sigma: float = 0.0

    def to_dict(self) -> dict[str, Any]:
        """Plain values; null where the recording does not tell."""
        return {
            "instruments": list(self.instruments),
            "offset": self.value if self.told else None,
            "standard_deviation": self.sigma if self.told else None,
            "drift": self.drift,
            "drift_standard_deviation": self.drift_sigma or None,
            "told": self.told,
            "reason": self.reason or None,
        }


@dataclass(frozen=True)
class Link:
    """What two clocks say of each other."""

    first: int
    second: int
    found: tuple[Candidate, ...]

    @property
    def gain(self) -> float:
        """Log likelihood of the best shift, against nothing in common."""
        return self.found[0].gain if self.found else 0.0


def joined(clocks: Sequence[LogClock]) -> list[Offset]:
    """Offsets of clocks against the first one, by the pairs that share most.

    Args:
        clocks: Of one run; that of the forces, if it is among them, only where there are but two.
    """
    if len(clocks) < 2:
        return [Offset(c.instruments, 0.0, 0.0, True) for c in clocks]
    links = sorted(
        (
            Link(i, j, tuple(candidates(clocks[i], clocks[j], _TRIED)))
            for i, j in combinations(range(len(clocks)), 2)
        ),
        key=lambda link: -link.gain,
    )
    known = {0: Offset(clocks[0].instruments, 0.0, 0.0, True)}
    while len(known) < len(clocks):
        link = next(
            (each for each in links if (each.first in known) != (each.second in known)), None
        )
        assert link is not None  # every pair has a link
        forward = link.first in known
        old, new = (link.first, link.second) if forward else (link.second, link.first)
        known[new] = _beyond(known[old], _measured(clocks, link), clocks[new], 1 if forward else -1)
    return [known[i] for i in range(len(clocks))]


def _beyond(old: Offset, step: Offset, clock: LogClock, sign: int) -> Offset:
    return Offset(
        clock.instruments,
        old.value + sign * step.value,
        float(np.hypot(old.sigma, step.sigma)),
        old.told and step.told,
        step.reason or old.reason,
        old.drift + sign * step.drift,
        float(np.hypot(old.drift_sigma, step.drift_sigma)),
    )


def _measured(clocks: Sequence[LogClock], link: Link) -> Offset:
    """Offset of the second clock of a link against the first one."""
    first, second = clocks[link.first], clocks[link.second]
    names = f"{' and '.join(first.instruments)} against {' and '.join(second.instruments)}"
    if link.gain < _LEAST_GAIN:
        return Offset(
            second.instruments,
            0.0,
            np.inf,
            False,
            f"{names}: the motion that both saw is too little",
        )
    tried = [
        (c, s) for c in link.found for s in [_overall(first, second, c.shift)] if s is not None
    ]
    if not tried:
        return Offset(
            second.instruments, link.found[0].shift, np.inf, False, f"{names}: too little overlaps"
        )
    # The likeliest of the rough search, unless the finer one knows better among those about as
    # likely.
    close = sorted((t for t in tried if t[0].gain > _CLOSE * link.gain), key=lambda t: t[1].cost)
    if not close:
        return Offset(
            second.instruments, link.found[0].shift, np.inf, False, f"{names}: too little overlaps"
        )
    best = close[0][1]
    others = [
        s
        for c, s in close[1:]
        if c.gain > _ALIKE * link.gain
        and abs(s.value - best.value) > _APART
        and s.cost < best.cost + _MUCH
    ]
    if others:
        shifts = " and ".join(f"{s:.3f} s" for s in sorted((best.value, others[0].value)))
        reason = f"{names}: the motion repeats itself, so that shifts of {shifts} explain it alike"
        return Offset(second.instruments, best.value, np.inf, False, reason)
    told = best.sigma < _LARGEST_SIGMA
    reason = (
        ""
        if told
        else f"{names}: the motion is too slow to tell it better than to {best.sigma * 1e3:.0f} ms"
    )
    drift, deviation = _drift(first, second, best)
    return Offset(second.instruments, best.value, best.sigma, told, reason, drift, deviation)


def _overall(first: LogClock, second: LogClock, guess: float) -> Shift | None:
    """Shift over the recording, or its liveliest part."""
    start, end = _common(first, second, guess)
    if end - start <= 1.5 * _PART:
        return refined(first, second, guess, around=(start, end))
    return refined(first, second, guess, around=liveliest(first, start, end))


def _common(first: LogClock, second: LogClock, shift: float) -> tuple[float, float]:
    """Part of the first clock's time that the second one was running too."""
    a, b = first.span, second.span
    return max(a[0], b[0] - shift), min(a[1], b[1] - shift)


def liveliest(clock: LogClock, start: float, end: float) -> tuple[float, float]:
    """Part of an interval in which a clock sees most change."""
    signal = next(iter(clock.signals.values())).between(start, end)
    scaled = signal.values / np.maximum(signal.values.std(axis=0), 1e-300)
    # Means over half a second: changes of these are motion, not noise.
    bins = np.floor((signal.time - signal.time[0]) / 0.5).astype(np.int64)
    count = np.maximum(np.bincount(bins), 1)
    means = np.column_stack(
        [np.bincount(bins, scaled[:, i]) / count for i in range(scaled.shape[1])]
    )
    changes = np.concatenate([[0.0], np.cumsum(np.sum(np.diff(means, axis=0) ** 2, axis=1))])
    width = round(_PART / 0.5)
    gained = changes[width:] - changes[:-width]
    begin = start + 0.5 * float(np.argmax(gained)) if len(gained) else start
    return begin, min(end, begin + _PART)


def _drift(first: LogClock, second: LogClock, overall: Shift) -> tuple[float, float]:
    """By how much the second clock runs faster than the first one, with its 1-sigma; 0 where none
    shows.
    """

    def at(middle: float, reach: float) -> Shift | None:
        around = (middle - _PART / 2, middle + _PART / 2)
        return refined(first, second, overall.value, around=around, reach=reach)

    return drift_of(at, _common(first, second, overall.value))


def drift_of(
    at: Callable[[float, float], Shift | None], span: tuple[float, float]
) -> tuple[float, float]:
    """Drift between two clocks with its 1-sigma, from parts of a recording; 0 where none shows, or
    it is too short to show any.

    Args:
        at: Shift about a time of the first clock [s], looked for as far as a reach [s].
        span: Part of the first clock's time in which both ran [s].
    """
    start, end = span
    if end - start < 3 * _PART:
        return 0.0, 0.0
    count = min(_MOST_PARTS, int((end - start) / _PART))
    middles = np.linspace(start + _PART / 2, end - _PART / 2, count)
    reach = max(0.05, _FASTEST_DRIFT * (end - start))
    parts = [at(float(middle), reach) for middle in middles]
    told = [
        (m, p)
        for m, p in zip(middles, parts, strict=True)
        if p is not None and p.sigma < _LARGEST_SIGMA
    ]
    if len(told) < 3:
        return 0.0, 0.0
    time = np.array([m for m, _ in told])
    slope, sigma = _line(
        time, np.array([p.value for _, p in told]), np.array([p.sigma for _, p in told])
    )
    return (slope, sigma) if abs(slope) > max(_CLEAR * sigma, _LEAST_DRIFT) else (0.0, sigma)


def _line(x: Array, y: Array, sigma: Array) -> tuple[float, float]:
    """Slope of a line through points, with its 1-sigma, enlarged where they scatter more than they
    should.
    """
    weight = 1 / np.maximum(sigma, 1e-5) ** 2
    center = np.average(x, weights=weight)
    spread = float(np.sum(weight * (x - center) ** 2))
    slope = float(np.sum(weight * (x - center) * y)) / spread
    residual = y - np.average(y, weights=weight) - slope * (x - center)
    excess = float(np.sum(weight * residual**2)) / max(len(x) - 2, 1)
    return slope, float(np.sqrt(max(1.0, excess) / spread))
