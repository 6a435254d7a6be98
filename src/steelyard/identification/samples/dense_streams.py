"""Streams with many more samples than any motion of a platform asks for: their samples are
averaged, so that a fit takes the time of the motion, not that of the converter.

The mean of n samples with white noise has a 1-sigma of sqrt(n) less and says all that they say of
what hardly changes while they are taken. Where their noise is not stated it is estimated from the
means, whatever its colour.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run, Stream
from steelyard.identification.model.settings import MOTION, MotionSettings
from steelyard.identification.samples.motion_noise import stands_still

_APART = 16
"""Samples over which the time between two is looked at: some converters hand them over in
packets."""
_ROUNDING = 1e-6
"""Of times, as a part of the number of samples in a group."""


def average_dense(experiment: Experiment, settings: MotionSettings = MOTION) -> Experiment:
    """An experiment with at most as many samples as settings call dense; the very same where no
    stream of a run in motion has more.

    Args:
        experiment: With its runs.
        settings: With the longest time that samples are averaged over.
    """
    longest = settings.averaged_over if experiment.robot.m else settings.averaged_over_on_sensor
    runs = tuple(_averaged_run(experiment, run, longest, settings) for run in experiment.runs)
    same = all(new is old for new, old in zip(runs, experiment.runs, strict=True))
    return experiment if same else replace(experiment, runs=runs)


def _averaged_run(
    experiment: Experiment, run: Run, longest: float, settings: MotionSettings
) -> Run:
    """A run with its dense streams averaged; the very same where none is dense."""
    if run.static:
        return run
    streams = {
        # Stamps that scatter are no property of the mean of their samples.
        name: stream
        if experiment.instruments[name].calibration.jitter
        else averaged(stream, longest, settings)
        for name, stream in run.streams.items()
    }
    if all(streams[name] is stream for name, stream in run.streams.items()):
        return run
    return replace(run, streams=streams, sync=experiment.event_times(run))


def averaged(stream: Stream, longest: float, settings: MotionSettings = MOTION) -> Stream:
    """A stream of means of as many samples as fit into a time; the very same where that is one, or
    where gaps would lose more than a few.

    Args:
        stream: Of a run in motion.
        longest: Time that samples are averaged over [s].
        settings: When a mean counts.
    """
    count = _count(stream.time, longest)
    if count < 2 or any(stands_still(values) for values in stream.values.values()):
        # Means of an encoder that flickers by a digit would no longer show that it stands still.
        return stream
    there = np.zeros(len(stream), dtype=bool)
    for values in stream.values.values():
        there |= np.isfinite(values.reshape(len(values), -1)).any(axis=1)
    rows = np.flatnonzero(there)
    groups = list(_groups(stream.time[rows], count, longest))
    if count * len(groups) < (1 - settings.lost_in_groups) * len(rows):
        return stream
    of = rows[np.asarray(groups)[:, None] + np.arange(count)]
    return replace(
        stream,
        time=stream.time[of].mean(axis=1),
        values={
            name: _mean_rotations(values[of], settings)
            if values.ndim == 3
            else _means(values[of], settings)
            for name, values in stream.values.items()
        },
        angles={},
        off={},
        mean_of=count * stream.mean_of,
    )


def _count(time: Array, longest: float) -> int:
    """How many samples are taken within a time [s], by their usual distance; 1 where that cannot be
    told.
    """
    if len(time) <= 2 * _APART:
        return 1
    step = float(np.median(time[_APART:] - time[:-_APART])) / _APART
    return int(longest / step + _ROUNDING) if step > 0 else 1


def _groups(time: Array, count: int, longest: float) -> Iterator[int]:
    """Where groups of so many samples begin that no gap parts."""
    edges = [0, *(np.flatnonzero(np.diff(time) > longest) + 1).tolist(), len(time)]
    for start, end in pairwise(edges):
        yield from range(start, end - count + 1, count)


def _means(values: Array, settings: MotionSettings) -> Array:
    """Means of groups channel by channel, shape (g, n, k) -> (g, k); NaN where too few samples are
    there, or too few that do not stand alone.
    """
    middle, off, use = _about_middle(values, settings)
    count = use.sum(axis=1)
    mean = middle + np.where(use, off, 0.0).sum(axis=1) / np.maximum(count, 1)
    return np.where(count >= settings.needed_in_group * values.shape[1], mean, np.nan)


def _mean_rotations(values: Array, settings: MotionSettings) -> Array:
    """Rotations nearest to the means of groups, shape (g, n, 3, 3) -> (g, 3, 3); NaN as above."""
    groups, n = values.shape[:2]
    *_, use = _about_middle(values.reshape(groups, n, 9), settings)
    whole = np.logical_and.reduce(use, axis=2)
    count = whole.sum(axis=1)
    kept = count >= settings.needed_in_group * n
    found = np.full((groups, 3, 3), np.nan)
    mean = np.where(whole[:, :, None, None], values, 0.0)[kept].sum(axis=1)
    u, _, vt = np.linalg.svd(mean)
    u[:, :, 2] *= np.linalg.det(u @ vt)[:, None]
    found[kept] = u @ vt
    return found


def _about_middle(
    values: Array, settings: MotionSettings
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Medians of groups, shape (g, k), how far samples are from them and which do not stand alone,
    shape (g, n, k).

    What stands alone is far beyond what all but a few samples of the channel do within their
    groups. Equal samples, as a stuck channel has them, keep their very value.
    """
    there = np.isfinite(values)
    order = np.sort(np.where(there, values, np.inf), axis=1)
    place = np.maximum(there.sum(axis=1) - 1, 0) // 2
    middle = np.take_along_axis(order, place[:, None], axis=1)[:, 0]
    middle = np.where(np.isfinite(middle), middle, 0.0)
    off = np.where(there, values - middle[:, None], 0.0)
    far = np.abs(off)
    usual = np.array([
        np.quantile(far[:, :, i][there[:, :, i]], settings.usual_in_group)
        if there[:, :, i].any()
        else 0.0
        for i in range(values.shape[2])
    ])  # fmt: skip
    # Converters that hardly resolve what they read have no usual distance.
    return middle, off, there & ((far <= settings.alone_in_group * usual) | (usual == 0.0))
