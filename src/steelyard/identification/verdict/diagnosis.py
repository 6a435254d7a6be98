"""Where forces and motion contradict each other beyond measure: which simple mistake would explain
it.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from steelyard.dynamics import platform_regressor
from steelyard.identification.model.unknown_body import BODY, unknown_body
from steelyard.identification.samples.preparation import prepare
from steelyard.identification.samples.prepared import Samples
from steelyard.identification.solve.posterior import Posterior
from steelyard.identification.verdict.settings import VERDICT, VerdictSettings

_RIDGE = 1e-10
"""Of the fit of a body whose ten the motion may not tell."""


def diagnose(posterior: Posterior, settings: VerdictSettings = VERDICT) -> Iterator[str]:
    """Mistakes of description that would explain a recording that does not balance, in words."""
    yield from _accelerometer(posterior, settings)
    yield from _swap(posterior, settings)


def _accelerometer(posterior: Posterior, settings: VerdictSettings) -> Iterator[str]:
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
        if abs(factor + 1) < settings.near:
            yield (
                f"run '{run.name}': the accelerometer feels gravity upside down; check the sign of"
                " 'gravity' in the robot file and of the accelerometer's columns"
            )
        elif abs(factor * 9.80665 - 1) < settings.near:
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


def _swap(posterior: Posterior, settings: VerdictSettings) -> Iterator[str]:
    """Two force columns exchanged."""
    experiment = posterior.experiment
    run = next(
        (
            r
            for r, s in zip(experiment.runs, posterior.samples, strict=True)
            if s.tension is not None
        ),
        None,
    )
    if run is None:
        return
    # As the description has it: what was estimated has been bent to bear the mistake.
    samples = prepare(experiment, run, thin=True, commanded=True)
    few = samples.part(slice(None, None, max(1, len(samples) // settings.swap_samples)))
    assert few.tension is not None
    m = few.tension.shape[1]
    as_it_is = _misfit(few, np.arange(m), settings.swap_offset)
    best, pair = as_it_is, (0, 0)
    for i, j in combinations(range(m), 2):
        order = np.arange(m)
        order[[i, j]] = j, i
        misfit = _misfit(few, order, settings.swap_offset)
        if misfit < best:
            best, pair = misfit, (i, j)
    if best < settings.swap_better * as_it_is:
        yield (
            f"with the columns of cables {pair[0] + 1} and {pair[1] + 1} exchanged the residual"
            f" would fall to {best / as_it_is:.0%}; check the order of the force sensors"
        )


def _misfit(samples: Samples, order: NDArray[np.intp], offset: float) -> float:
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
    precision[BODY.stop :] = (offset * max(float(np.median(np.abs(tension))), 1e-9)) ** -2
    fitted = unknown_body(columns, target, precision, ridge=_RIDGE)
    count = target.size + W.shape[2]
    lost = float(np.sum(fitted.residual**2)) + fitted.penalty
    return float(lost / count)
