"""A part of an experiment that is fitted quickly and determines the same."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from steelyard.arrays import Array
from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run, Stream
from steelyard.inspection.agreements.excerpt import Excerpt
from steelyard.inspection.settings import INSPECTION, InspectionSettings
from steelyard.instruments import Instrument
from steelyard.instruments.noise import ColoredNoise, averaged


def part_of(
    experiment: Experiment, excerpts: list[Excerpt], settings: InspectionSettings = INSPECTION
) -> Experiment:
    """Some runs, of each what an excerpt shows, fast streams averaged.

    Args:
        experiment: The whole.
        excerpts: Of some of its runs.
        settings: With the rates beyond which samples are averaged.
    """
    shown = {excerpt.run.name: excerpt for excerpt in excerpts}
    runs = [run for run in experiment.runs if run.name in shown]
    fastest = settings.fastest if experiment.robot.m else settings.fastest_on_sensor
    often = {
        name: max(1, int(_rate(runs, name) / fastest))
        for name, instrument in experiment.instruments.items()
        if not instrument.commanded
    }
    instruments = {
        name: _averaged_noise(each, often.get(name, 1))
        for name, each in experiment.instruments.items()
    }
    cut = (run if run.static else _cut(experiment, run, shown[run.name], often) for run in runs)
    return replace(experiment, instruments=instruments, runs=tuple(cut))


def _rate(runs: list[Run], name: str) -> float:
    steps = [
        float(np.median(np.diff(r.streams[name].time)))
        for r in runs
        if not r.static and name in r.streams and len(r.streams[name]) > 2
    ]
    steps = [step for step in steps if step > 0]
    return 1 / min(steps) if steps else 0.0


def _cut(experiment: Experiment, run: Run, excerpt: Excerpt, often: dict[str, int]) -> Run:
    """What an excerpt shows of a run, its fast streams averaged."""
    streams = {name: _averaged(stream, often.get(name, 1)) for name, stream in run.streams.items()}
    sync = experiment.event_times(run)
    return replace(run, streams=streams, sync=sync, window=excerpt.window)


def _averaged(stream: Stream, often: int) -> Stream:
    """Means of so many samples in a row."""
    if often == 1:
        return stream
    n = len(stream) // often * often

    def mean(values: Array) -> Array:
        blocks = values[:n].reshape(-1, often, *values.shape[1:])
        found = blocks.mean(axis=1)
        if values.ndim == 3:
            there = np.isfinite(found).all(axis=(1, 2))
            found[there] = Rotation.from_matrix(found[there]).as_matrix()
        return np.asarray(found)

    return Stream(mean(stream.time), {q: mean(v) for q, v in stream.values.items()}, stream.source)


def _averaged_noise(instrument: Instrument, often: int) -> Instrument:
    """With the noise of averages."""
    # Every kind states its noise under this key, as a number or as a map.
    noise = dict(instrument).get("noise")
    if often == 1 or noise is None:
        return instrument
    less = float(1 / np.sqrt(often))
    if isinstance(noise, float | int | ColoredNoise):
        return instrument.model_copy(update={"noise": averaged(noise, less)})
    stated = {key: averaged(value, less) for key, value in dict(noise).items() if value is not None}
    return instrument.model_copy(update={"noise": noise.model_copy(update=stated)})
