"""Short names that tell estimates of several files from each other."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from steelyard.display import printable
from steelyard.estimates.named_estimate import NamedEstimate

FILE_NAME = "estimate.json"
"""What `identify` writes into its folder."""
LONGEST_NAME = 60
"""Characters; longer names are cut."""


def short_names(found: Sequence[NamedEstimate]) -> list[str]:
    """A name for each: method, experiment, both, and where that is not enough the file."""
    methods = [each.estimate.method for each in found]
    experiments = [each.experiment for each in found]
    files = [_file_name(each.source) for each in found]
    forms = []
    if len(set(experiments)) == 1:
        forms.append(methods)
    if len(set(methods)) == 1:
        forms.append(experiments)
    forms.append(_joined(experiments, methods))
    if len(set(methods)) == 1:
        forms.append(files)
    forms.append(_joined(files, methods))
    for form in forms:
        names = [shortened(name) for name in form]
        if names and all(names) and len(set(names)) == len(names):
            return names
    return _numbered(names)


def _joined(first: Sequence[str], second: Sequence[str]) -> list[str]:
    return [f"{a}, {b}" for a, b in zip(first, second, strict=True)]


def _numbered(names: Sequence[str]) -> list[str]:
    """Names of which those that stand several times are counted."""
    total = Counter(names)
    seen: Counter[str] = Counter()
    found = []
    for name in names:
        seen[name] += 1
        found.append(f"{name} #{seen[name]}" if total[name] > 1 else name)
    return found


def _file_name(source: str) -> str:
    """A file as a person calls it: by its folder where it has the usual name."""
    path = Path(source)
    usual = path.name == FILE_NAME and path.parent.name
    return printable(path.parent.name if usual else path.stem)


def shortened(name: str) -> str:
    """A name of at most :data:`LONGEST_NAME` characters."""
    return name if len(name) <= LONGEST_NAME else f"{name[:LONGEST_NAME]}…"
