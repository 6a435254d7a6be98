"""``provenance.json``: what a folder of results was made of, by what, and what it holds."""

from __future__ import annotations

import hashlib
import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from steelyard.errors import InputError
from steelyard.files.json_file import read_json
from steelyard.output import to_json, write_json
from steelyard.provenance.hashes import FileHash, files_of, hash_of, path_from, versions

FORMAT = "steelyard-provenance/1"
FILE_NAME = "provenance.json"
_DROPPED = ("--out", "--force", "--quiet", "--json")
"""Options that change nothing of the numbers; the first has a value."""


@dataclass(frozen=True)
class Provenance:
    """What stands in the file."""

    versions: Mapping[str, str]
    """Program or library -> its version."""
    command: tuple[str, ...]
    """Words after ``steelyard``, paths from the folder of results; empty: made in Python."""
    time: str
    """When it was made: UTC, ISO 8601."""
    inputs: tuple[FileHash, ...]
    """Paths from the folder of results."""
    results: tuple[FileHash, ...]

    def to_dict(self) -> dict[str, Any]:
        """Plain values in the shape of the file; the last is a hash of all others."""
        values = {
            "format": FORMAT,
            "versions": dict(self.versions),
            "command": list(self.command),
            "time": self.time,
            "inputs": [each.to_dict() for each in self.inputs],
            "results": [each.to_dict() for each in self.results],
        }
        return {**values, "sha256": hashlib.sha256(to_json(values).encode()).hexdigest()}


def origin(inputs: Sequence[Path], folder: Path) -> dict[str, Any]:
    """What files of results themselves carry: versions and inputs, the same for the same input.

    Args:
        inputs: Files that were read.
        folder: What their paths begin at.
    """
    return {
        "versions": versions(),
        "inputs": [hash_of(path, folder).to_dict() for path in files_of(inputs)],
    }


def write_provenance(
    fresh: Path, target: Path, inputs: Sequence[Path], command: Sequence[str] = ()
) -> None:
    """Write the file beside results that are complete.

    The time is that of the environment's ``SOURCE_DATE_EPOCH`` where it is set.

    Args:
        fresh: Folder of the results.
        target: Where they will lie: paths begin there.
        inputs: Files that were read.
        command: Words after ``steelyard``, as they were typed.
    """
    record = Provenance(
        versions(),
        tuple(_portable(command, target)),
        _now(),
        tuple(hash_of(path, target) for path in files_of(inputs)),
        tuple(hash_of(path, fresh) for path in files_of([fresh])),
    )
    write_json(record.to_dict(), fresh / FILE_NAME)


def renew_provenance(fresh: Path, folder: Path) -> None:
    """Write the file anew where some of the results of a folder are about to be replaced.

    Args:
        fresh: Folder of the new ones.
        folder: The folder of results; without provenance it gets none.
    """
    if not (folder / FILE_NAME).is_file():
        return
    before = read_provenance(folder)
    drawn = {each.file: each for each in (hash_of(p, fresh) for p in files_of([fresh]))}
    kept = {each.file: each for each in before.results}
    renewed = replace(before, results=tuple({**kept, **drawn}.values()))
    write_json(renewed.to_dict(), fresh / FILE_NAME)


def read_provenance(folder: Path) -> Provenance:
    """Read the file of a folder.

    Raises:
        InputError: It is not there, or not of this form.
    """
    path = folder / FILE_NAME
    if not path.is_file():
        raise InputError(
            f"{folder}: expected a folder of results with {FILE_NAME}, found none in it; name one"
            " that identify, calibrate or design wrote with --out"
        )
    values = read_json(path)
    try:
        if values["format"] != FORMAT:
            raise ValueError
        command = tuple(values["command"])
        named = {str(k): str(v) for k, v in values["versions"].items()}
        inputs, results = (tuple(map(_hash, values[key])) for key in ("inputs", "results"))
        if not all(isinstance(word, str) for word in command):
            raise ValueError
        return Provenance(named, command, str(values["time"]), inputs, results)
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError):
        raise InputError(
            f"{path}: expected what steelyard wrote ('{FORMAT}'), found something else; make the"
            " results again"
        ) from None


def _hash(values: Mapping[str, Any]) -> FileHash:
    file, digest = values["file"], values["sha256"]
    if not isinstance(file, str) or not isinstance(digest, str) or "\0" in file:
        raise ValueError
    return FileHash(file, digest, int(values["bytes"]))


def _portable(command: Sequence[str], target: Path) -> list[str]:
    """The words without where results go, and with paths from there."""
    words = list(command[:1])
    place = False
    for word in command[1:]:
        name = word.split("=")[0]
        if place or name in _DROPPED:
            place = not place and word == _DROPPED[0]
            continue
        try:
            is_path = not word.startswith("-") and Path(word).exists()
        except (OSError, ValueError):
            is_path = False
        words.append(path_from(Path(word), target) if is_path else word)
    return words


def _now() -> str:
    """Time of the making; the environment may state one, so that builds are the same bytes."""
    stated = os.environ.get("SOURCE_DATE_EPOCH", "")
    seconds = int(stated) if stated.isdecimal() and len(stated) < 12 else int(time.time())
    return time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime(seconds))
