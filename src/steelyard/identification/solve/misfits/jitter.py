"""Time stamps that scatter: noise where the readings change quickly, none where they rest.

A stamp that is late by the absolute value of a normal number of 1-sigma j is late by a mean that
the delay of the clock takes up, and scatters about it by j sqrt(1 - 2 / pi). What that makes of a
reading is its rate times as much, white from sample to sample.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.optimize import minimize_scalar

from steelyard.arrays import Array
from steelyard.identification.model.balance import Forces
from steelyard.identification.model.looked_at import looked_at, rate_along
from steelyard.identification.model.motion_segment import Reading, Segment
from steelyard.identification.model.reading_times import reference_clocks
from steelyard.identification.model.sources import Source
from steelyard.identification.solve.fit_state import Fit, FitState, Task
from steelyard.identification.solve.joint_fit import fit

SCATTER = float(np.sqrt(1 - 2 / np.pi))
"""1-sigma of the absolute value of a standard normal number."""
_APART = 0.05
"""Time after which stamps scatter anew [s]: a logger that writes messages in the order in which
they came makes those that follow each other late together."""
_ORDER = 2
"""Of the polynomials that show the rate of force readings."""
_FEWEST = 7
"""Samples that they go through, at least."""
_CHANGING = 0.25
"""Part of the squared rate that a motion gives them, which readings show at least if they follow
it."""
_HALF = 0.1
"""Half the time that they go through [s]: forces on platforms follow motions of a few hertz."""


def with_jitter(task: Task, state: FitState) -> tuple[Task, FitState]:
    """Task and state whose readings are as noisy as their time stamps make them, about the present
    motion; the very same where no stamp scatters.
    """
    jitters = _jitters(task, state)
    if not jitters:
        return task, state
    segments, force_samples = [], []
    for segment, forces in zip(state.segments, task.force_samples, strict=True):
        if segment.static:
            segments.append(segment)
            force_samples.append(forces)
            continue
        readings = tuple(
            _with_lateness(task, state, segment, each, SCATTER * jitters[each.source[0]])
            if each.source[0] in jitters
            else each
            for each in segment.readings
        )
        segments.append(replace(segment, readings=readings))
        if forces is not None and forces.name in jitters:
            forces = replace(forces, late=jitters[forces.name] * SCATTER * _force_rates(forces))
        force_samples.append(forces)
    return (
        replace(task, force_samples=tuple(force_samples)),
        replace(state, segments=tuple(segments)),
    )


def _with_lateness(
    task: Task, state: FitState, segment: Segment, reading: Reading, scatter: float
) -> Reading:
    """A reading whose stamps scatter by so much [s]."""
    _, rate = _residual_and_rate(task, state, segment, reading)
    return replace(reading, late=scatter * rate)


def with_jitter_found(task: Task, found: Fit) -> tuple[Task, Fit]:
    """The task with the jitter of time stamps that its residuals ask for, and its fit.

    Raises:
        numpy.linalg.LinAlgError: The motion is not determined.
    """
    first = found
    for _ in task.experiment.instruments:
        asked = _asked(task, found.state)
        if asked is None:
            break
        name, jitter = asked
        state = replace(found.state, jitters={**found.state.jitters, name: jitter})
        # What was taken for larger noise is noise where the motion is fast.
        state = replace(state, factors={k: v for k, v in state.factors.items() if k[0] != name})
        task, state = with_jitter(task, state)
        found = fit(task, state, beginning=True)
    return task, found if found is first else fit(task, found.state)


def _jitters(task: Task, state: FitState) -> dict[str, float]:
    """Instrument -> 1-sigma of its jitter [s], as stated or as found, where it has any."""
    stated = {
        name: each.calibration.jitter
        for name, each in task.experiment.instruments.items()
        if each.calibration.jitter
    }
    return {**state.jitters, **stated}


@dataclass(frozen=True, eq=False)
class _Scattering:
    """Residuals of one quantity, and what a second of lateness would make of them."""

    name: str
    square: Array
    """Squared second differences of residuals shortly after each other, of the size of their
    variance, shape (n,)."""
    by_time: Array
    """Squared rates there, shape (n,)."""
    sigma: float
    """1-sigma of their noise as it is stated, or as it began."""

    @property
    def score(self) -> float:
        """How surely the residuals are larger where the readings change quickly, a standard normal
        number.
        """
        spread = self.by_time - self.by_time.mean()
        usual = float(np.mean(self.square))
        # Of white noise: squares of two second differences that share residuals go together by four
        # ninths and by a thirty-sixth.
        size = usual * np.sqrt(2 * (1 + 2 * (4 / 9 + 1 / 36)) * np.sum(spread**2))
        return float(np.sum(self.square * spread) / size) if size > 0 else 0.0

    def shows(self, jitter: float, least: float) -> bool:
        """Whether a jitter [s] makes more than a small part of the noise."""
        late = SCATTER * jitter * float(np.sqrt(np.mean(self.by_time)))
        return late > least * self.sigma

    @cached_property
    def jitter(self) -> float:
        """The likeliest [s], beside white noise of any size."""
        highest = float(np.mean(self.square)) / max(float(np.mean(self.by_time)), 1e-300)

        def lack(share: float) -> float:
            late = share * highest * self.by_time
            rest = max(float(np.mean(self.square - late)), 1e-6 * float(np.mean(self.square)))
            variance = rest + late
            return float(np.sum(self.square / variance + np.log(variance)))

        found = minimize_scalar(lack, bounds=(1e-6, 1.0), method="bounded")
        return float(np.sqrt(found.x * highest) / SCATTER)


def _asked(task: Task, state: FitState) -> tuple[str, float] | None:
    """The instrument that asks most for jitter, and how much; None: none does.

    Instruments whose jitter is stated are not asked.
    """
    present = _jitters(task, state)
    best: _Scattering | None = None
    for each in _scatterings(task, state):
        stated = task.experiment.instruments[each.name].calibration.jitter is not None
        if stated or each.name in present or each.score < task.settings.jittering:
            continue
        if not each.shows(each.jitter, task.settings.least_jitter):
            continue
        if best is None or each.score > best.score:
            best = each
    return None if best is None else (best.name, best.jitter)


def _scatterings(task: Task, state: FitState) -> Iterator[_Scattering]:
    """Of every quantity of the motion instruments."""
    squares: dict[Source, list[Array]] = {}
    rates: dict[Source, list[Array]] = {}
    sigmas: dict[Source, float] = {}
    for segment in state.segments:
        for reading in () if segment.static else segment.readings:
            instrument = task.experiment.instruments[reading.source[0]]
            if instrument.commanded or instrument.stands_in(task.experiment.robot.m):
                continue
            residual, rate = _residual_and_rate(task, state, segment, reading)
            use = np.isfinite(residual).all(axis=1)
            # One spike is no jitter: it counts for what noise may do at most.
            bound = task.settings.jitter_bound * float(np.sqrt(np.mean(residual[use] ** 2)))
            held = np.clip(residual[use], -bound, bound)
            # What goes on for a while, as of a heading that walks while the platform turns, or of a
            # filter that follows the accelerometer, is no jitter, and not in second differences
            # over
            # a short time.
            lag = _lag(reading.time[use])
            if len(held) <= 2 * lag or not _changes(
                reading.values[use], reading.time[use], lag, rate[use]
            ):
                continue
            differences = held[2 * lag :] - 2 * held[lag:-lag] + held[: -2 * lag]
            squares.setdefault(reading.source, []).append(differences.ravel() ** 2 / 6)
            sigmas[reading.source] = reading.sigma
            square = rate[use] ** 2
            around = (square[2 * lag :] + 4 * square[lag:-lag] + square[: -2 * lag]) / 6
            rates.setdefault(reading.source, []).append(around.ravel())
    for source, each in squares.items():
        square = np.concatenate(each)
        yield _Scattering(source[0], square, np.concatenate(rates[source]), sigmas[source])


def _changes(values: Array, time: Array, lag: int, rate: Array) -> bool:
    """Whether readings change as quickly as the motion would have it: what an encoder of a winch
    that stands still reads cannot be late, whatever its residuals do.

    Args:
        values: Of one quantity, shape (n, k), or matrices, which are not looked at.
        time: Of its samples [s], shape (n,).
        lag: Samples between two that are compared.
        rate: By how much these would change in a second, shape (n, k).
    """
    if values.ndim > rate.ndim:
        return True
    after = lag * float(np.median(np.diff(time)))
    # Noise is alike in differences over one and over two lags; what changes steadily is not.
    one, two = (np.mean((values[each:] - values[:-each]) ** 2) for each in (lag, 2 * lag))
    return bool(two - one > _CHANGING * 3 * after**2 * np.mean(rate**2))


def _lag(time: Array) -> int:
    """Samples between two whose stamps scatter independently of each other."""
    mean = float(np.ptp(time)) / max(len(time) - 1, 1) if len(time) else _APART
    return max(1, round(_APART / max(mean, 1e-6)))


def _residual_and_rate(
    task: Task, state: FitState, segment: Segment, reading: Reading
) -> tuple[Array, Array]:
    """Of a quantity against the motion and its disturbances, and by how much it changes in a
    second, shape (n, k) each.
    """
    references = reference_clocks(task.experiment, task.calibration_parameters, segment)
    _, local, motion, linear = looked_at(
        task.experiment, segment, reading, slice(None), state.calibration, references
    )
    by = (linear["by_pose"], linear["by_rate"], linear["by_acceleration"])
    residual = linear["residual"] + segment.disturbance_of(reading.source, local)
    return np.asarray(residual), rate_along(by, motion)


def _force_rates(forces: Forces) -> Array:
    """By how much force readings change in a second, shape (n, r)."""
    from scipy.signal import savgol_filter

    values = np.hstack(list(forces.readings.values()))
    step = float(np.median(np.diff(forces.time))) if len(forces.time) > 1 else 1.0
    many = 2 * max(_FEWEST // 2, round(_HALF / max(step, 1e-6))) + 1
    if len(values) <= many:
        return np.zeros_like(values)
    return np.asarray(savgol_filter(values, many, _ORDER, deriv=1, delta=step, axis=0))
