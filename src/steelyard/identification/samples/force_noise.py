"""Noise of the force readings: as stated, or as they show it."""

from __future__ import annotations

import numpy as np

from steelyard.arrays import Array
from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run
from steelyard.identification.samples.prepared import Samples
from steelyard.instruments import Quantity

_TYPICAL_SIZE = 1e-12
"""Of readings that are all zero or missing, so that their noise is no zero [N]."""
_LEAST_NOISE = 1e-3
"""Of force readings whose noise is not stated, as a part of the largest: no sensor is described
better."""
_FINEST = 1e-7
"""Of force readings, as a part of the largest: squares of less are lost in the rounding of normal
equations, whatever is stated."""
_NOISE_AT_REST = 10.0
"""First guess of the noise of readings of which each stands alone, in units of the least."""


def force_sigma(experiment: Experiment, run: Run, samples: Samples) -> tuple[Array, bool]:
    """1-sigma of single force readings, shape (r,), and whether it was stated."""
    quantities = _force_quantities(experiment, run)
    least = least_sigma(experiment, run)
    if all(q.noise for q in quantities):
        stated = np.concatenate([np.full(q.size, q.noise) for q in quantities])
        return np.maximum(stated / _means(experiment, run), _FINEST / _LEAST_NOISE * least), True
    seen = np.concatenate([np.full(q.size, samples.noise.get(q.name, np.nan)) for q in quantities])
    return np.maximum(np.where(np.isfinite(seen), seen, _NOISE_AT_REST * least), least), False


def least_sigma(experiment: Experiment, run: Run) -> Array:
    """Least 1-sigma of single force readings, shape (r,)."""
    name = experiment.force_instrument(run)
    assert name is not None
    values = run.streams[name].values
    least = np.concatenate(
        [
            np.full(
                q.size,
                _LEAST_NOISE * float(np.nanmax(np.abs(values[q.name]), initial=_TYPICAL_SIZE)),
            )
            for q in _force_quantities(experiment, run)
        ]
    )
    return np.asarray(least / _means(experiment, run))


def _means(experiment: Experiment, run: Run) -> float:
    """By how much the noise of a force reading is less than that of a sample."""
    name = experiment.force_instrument(run)
    assert name is not None
    return float(np.sqrt(run.streams[name].mean_of))


def _force_quantities(experiment: Experiment, run: Run) -> tuple[Quantity, ...]:
    name = experiment.force_instrument(run)
    assert name is not None
    return experiment.instruments[name].quantities(experiment.robot.m)
