"""Experiments with other readings, another description, or other clocks than they had."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from steelyard.arrays import Array
from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run, Stream

Edit = Callable[[Experiment], Experiment]
"""From one experiment to another; the first stays as it is."""


def with_streams(
    experiment: Experiment, name: str, change: Callable[[Stream], Stream]
) -> Experiment:
    """Other streams of one instrument."""

    def of_run(run: Run) -> Run:
        if name not in run.streams:
            return run
        return replace(run, streams={**run.streams, name: change(run.streams[name])})

    return replace(experiment, runs=tuple(of_run(run) for run in experiment.runs))


def with_values(
    experiment: Experiment, name: str, change: Callable[[Mapping[str, Array]], Mapping[str, Array]]
) -> Experiment:
    """Other readings of one instrument; ``change`` gives the quantities that differ."""
    return with_streams(
        experiment,
        name,
        lambda stream: replace(stream, values={**stream.values, **change(stream.values)}),
    )


def vector(name: str, quantity: str, matrix: ArrayLike) -> Edit:
    """Readings of a vector multiplied by a matrix, a diagonal or a number."""
    M = np.asarray(matrix, dtype=np.float64)
    return readings(name, quantity, lambda v: v @ M.T if M.ndim == 2 else v * M)


def readings(name: str, quantity: str, change: Callable[[Array], Array]) -> Edit:
    """Readings of one quantity, changed as a whole."""
    return lambda e: with_values(e, name, lambda v: {quantity: change(v[quantity])})


def exchanged(name: str, quantity: str, i: int, k: int) -> Edit:
    """Two columns of a vector, numbered from 0, exchanged."""

    def change(values: Array) -> Array:
        order = np.arange(values.shape[1])
        order[[i, k]] = order[[k, i]]
        return values[:, order]

    return readings(name, quantity, change)


def quaternions(order: Sequence[int]) -> Callable[[Array], Array]:
    """Rotations, shape (n, 3, 3), whose quaternions w, x, y, z are read in another order."""

    def change(R: Array) -> Array:
        q = Rotation.from_matrix(R).as_quat(scalar_first=True)
        flips = np.where(np.sum(q[1:] * q[:-1], axis=1) < 0, -1.0, 1.0)
        q *= np.concatenate([[1.0], np.cumprod(flips)])[:, None]
        return np.asarray(Rotation.from_quat(q[:, list(order)], scalar_first=True).as_matrix())

    return change


def z_down(R: Array) -> Array:
    """Rotations, shape (n, 3, 3), between frames that both have z down and y the other way."""
    flip = np.diag([1.0, -1.0, -1.0])
    return np.asarray(flip @ R @ flip)


def late(name: str, delay: float) -> Edit:
    """An instrument whose clock is late [s], though nobody says so."""
    return lambda e: with_streams(e, name, lambda s: replace(s, time=s.time + delay))


def without_sync(experiment: Experiment) -> Experiment:
    """Clocks that are apart though nobody says so."""
    return replace(experiment, runs=tuple(replace(run, sync={}) for run in experiment.runs))


def instrument(name: str, **keys: Any) -> Edit:
    """Another description of an instrument."""

    def change(experiment: Experiment) -> Experiment:
        changed = experiment.instruments[name].model_copy(update=keys)
        return replace(experiment, instruments={**experiment.instruments, name: changed})

    return change


def robot(**keys: Any) -> Edit:
    """Another robot file; each key is a function of the robot."""
    return lambda e: replace(e, robot=replace(e.robot, **{k: v(e.robot) for k, v in keys.items()}))
