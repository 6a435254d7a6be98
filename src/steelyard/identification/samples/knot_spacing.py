"""How fine the knots of a motion must be: the marginal likelihood of single streams under splines
of different spacing.

A stream is a spline plus white noise. The spline has a proper prior, white noise in the derivative
that is the motion's third, so that splines of any number of knots are compared as what they are:
distributions of readings. Everything is banded.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy.interpolate import BSpline
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.optimize import minimize_scalar
from scipy.sparse import csr_array, dia_array

from steelyard.arrays import Array
from steelyard.experiment.model import Experiment
from steelyard.identification.model.settings import MOTION, MotionSettings
from steelyard.identification.samples.motion_noise import LEAST_RAPID, rapid_scatter
from steelyard.identification.samples.motion_streams import MotionStream, steps_of
from steelyard.rotations import quaternions_of
from steelyard.smoothing import DEGREE, knots

_TIMES, _ALIKE = 4, 1.1
"""That a variance is looked at again, and what is alike: the prior of what jerk leaves open is in
it."""


@dataclass(frozen=True, eq=False)
class Channelled:
    """Samples of one stream: n times [s], never decreasing, and k channels."""

    time: Array
    values: Array
    """Shape (n, k)."""
    order: int
    """Derivative of the motion that it reads: 0 the pose, 1 its rate, 2 its acceleration."""
    sigma: float | None
    """1-sigma per sample; None: not stated."""
    is_place: bool = False
    """Whether it reads where something is, which may jump."""


def evidence(stream: Channelled, grid: Array, settings: MotionSettings = MOTION) -> float:
    """Largest log likelihood of a stream over the intensity of the noise in its derivative, and
    over its own noise, which is what is stated at least.

    Args:
        stream: Within the knots.
        grid: Knots of a quintic spline [s].
        settings: Of the prior and the search.
    """
    n, k = stream.values.shape
    centred = stream.values - stream.values.mean(axis=0)
    # In units of how far they vary, so that nothing depends on theirs.
    span = float(np.abs(centred).max(initial=0.0))
    if not span:
        return 0.0
    values, sigma = centred / span, None if stream.sigma is None else stream.sigma / span
    design = csr_array(BSpline.design_matrix(np.clip(stream.time, grid[0], grid[-1]), grid, DEGREE))
    gram, right = _band(design.T @ design), np.asarray(design.T @ values)
    square = float(np.sum(values**2))
    smooth = _integral(grid, 3 - stream.order)
    flat = _integral(grid, 0) / (settings.undamped**2 * (grid[-1] - grid[0]))
    # A first guess: derivatives as the range and the spacing have it.
    spacing = (grid[-1] - grid[0]) / max(len(grid) - 2 * DEGREE - 1, 1)
    first = np.log(settings.first_jerk / spacing ** (2 * (3 - stream.order) - 1))

    noise = settings.unstated_noise if sigma is None else sigma
    least_variance = 0.0 if sigma is None else sigma**2

    def minus(log_intensity: float) -> float:
        # The intensity is in units of the variance of the noise, which is likeliest as the misfit
        # has
        # it: stamps that jitter make readings noisier than stated, and are no motion.
        variance = noise**2
        for _ in range(_TIMES if sigma is not None else 1):
            prior = smooth / np.exp(log_intensity) + flat * variance
            try:
                prior_factor = cholesky_banded(prior, lower=True, check_finite=False)
                factor = cholesky_banded(gram + prior, lower=True, check_finite=False)
            except np.linalg.LinAlgError:
                return np.inf
            fitted = cho_solve_banded((factor, True), right, check_finite=False)
            misfit = max(square - float(np.sum(fitted * right)), 1e-18 * square + 1e-300)
            before, variance = variance, max(misfit / (n * k), least_variance)
            if variance < _ALIKE * before:
                break
        volume = 2 * k * float(np.sum(np.log(factor[0])) - np.sum(np.log(prior_factor[0])))
        return float(0.5 * (misfit / variance + n * k * float(np.log(variance)) + volume))

    first -= 2 * np.log(noise)
    least, most = settings.jerk_range
    found = minimize_scalar(
        minus,
        bounds=(first + np.log(least), first + np.log(most)),
        method="bounded",
        options={"xatol": settings.jerk_tolerance, "maxiter": settings.jerk_iterations},
    )
    return float(-found.fun - n * k * np.log(span))


def best_spacing(
    streams: Sequence[Channelled],
    candidates: Sequence[float],
    start: float,
    end: float,
    *,
    settings: MotionSettings = MOTION,
) -> float:
    """The widest spacing of knots that is about as likely as the best.

    What is fast shows in rates and accelerations by far the most. Where these are quiet, and finer
    knots than they ask for only make them worse, a place that jumps is no motion.

    Args:
        streams: Of one motion.
        candidates: Spacings [s], ascending.
        start: Of the interval to judge on [s].
        end: Of the interval [s].
        settings: With what is about as likely.
    """
    found = _evidences(streams, candidates, start, end, settings)
    best = _widest(found, settings)
    if {1, 2} <= {each.order for each in streams if _is_quiet(each, settings)}:
        beside = _widest(found[[not each.is_place for each in streams]], settings)
        of_rates = found[[each.order > 0 for each in streams]].sum(axis=0)
        if (
            candidates[beside] > settings.much_wider * candidates[best]
            and of_rates[best] < of_rates[beside] - settings.no_motion
        ):
            best = beside
    return candidates[best]


def _evidences(
    streams: Sequence[Channelled],
    candidates: Sequence[float],
    start: float,
    end: float,
    settings: MotionSettings,
) -> Array:
    """Evidence of each stream on knots of each spacing, shape (s, c): nothing of a stream that is
    not there.
    """
    found = np.zeros((len(streams), len(candidates)))
    grids = [knots(start, end, spacing) for spacing in candidates]
    for stream, row in zip(streams, found, strict=True):
        use = (stream.time >= start) & (stream.time <= end)
        if use.sum() > 2 * DEGREE:
            part = replace(stream, time=stream.time[use], values=stream.values[use])
            row[:] = [evidence(part, grid, settings) for grid in grids]
    return found


def _is_quiet(stream: Channelled, settings: MotionSettings) -> bool:
    """Whether what is fast in a stream is no more than its stated noise."""
    if stream.sigma is None or len(stream.values) < LEAST_RAPID:
        return False
    return rapid_scatter(stream.values) < settings.shaken * stream.sigma


def _widest(found: Array, settings: MotionSettings) -> int:
    """Place of the widest spacing that is about as likely as the best, by evidences of shape (s,
    c); the first where there are none.
    """
    if not found.any():
        return 0
    whole = found.sum(axis=0)
    return int(np.flatnonzero(whole >= whole.max() - settings.as_likely)[-1])


def closest_spacing(
    experiment: Experiment, streams: Sequence[MotionStream], settings: MotionSettings
) -> float:
    """Spacing of the knots that the instruments of the motion resolve at all [s].

    Args:
        experiment: With its robot.
        streams: That tell the motion.
        settings: With the limits.
    """
    limit = settings.finest if experiment.robot.m else settings.finest_on_sensor
    return float(max(limit, settings.per_knot * max(steps_of(streams).values())))


def relative_stretch(
    experiment: Experiment, streams: Sequence[MotionStream], tension: Array | None
) -> float:
    """By how much cables stretch more and less along a motion, over the stated noise of the lengths
    that are read of them; 0: they do not, or nobody has stated or read it.

    Args:
        experiment: With its robot.
        streams: That tell the motion.
        tension: Of the cables [N], shape (n, m); None: nobody reads them.
    """
    robot = experiment.robot
    read = [each.sigma for each in streams if each.needs_tension and each.sigma]
    if tension is None or not robot.cable.axial_stiffness or not read:
        return 0.0
    # Of a platform in the middle.
    length = np.linalg.norm(robot.anchors - robot.anchors.mean(axis=0), axis=1)
    stretch = length * np.nanstd(tension, axis=0) / robot.cable.axial_stiffness
    return float(np.median(stretch) / min(read))


def chosen_spacing(
    experiment: Experiment,
    streams: Sequence[MotionStream],
    stretches: Sequence[tuple[float, float]],
    settings: MotionSettings,
    tension: Array | None = None,
) -> tuple[float, float]:
    """Spacing of the knots: as fine as the readings ask for, and somewhat finer; and what they
    could resolve, see :class:`Recorded`.

    Lengths of cables that stretch read accelerations, which splines follow worst: by more than
    their noise they ask for finer knots than what reads the motion itself.

    Args:
        experiment: With its robot.
        streams: That tell the motion.
        stretches: Beginning and end of each that is fitted [s].
        settings: With the limits.
        tension: Of the cables [N], shape (n, m); None: nobody reads them.
    """
    if not stretches:
        return settings.widest, np.inf
    start, end = max(stretches, key=lambda part: part[1] - part[0])
    end = min(end, start + settings.judged)
    channelled = []
    for stream in streams:
        values, sigma = stream.values, stream.sigma
        if values.ndim == 3:
            values = quaternions_of(values)
            # A quaternion turns half as fast as the rotation vector.
            sigma = sigma / 2 if sigma else None
        complete = np.isfinite(values).all(axis=1)
        is_place = not stream.order and "position" in stream.determines
        channelled.append(
            Channelled(stream.common[complete], values[complete], stream.order, sigma, is_place)
        )
    limit = settings.finest if experiment.robot.m else settings.finest_on_sensor
    finest = closest_spacing(experiment, streams, settings)
    widest = max(finest, min(settings.widest, (end - start) / 8))
    count = 1 + int(np.ceil(2 * np.log2(widest / finest)))
    candidates = [float(each) for each in np.geomspace(finest, widest, count)]
    best = best_spacing(channelled, candidates, start, end, settings=settings)
    force_samples = [
        float(np.median(np.diff(s.common)))
        for s in streams
        if s.source[1] == "specific_force" and len(s.common) > 1
    ]
    # Where the readings would have it finer than they resolve, it is no use to go on.
    resolved = (
        max(limit, settings.per_vibration * min(force_samples))
        if force_samples and best > finest
        else np.inf
    )
    much = relative_stretch(experiment, streams, tension) > settings.much_stretched
    finer = settings.finer_stretched if much else settings.finer
    return float(max(finest, best / finer)), resolved


def _integral(grid: Array, order: int) -> Array:
    """Matrix of the integral of a squared derivative, lower banded form, shape (6, f); runs that
    are alike have the same knots.
    """
    return _integral_of(grid.tobytes(), order)


@lru_cache(maxsize=64)
def _integral_of(knots_in_bytes: bytes, order: int) -> Array:
    """The same of knots that can be compared."""
    grid = np.frombuffer(knots_in_bytes)
    inner = grid[DEGREE : len(grid) - DEGREE]
    nodes, weights = np.polynomial.legendre.leggauss(DEGREE - order + 1)
    half = np.diff(inner) / 2
    times = ((inner[1:] + inner[:-1]) / 2)[:, None] + half[:, None] * nodes
    root = np.sqrt((half[:, None] * weights).ravel())
    count = len(grid) - DEGREE - 1
    derivative = csr_array(
        BSpline.design_matrix(times.ravel(), grid[order : len(grid) - order], DEGREE - order)
    )
    for step in range(order - 1, -1, -1):
        # Coefficients of the derivative of a spline are scaled differences of its own.
        degree = DEGREE - step
        own = grid[step : len(grid) - step]
        size = count - step
        scale = degree / (own[degree + 1 : degree + size] - own[1:size])
        differences = dia_array(
            (np.array([np.append(-scale, 0.0), np.append(0.0, scale)]), [0, 1]),
            shape=(size - 1, size),
        )
        derivative = csr_array(derivative @ differences)
    weighted = csr_array(derivative.multiply(root[:, None]))
    band = _band(weighted.T @ weighted)
    band.flags.writeable = False
    return band


def _band(matrix: csr_array) -> Array:
    """A symmetric matrix of the width of the splines in lower banded form."""
    size = matrix.shape[0]
    band = np.zeros((DEGREE + 1, size))
    for d in range(DEGREE + 1):
        diagonal = matrix.diagonal(-d)
        band[d, : len(diagonal)] = diagonal
    return band
