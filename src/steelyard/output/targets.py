"""Places for results, refused before any work is done where nothing can be written there."""

from __future__ import annotations

import os
from pathlib import Path

from steelyard.errors import InputError
from steelyard.output.hidden import HIDDEN


def check_target(target: Path, *, force: bool) -> None:
    """Refuse a place for results before any work is done.

    Args:
        target: Where the results belong.
        force: Whether they may replace others.

    Raises:
        InputError: Something is there already and may not be replaced, or the place cannot be
            written to.
    """
    if target.is_symlink() and not target.exists():
        raise InputError(
            f"{target}: expected a folder for the results, found a link to nothing; choose another"
            " with --out"
        )
    if target.exists() and not target.is_dir():
        raise InputError(
            f"{target}: expected a folder for the results, found a file; choose another with --out"
        )
    if (
        target.is_dir()
        and not force
        and any(not entry.name.startswith(HIDDEN) for entry in target.iterdir())
    ):
        raise InputError(
            f"{target}: expected a new or empty folder for the results, found files; choose"
            " another, or --force to replace them"
        )
    _check_place(target.absolute() if target.is_dir() else target.absolute().parent, target)


def check_file_target(target: Path, *, force: bool) -> None:
    """Refuse a place for a single file before any work is done.

    Args:
        target: Where the file belongs.
        force: Whether it may replace another.

    Raises:
        InputError: Something is there already and may not be replaced, or the place cannot be
            written to.
    """
    if target.is_symlink() and not target.exists():
        raise InputError(
            f"{target}: expected a file to write, found a link to nothing; choose another with"
            " --out"
        )
    if target.exists() and not target.is_file():
        found = "a folder" if target.is_dir() else "something that is no regular file"
        raise InputError(
            f"{target}: expected a file to write, found {found}; choose another with --out"
        )
    if target.exists() and not force:
        raise InputError(
            f"{target}: expected a new file, found one of that name; choose another with --out, or"
            " --force to replace it"
        )
    _check_place(target.resolve().parent, target)


def _check_place(folder: Path, target: Path) -> None:
    while not folder.exists():
        folder = folder.parent
    if not folder.is_dir() or not os.access(folder, os.W_OK):
        raise InputError(
            f"{target}: expected a place that can be written to, found none; choose another with"
            " --out"
        )
