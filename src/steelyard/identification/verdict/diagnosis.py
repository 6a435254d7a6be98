"""Where forces and motion contradict each other beyond measure: which simple mistake would explain
it.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from steelyard.dynamics import platform_regressor
from steelyard.identification.model.preparation import Samples, prepare
from steelyard.identification.model.unknown_body import BODY, unknown_body
from steelyard.identification.solve.posterior import Posterior

_MOST_SAMPLES = 400
_OFFSET = 0.01
"""1-sigma of the offsets of force sensors in the comparison, as a part of the median tension."""
_MUCH_BETTER = 0.25
"""Part of the residual that a swap must leave at most to be named."""
_NEAR = 0.15
_RIDGE = 1e-10
"""Of the fit of a body whose ten the motion may not tell."""


def diagnose(posterior: Posterior) -> Iterator[str]:
    """Mistakes of description that would explain a recording that does not balance, in words."""
    yield from _accelerometer(posterior)
    yield from _swap(posterior)


def _accelerometer(posterior: Posterior) -> Iterator[str]:
    """What the accelerometers feel on average must be gravity: a platform goes nowhere in the long
    run.
    """
    experiment = posterior.experiment
    gravity = experiment.robot.gravity
    for run in experiment.runs:
        if run.static or not any(
            "specific_force" in stream.values for stream in run.streams.values()
        ):
            continue
        samples = prepare(experiment, run, thin=True, commanded=True)
        if samples.rotation is None:
            continue
        force_samples = np.mean(
            np.einsum("nij,nj->ni", samples.rotation, samples.specific_force), axis=0
        )
        factor = float(force_samples @ -gravity / (gravity @ gravity))
        if abs(factor + 1) < _NEAR:
            yield (
                f"run '{run.name}': the accelerometer feels gravity upside down; check the sign of"
                " 'gravity' in the robot file and of the accelerometer's columns"
            )
        elif abs(factor * 9.80665 - 1) < _NEAR:
            yield (
                f"run '{run.name}': the accelerometer seems to read in g; state 'units: {{ax: g,"
                " ay: g, az: g}'"
            )
        elif abs(factor) < 0.05:
            yield (
                f"run '{run.name}': the accelerometer seems to have gravity taken out; state"
                " 'gravity: removed' for the IMU"
            )
        return


def _swap(posterior: Posterior) -> Iterator[str]:
    """Two force columns exchanged."""
    experiment = posterior.experiment
    run = next(
        (
            r
            for r, s in zip(experiment.runs, posterior.samples, strict=True)
            if s.structure is not None
        ),
        None,
    )
    if run is None:
        return
    # As the description has it: what was estimated has been bent to bear the mistake.
    samples = prepare(experiment, run, thin=True, commanded=True)
    few = samples.part(slice(None, None, max(1, len(samples) // _MOST_SAMPLES)))
    assert few.tension is not None
    m = few.tension.shape[1]
    as_it_is = _misfit(few, np.arange(m))
    best, pair = as_it_is, (0, 0)
    for i, j in combinations(range(m), 2):
        order = np.arange(m)
        order[[i, j]] = j, i
        misfit = _misfit(few, order)
        if misfit < best:
            best, pair = misfit, (i, j)
    if best < _MUCH_BETTER * as_it_is:
        yield (
            f"with the columns of cables {pair[0] + 1} and {pair[1] + 1} exchanged the residual"
            f" would fall to {best / as_it_is:.0%}; check the order of the force sensors"
        )


def _misfit(samples: Samples, order: NDArray[np.intp]) -> float:
    """Mean square of the residual of a body with offsets, for tensions in another order; the
    geometry of the cables hardly changes.
    """
    assert samples.structure is not None
    assert samples.tension is not None
    tension = samples.tension[:, order]
    W = samples.structure
    Y = platform_regressor(samples.specific_force, samples.omega, samples.alpha)
    scale = np.sqrt(np.mean(np.sum(W**2, axis=2), axis=0))
    columns = np.concatenate([Y, W], axis=2) / scale[:, None]
    target = np.einsum("nkm,nm->nk", W, tension) / scale
    precision = np.zeros(columns.shape[2])
    precision[BODY.stop :] = (_OFFSET * max(float(np.median(np.abs(tension))), 1e-9)) ** -2
    fitted = unknown_body(columns, target, precision, ridge=_RIDGE)
    count = target.size + W.shape[2]
    lost = float(np.sum(fitted.residual**2)) + fitted.penalty
    return float(lost / count)
