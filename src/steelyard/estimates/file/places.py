"""Estimates as people name them: a file or its folder, a method behind a colon, a load behind a
#.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from steelyard.estimates.file.estimate_file import read_estimate_file
from steelyard.estimates.named_estimate import NamedEstimate, short_names


def read_estimates(places: Sequence[str], method: str | None = None) -> tuple[NamedEstimate, ...]:
    """Read estimates and give them short names that differ.

    Args:
        places: Estimate files or folders with one, each with ``:METHOD`` behind it where not the
            default is meant, and ``#LOAD`` behind that for another load than the first.
        method: Of those without; None: the result of the file; ``all``: every one.

    Raises:
        InputError: See :func:`read_estimate_file`; or a file has no such method, or no such load.
    """
    found: list[NamedEstimate] = []
    for place in places:
        path, own, load = _split(place)
        found += read_estimate_file(path).chosen(own or method, load)
    return tuple(
        replace(each, name=name) for each, name in zip(found, short_names(found), strict=True)
    )


def _split(place: str) -> tuple[Path, str | None, str | None]:
    """Path, method and load; a path that is there is a path, whatever colons it has."""
    before, _, load = place.rpartition("#")
    if before and load and not _exists(place):
        path, method, _ = _split(before)
        return path, method, load
    path_text, _, method_text = place.rpartition(":")
    if path_text and method_text and not _exists(place):
        return Path(path_text), method_text, None
    return Path(place), None, None


def _exists(place: str) -> bool:
    try:
        return Path(place).exists()
    except (OSError, ValueError):
        return False
