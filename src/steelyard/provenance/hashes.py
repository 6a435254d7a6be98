"""Hashes of the files that a result rests on."""

from __future__ import annotations

import hashlib
import os
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from steelyard.errors import InputError
from steelyard.experiment.model import Experiment
from steelyard.files.yaml_file import read_yaml

LIBRARIES = ("numpy", "scipy", "casadi", "clarabel", "polars")
"""Those that the numbers depend on."""
_YAML = (".yaml", ".yml")
_UNKNOWN = "not installed as a package"


@dataclass(frozen=True)
class FileHash:
    """A file as it was."""

    file: str
    """Its path from the folder that is spoken of, with slashes."""
    sha256: str
    size: int
    """[bytes]"""

    def to_dict(self) -> dict[str, str | int]:
        """Plain values."""
        return {"file": self.file, "sha256": self.sha256, "bytes": self.size}


def hash_of(path: Path, folder: Path) -> FileHash:
    """The hash of a file, under its path from a folder.

    Raises:
        OSError: It cannot be read.
    """
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    return FileHash(path_from(path, folder), digest, path.stat().st_size)


def path_from(path: Path, folder: Path) -> str:
    """Path of a file from a folder, the same on every machine where both lie alike."""
    return Path(os.path.relpath(path.resolve(), folder.resolve())).as_posix()


def versions() -> dict[str, str]:
    """Program or library -> its version: all that the numbers depend on."""
    python = f"{sys.version_info.major}.{sys.version_info.minor}"
    own = {"steelyard": version_of("steelyard"), "Python": python}
    return {**own, **{name: version_of(name) for name in LIBRARIES}}


def version_of(name: str) -> str:
    """Of a package."""
    try:
        return version(name)
    except PackageNotFoundError:
        return _UNKNOWN


def inputs_of(experiment: Experiment) -> list[Path]:
    """Every file that an experiment was read from, once: the experiment file, the robot file with
    its covariance, the recordings; none of one that was made in memory.
    """
    if not experiment.source:
        return []
    streams = (s.source for run in experiment.runs for s in run.streams.values())
    source = Path(experiment.source)
    robots = (
        path for path in mentioned_files(source) if path.suffix in _YAML or path.suffix == ".csv"
    )
    listed = [source, *robots, *map(Path, streams)]
    return list(files_of(listed))


def files_of(paths: Iterable[Path]) -> Iterator[Path]:
    """Each file once; of a folder all files in it."""
    seen = set()
    for path in paths:
        found = sorted(path.rglob("*")) if path.is_dir() else [path]
        for each in found:
            if each.is_file() and each not in seen:
                seen.add(each)
                yield each


def mentioned_files(path: Path) -> Iterator[Path]:
    """Files that a YAML file names beside itself, and those that they name: robot files, their
    covariances, recordings.
    """
    try:
        values = read_yaml(path).data if path.suffix in _YAML else None
    except InputError:
        # It was read before: whatever it is now, its hash says so.
        return
    for text in _texts(values):
        try:
            other = path.parent / text
            there = other.exists() and other.resolve() not in (
                path.resolve(),
                path.parent.resolve(),
            )
        except (OSError, ValueError):
            continue
        if there and (text.endswith((".csv", *_YAML)) or "/" in text or "." in text):
            yield other
            if other.is_file() and other.suffix in _YAML:
                yield from mentioned_files(other)


def _texts(values: object) -> Iterator[str]:
    """All texts in plain values."""
    if isinstance(values, str):
        yield values
    elif isinstance(values, dict):
        for each in values.values():
            yield from _texts(each)
    elif isinstance(values, list):
        for each in values:
            yield from _texts(each)
