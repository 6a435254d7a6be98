"""An experiment as a caller in Python hands it over: a value, or the path of its file."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TypeAlias

from steelyard.errors import InputError
from steelyard.experiment.model import Experiment
from steelyard.experiment.read import read_experiment

GivenExperiment: TypeAlias = Experiment | str | Path
"""An experiment, or the path of its file."""


def experiment_of(given: GivenExperiment, *, weighed: bool = True) -> Experiment:
    """The experiment itself.

    Args:
        given: A value, or the path of its file.
        weighed: See :func:`.read_experiment`.

    Raises:
        InputError: It is neither, or the file is wrong.
    """
    if isinstance(given, Experiment):
        return given
    if isinstance(given, str | os.PathLike):
        return read_experiment(Path(given), weighed=weighed)
    raise InputError(
        "experiment: expected an Experiment or the path of its file, found"
        f" {type(given).__name__}; make one with read_experiment or Experiment.from_frames"
    )
