"""Whether the streams of a run were stamped by clocks that agree."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from steelyard.drafts.settings import ARRANGE
from steelyard.drafts.survey import DraftStream


def one_clock(streams: Sequence[DraftStream]) -> tuple[bool, str]:
    """Whether the times of streams may be compared, and why."""
    if len({found.clock for found in streams}) == 1:
        return True, "one file, one clock"
    starts, ends = np.array([found.span for found in streams]).T
    overlap, shortest = float(ends.min() - starts.max()), float((ends - starts).min())
    if overlap < ARRANGE.overlap * shortest or overlap <= 0:
        return False, "their times do not overlap"
    if starts.min() > ARRANGE.since_1970:
        return True, "all times count since 1970 and overlap"
    if starts.min() > ARRANGE.long_running * float((ends - starts).max()):
        return True, "all clocks had run for long and overlap"
    rates = [found.rate for found in streams if found.rate]
    close = max(ARRANGE.agree, 2 / min(rates) if rates else 0.0)
    if np.ptp(starts) <= close and np.ptp(ends) <= close:
        return True, "all begin and end together"
    if np.ptp(starts) == 0:
        return False, "all begin at the same number, as logs do that count from their own start"
    return False, f"they begin at {starts.min():.4g} to {starts.max():.4g} s on their own clocks"
