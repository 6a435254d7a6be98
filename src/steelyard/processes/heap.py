"""Memory that the C library keeps though nobody uses it: as much as serves, and no more.

Where values that stay are made between large ones that come and go, its heap is full of holes that
it keeps for later; the process then grows for hours though what it holds does not. Where it keeps
nothing, every matrix is memory that the system has to find, and to fill with zeros, anew.
"""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Callable
from functools import cache

_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3
"""Of ``malloc.h``."""
_LARGEST = 32 << 20
"""Largest piece that is kept in the heap [bytes]: where glibc ends by itself."""


def give_back() -> None:
    """Give what is free to the system, where the C library can (glibc); takes some milliseconds."""
    trim = _trim()
    if trim is not None:
        trim(0)


def keep_for_reuse() -> None:
    """Keep what matrices leave behind for the next ones, as the C library does by itself (glibc)
    where nobody has said otherwise: workers of Dask begin with ``MALLOC_TRIM_THRESHOLD_``, and take
    a third longer with it.
    """
    library = _library()
    if library is not None and hasattr(library, "mallopt"):
        library.mallopt(_MMAP_THRESHOLD, _LARGEST)
        library.mallopt(_TRIM_THRESHOLD, 2 * _LARGEST)


@cache
def _library() -> ctypes.CDLL | None:
    """The C library of Linux; None: another system."""
    return ctypes.CDLL(None) if sys.platform.startswith("linux") else None


@cache
def _trim() -> Callable[[int], int] | None:
    """``malloc_trim`` of the C library; None: it has none."""
    found: Callable[[int], int] | None = getattr(_library(), "malloc_trim", None)
    return found
