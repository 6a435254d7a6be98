"""Time of processes that a benchmark begins."""

from __future__ import annotations

import resource


def seconds_of_children() -> float:
    """Of the processor, in all processes that were begun and have ended [s]."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime
