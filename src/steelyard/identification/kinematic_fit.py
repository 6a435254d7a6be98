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
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from steelyard.arrays import Array
from steelyard.experiment.model import Experiment, Run, is_motion
from steelyard.identification.arc import POSE, Basis, NormalEquations, Rows, accumulate, basis, motion_at, spread
from steelyard.identification.preparation import Samples
from steelyard.identification.smoothing import DEGREE, Samples1D, fit, knots
from steelyard.identification.sources import Source
from steelyard.identification.unknowns import ROBOT, Systematic, Unknowns, clock_of
from steelyard.instruments.equations import linearised

_LONGEST = 120.0
"""Length of recording that tells the calibration [s]; constants need no more."""
_SHORTEST = 3.0
"""Least length of recording taken from each run [s]."""
_STEPS = 12
_CONVERGED = 0.1
"""Largest last step of a systematic error, in its 1-sigma; a clock that moves lets samples in and out, so that it never ends at zero."""
_UNIT = 0.01
"""How loosely the length of the quaternion is held near one; nothing depends on it."""
_PLACE, _SPEED = 100.0, 10.0
"""1-sigma of where a platform may be [m] and how fast it may move [m/s], where no instrument tells: it does not fly away."""
_LARGER = 1.3
"""Residuals that are so much larger than the stated noise replace it."""


@dataclass(frozen=True, eq=False)
class Reading:
    """Samples of one quantity of one instrument within an arc."""

    source: Source
    time: Array
    """By the instrument's clock, moved to the common event: common time plus delay [s], shape (n,)."""
    values: Array
    sigma: float
    """1-sigma per sample and axis."""


@dataclass(frozen=True, eq=False)
class Arc:
    """A stretch of a run with one spline."""

    run: str
    knots: Array
    readings: tuple[Reading, ...]
    coefficients: Array
    """Of the pose, shape (f, 7)."""


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
    active = _active(experiment, unknowns, arcs)
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
        readings = tuple(_readings(experiment, run, systematic, start, end, spacing))
        grid = knots(start, end, spacing)
        coefficients = _start(samples, chosen, grid, start, end, spacing)
        if coefficients is not None and len(readings) > 1:
            yield Arc(run.name, grid, readings, coefficients)


def _readings(
    experiment: Experiment, run: Run, systematic: Systematic, start: float, end: float, spacing: float
) -> Iterator[Reading]:
    for name, stream in run.streams.items():
        instrument = experiment.instruments[name]
        if not is_motion(instrument):
            continue
        time = experiment.common_time(run, name, 0.0)
        common = time - systematic.delay(clock_of(experiment, name), run.name)
        for quantity in instrument.quantities(experiment.robot.m):
            if quantity.name not in stream.values:
                continue
            values = stream.values[quantity.name]
            use = np.isfinite(values.reshape(len(values), -1)).all(axis=1) & (common >= start) & (common <= end)
            sigma = quantity.noise or _scatter(common[use], values[use], start, end, spacing)
            if sigma is not None and use.any():
                yield Reading((name, quantity.name), time[use], values[use], sigma)


_LEAST_NOISE = 1e-4
"""Of a quantity that scatters by nothing but rounding, as a part of how much it varies: no sensor resolves more."""


def _scatter(time: Array, values: Array, start: float, end: float, spacing: float) -> float | None:
    """1-sigma of the samples about their own spline; None where they do not determine one."""
    flat = values.reshape(len(values), -1)
    fitted = fit(Samples1D(time, flat), start, end, spacing, robust=True) if len(time) else None
    if fitted is None:
        return None
    # Nine elements of a rotation matrix scatter by sqrt(6 / 9) of the rotation vector.
    scale = np.sqrt(1.5) if values.ndim == 3 else 1.0
    least = _LEAST_NOISE * float(flat.std(axis=0).max()) + 1e-9 * float(np.abs(flat).max()) + 1e-12
    return max(fitted.sigma * scale, least)


def _start(
    samples: Samples, chosen: NDArray[np.bool_], grid: Array, start: float, end: float, spacing: float
) -> Array | None:
    """Coefficients of the pose that the samples show."""
    assert samples.rotation is not None
    time = samples.time[chosen]
    quaternion = Rotation.from_matrix(samples.rotation[chosen]).as_quat(scalar_first=True)
    flips = np.where(np.sum(quaternion[1:] * quaternion[:-1], axis=1) < 0, -1.0, 1.0)
    quaternion *= np.concatenate([[1.0], np.cumprod(flips)])[:, None]
    position = np.zeros((len(time), 3)) if samples.position is None else samples.position[chosen]
    pose = np.hstack([position, quaternion])
    if len(time) <= 1:
        return None
    # Samples do not reach the ends, and may be few: the nearest pose stands in there.
    fine = np.linspace(start, end, 3 * (len(grid) - DEGREE))
    filled = np.column_stack([np.interp(fine, time, column) for column in pose.T])
    fitted = fit(Samples1D(fine, filled), start, end, spacing)
    return None if fitted is None else np.asarray(fitted.spline.c[:, :POSE])


def _active(experiment: Experiment, unknowns: Unknowns, arcs: Sequence[Arc]) -> NDArray[np.bool_]:
    """Systematic errors that act on the readings and are not known exactly, shape (u,)."""
    active = np.zeros(len(unknowns), dtype=bool)
    for arc in arcs:
        for reading in arc.readings:
            name = reading.source[0]
            for term in experiment.instruments[name].terms(unknowns.m):
                active[unknowns.place(name, term.key, arc.run)] = True
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
    deviation = unknowns.deviation[active]
    current = list(arcs)
    converged = False
    ratios: dict[Source, float] = {}
    covariance = np.diag(unknowns.deviation**2)
    for _ in range(_STEPS):
        squares: dict[Source, list[tuple[float, int]]] = {}
        equations = [
            accumulate(
                len(arc.coefficients),
                count,
                motion_rows(experiment, arc, Systematic(unknowns, values), active, larger, squares),
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
        ratios = {
            source: float(np.sqrt(sum(s for s, _ in pairs) / sum(n for _, n in pairs)))
            for source, pairs in squares.items()
        }
        converged = bool(np.all(np.abs(step) < _CONVERGED * np.sqrt(np.diag(found))))
        if converged:
            break
    return KinematicFit(Systematic(unknowns, values), covariance, ratios, converged), current


def _moved(arc: Arc, equations: NormalEquations, border: Array) -> Arc:
    step = equations.motion_step(border).reshape(-1, POSE)
    return replace(arc, coefficients=arc.coefficients + step)


def motion_rows(
    experiment: Experiment,
    arc: Arc,
    systematic: Systematic,
    active: NDArray[np.bool_],
    larger: Mapping[Source, float],
    squares: dict[Source, list[tuple[float, int]]],
) -> Iterator[Rows]:
    """Whitened readings of an arc, then what holds the motion where no instrument does.

    Args:
        experiment: With its instruments.
        arc: With readings and present motion.
        systematic: Present values of the systematic errors.
        active: Which of them are unknown, shape (u,).
        larger: Quantity -> by how much its noise exceeds what was stated.
        squares: Is given the sum of squares and the count of the residuals of each quantity.
    """
    unknowns = systematic.unknowns
    column_of, count = np.cumsum(active) - 1, int(active.sum())
    references = reference_clocks(experiment, unknowns, arc)
    for reading in arc.readings:
        name, quantity = reading.source
        instrument = experiment.instruments[name]
        own, reference = clock_of(experiment, name), references[clock_of(experiment, name)]
        clock, origin = (unknowns.place(each, "delay", arc.run) for each in (own, reference))
        delay = systematic.values[clock] - systematic.values[origin] + unknowns.mean[origin]
        times = reading.time - delay[0]
        # A clock that has moved may carry samples out of the arc.
        inside = (times >= arc.knots[0]) & (times <= arc.knots[-1])
        times = np.clip(times, arc.knots[0], arc.knots[-1])
        local = basis(arc.knots, times)
        motion = motion_at(local, arc.coefficients)
        errors = list(systematic.of(name, instrument, arc.run).values())
        linear = linearised(
            instrument, quantity, experiment.robot, reading.values, motion[:3],
            np.concatenate(errors) if errors else np.zeros(1), systematic.gravity,
        )  # fmt: skip
        by = (linear["by_pose"], linear["by_rate"], linear["by_acceleration"])
        # A later clock looks at an earlier instant of the motion.
        by_delay = -sum(np.einsum("nki,ni->nk", jacobian, rate) for jacobian, rate in zip(by, motion[1:], strict=True))
        by_errors = np.zeros((*linear["residual"].shape, count))

        def put(place: slice, derivative: Array) -> None:
            use = active[place]
            by_errors[:, :, column_of[place][use]] += derivative[:, :, use]  # noqa: B023

        column = 0
        for term in instrument.terms(unknowns.m):
            put(unknowns.place(name, term.key, arc.run), linear["by_errors"][:, :, column : column + term.size])
            column += term.size
        put(clock, by_delay[:, :, None])
        put(origin, -by_delay[:, :, None])
        put(unknowns.places[ROBOT, "gravity", None], linear["by_gravity"])
        sigma = reading.sigma * larger.get(reading.source, 1.0)
        residual = linear["residual"] / sigma
        size = np.sqrt(np.sum(residual**2, axis=1))
        # Spikes count no more than what noise may reach once in ten thousand samples [Huber1964]_.
        weight = (inside * np.sqrt(np.minimum(1.0, _cut(residual.shape[1]) / np.maximum(size, 1e-300))))[:, None]
        squares.setdefault(reading.source, []).append(_squares(size[inside], residual.shape[1]))
        yield Rows(
            local.first,
            weight * residual,
            weight[:, :, None] * spread(local, *by) / sigma,
            weight[:, :, None] * by_errors / sigma,
        )
    yield _held(arc, count)


def reference_clocks(experiment: Experiment, unknowns: Unknowns, arc: Arc) -> dict[str, str]:
    """Clock -> clock whose time the motion is told in, the best known one of those that can be compared.

    Motion and all clocks moved together read the same. Without a reference the knots, which stay, would seem to tell the time.
    """
    rotating, moving = dict[str, None](), dict[str, str]()
    for name, quantity in (reading.source for reading in arc.readings):
        clock = clock_of(experiment, name)
        if quantity in {"position", "specific_force"}:
            moving[name] = clock
        else:
            rotating[clock] = None
    # Place and acceleration are compared, and attitude with both; one of them alone fits any attitude.
    alone = len(moving) == 1 and not rotating.keys() & set(moving.values())
    groups = [rotating.keys(), set(moving.values())] if alone else [dict.fromkeys([*rotating, *moving.values()]).keys()]

    def known(clock: str) -> float:
        return float(unknowns.deviation[unknowns.place(clock, "delay", arc.run)][0])

    return {clock: min(group, key=known) for group in groups for clock in group}


def _squares(size: Array, k: int) -> tuple[float, int]:
    """Sum of the squares of whitened residuals of k numbers each, and how many numbers; without spikes, which tell no noise."""
    usual = float(np.median(size)) / np.sqrt(chi2.ppf(0.5, k)) if len(size) else 1.0
    kept = size[size <= _cut(k) * max(1.0, usual)]
    return float(np.sum(kept**2)), len(kept) * k


def _cut(k: int) -> float:
    return float(np.sqrt(chi2.ppf(1 - 1e-4, k)))


def _held(arc: Arc, border: int) -> Rows:
    """Length of the quaternion near one; place and speed of a platform within a hall."""
    inner = arc.knots[DEGREE : len(arc.knots) - DEGREE]
    # At the knots too: the first and the last coefficient hardly show anywhere else.
    local: Basis = basis(arc.knots, np.sort(np.concatenate([inner, (inner[1:] + inner[:-1]) / 2])))
    pose, rate, *_ = motion_at(local, arc.coefficients)
    n = len(pose)
    by_pose, by_rate = np.zeros((n, 7, POSE)), np.zeros((n, 7, POSE))
    by_pose[:, 0, 3:] = 2 * pose[:, 3:] / _UNIT
    by_pose[:, 1:4, :3] = np.eye(3) / _PLACE
    by_rate[:, 4:7, :3] = np.eye(3) / _SPEED
    residual = np.hstack(
        [(np.sum(pose[:, 3:] ** 2, axis=1, keepdims=True) - 1) / _UNIT, pose[:, :3] / _PLACE, rate[:, :3] / _SPEED]
    )
    return Rows(local.first, residual, spread(local, by_pose, by_rate), np.zeros((n, 7, border)))
