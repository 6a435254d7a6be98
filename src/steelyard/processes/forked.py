"""Processes that were forked from one whose libraries had begun threads."""

from __future__ import annotations

import os
from functools import cache

from steelyard.errors import SteelyardError


def check_not_forked() -> None:
    """See that tables can be read and written in this process.

    Polars computes tables in threads that it begins at its first use. A fork copies the memory
    without the threads, and the copy would wait for them without end.

    Raises:
        SteelyardError: The process was forked from one that had used tables.
    """
    if _first_user() != os.getpid():
        raise SteelyardError(
            "expected a process of its own for recordings, found one that was forked from a process"
            " that had read some; use multiprocessing.get_context('spawn'), or read the experiment"
            " before the fork and identify it after"
        )


@cache
def _first_user() -> int:
    """The process that used tables first; a forked one inherits the answer."""
    return os.getpid()
