"""What the motion instruments say about each other: biases, misalignments, clocks and frames from kinematics alone.

Attitude, gyro, accelerometer and tracker look at one motion. A spline through all of their raw samples, each at its own time, with
every systematic error as a further unknown with its prior, tells those errors as far as the instruments contradict each other; what
they leave open keeps its prior. No force is used, so no body enters.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.experiment.model import Experiment, Run
from steelyard.identification.arc import POSE, NormalEquations, accumulate
from steelyard.identification.motion_rows import Arc, Tally, motion_rows
from steelyard.identification.preparation import Samples
from steelyard.identification.recorded_arcs import poses_of, readings_between, started
from steelyard.identification.sources import Source
from steelyard.identification.unknowns import ROBOT, Systematic, Unknowns, clock_of
from steelyard.smoothing import knots

_LONGEST = 120.0
"""Length of recording that tells the calibration [s]; constants need no more."""
_SHORTEST = 3.0
"""Least length of recording taken from each run [s]."""
_STEPS = 12
_CONVERGED = 0.1
"""Largest last step of a systematic error, in its 1-sigma; a clock that moves lets samples in and out, so that it never ends at zero."""
_LARGER = 1.3
"""Residuals that are so much larger than the stated noise replace it."""


@dataclass(frozen=True, eq=False)
class KinematicFit:
    """Systematic errors after the motion instruments have been compared."""

    systematic: Systematic
    covariance: Array
    """Of all of them, shape (u, u)."""
    ratios: Mapping[Source, float]
    """Residuals of each quantity in units of its stated noise, root mean square; of about 1 where the noise is as stated."""
    converged: bool
    arcs: tuple[Arc, ...] = ()
    """The motion, as fitted."""


def fit_kinematics(experiment: Experiment, unknowns: Unknowns, samples: Sequence[Samples]) -> KinematicFit:
    """Compare the motion instruments of an experiment.

    Args:
        experiment: With its runs.
        unknowns: Its systematic errors.
        samples: Of the runs in motion, with their plans: the same cuts and knots are used.
    """
    values = unknowns.mean.copy()
    prior = KinematicFit(Systematic(unknowns, values), np.diag(unknowns.deviation**2), {}, True)
    share = max(_SHORTEST, _LONGEST / max(1, len(samples)))
    runs = {run.name: run for run in experiment.runs}
    arcs = [
        arc for each in samples for arc in _arcs(experiment, runs[each.run], each, Systematic(unknowns, values), share)
    ]
    active = told_about(experiment, unknowns, arcs)
    if not arcs or not active.any():
        return prior
    fitted, moved = _solve(experiment, unknowns, arcs, active, {})
    larger = {source: ratio for source, ratio in fitted.ratios.items() if ratio > _LARGER}
    if larger:
        # A noise that is visibly larger than stated must not count as if it were as stated.
        again, moved = _solve(experiment, unknowns, moved, active, larger)
        fitted = replace(again, ratios=fitted.ratios)
    return replace(fitted, arcs=tuple(moved))


def _arcs(experiment: Experiment, run: Run, samples: Samples, systematic: Systematic, longest: float) -> Iterator[Arc]:
    if samples.plan is None or samples.rotation is None:
        return
    spacing = samples.plan.spacing
    for start, end, times in samples.plan.parts:
        if longest < _SHORTEST:
            return
        if end - start < 4 * spacing:
            continue
        end = min(end, start + longest)
        longest -= end - start
        chosen = (
            (samples.time >= start) & (samples.time <= end) & (samples.time >= times[0]) & (samples.time <= times[-1])
        )
        readings = tuple(readings_between(experiment, run, systematic, start, end, spacing))
        grid = knots(start, end, spacing)
        coefficients = started(samples.time[chosen], poses_of(samples)[chosen], grid, start, end, spacing)
        if coefficients is not None and len(readings) > 1:
            yield Arc(run.name, grid, readings, coefficients)


def told_about(experiment: Experiment, unknowns: Unknowns, arcs: Sequence[Arc]) -> NDArray[np.bool_]:
    """Systematic errors that act on the readings and are not known exactly, shape (u,)."""
    active = np.zeros(len(unknowns), dtype=bool)
    for arc in arcs:
        for reading in arc.readings:
            name = reading.source[0]
            for term in experiment.instruments[name].terms(unknowns.m):
                active[unknowns.place(name, term.key, arc.run)] = True
            if not arc.static:
                active[unknowns.place(clock_of(experiment, name), "delay", arc.run)] = True
    active[unknowns.places[ROBOT, "gravity", None]] = True
    return active & (unknowns.deviation > 0)


def _solve(
    experiment: Experiment,
    unknowns: Unknowns,
    arcs: Sequence[Arc],
    active: NDArray[np.bool_],
    larger: Mapping[Source, float],
) -> tuple[KinematicFit, list[Arc]]:
    """Gauss-Newton over motion and systematic errors."""
    values, count = unknowns.mean.copy(), int(active.sum())
    column_of = np.where(active, np.cumsum(active) - 1, -1)
    deviation = unknowns.deviation[active]
    sources = list(dict.fromkeys(reading.source for arc in arcs for reading in arc.readings))
    current = list(arcs)
    converged = False
    ratios: dict[Source, float] = {}
    covariance = np.diag(unknowns.deviation**2)
    for _ in range(_STEPS):
        tally = Tally()
        equations = [
            accumulate(
                len(arc.coefficients),
                count,
                motion_rows(experiment, arc, Systematic(unknowns, values), column_of, larger, tally),
            )
            for arc in current
        ]
        try:
            reduced = [each.reduced() for each in equations]
        except np.linalg.LinAlgError:
            break
        # In units of the prior, where no data can tell less than nothing: of that, rounding of exact data would make negative variances.
        told, axes = np.linalg.eigh(deviation[:, None] * np.sum([m for m, _ in reduced], axis=0) * deviation)
        gradient = (unknowns.mean - values)[active] / deviation + deviation * np.sum([g for _, g in reduced], axis=0)
        unit = (axes / (1 + np.maximum(told, 0.0))) @ axes.T
        step = deviation * (unit @ gradient)
        current = [_moved(arc, each, step) for arc, each in zip(current, equations, strict=True)]
        values[active] += step
        found = deviation[:, None] * unit * deviation
        covariance[np.ix_(active, active)] = found
        ratios = {source: float(np.sqrt(tally.square[source] / max(tally.count[source], 1.0))) for source in sources}
        converged = bool(np.all(np.abs(step) < _CONVERGED * np.sqrt(np.diag(found))))
        if converged:
            break
    return KinematicFit(Systematic(unknowns, values), covariance, ratios, converged), current


def _moved(arc: Arc, equations: NormalEquations, border: Array) -> Arc:
    step = equations.motion_step(border).reshape(-1, POSE)
    return replace(arc, coefficients=arc.coefficients + step)
