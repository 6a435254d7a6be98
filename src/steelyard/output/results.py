"""Places for results that are filled when a block ends without an error."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from steelyard.output.disk import can_exchange, synchronise, synchronise_tree
from steelyard.output.hidden import HIDDEN, NEW, PLAN, Workshop, settle
from steelyard.output.placing import put_in_place
from steelyard.output.targets import check_file_target, check_target


@contextmanager
def results_folder(target: Path, *, force: bool, shared: bool = False) -> Iterator[Path]:
    """A folder to write results into, which appear at their place only when the block ends without
    an error, and are on the disk then.

    With ``force``, files and folders of the same names are replaced, all of them in one step where
    the system can do that; whatever else lies there stays.

    Args:
        target: Where the results belong.
        force: Whether they may replace others.
        shared: Whether the folder is not for these results alone: it stays the same folder, and
            results are moved to their places one by one, which the next process finishes where this
            one is killed meanwhile.

    Yields:
        An empty folder beside the target.

    Raises:
        InputError: See :func:`check_target`; also where others put something there meanwhile.
        OSError: It could not be written; what was there is as it was.
    """
    settle(target)
    check_target(target, force=force)
    place = target.resolve() if target.exists() else target.absolute()
    within = place if place.is_dir() else place.parent
    with _named(target, folder=True), _workshop(within) as (workshop, made):
        (workshop.path / NEW).mkdir()
        if not shared and place.is_dir() and _may_be_exchanged(place, workshop):
            # Where the parent belongs to others, or to another device, it stays within.
            with suppress(OSError):
                workshop.move(place.parent)
        fresh = workshop.path / NEW
        yield fresh
        check_target(target, force=force)
        synchronise_tree(fresh)
        if place.exists():
            put_in_place(fresh, place, workshop.path / PLAN)
        else:
            os.rename(fresh, place)
            synchronise(place.parent)
        _synchronise_made(made)


@contextmanager
def results_file(target: Path, *, force: bool) -> Iterator[Path]:
    """A path to write one file to, which appears at its place only when the block ends without an
    error, and is on the disk then.

    Args:
        target: Where the file belongs.
        force: Whether it may replace another.

    Yields:
        A path beside the target at which nothing is.

    Raises:
        InputError: See :func:`check_file_target`; also where others put something there meanwhile.
        OSError: It could not be written; what was there is as it was.
    """
    settle(target)
    check_file_target(target, force=force)
    place = target.resolve()
    with _named(target, folder=False), _workshop(place.parent) as (workshop, made):
        folder = workshop.path / NEW
        folder.mkdir()
        fresh = folder / place.name
        yield fresh
        check_file_target(target, force=force)
        synchronise(fresh)
        os.replace(fresh, place)
        synchronise(place.parent)
        _synchronise_made(made)


@contextmanager
def _workshop(folder: Path) -> Iterator[tuple[Workshop, list[Path]]]:
    """A hidden folder in a folder, gone in the end, and what had to be made of the folder; that
    goes too where the block fails.
    """
    made = [each for each in (folder, *folder.parents) if not each.exists()]
    if made:
        folder.mkdir(parents=True, exist_ok=True)
    done = False
    try:
        # Inside a folder that exists: what lies beside it may be another device, or somebody
        # else's.
        workshop = Workshop(folder)
        try:
            yield workshop, made
            done = True
        finally:
            # What cannot be removed is removed by the next one.
            with suppress(OSError):
                workshop.close()
    finally:
        if not done:
            # Others may have begun to use them.
            with suppress(OSError):
                for each in made:
                    each.rmdir()


def _may_be_exchanged(place: Path, workshop: Workshop) -> bool:
    """Whether another folder may take the name of this one: nobody whom we know stands in it, and
    no other process prepares results within.
    """
    if not can_exchange():
        return False
    try:
        here = Path.cwd()
    except OSError:
        return False
    others = {name for name in os.listdir(place) if name.startswith(HIDDEN)}
    return place not in (here, *here.parents) and others <= {workshop.path.name}


def _synchronise_made(made: list[Path]) -> None:
    """Force the names of folders that had to be made to the disk."""
    for each in made:
        synchronise(each.parent)


@contextmanager
def _named(target: Path, *, folder: bool) -> Iterator[None]:
    """Name the place that was asked for in errors instead of the hidden one that stands in for
    it.
    """
    try:
        yield
    except OSError as error:
        name = error.filename
        if isinstance(name, bytes):
            name = os.fsdecode(name)
        if name is None and error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO):
            error.filename = str(target)
        if isinstance(name, str):
            parts = Path(name).parts
            within = [i for i, part in enumerate(parts) if part.startswith(HIDDEN)]
            if within:
                inner = parts[within[0] + 2 :] if folder else ()
                error.filename = str(target.joinpath(*inner))
        raise
