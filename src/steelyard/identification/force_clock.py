"""The clock of the forces against that of the motion: the shift at which the forces fit the motion
best.

The balance of forces and moments is linear in the ten parameters of the body and in the offsets of
the sensors, at any shift: its residuals show the shift, and nothing needs to be known of the body
beforehand.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.clocks.shift import Shift, least
from steelyard.dynamics import platform_regressor
from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run
from steelyard.identification.model.sources import choose_sources
from steelyard.identification.model.unknown_body import BODY, unknown_body
from steelyard.identification.samples.preparation import samples_of
from steelyard.identification.samples.reading import SmoothPart, UndeterminedError
from steelyard.identification.samples.run_reader import RunReader
from steelyard.identification.settings import SYNCHRONISATION, SynchronisationSettings
from steelyard.robot.kinematics import cables_at
from steelyard.smoothing import choose_spacing


@dataclass(frozen=True, eq=False)
class ForceClockProblem:
    """One run: its motion on a grid of the motion's clock, and the force readings on theirs."""

    grid: Array
    """[s], shape (g,)."""
    regressor: Array
    """Of the body, shape (g, 6, 10)."""
    structure: Array
    """From force readings to the wrench, shape (g, 6, k)."""
    time: Array
    """Of the force readings [s], shape (n,)."""
    readings: Array
    """Shape (n, k)."""
    small_offsets: bool
    """Whether the offsets of the sensors are small against their readings."""
    settings: SynchronisationSettings = SYNCHRONISATION

    @cached_property
    def scale(self) -> Array:
        """Wrench of readings of 1, root mean square, shape (6,)."""
        return np.asarray(np.sqrt(np.mean(np.sum(self.structure**2, axis=2), axis=0)))

    @property
    def coefficients(self) -> float:
        """Body and offsets, for each of the six channels."""
        return float(self.structure.shape[2] + 10) / 6

    def structure_at(self, rows: NDArray[np.intp], shift: float) -> Array:
        """From force readings to the wrench at the time of some of them, shape (n, 6, k)."""
        return self._at(self.structure, rows, shift)

    def _at(self, values: Array, rows: NDArray[np.intp], shift: float) -> Array:
        """Values of the grid at the time of some readings."""
        where = (self.time[rows] + shift - self.grid[0]) / self.settings.grid
        below = np.clip(np.floor(where).astype(np.int64), 0, len(self.grid) - 2)
        part = (where - below)[:, None, None]
        return np.asarray(values[below] * (1 - part) + values[below + 1] * part)

    def residuals(self, rows: NDArray[np.intp], shift: float) -> Array:
        """Residuals of some readings with the body that fits them best, in units of
        :attr:`scale`, shape (n, 6); ``shift`` from the forces' time to the motion's.
        """
        settings = self.settings
        W, Y = self.structure_at(rows, shift), self._at(self.regressor, rows, shift)
        columns = np.concatenate([Y, W], axis=2) / self.scale[:, None]
        target = np.einsum("nkm,nm->nk", W, self.readings[rows]) / self.scale
        # Offsets of cables are small against the readings; without that, they and the weight would
        # explain each other.
        precision = np.zeros(columns.shape[2])
        if self.small_offsets:
            median = np.median(np.abs(self.readings), axis=0)
            offset = settings.sensor_offset * np.maximum(median, 1e-9)
            precision[BODY.stop :] = (settings.residual / offset) ** 2
        return unknown_body(columns, target, precision, ridge=settings.ridge).residual

    def inside(self, shift: float) -> NDArray[np.intp]:
        """Readings at whose time the motion is known, shape (n,)."""
        at = self.time + shift
        return np.flatnonzero((at >= self.grid[0]) & (at <= self.grid[-1]))

    def gains(self, shifts: Array) -> Array:
        """Log likelihood of each shift against a platform that hangs still; 0 where too little
        overlaps, shape (s,).
        """
        settings, search = self.settings, self.settings.offset.search
        step = float(np.median(np.diff(self.time)))
        least_count = search.least_overlap * min(len(self.time), np.ptp(self.grid) / step)
        found = np.zeros(len(shifts))
        for i, shift in enumerate(shifts):
            rows = self.inside(float(shift))
            if len(rows) < max(least_count, search.fewest):
                continue
            few = rows[:: max(1, len(rows) // settings.most_scanned)]
            wrench = np.einsum(
                "nkm,nm->nk", self.structure_at(few, float(shift)), self.readings[few]
            )
            still = np.var(wrench, axis=0)
            # What is fitted takes its part of any readings.
            independent = len(rows) * step / search.correlation_time
            free = max(independent - self.coefficients, settings.least_free * independent)
            left = np.mean(self.residuals(few, float(shift)) ** 2, axis=0) * self.scale**2
            left = left * independent / free
            ratio = np.log(np.maximum(still, 1e-300) / np.maximum(left, 1e-300))
            found[i] = 0.5 * independent * float(np.mean(ratio))
        return found


@dataclass(frozen=True, eq=False)
class _ForceShift:
    """Readings that are inside at all shifts near a guess, as a
    :class:`steelyard.clocks.shift.ShiftTerm`.
    """

    problem: ForceClockProblem
    rows: NDArray[np.intp]

    @property
    def time(self) -> Array:
        return self.problem.time[self.rows]

    @property
    def coefficients(self) -> float:
        return self.problem.coefficients

    def residual(self, shift: float) -> Array:
        return self.problem.residuals(self.rows, shift)


def force_clock_problem(
    experiment: Experiment,
    run: Run,
    around: tuple[float, float] | None = None,
    *,
    settings: SynchronisationSettings = SYNCHRONISATION,
) -> ForceClockProblem | None:
    """Motion and forces of a run, each on its own clock; None where the motion is not determined.

    Args:
        experiment: With its instruments.
        run: With ``sync`` under which the motion instruments agree with each other; the forces'
            event may be any.
        around: Interval of the motion's common time to look at [s]; None: all.
        settings: Of the balance of forces and motion.

    Raises:
        InputError: The run lacks what tells where the cables pull.
    """
    robot = experiment.robot.with_straight_cables()
    sources = choose_sources(experiment, run, None, commanded=True)
    reader = RunReader(experiment, robot, run, sources)
    raw = {source: samples_of(reader, source) for source in sources.used()}
    start = max(float(s.time[0]) for s in raw.values())
    end = min(float(s.time[-1]) for s in raw.values())
    if around is not None:
        start, end = max(start, around[0]), min(end, around[1])
    search = settings.offset.search
    if end - start < search.fewest * search.smoothing.finest:
        return None
    finest = max(2 * float(np.median(np.diff(s.time))) for s in raw.values())
    spacings = search.smoothing.spacings(finest)
    spacing = choose_spacing(list(raw.values()), spacings, start, end, robust=True)
    part = SmoothPart(reader, raw, start, end, spacing, robust=True)
    grid = np.arange(start + spacing, end - spacing, settings.grid)
    if len(grid) < search.fewest:
        return None
    readings = np.hstack(
        [v.reshape(len(v), -1) for v in run.streams[sources.force].values.values()]
    )
    use = np.isfinite(readings).all(axis=1)
    time, readings = reader.time(sources.force)[use], readings[use]
    try:
        turning = part.turning(grid)
        Y = platform_regressor(part.specific_force(grid), turning["omega"], turning["alpha"])
        if robot.m:
            pose = part.pose(grid)
            W = cables_at(
                robot, pose["position"], pose["rotation"], np.median(np.abs(readings), axis=0)
            ).structure
        else:
            W = np.broadcast_to(np.eye(6), (len(grid), 6, 6))
            readings = reader.force_samples(
                {q: v[use] for q, v in run.streams[sources.force].values.items()}, {}
            )
    except UndeterminedError:
        return None
    return ForceClockProblem(grid, Y, W, time, readings, robot.m > 0, settings)


def likeliest(problem: ForceClockProblem, shifts: Array) -> tuple[Shift | None, Shift | None]:
    """The shift at which the forces fit the motion best, and the next best that is about as good.

    Args:
        problem: Motion and forces.
        shifts: Among which to look first [s], ascending.
    """
    settings, distinct = problem.settings, problem.settings.offset.distinct
    gains = problem.gains(shifts)
    found: list[tuple[float, Shift]] = []
    # Clocks that were set to the same time need no search; all others have to stand out against
    # them.
    for place in [*([int(np.argmin(np.abs(shifts)))] if len(shifts) else []), *np.argsort(-gains)]:
        if len(found) > settings.offset.tried or gains[place] <= settings.least_gain:
            if found:
                break
            continue
        if any(abs(float(shifts[place]) - each.value) < distinct for _, each in found):
            continue
        refined = near(problem, float(shifts[place]))
        if refined is not None:
            found.append((float(gains[place]), refined))
    if not found:
        return None, None
    top = max(gain for gain, _ in found)
    close = [each for gain, each in found if gain > settings.close_gain * top]
    best, *others = sorted(close, key=lambda each: each.cost)
    for other in others:
        fits_as_well = other.cost < best.cost + settings.clearly_better
        if fits_as_well and abs(other.value - best.value) > distinct:
            return best, other
    return best, None


def near(problem: ForceClockProblem, guess: float, reach: float | None = None) -> Shift | None:
    """The best shift near a guess; None where too little overlaps.

    Args:
        problem: Motion and forces.
        guess: Of the shift [s].
        reach: How far from it to look [s]; None: as the settings say.
    """
    settings = problem.settings.offset
    reach = settings.shift.reach if reach is None else reach
    # Numerical derivatives look a little farther.
    farthest = reach + settings.shift.difference
    rows = np.intersect1d(problem.inside(guess - farthest), problem.inside(guess + farthest))
    if len(rows) < settings.search.fewest:
        return None
    return least([_ForceShift(problem, rows)], guess, reach, settings.shift)


def scanned(problem: ForceClockProblem) -> Array:
    """All shifts at which enough overlaps [s], ascending."""
    motion, time = problem.grid, problem.time
    step = problem.settings.offset.search.step
    return np.asarray(np.arange(motion[0] - time[-1], motion[-1] - time[0], step))
