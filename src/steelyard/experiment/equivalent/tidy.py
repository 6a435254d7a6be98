"""An experiment on one clock: what is left of its recordings once nothing about their clocks has to
be said any more.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run, Stream


def tidied(experiment: Experiment) -> Experiment:
    """The same experiment with all streams on the common clock of their run.

    Time 0 is the common event of a run, or its first force sample where the clocks agree. Delays
    are unknowns with a prior, which stays as it is. Sources become names relative to the experiment
    file, or bare names of files that lie elsewhere.

    Args:
        experiment: Its clocks are known.
    """
    folder = Path(experiment.source).parent
    return replace(
        experiment, runs=tuple(_tidied(experiment, run, folder) for run in experiment.runs)
    )


def _tidied(experiment: Experiment, run: Run, folder: Path) -> Run:
    """A run with all its streams on the common clock."""
    force = experiment.force_instrument(run)
    first = float(run.streams[force].time[0]) if force else 0.0
    streams = {}
    for name, stream in run.streams.items():
        event = 0.0 if run.static else run.sync.get(name, first)
        streams[name] = Stream(stream.time - event, stream.values, _source(stream.source, folder))
    return replace(
        run, streams=streams, sync=dict.fromkeys(run.sync, 0.0) if not run.static else {}
    )


def _source(source: str, folder: Path) -> str:
    """Where a stream came from, without saying anything of the machine."""
    path = Path(source)
    inside = path.is_relative_to(folder) and ".." not in path.relative_to(folder).parts
    return path.relative_to(folder).as_posix() if inside else path.name
