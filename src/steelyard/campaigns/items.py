"""Which experiments a campaign is of: from files, folders, globs and URLs to names and paths."""

from __future__ import annotations

import glob
import posixpath
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from steelyard.campaigns.inputs import file_system, in_one_line, is_url
from steelyard.errors import InputError

EXPERIMENT = "experiment.yaml"
"""Name of the files that are looked for in folders."""
_FORMAT = b"steelyard/1"
_BEGINNING = 4096
"""Bytes of a file that state its format."""


@dataclass(frozen=True)
class Item:
    """One experiment of a campaign."""

    name: str
    """Unlike the others'; parts of a path, without ``..``."""
    path: str
    """Absolute path of the experiment file, or its URL."""


def find_items(places: Sequence[str | Path]) -> tuple[Item, ...]:
    """All experiments that are meant, in the order of their names; each once.

    A file has the name of its folder (or its own, where it is not called ``experiment.yaml``); one
    found in a folder or by a glob has the path below that folder, or below the last folder of the
    glob without a wildcard.

    Args:
        places: Experiment files, folders that are searched for files ``experiment.yaml``, globs,
            and URLs of them.

    Raises:
        InputError: There is nothing, or two experiments would have the same name.
    """
    found: dict[str, Item] = {}
    for place in map(str, places):
        for item in _url_items(place) if is_url(place) else _local_items(place):
            other = found.setdefault(item.name, item)
            if other.path != item.path:
                raise InputError(
                    f"{item.path}: expected experiments of different names, found '{item.name}' for"
                    f" {other.path} too; name a folder above both instead"
                )
    if not found:
        raise InputError(
            "EXPERIMENT: expected experiments, found none; name files, folders or globs"
        )
    return tuple(found[name] for name in sorted(found))


def _local_items(place: str) -> Iterator[Item]:
    """Experiments of a path or a glob."""
    path = Path(place)
    if path.is_file():
        yield Item(_name(path, path.absolute().parent.parent), _absolute(path))
    elif path.is_dir():
        yield from _in_folder(path, place, _top(path))
    elif glob.has_magic(place):
        matches = sorted(glob.glob(place, recursive=True))
        fixed = path
        while glob.has_magic(str(fixed)):
            fixed = fixed.parent
        count = 0
        for match in map(Path, matches):
            inner = [Item(_name(match, fixed), _absolute(match))] if _is_experiment(match) else []
            for item in _below(match, fixed) if match.is_dir() else inner:
                count += 1
                yield item
        if not count:
            raise InputError(f"{place}: expected experiments, found none; check the glob")
    else:
        raise InputError(
            f"{place}: expected an experiment file, a folder or a glob, found nothing there; check"
            " the path"
        )


def _in_folder(folder: Path, place: str, top: Path) -> Iterator[Item]:
    """All experiments below a folder.

    Raises:
        InputError: There is none.
    """
    items = list(_below(folder, top))
    if not items:
        raise InputError(
            f"{place}: expected files {EXPERIMENT} in this folder or below it, found none; name"
            " another folder, or the files themselves"
        )
    yield from items


def _top(folder: Path) -> Path:
    """Where names of experiments in a folder begin: one that is an experiment itself has its
    name.
    """
    return folder.absolute().parent if (folder / EXPERIMENT).is_file() else folder


def _below(folder: Path, top: Path) -> Iterator[Item]:
    """Experiments in a folder and below it, hidden ones left out."""
    try:
        paths = sorted(folder.rglob(EXPERIMENT))
    except OSError as error:
        raise InputError(
            f"{folder}: expected a folder that can be read, found one that cannot"
            f" ({error.strerror}); check its rights"
        ) from error
    for path in paths:
        inner = path.relative_to(folder).parts
        if path.is_file() and not any(part.startswith(".") for part in inner):
            yield Item(_name(path, top), _absolute(path))


def _is_experiment(path: Path) -> bool:
    """Whether a file that a glob has found is meant: others may lie beside, such as robot files."""
    if path.suffix not in (".yaml", ".yml") or not path.is_file():
        return False
    if path.name == EXPERIMENT:
        return True
    try:
        with path.open("rb") as file:
            return _FORMAT in file.read(_BEGINNING)
    except OSError:
        return True


def _absolute(path: Path) -> str:
    return str(path.resolve())


def _name(path: Path, top: Path) -> str:
    """Path below a folder; without the name of the file where that is the usual one."""
    relative = path.absolute().relative_to(top.absolute())
    relative = relative.parent if path.name == EXPERIMENT else relative.with_suffix("")
    name = relative.as_posix()
    # An experiment that lies in the folder itself.
    return path.absolute().parent.name if name == "." else name


def _url_items(url: str) -> Iterator[Item]:
    """Experiments of a URL: a file, a folder or a glob.

    Raises:
        InputError: It cannot be read, or there is nothing.
    """
    system, path = file_system(url)
    scheme = url.partition("://")[0]
    path = path.rstrip("/")
    try:
        if glob.has_magic(path):
            paths = [each for each in system.glob(path) if each.endswith((".yaml", ".yml"))]
            top = path
            while glob.has_magic(top):
                top = posixpath.dirname(top)
        elif system.isfile(path):
            paths, top = [path], posixpath.dirname(posixpath.dirname(path))
        else:
            paths = [each for each in system.find(path) if posixpath.basename(each) == EXPERIMENT]
            alone = posixpath.join(path, EXPERIMENT) in paths
            top = posixpath.dirname(path) if alone else path
    except Exception as error:
        raise InputError(
            f"{url}: expected files that can be listed, found none that can"
            f" ({in_one_line(error)}); check the address and the rights"
        ) from error
    if not paths:
        raise InputError(f"{url}: expected experiments, found none; check the URL")
    for each in sorted(paths):
        yield Item(
            _name(Path(f"/{each.lstrip('/')}"), Path(f"/{top.lstrip('/')}")), f"{scheme}://{each}"
        )
