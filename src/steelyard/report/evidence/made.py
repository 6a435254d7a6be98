"""How a result was made: versions, what was asked for, and which bytes were read."""

from __future__ import annotations

import hashlib
import json
import os
import sys
from collections.abc import Iterator, Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from steelyard.experiment.model import Experiment
from steelyard.report.evidence.values import Input, Made
from steelyard.robot.file import robot_file

_LIBRARIES = ("numpy", "scipy", "casadi", "clarabel", "polars")
"""Those that the numbers depend on."""
_UNKNOWN = "not installed as a package"


def steelyard_version() -> str:
    """Of this package."""
    return _version("steelyard")


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return _UNKNOWN


def made_of(experiment: Experiment, options: Mapping[str, str]) -> Made:
    """How the estimate of an experiment is made.

    Args:
        experiment: As it was read; one that was made in memory has no files.
        options: What was asked for, by name.
    """
    python = f"{sys.version_info.major}.{sys.version_info.minor}"
    versions = (
        ("steelyard", steelyard_version()),
        ("Python", python),
        *((n, _version(n)) for n in _LIBRARIES),
    )
    return Made(versions, tuple(options.items()), tuple(_inputs(experiment)))


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
