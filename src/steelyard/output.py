"""Results reach their place whole or not at all: written beside it, then renamed."""

from __future__ import annotations

import io
import json
import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from steelyard.arrays import Array
from steelyard.errors import InputError

_HIDDEN = ".steelyard-"
"""How the names of unfinished results begin; what a killed process left does not count as files of
the user."""


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
        and any(not entry.name.startswith(_HIDDEN) for entry in target.iterdir())
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


@contextmanager
def results_folder(target: Path, *, force: bool) -> Iterator[Path]:
    """A folder to write results into, which appear at their place only when the block ends without
    an error.

    With ``force``, files and folders of the same names are replaced; whatever else lies there
    stays.

    Args:
        target: Where the results belong.
        force: Whether they may replace others.

    Yields:
        An empty folder beside the target.

    Raises:
        InputError: See :func:`check_target`; also where others put something there meanwhile.
    """
    check_target(target, force=force)
    place = target.resolve() if target.exists() else target.absolute()
    with _beside(place if place.is_dir() else place.parent) as beside:
        fresh = beside / "new"
        fresh.mkdir()
        try:
            yield fresh
        except OSError as error:
            _rename_in(error, fresh, target)
            raise
        check_target(target, force=force)
        _publish(fresh, place, beside / "old")


@contextmanager
def results_file(target: Path, *, force: bool) -> Iterator[Path]:
    """A path to write one file to, which appears at its place only when the block ends without an
    error.

    Args:
        target: Where the file belongs.
        force: Whether it may replace another.

    Yields:
        A path beside the target at which nothing is.

    Raises:
        InputError: See :func:`check_file_target`; also where others put something there meanwhile.
    """
    check_file_target(target, force=force)
    place = target.resolve()
    with _beside(place.parent) as beside:
        fresh = beside / place.name
        try:
            yield fresh
        except OSError as error:
            _rename_in(error, fresh, target)
            raise
        check_file_target(target, force=force)
        fresh.replace(place)


@contextmanager
def _beside(folder: Path) -> Iterator[Path]:
    """A hidden place in a folder, gone in the end; what had to be made of the folder goes too where
    the block fails.
    """
    made = [each for each in (folder, *folder.parents) if not each.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    # Inside a folder that exists: what lies beside it may be another device, or somebody else's.
    hidden = Path(tempfile.mkdtemp(prefix=_HIDDEN, dir=folder))
    done = False
    try:
        yield hidden
        done = True
    finally:
        shutil.rmtree(hidden, ignore_errors=True)
        if not done:
            # Others may have begun to use them.
            with suppress(OSError):
                for each in made:
                    each.rmdir()


def _rename_in(error: OSError, fresh: Path, target: Path) -> None:
    """Name the place that was asked for instead of the hidden one that stands in for it."""
    name = error.filename
    if isinstance(name, str) and Path(name).is_relative_to(fresh):
        error.filename = str(target / Path(name).relative_to(fresh))


def _publish(fresh: Path, place: Path, old: Path) -> None:
    """Move results into place, all or none."""
    if not place.exists():
        fresh.rename(place)
        return
    # Entry by entry: what else is there stays, and so does the folder itself, in which somebody may
    # stand.
    old.mkdir()
    moved: list[str] = []
    try:
        for entry in sorted(fresh.iterdir()):
            there = place / entry.name
            moved.append(entry.name)
            if there.exists() or there.is_symlink():
                there.rename(old / entry.name)
            entry.rename(there)
    except BaseException:
        for name in reversed(moved):
            there, before = place / name, old / name
            if (there.exists() or there.is_symlink()) and not (fresh / name).exists():
                there.rename(fresh / name)
            if before.exists() or before.is_symlink():
                before.rename(there)
        raise


def write_json(values: Mapping[str, Any], path: Path) -> None:
    """Write plain values as JSON."""
    path.write_text(to_json(values) + "\n", encoding="utf-8")


def to_json(values: Mapping[str, Any], *, ascii_only: bool = False) -> str:
    """Plain values as JSON text; NaN is a mistake here, the contract has null.

    Args:
        values: What to write.
        ascii_only: Whether to escape all other characters, for terminals of any encoding.
    """
    return json.dumps(values, indent=1, allow_nan=False, ensure_ascii=ascii_only)


def write_table(runs: Sequence[tuple[str, Mapping[str, Array]]], path: Path) -> None:
    """Write Parquet: one row per instant, the run in the first column.

    Args:
        runs: Run and its columns, the same for all.
        path: Of the file.
    """
    import polars as pl

    frames = [
        pl.DataFrame(columns).select(pl.lit(run).alias("run"), pl.all()) for run, columns in runs
    ]
    # Into memory first: names of files are bytes, which the library would have as text.
    buffer = io.BytesIO()
    pl.concat(frames).write_parquet(buffer)
    path.write_bytes(buffer.getvalue())
