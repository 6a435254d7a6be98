"""Which streams were recorded together, and by which instruments: runs and names from folders, file
names and times.
"""

from __future__ import annotations

import json
import os
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path

import numpy as np

from steelyard.drafts.clocks import one_clock
from steelyard.drafts.settings import ARRANGE
from steelyard.drafts.survey import DraftStream, Unused, name_of
from steelyard.drafts.words import INSTRUMENTS, words_of
from steelyard.logs.formats import ending_of

FORCES = frozenset({"tension", "wrench"})
MOTIONS = frozenset({"imu", "attitude", "position", "pose"})
_NAMES = {
    "tension": "cables",
    "wrench": "wrench",
    "imu": "imu",
    "attitude": "attitude",
    "position": "tracker",
    "pose": "pose",
    "length": "winches",
    "command": "command",
}
_ONCE = frozenset({"tension", "wrench", "length", "command"})
"""Kinds that a run has but one stream of."""
_GROUPED = (".h5", ".hdf5", ".mat", ".tdms")
"""Endings of logs that hold groups of arrays."""


@dataclass(frozen=True, eq=False)
class RunGroup:
    """Streams that belong to one run."""

    name: str
    streams: tuple[DraftStream, ...]
    static: bool

    @property
    def kinds(self) -> set[str]:
        """Of its instruments."""
        return {found.kind for found in self.streams}

    @property
    def complete(self) -> bool:
        """Whether forces and motion are both there."""
        return bool(self.kinds & FORCES and self.kinds & MOTIONS)


@dataclass(frozen=True, eq=False)
class DraftRun:
    """A run with its streams under the names of their instruments."""

    name: str
    static: bool
    streams: Mapping[str, DraftStream]
    agree: bool
    """Whether the clocks do."""
    why: str
    """Why, or why not."""


def groups_of(found: Sequence[DraftStream]) -> tuple[list[RunGroup], list[Unused]]:
    """Sort streams into runs.

    Returns:
        Runs that have forces and motion, and what is left.
    """
    unused: list[Unused] = []
    still: dict[tuple[Path, str], list[DraftStream]] = {}
    moving: dict[tuple[Path, str], list[DraftStream]] = {}
    for each in found:
        if each.static or len(each.stream) >= ARRANGE.fewest:
            (still if each.static else moving).setdefault(_key(each), []).append(each)
        else:
            unused.append(each.unused(f"{len(each.stream)} samples are too few"))
    groups: list[RunGroup] = []
    for static, by_name in ((True, still), (False, moving)):
        made = [RunGroup(_name(key), tuple(its), static) for key, its in by_name.items()]
        for group in _joined(made, static):
            fitted, dropped = _fitted(group)
            unused += dropped
            if fitted.complete:
                groups.append(fitted)
            else:
                missing = "motion" if fitted.kinds & FORCES else "forces"
                why = f"no log of {missing} that belongs to it"
                unused += [each.unused(why) for each in fitted.streams]
    return _distinctly_named(groups), unused


def _key(found: DraftStream) -> tuple[Path, str]:
    """Folder and what is left of the file's name without words that say which instrument."""
    path = found.place.path
    folder = path.parent
    stem = path.name if path.is_dir() else path.name.split(".")[0]
    kept = "".join(part for part in re.split(r"([_\-. ]+)", stem) if not _is_instrument(part))
    kept = re.sub(r"([_\-. ])[_\-. ]+", r"\1", kept)
    group = found.place.topic
    if group and ending_of(path) in _GROUPED and not INSTRUMENTS.issuperset(words_of(group)):
        # Of a file of arrays that holds several recordings, each group is one.
        kept = f"{kept}-{group}".strip("-")
    numbered = re.fullmatch(r"([a-z]+)(\d+)", kept.lower())
    if numbered and numbered[1] in INSTRUMENTS:
        kept = numbered[2]
    if _is_instrument(folder.name):
        folder = folder.parent
    return folder, kept.strip("_-. ")


def _is_instrument(text: str) -> bool:
    """Whether all words of a text say which instrument, one at least."""
    words = words_of(text)
    return bool(words) and INSTRUMENTS.issuperset(words)


def _name(key: tuple[Path, str]) -> str:
    folder, part = key
    return part or _text(folder.resolve()) or "run"


def _text(folder: Path) -> str:
    """Name of a folder, whatever bytes it has."""
    return os.fsencode(folder.name).decode(errors="replace")


def _joined(groups: Sequence[RunGroup], static: bool) -> list[RunGroup]:
    """Groups that lack forces or motion put together: those recorded at the same time, else all
    that has no double.
    """
    whole = [group for group in groups if group.complete]
    lacking = [group for group in groups if not group.complete]
    rest = [found for group in lacking for found in group.streams]
    if not rest or static:
        return [*whole, *lacking]
    if all(found.span[0] > ARRANGE.since_1970 for found in rest):
        for bunch in _overlapping(rest):
            home = next((group for group in whole if _overlap(group.streams, bunch)), None)
            if home is None:
                whole.append(RunGroup(_name(_key(bunch[0])), tuple(bunch), static))
            else:
                whole[whole.index(home)] = replace(home, streams=(*home.streams, *bunch))
        return whole
    if not whole:
        return [RunGroup(_name((rest[0].place.path.parent, "")), tuple(rest), static)]
    return [*whole, *lacking]


def _overlapping(streams: Sequence[DraftStream]) -> Iterator[list[DraftStream]]:
    """Streams whose times overlap, bunch by bunch."""
    bunch: list[DraftStream] = []
    for found in sorted(streams, key=lambda each: each.span[0]):
        if bunch and found.span[0] > max(each.span[1] for each in bunch):
            yield bunch
            bunch = []
        bunch.append(found)
    if bunch:
        yield bunch


def _overlap(one: Sequence[DraftStream], other: Sequence[DraftStream]) -> bool:
    start = max(min(found.span[0] for found in each) for each in (one, other))
    end = min(max(found.span[1] for found in each) for each in (one, other))
    return start < end


def _fitted(group: RunGroup) -> tuple[RunGroup, list[Unused]]:
    """The group without doubles, and of poses at rest without what has other rows."""
    kept: list[DraftStream] = []
    unused: list[Unused] = []
    for found in group.streams:
        double = next((f for f in kept if _same(f, found)), None)
        if double is not None:
            other = name_of(double.place.path, double.place.topic)
            unused.append(found.unused(f"the same as in {other}"))
        elif found.kind in _ONCE and any(f.kind == found.kind for f in kept):
            why = f"run '{group.name}' has one already; name it yourself if both belong to it"
            unused.append(found.unused(why))
        else:
            kept.append(found)
    rows = next((len(f.stream) for f in kept if f.kind in FORCES), None)
    if group.static and rows is not None:
        for found in kept:
            if len(found.stream) != rows:
                why = f"{len(found.stream)} rows without time, where the forces have {rows}"
                unused.append(found.unused(why))
        kept = [found for found in kept if len(found.stream) == rows]
    return replace(group, streams=tuple(kept)), unused


def _same(one: DraftStream, other: DraftStream) -> bool:
    """Whether two streams are the same readings, as two logs of one recording have them."""
    first, second = one.stream.values, other.stream.values
    if one.kind != other.kind or len(one.stream) != len(other.stream):
        return False
    return first.keys() == second.keys() and all(
        np.allclose(first[name], second[name], rtol=1e-6, atol=1e-9, equal_nan=True)
        for name in first
    )


def _numbered(name: str) -> Iterator[str]:
    """A name, then the same with a number behind it."""
    yield name
    yield from (f"{name}-{number}" for number in count(2))


def _distinctly_named(groups: Sequence[RunGroup]) -> list[RunGroup]:
    """Runs of different names; those of the same name get that of the folder around them."""
    names = [group.name for group in groups]
    taken: set[str] = set()
    named = []
    for group in groups:
        name = group.name
        if names.count(name) > 1:
            around = [_text(folder) for folder in group.streams[0].place.path.resolve().parents]
            name = next((f"{folder}-{name}" for folder in around if folder not in {name, ""}), name)
        name = next(each for each in _numbered(name) if each not in taken)
        taken.add(name)
        named.append(replace(group, name=name))
    return named


def runs_of(groups: Sequence[RunGroup]) -> list[DraftRun]:
    """Runs whose streams stand under the names of their instruments, the same in all runs."""
    counts = [Counter(found.kind for found in group.streams) for group in groups]
    several = {kind for each in counts for kind in each if each[kind] > 1}
    known: dict[str, str] = {}
    """Name -> settings of the instrument."""
    runs = []
    for group in groups:
        streams: dict[str, DraftStream] = {}
        for found in group.streams:
            base = _NAMES[found.kind] if found.kind not in several else _own_name(found)
            settings = json.dumps([found.kind, found.settings], sort_keys=True)
            # An instrument has one stream in a run, and the same settings in all runs.
            free = (each for each in _numbered(base) if each not in streams)
            name = next(each for each in free if known.get(each, settings) == settings)
            known[name] = settings
            streams[name] = found
        agree, why = (True, "") if group.static else one_clock(group.streams)
        runs.append(DraftRun(group.name, group.static, streams, agree, why))
    return runs


def _own_name(found: DraftStream) -> str:
    """A name that distinguishes an instrument from others of its kind."""
    own = [*found.label, *words_of(found.place.topic or "")] or [
        word for word in words_of(found.place.path.name.split(".")[0]) if word in INSTRUMENTS
    ]
    words = [word for word in dict.fromkeys(own) if word != _NAMES[found.kind]]
    return "-".join([_NAMES[found.kind], *words[:3]])[:60]
