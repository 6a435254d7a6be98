"""Hidden folders in which results are prepared, and what remains of those whose process is gone.

Each holds ``lock``, which its process keeps locked as long as it lives, ``new`` with the results
and, once these begin to take their place, ``plan.json``: enough for the next process to finish.
"""

from __future__ import annotations

import fcntl
import os
import shutil
import stat
import tempfile
from contextlib import suppress
from pathlib import Path

from steelyard.output.placing import finish, read_plan

HIDDEN = ".steelyard-"
"""How the names begin; what a killed process left does not count as files of the user."""
NEW, LOCK, PLAN = "new", "lock", "plan.json"
_ATTEMPTS = 20
"""To make a folder that no other process takes for a left one before it is locked."""


class Workshop:
    """A hidden folder that is ours while this process lives."""

    def __init__(self, parent: Path) -> None:
        """Make one in a folder.

        Raises:
            OSError: It cannot be made.
        """
        for attempt in range(_ATTEMPTS):
            self.path = Path(tempfile.mkdtemp(prefix=HIDDEN, dir=parent))
            try:
                self._lock = _locked(self.path, make=True)
            except FileNotFoundError:
                if attempt == _ATTEMPTS - 1:
                    raise
                continue
            except BaseException:
                shutil.rmtree(self.path, ignore_errors=True)
                raise
            break

    def move(self, parent: Path) -> None:
        """Put it into another folder.

        Raises:
            OSError: It cannot be moved there, and is where it was.
        """
        there = parent / self.path.name
        os.rename(self.path, there)
        self.path = there

    def close(self) -> None:
        """Finish what has begun to take its place, and remove the folder."""
        try:
            _remove(self.path)
        finally:
            os.close(self._lock)


def settle(place: Path) -> None:
    """Finish and remove what killed processes left in a folder of results or beside it.

    Touched are only hidden folders that belong to this user and that steelyard locked, and whose
    process is gone. What cannot be removed stays.

    Args:
        place: Folder of results; need not exist.
    """
    place = place.resolve()
    for parent in (place, place.parent):
        with suppress(OSError):
            for name in os.listdir(parent):
                if name.startswith(HIDDEN):
                    with suppress(OSError):
                        _settle(parent / name)


def _settle(folder: Path) -> None:
    """Finish and remove one hidden folder, if it is surely ours and nobody works in it."""
    found = folder.lstat()
    if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.geteuid():
        return
    if not (folder / LOCK).exists():
        # Of a process that was killed before it locked the folder, or while it removed it; one that
        # is about to lock it makes another. With anything in it, it is not ours.
        folder.rmdir()
        return
    lock = _locked(folder, make=False)
    try:
        _remove(folder)
    finally:
        os.close(lock)


def _locked(folder: Path, *, make: bool) -> int:
    """The open lock of a folder.

    Raises:
        OSError: Somebody else has it, or the file system has no locks.
        FileNotFoundError: Somebody took the folder for a left one meanwhile.
    """
    path = folder / LOCK
    flags = os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW
    file = os.open(path, flags | (os.O_CREAT | os.O_EXCL if make else 0), 0o600)
    try:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            if make:
                raise FileNotFoundError(str(path)) from None
            raise
        except OSError:
            # Without locks nobody can tell whether we live, so nobody removes this.
            if not make:
                raise
        # Between opening and locking another process may have removed it.
        if not os.path.samestat(os.fstat(file), path.stat()):
            raise FileNotFoundError(str(path))
    except BaseException:
        os.close(file)
        raise
    return file


def _remove(folder: Path) -> None:
    """Finish, then remove in an order in which every beginning of it can be finished later."""
    plan = read_plan(folder / PLAN)
    if plan is not None:
        finish(plan, folder)
    for name in os.listdir(folder):
        path = folder / name
        if name in (LOCK, PLAN):
            continue
        if path.is_dir() and not path.is_symlink():
            _remove_tree(path)
        else:
            path.unlink()
    (folder / PLAN).unlink(missing_ok=True)
    (folder / LOCK).unlink(missing_ok=True)
    folder.rmdir()


def _remove_tree(path: Path) -> None:
    """Remove a folder, one that may not be written to as well."""
    for inner, _, _ in os.walk(path):
        with suppress(OSError):
            os.chmod(inner, stat.S_IRWXU)
    shutil.rmtree(path)
