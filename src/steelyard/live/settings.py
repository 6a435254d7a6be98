"""Numbers that decide how a stream of samples is taken, with the reason of each."""

from __future__ import annotations

from dataclasses import dataclass, field

from steelyard.identification.recursive.settings import RECURSIVE, RecursiveSettings


@dataclass(frozen=True)
class LiveSettings:
    """How :func:`steelyard.watch` takes samples."""

    recursion: RecursiveSettings = field(default=RECURSIVE)
    """How the estimate follows them."""
    patience: float = 0.2
    """How long a sample may be late to be sorted in [s]."""
    silent: float = 2.0
    """After so long without a sample, an instrument is no longer waited for [s]."""
    kept: float = 3.0
    """Of what has been used that stays at hand [s]: filters have edges."""
    longest: float = 60.0
    """Of a recording that has not told a beginning yet, what is kept [s]."""
    judged: float = 5.0
    """Between two verdicts [s]: each asks all that was seen so far."""
    again: float = 2.0
    """Length of forces and motion after which a motion goes on that was not seen for a while
    [s]."""
    wanted: tuple[tuple[str, float], ...] = ()
    """Body parameter and the 1-sigma of it until which the time is foreseen."""
    parts: int = 60
    """Chunks that are kept one by one for the verdict; older ones are summed up."""
    ahead: float = 10.0
    """By how much a time stamp may be ahead of the last one of its instrument [s]: what is further
    ahead is taken once several in a row agree."""
    agreeing: int = 5
    """So many."""
    largest_message: int = 1 << 20
    """[bytes]"""
    most_samples: int = 20_000
    """Of one instrument in one message."""


LIVE = LiveSettings()
"""What is used where nothing is given."""
