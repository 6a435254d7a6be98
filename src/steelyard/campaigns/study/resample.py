"""Bootstrap: another experiment of the runs, or of blocks of the runs, of a real one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np

from steelyard.errors import InputError
from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run
from steelyard.identification.synchronisation import synchronise

FEWEST = 5
"""Runs or blocks: of fewer the scatter of what is drawn says nothing."""


def resampled(experiment: Experiment, block: float, rng: np.random.Generator) -> Experiment:
    """As many runs, or blocks of them, drawn with replacement; each is a run of its own.

    Args:
        experiment: As it was read.
        block: Length of the blocks [s]; 0: whole runs.
        rng: What is drawn.

    Raises:
        InputError: There are too few of them.
    """
    parts = list(_parts(synchronise(experiment).experiment, block))
    if len(parts) < FEWEST:
        found = f"blocks of {block:g} s" if block else "runs"
        raise InputError(
            f"--bootstrap: expected at least {FEWEST} runs or blocks to draw from, found"
            f" {len(parts)} {found}; choose a shorter --block"
        )
    chosen = rng.integers(len(parts), size=len(parts))
    runs = tuple(replace(parts[i], name=f"{parts[i].name} {n}") for n, i in enumerate(chosen))
    return replace(experiment, runs=runs)


def _parts(experiment: Experiment, block: float) -> Iterator[Run]:
    """Whole runs, or blocks of the runs in motion."""
    for run in experiment.runs:
        if run.static or not block:
            yield run
        else:
            yield from _blocks(experiment, run, block)


def _blocks(experiment: Experiment, run: Run, block: float) -> Iterator[Run]:
    """Blocks of equal length, about as long as is asked for."""
    force = experiment.force_instrument(run) or next(iter(run.streams))
    times = {name: experiment.common_time(run, name) for name in run.streams}
    start, end = float(times[force][0]), float(times[force][-1])
    if run.window is not None:
        origin = 0.0 if run.sync else start
        start, end = max(start, origin + run.window[0]), min(end, origin + run.window[1])
    bounds = np.linspace(start, end, max(1, round((end - start) / block)) + 1)
    for low, high in pairwise(bounds):
        streams = {
            name: stream.at_rows((times[name] >= low) & (times[name] < high))
            for name, stream in run.streams.items()
        }
        yield replace(run, streams=streams, window=None)
