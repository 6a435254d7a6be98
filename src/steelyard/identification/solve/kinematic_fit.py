"""What the motion instruments say about each other: biases, misalignments, clocks and frames from
kinematics alone.

Attitude, gyro, accelerometer and tracker look at one motion. A spline through all of their raw
samples, each at its own time, with every systematic error as a further unknown with its prior,
tells those errors as far as the instruments contradict each other; what they leave open keeps its
prior. No force is used, so no body enters.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.experiment.model import Experiment, Run
from steelyard.identification.model.calibration_parameters import (
    ROBOT,
    Calibration,
    CalibrationParameters,
    clock_of,
)
from steelyard.identification.model.motion_residuals import Segment, Tally, motion_residuals
from steelyard.identification.model.preparation import Samples
from steelyard.identification.model.segment import POSE, NormalEquations, accumulate
from steelyard.identification.model.sources import Source
from steelyard.identification.solve.segmentation import poses_of, readings_between, started
from steelyard.smoothing import knots

_LONGEST = 120.0
"""Length of recording that tells the calibration [s]; constants need no more."""
_SHORTEST = 3.0
"""Least length of recording taken from each run [s]."""
_STEPS = 12
_CONVERGED = 0.1
"""Largest last step of a systematic error, in its 1-sigma; a clock that moves lets samples in and
out, so that it never ends at zero."""
_LARGER = 1.3
"""Residuals that are so much larger than the stated noise replace it."""


@dataclass(frozen=True, eq=False)
class KinematicFit:
    """Systematic errors after the motion instruments have been compared."""

    calibration: Calibration
    covariance: Array
    """Of all of them, shape (u, u)."""
    ratios: Mapping[Source, float]
    """Residuals of each quantity in units of its stated noise, root mean square; of about 1 where
    the noise is as stated."""
    converged: bool
    segments: tuple[Segment, ...] = ()
    """The motion, as fitted."""


def fit_kinematics(
    experiment: Experiment,
    calibration_parameters: CalibrationParameters,
    samples: Sequence[Samples],
) -> KinematicFit:
    """Compare the motion instruments of an experiment.

    Args:
        experiment: With its runs.
        calibration_parameters: Its systematic errors.
        samples: Of the runs in motion, with their plans: the same cuts and knots are used.
    """
    values = calibration_parameters.mean.copy()
    prior = KinematicFit(
        Calibration(calibration_parameters, values),
        np.diag(calibration_parameters.deviation**2),
        {},
        True,
    )
    share = max(_SHORTEST, _LONGEST / max(1, len(samples)))
    runs = {run.name: run for run in experiment.runs}
    segments = [
        segment
        for each in samples
        for segment in _segments(
            experiment, runs[each.run], each, Calibration(calibration_parameters, values), share
        )
    ]
    active = told_about(experiment, calibration_parameters, segments)
    if not segments or not active.any():
        return prior
    fitted, moved = _solve(experiment, calibration_parameters, segments, active, {})
    larger = {source: ratio for source, ratio in fitted.ratios.items() if ratio > _LARGER}
    if larger:
        # A noise that is visibly larger than stated must not count as if it were as stated.
        again, moved = _solve(experiment, calibration_parameters, moved, active, larger)
        fitted = replace(again, ratios=fitted.ratios)
    return replace(fitted, segments=tuple(moved))


def _segments(
    experiment: Experiment, run: Run, samples: Samples, calibration: Calibration, longest: float
) -> Iterator[Segment]:
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
            (samples.time >= start)
            & (samples.time <= end)
            & (samples.time >= times[0])
            & (samples.time <= times[-1])
        )
        readings = tuple(readings_between(experiment, run, calibration, start, end, spacing))
        grid = knots(start, end, spacing)
        coefficients = started(
            samples.time[chosen], poses_of(samples)[chosen], grid, start, end, spacing
        )
        if coefficients is not None and len(readings) > 1:
            yield Segment(run.name, grid, readings, coefficients)


def told_about(
    experiment: Experiment,
    calibration_parameters: CalibrationParameters,
    segments: Sequence[Segment],
) -> NDArray[np.bool_]:
    """Systematic errors that act on the readings and are not known exactly, shape (u,)."""
    active = np.zeros(len(calibration_parameters), dtype=bool)
    for segment in segments:
        for reading in segment.readings:
            name = reading.source[0]
            for term in experiment.instruments[name].terms(calibration_parameters.m):
                active[calibration_parameters.place(name, term.key, segment.run)] = True
            if not segment.static:
                active[
                    calibration_parameters.place(clock_of(experiment, name), "delay", segment.run)
                ] = True
    active[calibration_parameters.places[ROBOT, "gravity", None]] = True
    return active & (calibration_parameters.deviation > 0)


def _solve(
    experiment: Experiment,
    calibration_parameters: CalibrationParameters,
    segments: Sequence[Segment],
    active: NDArray[np.bool_],
    larger: Mapping[Source, float],
) -> tuple[KinematicFit, list[Segment]]:
    """Gauss-Newton over motion and systematic errors."""
    values, count = calibration_parameters.mean.copy(), int(active.sum())
    column_of = np.where(active, np.cumsum(active) - 1, -1)
    deviation = calibration_parameters.deviation[active]
    sources = list(
        dict.fromkeys(reading.source for segment in segments for reading in segment.readings)
    )
    current = list(segments)
    converged = False
    ratios: dict[Source, float] = {}
    covariance = np.diag(calibration_parameters.deviation**2)
    for _ in range(_STEPS):
        tally = Tally()
        equations = [
            accumulate(
                len(segment.coefficients),
                count,
                motion_residuals(
                    experiment,
                    segment,
                    Calibration(calibration_parameters, values),
                    column_of,
                    larger,
                    tally,
                ),
            )
            for segment in current
        ]
        try:
            reduced = [each.reduced() for each in equations]
        except np.linalg.LinAlgError:
            break
        # In units of the prior, where no data can tell less than nothing: of that, rounding of
        # exact data would make negative variances.
        told, axes = np.linalg.eigh(
            deviation[:, None] * np.sum([m for m, _ in reduced], axis=0) * deviation
        )
        gradient = (calibration_parameters.mean - values)[active] / deviation + deviation * np.sum(
            [g for _, g in reduced], axis=0
        )
        unit = (axes / (1 + np.maximum(told, 0.0))) @ axes.T
        step = deviation * (unit @ gradient)
        current = [
            _moved(segment, each, step) for segment, each in zip(current, equations, strict=True)
        ]
        values[active] += step
        found = deviation[:, None] * unit * deviation
        covariance[np.ix_(active, active)] = found
        ratios = {
            source: float(np.sqrt(tally.square[source] / max(tally.count[source], 1.0)))
            for source in sources
        }
        converged = bool(np.all(np.abs(step) < _CONVERGED * np.sqrt(np.diag(found))))
        if converged:
            break
    return (
        KinematicFit(Calibration(calibration_parameters, values), covariance, ratios, converged),
        current,
    )


def _moved(segment: Segment, equations: NormalEquations, border: Array) -> Segment:
    step = equations.motion_step(border).reshape(-1, POSE)
    return replace(segment, coefficients=segment.coefficients + step)
