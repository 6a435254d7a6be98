"""How results take the place of others: all at once where the system can exchange two folders,
else name by name with a plan that the next process finishes.
"""

from __future__ import annotations

import errno
import json
import os
import shutil
import stat
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path

from steelyard.output.disk import exchange, synchronise, write_file

_LARGEST_PLAN = 1_000_000
"""[bytes]"""
_MOST_CARRIED = 1000
"""Files and folders of the user that are carried from the old folder to the new one; where there
are more, results are moved to their places one by one."""
_OLD = "old"


@dataclass(frozen=True)
class PlacingPlan:
    """What the results in a hidden folder are about to replace."""

    place: str
    """Name of the folder of results beside the hidden one; empty: that lies in it."""
    names: tuple[str, ...]
    """Of the results."""
    inode: int
    """Of the folder of new results, where it is to be exchanged; 0: they are moved one by one."""


def read_plan(path: Path) -> PlacingPlan | None:
    """A plan, as a process wrote it before it was killed; None where there is none.

    Raises:
        OSError: What is there is no plan of this form; it is left alone.
    """
    if not path.exists():
        return None
    text = path.read_bytes()[:_LARGEST_PLAN]
    try:
        values = json.loads(text)
        plan = PlacingPlan(values["place"], tuple(values["names"]), values["inode"])
        names = [*plan.names, *([plan.place] if plan.place else [])]
        if not isinstance(plan.inode, int) or not all(map(_is_name, names)):
            raise ValueError
    except (ValueError, KeyError, TypeError, RecursionError):
        raise OSError(errno.EINVAL, "expected a plan of steelyard", str(path)) from None
    return plan


def _is_name(name: object) -> bool:
    """Whether it is the name of something in a folder, and leads nowhere else."""
    return isinstance(name, str) and name not in ("", ".", "..") and not set(name) & {"/", "\0"}


def put_in_place(fresh: Path, place: Path, plan: Path) -> None:
    """Put results where others are; they are on the disk already.

    Args:
        fresh: Folder with the results, in a hidden folder beside the place or in it.
        place: A folder that is there.
        plan: Where the plan belongs, beside ``fresh``.

    Raises:
        OSError: It was not possible; the old results are as they were.
    """
    names = tuple(sorted(os.listdir(fresh)))
    folder = fresh.parent
    if len(names) == 1 and _one_step(fresh / names[0], place / names[0]):
        os.replace(fresh / names[0], place / names[0])
    elif folder.parent == place or not _exchanged(fresh, place, names, plan):
        _write_plan(PlacingPlan(_relative(place, folder), names, 0), plan)
        try:
            _move(fresh, place, names)
        except BaseException:
            _move_back(fresh, place, names)
            plan.unlink()
            raise
    synchronise(place)
    synchronise(place.parent)


def finish(plan: PlacingPlan, folder: Path) -> None:
    """Finish what a plan says, from whatever point: results in a hidden folder are in their place
    afterwards, and so is everything that was not theirs to replace.
    """
    fresh = folder / "new"
    place = folder.parent / plan.place if plan.place else folder.parent
    if not fresh.is_dir():
        return
    if not plan.inode:
        if place.is_dir():
            _move(fresh, place, plan.names)
            synchronise(place)
    elif fresh.stat().st_ino != plan.inode and place.is_dir():
        _bring_back(fresh, place, frozenset(plan.names))


def _relative(place: Path, folder: Path) -> str:
    return "" if folder.parent == place else place.name


def _write_plan(plan: PlacingPlan, path: Path) -> None:
    """Write a plan that is there as a whole or not at all."""
    trial = path.with_suffix(".trial")
    write_file(trial, json.dumps(asdict(plan)))
    synchronise(trial)
    os.replace(trial, path)
    synchronise(path.parent)


def _one_step(fresh: Path, there: Path) -> bool:
    """Whether a rename alone puts one result in the place of another."""
    return not fresh.is_dir() and (there.is_symlink() or not there.is_dir())


# By exchange


def _exchanged(fresh: Path, place: Path, names: tuple[str, ...], plan: Path) -> bool:
    """Exchange the folder of new results, with what else lies in the old one, for the old one;
    False where that is not possible.
    """
    try:
        _carry(place, fresh, frozenset(names), [_MOST_CARRIED])
        _like(place, fresh)
        synchronise(fresh)
        _write_plan(PlacingPlan(place.name, names, fresh.stat().st_ino), plan)
        exchange(fresh, place)
    except OSError:
        # What was carried is in its place still: only second names of it are removed here.
        for name in set(os.listdir(fresh)) - set(names):
            path = fresh / name
            if path.is_dir() and not path.is_symlink():
                shutil.rmtree(path)
            else:
                path.unlink()
        return False
    return True


def _carry(old: Path, fresh: Path, without: frozenset[str], budget: list[int]) -> None:
    """Give everything in a folder but some names a second name in another one; folders are made
    anew.

    Raises:
        OSError: Something cannot be carried, or there is too much of it.
    """
    for name in os.listdir(old):
        path, there = old / name, fresh / name
        if name in without:
            continue
        budget[0] -= 1
        if budget[0] < 0 or path.is_mount():
            raise OSError(errno.EXDEV, os.strerror(errno.EXDEV), str(path))
        if path.is_dir() and not path.is_symlink():
            os.mkdir(there)
            _carry(path, there, frozenset(), budget)
            _like(path, there)
            synchronise(there)
        else:
            os.link(path, there, follow_symlinks=False)


def _like(old: Path, fresh: Path) -> None:
    """Give a folder the rights and the owner of another."""
    before, after = old.stat(), fresh.stat()
    if (before.st_uid, before.st_gid) != (after.st_uid, after.st_gid):
        os.chown(fresh, before.st_uid, before.st_gid)
    shutil.copystat(old, fresh)


def _bring_back(old: Path, place: Path, without: frozenset[str]) -> None:
    """Bring what others put into the old folder after its names were carried into the new one."""
    for name in os.listdir(old):
        path, there = old / name, place / name
        if name in without:
            continue
        if not os.path.lexists(there):
            os.rename(path, there)
        elif path.is_dir() and not path.is_symlink():
            if there.is_dir() and not there.is_symlink():
                _bring_back(path, there, frozenset())
        else:
            theirs, ours = path.lstat(), there.lstat()
            newer = theirs.st_mtime_ns > ours.st_mtime_ns and not stat.S_ISDIR(ours.st_mode)
            if newer and not os.path.samestat(theirs, ours):
                os.replace(path, there)


# Name by name


def _move(fresh: Path, place: Path, names: tuple[str, ...]) -> None:
    """Move results to their places, from whatever point; what was there goes aside."""
    old = fresh.parent / _OLD
    with suppress(FileExistsError):
        os.mkdir(old)
    for name in names:
        new, there, aside = fresh / name, place / name, old / name
        if not os.path.lexists(new):
            continue
        if os.path.lexists(there) and not os.path.lexists(aside):
            os.rename(there, aside)
        os.rename(new, there)


def _move_back(fresh: Path, place: Path, names: tuple[str, ...]) -> None:
    """Undo it."""
    old = fresh.parent / _OLD
    for name in reversed(names):
        new, there, aside = fresh / name, place / name, old / name
        if not os.path.lexists(new):
            os.rename(there, new)
        if os.path.lexists(aside):
            os.rename(aside, there)
