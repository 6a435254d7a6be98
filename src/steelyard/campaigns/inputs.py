"""The files of an experiment: their hash, and a copy of those that lie behind a URL."""

from __future__ import annotations

import fcntl
import hashlib
import posixpath
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from errno import ENOSPC
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from steelyard.errors import InputError
from steelyard.experiment.form import RUN_KEYS
from steelyard.files.yaml_file import read_yaml
from steelyard.robot.file import bundled_names

_SCHEME = "://"
_COPIES = "steelyard-copy-"
"""Beginning of the names of folders for copies."""
_HELD = ".steelyard-held"
"""Locked as long as the copy is in use."""
_YOUNG = 60.0
"""A folder that is younger may not be locked yet [s]."""


def is_url(path: str) -> bool:
    """Whether a path is one that fsspec reads, such as ``s3://bucket/experiment.yaml``."""
    return _SCHEME in path


def file_system(url: str) -> tuple[Any, str]:
    """File system of a URL and the path within it.

    Raises:
        InputError: fsspec or what it needs for this scheme is not installed, there is no such
            scheme, or the URL has a password, which would stand in every table.
    """
    if "@" in urlsplit(url).netloc:
        shown = url.partition(_SCHEME)[0]
        raise InputError(
            f"{shown}://…@…: expected a URL without user and password, which would be written into"
            " the results, found one with them; leave them to the environment or to the"
            " configuration of fsspec"
        )
    if find_spec("fsspec") is None:
        raise InputError(
            f"{url}: reading URLs needs the package fsspec; install it with: pip install"
            ' "steelyard[cloud]"'
        )
    from fsspec.core import url_to_fs

    try:
        system, path = url_to_fs(url)
    except (ImportError, ValueError) as error:
        raise InputError(
            f"{url}: expected a URL that fsspec reads (file://, s3://, https://, …), found none"
            f" ({in_one_line(error)}); correct it, or install what it needs"
        ) from error
    # What was listed earlier in this process may have changed since.
    system.invalidate_cache()
    return system, path


def in_one_line(error: Exception) -> str:
    """What a library says."""
    return f"{type(error).__name__}: {' '.join(str(error).split())}".rstrip(": ")


def input_names(path: Path, fetch: Callable[[str], None] | None = None) -> list[str]:
    """All files that an experiment is read from, relative to its folder, the experiment first; only
    the experiment where that cannot be understood.

    Args:
        path: Of the experiment file.
        fetch: Called with each name before it is looked at.
    """
    fetch = fetch or (lambda name: None)
    fetch(path.name)
    names = [path.name]
    data = _data(path)
    robot = data.get("robot")
    if isinstance(robot, str) and robot not in bundled_names():
        fetch(robot)
        names.append(robot)
        covariance = _data(path.parent / robot).get("covariance")
        if isinstance(covariance, str):
            names.append(posixpath.join(posixpath.dirname(robot), covariance))
            fetch(names[-1])
    runs = data.get("runs")
    streams = [
        entry
        for run in (runs if isinstance(runs, list) else [])
        if isinstance(run, dict)
        for key, entry in run.items()
        if key not in RUN_KEYS
    ]
    for entry in streams:
        name = entry.get("file") if isinstance(entry, dict) else entry
        if isinstance(name, str) and name not in names:
            fetch(name)
            names.append(name)
    return names


def _data(path: Path) -> dict[str, Any]:
    """What a file of YAML has; nothing where it cannot be read: the reader will say why."""
    with suppress(InputError, OSError):
        data = read_yaml(path).data
        if isinstance(data, dict):
            return data
    return {}


def inputs_hash(path: Path) -> str:
    """SHA-256 over names and bytes of all that an experiment is read from; a file that is missing
    counts as such.

    Args:
        path: Of the experiment file.
    """
    total = hashlib.sha256()
    for name in input_names(path):
        total.update(f"{name}\0{_digest(path.parent / name)}\n".encode())
    return total.hexdigest()


def _digest(path: Path) -> str:
    """Of a file, or of all files of a folder (some logs are folders)."""
    try:
        if path.is_dir():
            inner = sorted(each for each in path.rglob("*") if each.is_file())
            return "".join(f"{each.relative_to(path)}\0{_digest(each)}\n" for each in inner)
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except (OSError, ValueError):
        return "missing"


@contextmanager
def local_experiment(path: str) -> Iterator[Path]:
    """The experiment file on this machine; what lies behind a URL is copied for the time of the
    block, with all files that it names.

    Raises:
        InputError: It cannot be fetched.
    """
    if not is_url(path):
        yield Path(path)
        return
    system, remote = file_system(path)
    remote = posixpath.normpath(f"/{remote}")
    with _copy_folder() as top:

        def fetch(name: str) -> None:
            # As seen from the root: names cannot leave the copy.
            place = posixpath.normpath(posixpath.join(posixpath.dirname(remote), name))
            local = top / place.lstrip("/")
            if local.exists():
                return
            local.parent.mkdir(parents=True, exist_ok=True)
            there = place if system.root_marker else place.lstrip("/")
            try:
                size = int(system.du(there))
                if size > shutil.disk_usage(top).free:
                    raise OSError(ENOSPC, f"{size / 1e6:.0f} MB do not fit on the disk", str(top))
                system.get(there, str(local), recursive=True)
            except FileNotFoundError:
                # The reader says which entry of the experiment names it.
                return
            except OSError as error:
                if error.errno == ENOSPC:
                    # The machine's fault: another time there may be room.
                    raise
                raise _unfetched(path, name, error) from error
            except Exception as error:
                raise _unfetched(path, name, error) from error

        local = top / remote.lstrip("/")
        input_names(local, fetch)
        if not local.is_file():
            raise InputError(f"{path}: expected a file, found nothing there; check the URL")
        yield local


def _unfetched(path: str, name: str, error: Exception) -> InputError:
    return InputError(
        f"{path}: expected a file that can be fetched, found '{name}' that cannot"
        f" ({in_one_line(error)}); check the address and the rights"
    )


@contextmanager
def _copy_folder() -> Iterator[Path]:
    """A folder for copies that goes with the block; what killed processes have left of theirs goes
    first, so that a machine never holds more than one experiment for each of its workers.
    """
    for old in Path(tempfile.gettempdir()).glob(f"{_COPIES}*"):
        with suppress(OSError):
            if time.time() - old.stat().st_mtime < _YOUNG:
                continue
            with (old / _HELD).open("rb") as held:
                # The lock goes with its process, however that ends.
                fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
                shutil.rmtree(old, ignore_errors=True)
    with tempfile.TemporaryDirectory(prefix=_COPIES) as temporary:
        top = Path(temporary)
        (top / _HELD).touch()
        with (top / _HELD).open("rb") as held:
            fcntl.flock(held, fcntl.LOCK_EX)
            yield top
