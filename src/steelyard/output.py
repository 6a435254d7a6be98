"""Results reach their place whole or not at all: written beside it, then renamed."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from steelyard.errors import InputError


def check_target(target: Path, *, force: bool) -> None:
    """Refuse a place for results before any work is done.

    Raises:
        InputError: Something is there already and may not be replaced, or the place cannot be written to.
    """
    if target.exists() and not target.is_dir():
        raise InputError(f"{target}: expected a folder for the results, found a file; choose another with --out")
    if target.is_dir() and any(target.iterdir()) and not force:
        raise InputError(
            f"{target}: expected a new or empty folder for the results, found files; choose another, or --force to replace them"
        )
    parent = target.absolute().parent
    while not parent.exists():
        parent = parent.parent
    if not parent.is_dir() or not os.access(parent, os.W_OK):
        raise InputError(f"{target}: expected a place that can be written to, found none; choose another with --out")


@contextmanager
def results_folder(target: Path, *, force: bool) -> Iterator[Path]:
    """A folder to write results into, which appears at its place only when the block ends without an error.

    With ``force``, files and folders of the same names are replaced; whatever else lies there stays.

    Args:
        target: Where the results belong.
        force: Whether they may replace others.

    Yields:
        An empty folder beside the target.

    Raises:
        InputError: See :func:`check_target`.
    """
    check_target(target, force=force)
    target = target.absolute()
    target.parent.mkdir(parents=True, exist_ok=True)
    beside = Path(tempfile.mkdtemp(prefix=f".{target.name}.", dir=target.parent))
    try:
        fresh = beside / "new"
        fresh.mkdir()
        yield fresh
        _publish(fresh, target, beside / "old")
    finally:
        shutil.rmtree(beside, ignore_errors=True)


def _publish(fresh: Path, target: Path, old: Path) -> None:
    if target.is_dir() and not any(target.iterdir()):
        target.rmdir()
    if not target.exists():
        fresh.rename(target)
        return
    old.mkdir()
    for entry in sorted(fresh.iterdir()):
        place = target / entry.name
        if place.exists() or place.is_symlink():
            place.rename(old / entry.name)
        entry.rename(place)


def write_json(values: Mapping[str, Any], path: Path) -> None:
    """Write plain values as JSON."""
    path.write_text(to_json(values) + "\n", encoding="utf-8")


def to_json(values: Mapping[str, Any]) -> str:
    """Plain values as JSON text; NaN is a mistake here, the contract has null."""
    return json.dumps(values, indent=1, allow_nan=False, ensure_ascii=False)
