"""How a result was made: versions, what was asked for, and which bytes were read."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from pathlib import Path

from steelyard.experiment.model import Experiment
from steelyard.provenance.hashes import hash_of, inputs_of, version_of, versions
from steelyard.report.evidence.values import Input, Made
from steelyard.robot.file import robot_file


def steelyard_version() -> str:
    """Of this package."""
    return version_of("steelyard")


def made_of(experiment: Experiment, options: Mapping[str, str]) -> Made:
    """How the estimate of an experiment is made.

    Args:
        experiment: As it was read; one that was made in memory has no files.
        options: What was asked for, by name.
    """
    return Made(tuple(versions().items()), tuple(options.items()), tuple(_inputs(experiment)))


def _inputs(experiment: Experiment) -> Iterator[Input]:
    """The experiment file, the robot as it was understood, and every recording once."""
    robot = json.dumps(robot_file(experiment.robot), sort_keys=True).encode()
    folder = Path(experiment.source).parent
    files = inputs_of(experiment)
    for i, path in enumerate(files or [None]):
        if path is not None:
            found = hash_of(path, folder)
            yield Input(found.file, found.sha256, found.size)
        if not i:
            name = f"robot '{experiment.robot.name}', as it was understood"
            yield Input(name, hashlib.sha256(robot).hexdigest(), len(robot))
