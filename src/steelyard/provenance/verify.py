"""Whether inputs and results are still those of the provenance, and whether the numbers come out
again.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from steelyard.files.json_file import read_json
from steelyard.output import settle, to_json
from steelyard.provenance.hashes import FileHash, hash_of, versions
from steelyard.provenance.record import FILE_NAME, Provenance, read_provenance

NUMBERS = ("estimate.json", "calibration.json", "design.json", "poses.json", "reference.json")
"""Files of results whose numbers are compared when they are computed again."""
TOLERANCE = 1e-9
"""Of numbers that come out again elsewhere, in units of their 1-sigma."""
_WITHOUT_SIGMA = 1e-3
"""What a number counts by that has no 1-sigma, in units of itself: shares and tests repeat to six
digits with another number of threads, estimates to eleven."""
_ORIGIN = "provenance"


@dataclass(frozen=True)
class Verification:
    """What became of the files of a folder of results."""

    provenance: Provenance
    changed: tuple[str, ...]
    """What is not as it was, a sentence each; empty: all is."""
    other_versions: tuple[str, ...]
    """Programs and libraries that have another version here."""

    def to_dict(self) -> dict[str, Any]:
        """Plain values."""
        return {
            "unchanged": not self.changed,
            "changed": list(self.changed),
            "other_versions": list(self.other_versions),
            "inputs": len(self.provenance.inputs),
            "results": len(self.provenance.results),
        }


def verify(folder: str | Path) -> Verification:
    """Look whether all inputs and results of a folder have the bytes they had.

    Args:
        folder: One that `identify`, `calibrate` or `design` wrote.

    Raises:
        InputError: It has no provenance.
    """
    folder = Path(folder)
    settle(folder)
    known = read_provenance(folder)
    changed = [
        *_changes_of_record(known, folder / FILE_NAME),
        *(each for found in known.inputs for each in _changes(found, folder, "input")),
        *(each for found in known.results for each in _changes(found, folder, "result")),
    ]
    here = versions()
    other = [
        f"{name} {here.get(name, 'unknown')}, was {was}"
        for name, was in known.versions.items()
        if here.get(name) != was
    ]
    return Verification(known, tuple(changed), tuple(other))


def _changes_of_record(known: Provenance, path: Path) -> Iterator[str]:
    if path.read_bytes() != (to_json(known.to_dict()) + "\n").encode():
        yield f"{FILE_NAME}: has changed since it was written"


def _changes(known: FileHash, folder: Path, what: str) -> Iterator[str]:
    path = folder / known.file
    if not path.is_file():
        yield f"{what} {known.file}: is not there"
        return
    found = hash_of(path, folder)
    if found.sha256 != known.sha256:
        sizes = f"{found.size} bytes, was {known.size}"
        hashes = f"SHA-256 {found.sha256[:12]}…, was {known.sha256[:12]}…"
        yield f"{what} {known.file}: has changed ({hashes}; {sizes})"


@dataclass(frozen=True)
class Repetition:
    """The numbers of a folder of results beside those that came out again."""

    numbers: int
    """How many were compared."""
    same_bits: bool
    largest: float
    """Difference, in units of the 1-sigma where a number has one, else of a thousand times
    itself."""
    where: str
    """Of the largest difference; empty: there is none."""

    @property
    def agrees(self) -> bool:
        """Whether the numbers are the same within :data:`TOLERANCE`."""
        return self.largest <= TOLERANCE

    def to_dict(self) -> dict[str, Any]:
        """Plain values."""
        finite = math.isfinite(self.largest)
        return {
            "numbers": self.numbers,
            "same_bits": self.same_bits,
            "largest_difference": self.largest if finite else None,
            "where": self.where,
            "agrees": self.agrees,
        }


def compare_numbers(before: Path, again: Path) -> Repetition:
    """Compare the numbers of two folders of results.

    Raises:
        InputError: A file cannot be read.
    """
    count, largest, where, same = 0, 0.0, "", True
    for name in NUMBERS:
        if not (before / name).is_file():
            continue
        there = (again / name).is_file()
        old, new = (
            _without_origin(read_json(p / name)) if p == before or there else None
            for p in (before, again)
        )
        for key, off, is_number in _differences(old, new, name, None):
            count += is_number
            same = same and off == 0
            if off > largest:
                largest, where = off, key
    return Repetition(count, same, largest, where)


def _without_origin(values: Any) -> Any:
    return {k: v for k, v in values.items() if k != _ORIGIN} if isinstance(values, dict) else values


def _differences(old: Any, new: Any, key: str, sigma: Any) -> Iterator[tuple[str, float, bool]]:
    """Key, size of the difference and whether it is of numbers, for every leaf of two values."""
    if isinstance(old, dict) and isinstance(new, dict):
        sigmas = old.get("standard_deviation")
        for name in [*old, *(n for n in new if n not in old)]:
            if name not in old or name not in new:
                yield f"{key}: {name}", math.inf, False
                continue
            if isinstance(sigmas, dict):
                own = sigmas.get(name)
            elif name == "value":
                own = sigmas
            else:
                own = sigma.get(name) if isinstance(sigma, dict) else None
            yield from _differences(old[name], new[name], f"{key}: {name}", own)
    elif isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        for i, (a, b) in enumerate(zip(old, new, strict=True)):
            own = sigma[i] if isinstance(sigma, list) and i < len(sigma) else None
            yield from _differences(a, b, f"{key}[{i}]", own)
    elif isinstance(old, float) and isinstance(new, float):
        told = isinstance(sigma, float) and sigma > 0
        scale = sigma if told else max(abs(old), abs(new)) / _WITHOUT_SIGMA
        yield key, 0.0 if old == new else abs(old - new) / scale, True
    else:
        yield key, 0.0 if old == new else math.inf, False
