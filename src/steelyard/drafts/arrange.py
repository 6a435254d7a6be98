"""Which streams were recorded together, and by which instruments: runs and names from folders, file
names and times.
"""

from __future__ import annotations

import json
import os
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
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
    still: list[DraftStream] = []
    moving: list[DraftStream] = []
    for each in found:
        if each.static:
            still.append(each)
        elif len(each.stream) >= ARRANGE.fewest:
            moving.append(each)
        else:
            unused.append(each.unused(f"{len(each.stream)} samples are too few"))
    groups: list[RunGroup] = []
    for static, streams in ((True, still), (False, moving)):
        by_name: dict[tuple[Path, str], list[DraftStream]] = {}
        for each in streams:
            by_name.setdefault(_key(each), []).append(each)
        made = [RunGroup(_name(key), tuple(its), static) for key, its in by_name.items()]
        made, dropped = _joined(made, static)
        unused += dropped
        for group in made:
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
    parts = re.split(r"([_\-. ]+)", stem)
    kept = "".join(part for part in parts if not _is_instrument(part))
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
    return part or os.fsencode(folder.resolve().name).decode(errors="replace") or "run"


def _joined(groups: Sequence[RunGroup], static: bool) -> tuple[list[RunGroup], list[Unused]]:
    """Groups that lack forces or motion put together: those recorded at the same time, else all
    that has no double.
    """
    whole = [group for group in groups if group.complete]
    rest = [found for group in groups if not group.complete for found in group.streams]
    if not rest or static:
        return [*whole, *(group for group in groups if not group.complete)], []
    if all(float(found.stream.time[0]) > ARRANGE.since_1970 for found in rest):
        for bunch in _overlapping(rest):
            home = next(
                (i for i, group in enumerate(whole) if _overlap(group.streams, bunch)), None
            )
            if home is None:
                whole.append(RunGroup(_name(_key(bunch[0])), tuple(bunch), static))
            else:
                whole[home] = replace(whole[home], streams=(*whole[home].streams, *bunch))
        return whole, []
    if not whole:
        return [RunGroup(_name((rest[0].place.path.parent, "")), tuple(rest), static)], []
    return [*whole, *(group for group in groups if not group.complete)], []


def _overlapping(streams: Sequence[DraftStream]) -> Iterable[list[DraftStream]]:
    """Streams whose times overlap, bunch by bunch."""
    bunch: list[DraftStream] = []
    end = -np.inf
    for found in sorted(streams, key=lambda f: float(f.stream.time[0])):
        if bunch and float(found.stream.time[0]) > end:
            yield bunch
            bunch = []
            end = -np.inf
        bunch.append(found)
        end = max(end, float(found.stream.time[-1]))
    if bunch:
        yield bunch


def _overlap(one: Sequence[DraftStream], other: Sequence[DraftStream]) -> bool:
    start = max(min(float(f.stream.time[0]) for f in each) for each in (one, other))
    end = min(max(float(f.stream.time[-1]) for f in each) for each in (one, other))
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
    return (
        one.kind == other.kind
        and len(one.stream) == len(other.stream)
        and one.stream.values.keys() == other.stream.values.keys()
        and all(
            np.allclose(values, other.stream.values[name], rtol=1e-6, atol=1e-9, equal_nan=True)
            for name, values in one.stream.values.items()
        )
    )


def _distinctly_named(groups: Sequence[RunGroup]) -> list[RunGroup]:
    """Runs of different names; those of the same name get that of the folder around them."""
    names = [group.name for group in groups]
    taken: set[str] = set()
    named = []
    for group in groups:
        name = group.name
        if names.count(name) > 1:
            around = [
                os.fsencode(p.name).decode(errors="replace")
                for p in group.streams[0].place.path.resolve().parents
            ]
            name = next((f"{folder}-{name}" for folder in around if folder not in {name, ""}), name)
        whole, count = name, 2
        while name in taken:
            name, count = f"{whole}-{count}", count + 1
        taken.add(name)
        named.append(replace(group, name=name))
    return named


def runs_of(groups: Sequence[RunGroup]) -> list[DraftRun]:
    """Runs whose streams stand under the names of their instruments, the same in all runs."""
    several: set[str] = set()
    for group in groups:
        counts = Counter(found.kind for found in group.streams)
        several.update(kind for kind, count in counts.items() if count > 1)
    known: dict[str, str] = {}
    """Name -> settings of the instrument."""
    runs = []
    for group in groups:
        streams: dict[str, DraftStream] = {}
        for found in group.streams:
            base = _NAMES[found.kind] if found.kind not in several else _own_name(found)
            settings = json.dumps([found.kind, found.settings], sort_keys=True)
            name, count = base, 2
            while name in streams or known.get(name, settings) != settings:
                name, count = f"{base}-{count}", count + 1
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
