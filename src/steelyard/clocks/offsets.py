"""From pairs of clocks to the time of all of them against one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from steelyard.arrays import Array, binned_means
from steelyard.clocks.clock_signals import LogClock
from steelyard.clocks.search import Candidate, candidates
from steelyard.clocks.settings import OFFSET, OffsetSettings
from steelyard.clocks.shift import Shift, refined


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
    known: bool
    """Whether the recording determines it."""
    reason: str = ""
    """Why it does not."""
    drift: float = 0.0
    """By how much the clock runs faster than that of the forces; 0 where none shows."""
    drift_sigma: float = 0.0

    def to_dict(self) -> dict[str, Any]:
        """Plain values; null where the recording does not determine them."""
        return {
            "instruments": list(self.instruments),
            "offset": self.value if self.known else None,
            "standard_deviation": self.sigma if self.known else None,
            "drift": self.drift,
            "drift_standard_deviation": self.drift_sigma or None,
            "told": self.known,
            "reason": self.reason or None,
        }


@dataclass(frozen=True)
class Link:
    """What the streams of two clocks share."""

    first: int
    second: int
    found: tuple[Candidate, ...]

    @property
    def gain(self) -> float:
        """Log likelihood of the best shift, against nothing in common."""
        return self.found[0].gain if self.found else 0.0


def joined(clocks: Sequence[LogClock], settings: OffsetSettings = OFFSET) -> list[Offset]:
    """Offsets of clocks against the first one, by the pairs that share most.

    Args:
        clocks: Of one run; that of the forces, if it is among them, only where there are but two.
        settings: When an offset counts as found.
    """
    if len(clocks) < 2:
        return [Offset(c.instruments, 0.0, 0.0, True) for c in clocks]
    links = [
        Link(i, j, tuple(candidates(clocks[i], clocks[j], settings.tried, settings.search)))
        for i, j in combinations(range(len(clocks)), 2)
    ]
    links.sort(key=lambda link: -link.gain)
    known = {0: Offset(clocks[0].instruments, 0.0, 0.0, True)}
    while len(known) < len(clocks):
        # Every pair has a link.
        link = next(each for each in links if (each.first in known) != (each.second in known))
        forward = link.first in known
        old, new = (link.first, link.second) if forward else (link.second, link.first)
        step = _measured(clocks, link, settings)
        known[new] = chained(known[old], step, clocks[new].instruments, 1 if forward else -1)
    return [known[i] for i in range(len(clocks))]


def chained(old: Offset, step: Offset, instruments: tuple[str, ...], sign: int = 1) -> Offset:
    """Offset of the clock of instruments by that of another clock and the step from there.

    Args:
        old: Of the other clock.
        step: From that clock to this one; with a sign of -1 from this one to that one.
        instruments: That share this clock.
        sign: Of the step.
    """
    return Offset(
        instruments,
        old.value + sign * step.value,
        float(np.hypot(old.sigma, step.sigma)),
        old.known and step.known,
        step.reason or old.reason,
        old.drift + sign * step.drift,
        float(np.hypot(old.drift_sigma, step.drift_sigma)),
    )


def _measured(clocks: Sequence[LogClock], link: Link, settings: OffsetSettings) -> Offset:
    """Offset of the second clock of a link against the first one."""
    first, second = clocks[link.first], clocks[link.second]
    names = f"{' and '.join(first.instruments)} against {' and '.join(second.instruments)}"

    def unknown(value: float, reason: str) -> Offset:
        return Offset(second.instruments, value, np.inf, False, f"{names}: {reason}")

    if link.gain < settings.least_gain:
        return unknown(0.0, "the motion that both recorded is too small")
    refinements = [(c, _overall(first, second, c.shift, settings)) for c in link.found]
    # The likeliest of the rough search, unless the finer one decides among those about as likely.
    close = [
        (c, shift)
        for c, shift in refinements
        if shift is not None and c.gain > settings.close_gain * link.gain
    ]
    if not close:
        return unknown(link.found[0].shift, "too little overlaps")
    close.sort(key=lambda pair: pair[1].cost)
    best = close[0][1]
    for candidate, shift in close[1:]:
        is_as_likely = candidate.gain > settings.equal_gain * link.gain
        fits_as_well = shift.cost < best.cost + settings.clearly_better
        if is_as_likely and fits_as_well and abs(shift.value - best.value) > settings.distinct:
            return unknown(best.value, ambiguous(best, shift))
    drift, deviation = _drift(first, second, best, settings)
    known = best.sigma < settings.largest_sigma
    reason = "" if known else f"{names}: {uncertain(best)}"
    return Offset(second.instruments, best.value, best.sigma, known, reason, drift, deviation)


def ambiguous(one: Shift, other: Shift) -> str:
    """Why an offset is not known where two shifts are equally likely."""
    low, high = sorted((one.value, other.value))
    return f"the motion is periodic, so that shifts of {low:.3f} s and {high:.3f} s fit alike"


def uncertain(shift: Shift) -> str:
    """Why an offset is not known where its shift is too uncertain."""
    return f"the motion is too slow: the 1-sigma of the shift is {shift.sigma * 1e3:.0f} ms"


def _overall(
    first: LogClock, second: LogClock, guess: float, settings: OffsetSettings
) -> Shift | None:
    """Shift over the recording, or its liveliest part."""
    start, end = _common(first, second, guess)
    if end - start > 1.5 * settings.part:
        start, end = liveliest(first, start, end, settings)
    return refined(first, second, guess, around=(start, end), settings=settings.shift)


def _common(first: LogClock, second: LogClock, shift: float) -> tuple[float, float]:
    """Part of the first clock's time that the second one was running too."""
    a, b = first.span, second.span
    return max(a[0], b[0] - shift), min(a[1], b[1] - shift)


def liveliest(
    clock: LogClock, start: float, end: float, settings: OffsetSettings = OFFSET
) -> tuple[float, float]:
    """Part of an interval in which the signals of a clock change most."""
    signal = next(iter(clock.signals.values())).between(start, end)
    scaled = signal.values / np.maximum(signal.values.std(axis=0), 1e-300)
    # Means over half a second: changes of these are motion, not noise.
    bins = np.floor((signal.time - signal.time[0]) / 0.5).astype(np.int64)
    means, _ = binned_means(bins, scaled)
    changes = np.concatenate([[0.0], np.cumsum(np.sum(np.diff(means, axis=0) ** 2, axis=1))])
    width = round(settings.part / 0.5)
    gained = changes[width:] - changes[:-width]
    begin = start + 0.5 * float(np.argmax(gained)) if len(gained) else start
    return begin, min(end, begin + settings.part)


def _drift(
    first: LogClock, second: LogClock, overall: Shift, settings: OffsetSettings
) -> tuple[float, float]:
    """By how much the second clock runs faster than the first one, with its 1-sigma; 0 where none
    shows.
    """

    def at(middle: float, reach: float) -> Shift | None:
        around = (middle - settings.part / 2, middle + settings.part / 2)
        return refined(
            first, second, overall.value, around=around, reach=reach, settings=settings.shift
        )

    return drift_of(at, _common(first, second, overall.value), settings)


def drift_of(
    at: Callable[[float, float], Shift | None],
    span: tuple[float, float],
    settings: OffsetSettings = OFFSET,
) -> tuple[float, float]:
    """Drift between two clocks with its 1-sigma, from parts of a recording; 0 where none shows, or
    it is too short to show any.

    Args:
        at: Shift about a time of the first clock [s], looked for as far as a reach [s].
        span: Part of the first clock's time in which both ran [s].
        settings: When a drift counts as found.
    """
    start, end = span
    if end - start < 3 * settings.part:
        return 0.0, 0.0
    count = min(settings.most_parts, int((end - start) / settings.part))
    middles = np.linspace(start + settings.part / 2, end - settings.part / 2, count)
    reach = max(0.05, settings.largest_drift * (end - start))
    points = []
    for middle in middles:
        shift = at(float(middle), reach)
        if shift is not None and shift.sigma < settings.largest_sigma:
            points.append((middle, shift.value, shift.sigma))
    if len(points) < 3:
        return 0.0, 0.0
    slope, sigma = _line(*np.array(points).T)
    is_clear = abs(slope) > max(settings.significant * sigma, settings.least_drift)
    return (slope, sigma) if is_clear else (0.0, sigma)


def _line(x: Array, y: Array, sigma: Array) -> tuple[float, float]:
    """Slope of a line through points, with its 1-sigma, enlarged where they scatter more than they
    should.
    """
    weight = 1 / np.maximum(sigma, 1e-5)
    line, covariance = np.polyfit(x, y, 1, w=weight, cov="unscaled")
    residual = weight * (y - np.polyval(line, x))
    excess = float(np.sum(residual**2)) / max(len(x) - 2, 1)
    return float(line[0]), float(np.sqrt(max(1.0, excess) * covariance[0, 0]))
