"""From logs to a first experiment: what it holds, what was guessed, what is left to
check.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from steelyard.drafts.arrange import DraftRun, RunGroup, groups_of, runs_of
from steelyard.drafts.clocks import one_clock
from steelyard.drafts.compare import compared
from steelyard.drafts.survey import DraftStream, Unused, name_of, streams_in
from steelyard.errors import InputError
from steelyard.logs.formats import FORMATS, ending_of, topics
from steelyard.robot.model import Robot

_OF_THE_DEVICE = {"acts_on", "gravity", "rpy_deg"}
"""Keys that one recording may show and another of the same device may not."""
_ORDER = ("tension", "wrench", "imu", "attitude", "position", "pose", "length", "command")
MOST_LOGS = 1000
"""Files that are looked at: each takes a tenth of a second at least."""
MOST_STREAMS = 2000
"""In all logs: all of them are in memory at once."""
Progress = Callable[[str, float], None]


@dataclass(frozen=True, eq=False)
class Draft:
    """A first experiment."""

    instruments: Mapping[str, Mapping[str, Any]]
    """Name -> keys as they stand in the file, ``kind`` first."""
    runs: tuple[DraftRun, ...]
    unused: tuple[Unused, ...]


def draft(logs: Sequence[Path], robot: Robot, progress: Progress | None = None) -> Draft:
    """Guess the experiment that logs were recorded in.

    Args:
        logs: Files, or folders with files in them or one level below.
        robot: What they were recorded on.
        progress: Called with what is being done.

    Raises:
        InputError: A log is not there, or no run has both forces and motion.
    """
    paths, unused = logs_in(logs)
    found: list[DraftStream] = []
    for i, path in enumerate(paths):
        if progress is not None:
            progress(f"reading {path.name}", i / len(paths))
        streams, left = _look(path, robot)
        found += streams
        unused += left
        if len(found) > MOST_STREAMS:
            raise InputError(
                f"{path}: expected at most {MOST_STREAMS} streams in all logs, found more; name"
                " fewer logs"
            )
    groups, left = groups_of(found)
    unused += left
    groups = [
        replace(g, streams=compared(g.streams, robot.m, agree=g.static or one_clock(g.streams)[0]))
        for g in groups
    ]
    if not groups:
        raise InputError(f"{_places(logs)}: {_nothing(paths, found, unused)}")
    groups = _agreed(groups)
    runs = runs_of(groups)
    return Draft(_instruments(runs), tuple(runs), tuple(unused))


def logs_in(places: Sequence[Path]) -> tuple[list[Path], list[Unused]]:
    """Logs among files and folders, each once, in the order of their names, and the files that are
    none.

    Raises:
        InputError: A place is not there, or there are too many.
    """
    paths: list[Path] = []
    unused: list[Unused] = []
    for place in places:
        if not place.exists():
            raise InputError(
                f"{place}: expected a log or a folder with logs, found nothing of that name; check"
                " the path"
            )
        if not place.is_dir() or _is_bag(place):
            if _is_bag(place) or ending_of(place) is not None:
                paths.append(place)
            else:
                unused.append(Unused(f"{place}", f"none of the formats {', '.join(FORMATS)}"))
            continue
        for entry in _entries(place):
            inner = [entry] if not entry.is_dir() or _is_bag(entry) else _entries(entry)
            paths += [path for path in inner if _is_bag(path) or _is_log(path)]
        if len(paths) > MOST_LOGS:
            raise InputError(
                f"{place}: expected at most {MOST_LOGS} logs, found more; name fewer folders"
            )
    return list({path.resolve(): path for path in paths}.values()), unused


def _entries(folder: Path) -> list[Path]:
    return sorted(path for path in folder.iterdir() if not path.name.startswith("."))


def _is_log(path: Path) -> bool:
    return path.is_file() and ending_of(path) is not None


def _is_bag(path: Path) -> bool:
    return path.is_dir() and (path / "metadata.yaml").is_file()


def _look(path: Path, robot: Robot) -> tuple[list[DraftStream], list[Unused]]:
    """Streams of all topics of a log, and what in it no instrument has."""
    try:
        str(path).encode()
    except UnicodeEncodeError:
        return [], [Unused(f"{path}", "its name is no text that a file could say; rename it")]
    try:
        choices: Sequence[str | None] = topics(path) or [None]
    except InputError as error:
        return [], [Unused(f"{path}", error.on_command_line)]
    found: list[DraftStream] = []
    unused: list[Unused] = []
    for topic in choices:
        streams, left = streams_in(path, topic, robot)
        found += streams
        unused += left
    return found, unused


def _agreed(groups: Sequence[RunGroup]) -> list[RunGroup]:
    """Settings that one run shows and another cannot are those of both, where no two runs
    contradict each other.
    """
    shown: dict[tuple[str, tuple[str, ...]], dict[str, list[Any]]] = {}
    for found in (each for group in groups for each in group.streams):
        own = shown.setdefault((found.kind, found.label), {})
        for key, value in found.settings.items():
            if key in _OF_THE_DEVICE:
                own.setdefault(key, []).append(value)
    agreed = []
    for group in groups:
        streams = [_settled(each, shown[each.kind, each.label]) for each in group.streams]
        agreed.append(replace(group, streams=tuple(streams)))
    return agreed


def _settled(found: DraftStream, shown: Mapping[str, Sequence[Any]]) -> DraftStream:
    """A stream with the settings that all others of its device agree on; what they answer need not
    be checked.
    """
    known = dict(found.settings)
    checks = found.checks
    for key, values in shown.items():
        if key not in known and all(value == values[0] for value in values):
            known[key] = values[0]
            checks = tuple(check for check in checks if key not in check)
    return replace(found, settings=known, checks=checks)


def _instruments(runs: Sequence[DraftRun]) -> dict[str, dict[str, Any]]:
    """Instruments in the order of the contract, forces first; those that always share a file share
    a clock.
    """
    names = dict.fromkeys(name for run in runs for name in run.streams)
    found = {name: next(run.streams[name] for run in runs if name in run.streams) for name in names}
    order = sorted(names, key=lambda name: _ORDER.index(found[name].kind))
    instruments: dict[str, dict[str, Any]] = {
        name: {"kind": found[name].kind, **found[name].settings} for name in order
    }
    clocks: dict[str, list[str]] = {}
    for name in order:
        first = next((each for each in clocks if _share(each, name, runs)), name)
        clocks.setdefault(first, []).append(name)
    for i, clock in enumerate(clock for clock in clocks.values() if len(clock) > 1):
        for name in clock:
            instruments[name]["clock"] = "recorder" if i == 0 else f"recorder-{i + 1}"
    return instruments


def _share(one: str, other: str, runs: Sequence[DraftRun]) -> bool:
    """Whether two instruments stand in the same file wherever both are, with the same time."""
    both = [run.streams for run in runs if {one, other} <= run.streams.keys() and not run.static]
    return bool(both) and all(its[one].clock == its[other].clock for its in both)


def _places(logs: Sequence[Path]) -> str:
    return f"{logs[0]}" if len(logs) == 1 else f"{logs[0]} and {len(logs) - 1} more"


def _nothing(paths: Sequence[Path], found: Sequence[DraftStream], unused: Sequence[Unused]) -> str:
    """Why there is no run."""
    if not paths:
        return (
            f"expected logs in one of the formats {', '.join(FORMATS)}, found none; name files or"
            " folders with recordings"
        )
    kinds = sorted({each.kind for each in found})
    shown = [each for each in unused if "expected" in each.what] or ([] if kinds else unused)
    first = f" ({shown[0].log}: {shown[0].what})" if shown else ""
    if kinds:
        return (
            "expected logs of forces (tension, wrench) and of motion (imu, attitude, position,"
            f" pose) that belong together, found {', '.join(kinds)}{first}; add what is missing, or"
            " write the experiment file by hand"
        )
    return (
        f"expected columns of an instrument, found none that is known{first}; rename columns as in"
        " the contract"
    )


def describe(found: DraftStream) -> dict[str, Any]:
    """A stream as plain values."""
    return {
        "log": name_of(found.place.path, None),
        "topic": found.place.topic,
        "kind": found.kind,
        "columns": list(found.used),
        "units": {**found.stated, **found.place.units},
        "rate": None if found.rate is None else float(f"{found.rate:.4g}"),
        "samples": len(found.times),
        "why": list(found.why),
        "check": list(found.checks),
    }
