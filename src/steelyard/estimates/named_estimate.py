"""An estimate among others: where it comes from, and the short name that distinguishes it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from steelyard.arrays import Array
from steelyard.display import printable
from steelyard.estimates.estimate import Estimate, named
from steelyard.estimates.joint_covariance import JointCovariance

FILE_NAME = "estimate.json"
"""What `identify` writes into its folder."""
LONGEST_NAME = 60
"""Characters; longer names are cut."""


@dataclass(frozen=True, eq=False)
class NamedEstimate:
    """An estimate among others."""

    name: str
    """Short and unlike the others'."""
    estimate: Estimate
    experiment: str = ""
    """Name of the experiment; empty: not known."""
    source: str = ""
    """Estimates of equal sources are made from the same recordings: the path of their file; empty:
    of its own."""
    correlated: bool = True
    """Whether the covariance is known, and not the 1-sigmas alone."""
    load: str = ""
    """Which of the loads of the experiment it is of; empty: there is one."""
    joint: JointCovariance | None = None
    """With the other loads of the same fit."""
    recordings: frozenset[str] = frozenset()
    """Digests of the readings that it stands on, one a run; empty: not known."""

    def to_dict(self) -> dict[str, Any]:
        """Plain values: what a comparison says of one of its estimates."""
        return {
            "name": self.name,
            "experiment": self.experiment,
            "method": self.estimate.method,
            **({"load": self.load} if self.load else {}),
            "file": self.source,
            **named(self.estimate.value),
            "standard_deviation": named(self.estimate.standard_deviation),
            "accepted": self.estimate.verdict.accepted,
        }


def same_source(first: NamedEstimate, second: NamedEstimate) -> bool:
    """Whether two estimates stand on the same recordings, some of them at least."""
    return _same_file(first, second) or bool(first.recordings & second.recordings)


def _same_file(first: NamedEstimate, second: NamedEstimate) -> bool:
    """Whether two estimates are of one file."""
    return bool(first.source) and first.source == second.source


def shared_covariance(first: NamedEstimate, second: NamedEstimate) -> Array | None:
    """Joint covariance of two loads of one fit, shape (20, 20); None: they are not."""
    of_one_fit = _same_file(first, second) and first.estimate.method == second.estimate.method
    if not of_one_fit or first.joint is None or first.load == second.load:
        return None
    if not {first.load, second.load} <= set(first.joint.loads):
        return None
    return first.joint.of_pair(first.load, second.load)


def short_names(found: Sequence[NamedEstimate]) -> list[str]:
    """A name for each: method, experiment, both, and where that is not enough the file."""
    methods = [each.estimate.method for each in found]
    experiments = [each.experiment for each in found]
    files = [_file_name(each.source) for each in found]
    forms: list[Sequence[str]] = []
    loads = [each.load for each in found]
    if any(loads):
        carried = [each.load or each.experiment for each in found]
        forms += [carried, _joined(experiments, carried)]
        methods = _joined(carried, methods)
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
