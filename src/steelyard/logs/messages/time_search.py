"""Where in a recording the rows of a window are, found by bisection.

Recorders index messages by the time at which they received them; a window is stated on the time of
a column, which may stand within the messages. Since such a time never decreases (a stream whose
time does is refused), a few dozen messages show which times of reception belong to a window, and
all others need not be decoded.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise

import numpy as np

from steelyard.logs.messages.recording import Interval

_MARGIN = 10**9
"""How close the bisection comes, and how much is read on either side: messages of one sender may
overtake each other by some milliseconds [ns]."""
_LOOKS = 16
"""Messages that are looked at first, evenly over the recording: a clock that was set back shows."""

Probe = Callable[[int], tuple[int, float] | None]
"""Time [ns] -> the first message received from then on: when it was received [ns] and its value in
a column; None: there is none."""


def interval_of_values(
    whole: Interval | None, probe: Probe, start: float, end: float
) -> Interval | None:
    """When messages were received whose values in a column lie within bounds.

    Args:
        whole: Of all messages of the recording.
        probe: Looks at single messages.
        start: Least value.
        end: Largest value.

    Returns:
        An interval that holds all of them; None: any time, since the recording is short, or what
        was looked at has no such value or decreases.
    """
    if whole is None or whole.end - whole.start <= _LOOKS * _MARGIN:
        return None
    seen: dict[int, float] = {}

    def value_from(received: int) -> float:
        """Value of the first message from a time on."""
        found = probe(received)
        if found is None:
            return math.inf
        seen[found[0]] = found[1]
        return found[1]

    for received in np.linspace(*whole, _LOOKS).tolist():
        value_from(int(received))
    first = _last(whole, lambda received: value_from(received) < start)
    last = _last(whole, lambda received: value_from(received) <= end)
    values = [value for _, value in sorted(seen.items())]
    never_decreases = all(before <= after for before, after in pairwise(values))
    if not never_decreases or any(map(math.isnan, values)):
        return None
    return Interval(first - _MARGIN, last + 2 * _MARGIN)


def _last(whole: Interval, holds: Callable[[int], bool]) -> int:
    """A time at which something still holds that later holds no more, at most a margin before the
    last such time; the beginning of the interval where it holds nowhere.
    """
    low, high = whole
    while high - low > _MARGIN:
        middle = (low + high) // 2
        if holds(middle):
            low = middle
        else:
            high = middle
    return low
