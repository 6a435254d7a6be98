"""How a result was made: versions, what was asked for, and which bytes were read."""

from __future__ import annotations

import hashlib
import json
import os
import sys
from collections.abc import Iterator, Mapping
from dataclasses import replace
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from steelyard.experiment.model import Experiment
from steelyard.report.evidence.values import Input, Made
from steelyard.robot.file import robot_file

_LIBRARIES = ("numpy", "scipy", "casadi", "clarabel", "polars")
"""Those that the numbers depend on."""
FACTS = ("project", "operator", "date")
"""Names of what stands under the title, in this order."""
_EARLIEST, _LATEST = 946_684_800.0, 4_102_444_800.0
"""Seconds since 1970 of the years 2000 and 2100: a clock that shows others was never set."""
_UNKNOWN = "not installed as a package"


def steelyard_version() -> str:
    """Of this package."""
    return _version("steelyard")


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return _UNKNOWN


def made_of(
    experiment: Experiment,
    options: Mapping[str, str],
    facts: Mapping[str, str | None] | None = None,
) -> Made:
    """How the estimate of an experiment is made.

    Args:
        experiment: As it was read; one that was made in memory has no files.
        options: What was asked for, by name.
        facts: What is to stand under the title, see :func:`with_facts`.
    """
    python = f"{sys.version_info.major}.{sys.version_info.minor}"
    versions = (
        ("steelyard", steelyard_version()),
        ("Python", python),
        *((n, _version(n)) for n in _LIBRARIES),
    )
    made = Made(versions, tuple(options.items()), tuple(_inputs(experiment)))
    return with_facts(made, {"date": _recorded_on(experiment), **_given(facts or {})})


def with_facts(made: Made, facts: Mapping[str, str | None]) -> Made:
    """The same with further facts under the title, or others of the same name.

    Args:
        made: How a result was made.
        facts: By name: project, operator, date; None: leave it as it is.
    """
    known = {**dict(made.facts), **_given(facts)}
    ordered = [*(name for name in FACTS if name in known), *(n for n in known if n not in FACTS)]
    return replace(made, facts=tuple((name, known[name]) for name in ordered))


def _given(facts: Mapping[str, str | None]) -> dict[str, str]:
    return {name: value for name, value in facts.items() if value}


def _recorded_on(experiment: Experiment) -> str | None:
    """The day on which the recording began, UTC; None: its clocks do not count from 1970. Never the
    day of today: the same recording gives the same report.
    """
    starts = [float(s.time[0]) for run in experiment.runs for s in run.streams.values() if len(s)]
    days = [start for start in starts if _EARLIEST < start < _LATEST]
    return datetime.fromtimestamp(min(days), UTC).date().isoformat() if days else None


def _inputs(experiment: Experiment) -> Iterator[Input]:
    """The experiment file, the robot as it was understood, and every recording once."""
    robot = json.dumps(robot_file(experiment.robot), sort_keys=True).encode()
    sources = dict.fromkeys(
        [experiment.source, *(s.source for run in experiment.runs for s in run.streams.values())]
    )
    folder = Path(experiment.source).parent
    for i, source in enumerate(sources):
        path = Path(source)
        if source and path.is_file():
            with path.open("rb") as file:
                digest = hashlib.file_digest(file, "sha256").hexdigest()
            yield Input(_beside(path, folder), digest, path.stat().st_size)
        if not i:
            name = f"robot '{experiment.robot.name}', as it was understood"
            yield Input(name, hashlib.sha256(robot).hexdigest(), len(robot))


def _beside(path: Path, folder: Path) -> str:
    """Path from the folder of the experiment: the same wherever that lies."""
    try:
        return Path(os.path.relpath(path, folder)).as_posix()
    except ValueError:
        # On another drive.
        return path.name
