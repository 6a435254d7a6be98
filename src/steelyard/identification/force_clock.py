"""The clock of the forces against that of the motion: the shift at which the forces carry the
platform best.

The balance of forces and moments is linear in the ten parameters of the body and in the offsets of
the sensors, at any shift: what it leaves over tells the shift, and nothing needs to be known of the
body beforehand.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.clocks.settings import SHIFT
from steelyard.clocks.shift import Shift, least
from steelyard.dynamics import platform_regressor
from steelyard.experiment.model import Experiment, Run
from steelyard.identification.model.preparation import samples_of
from steelyard.identification.model.reading import RunReader, SmoothPart, UndeterminedError
from steelyard.identification.model.sources import choose_sources
from steelyard.identification.model.unknown_body import BODY, unknown_body
from steelyard.robot.kinematics import cables_at
from steelyard.smoothing import choose_spacing

_GRID = 0.01
"""Of the motion [s]; between, it is straight enough."""
_FINEST, _WIDEST = 0.02, 0.5
"""Spacing of knots [s]."""
_SCAN = 0.04
"""Between the shifts that are looked at first [s]."""
_MOST_SCANNED = 300
"""Force readings at each of them."""
_LEAST_OVERLAP = 0.4
"""Of the shorter recording."""
_OFFSET = 0.01
"""1-sigma of the offset of a force sensor, as a part of the median reading."""
_TRIED = 3
_APART = 0.3
_LASTING = 0.2
"""Time after which a motion tells something new [s]."""
_LEAST_GAIN = 3.0
"""Log likelihood that forces and motion must share."""
_CLOSE = 0.85
"""Part of the largest gain that others may have to be looked at closer."""
_RIDGE = 1e-9
"""Of the fit of a body whose ten the motion may not tell."""
_MUCH = 0.1
"""Logarithm of the variance by which one shift must be better than another one."""


@dataclass(frozen=True, eq=False)
class Carrying:
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

    @cached_property
    def scale(self) -> Array:
        """Wrench of readings of 1, root mean square, shape (6,)."""
        return np.asarray(np.sqrt(np.mean(np.sum(self.structure**2, axis=2), axis=0)))

    def structure_at(self, rows: NDArray[np.intp], shift: float) -> Array:
        """From force readings to the wrench at the time of some of them, shape (n, 6, k)."""
        return self._at(self.structure, rows, shift)

    def _at(self, values: Array, rows: NDArray[np.intp], shift: float) -> Array:
        where = (self.time[rows] + shift - self.grid[0]) / _GRID
        below = np.clip(np.floor(where).astype(np.int64), 0, len(self.grid) - 2)
        part = (where - below)[:, None, None]
        return np.asarray(values[below] * (1 - part) + values[below + 1] * part)

    def over(self, rows: NDArray[np.intp], shift: float) -> Array:
        """What no body explains of some readings, whitened alike, shape (n, 6); ``shift`` from the
        forces' time to the motion's.
        """
        W, Y = self.structure_at(rows, shift), self._at(self.regressor, rows, shift)
        columns = np.concatenate([Y, W], axis=2) / self.scale[:, None]
        target = np.einsum("nkm,nm->nk", W, self.readings[rows]) / self.scale
        # Offsets of cables are small against the readings; without that, they and the weight would
        # explain each other.
        precision = np.zeros(columns.shape[2])
        if self.small_offsets:
            offset = _OFFSET * np.maximum(np.median(np.abs(self.readings), axis=0), 1e-9)
            precision[BODY.stop :] = (_OFFSET_NOISE / offset) ** 2
        return unknown_body(columns, target, precision, ridge=_RIDGE).residual

    def inside(self, shift: float) -> NDArray[np.intp]:
        """Readings at whose time the motion is known, shape (n,)."""
        at = self.time + shift
        return np.flatnonzero((at >= self.grid[0]) & (at <= self.grid[-1]))

    def gains(self, shifts: Array) -> Array:
        """Log likelihood of each shift against a platform that hangs still; 0 where too little
        overlaps, shape (s,).
        """
        step = float(np.median(np.diff(self.time)))
        least_count = _LEAST_OVERLAP * min(len(self.time), np.ptp(self.grid) / step)
        found = np.zeros(len(shifts))
        for i, shift in enumerate(shifts):
            rows = self.inside(float(shift))
            if len(rows) < max(least_count, 10):
                continue
            few = rows[:: max(1, len(rows) // _MOST_SCANNED)]
            left = np.mean(self.over(few, float(shift)) ** 2, axis=0)
            still = np.var(
                np.einsum("nkm,nm->nk", self.structure_at(few, float(shift)), self.readings[few]),
                axis=0,
            )
            # What is fitted explains some of any readings.
            independent = len(rows) * step / _LASTING
            freedom = max(independent - (self.structure.shape[2] + 10) / 6, 0.2 * independent)
            explained = np.log(
                np.maximum(still, 1e-300)
                / np.maximum(left * self.scale**2 * independent / freedom, 1e-300)
            )
            found[i] = 0.5 * independent * float(np.mean(explained))
        return found


_OFFSET_NOISE = 1.0
"""Residual that an offset of its 1-sigma is worth [N]."""


@dataclass(frozen=True, eq=False)
class _ForceShift:
    """Readings that are inside at all shifts near a guess, as a
    :class:`steelyard.clocks.shift.ShiftTerm`.
    """

    task: Carrying
    rows: NDArray[np.intp]

    @property
    def time(self) -> Array:
        return self.task.time[self.rows]

    @property
    def coefficients(self) -> float:
        return float(self.task.structure.shape[2] + 10) / 6

    def residual(self, shift: float) -> Array:
        return self.task.over(self.rows, shift)


def carrying(
    experiment: Experiment, run: Run, around: tuple[float, float] | None = None
) -> Carrying | None:
    """Motion and forces of a run, each on its own clock; None where the motion cannot be told.

    Args:
        experiment: With its instruments.
        run: With ``sync`` under which the motion instruments agree with each other; the forces'
            event may be any.
        around: Interval of the motion's common time to look at [s]; None: all.

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
    if end - start < 10 * _FINEST:
        return None
    finest = max(_FINEST, *(2 * float(np.median(np.diff(s.time))) for s in raw.values()))
    spacings = np.geomspace(finest, max(finest, _WIDEST), 7)
    spacing = choose_spacing(
        list(raw.values()), [float(s) for s in spacings], start, end, robust=True
    )
    part = SmoothPart(reader, raw, start, end, spacing, robust=True)
    grid = np.arange(start + spacing, end - spacing, _GRID)
    if len(grid) < 10:
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
    return Carrying(grid, Y, W, time, readings, robot.m > 0)


def likeliest(task: Carrying, shifts: Array) -> tuple[Shift | None, Shift | None]:
    """The shift at which the forces carry the platform best, and the next best that is about as
    good.

    Args:
        task: Motion and forces.
        shifts: Among which to look first [s], ascending.
    """
    gains = task.gains(shifts)
    found: list[tuple[float, Shift]] = []
    # Clocks that were set to the same time need no search; all others have to stand out against
    # them.
    for place in [*([int(np.argmin(np.abs(shifts)))] if len(shifts) else []), *np.argsort(-gains)]:
        if len(found) > _TRIED or gains[place] <= _LEAST_GAIN:
            if found:
                break
            continue
        if any(abs(float(shifts[place]) - each.value) < _APART for _, each in found):
            continue
        refined = near(task, float(shifts[place]))
        if refined is not None:
            found.append((float(gains[place]), refined))
    if not found:
        return None, None
    top = max(gain for gain, _ in found)
    close = sorted(
        (each for gain, each in found if gain > _CLOSE * top), key=lambda each: each.cost
    )
    best = close[0]
    rival = next(
        (e for e in close[1:] if e.cost < best.cost + _MUCH and abs(e.value - best.value) > _APART),
        None,
    )
    return best, rival


def near(task: Carrying, guess: float, reach: float = SHIFT.reach) -> Shift | None:
    """The best shift near a guess."""
    rows = np.intersect1d(task.inside(guess - reach - 1e-3), task.inside(guess + reach + 1e-3))
    return least([_ForceShift(task, rows)], guess, reach) if len(rows) >= 10 else None


def scanned(task: Carrying) -> Array:
    """All shifts at which enough overlaps [s], ascending."""
    return np.asarray(np.arange(task.grid[0] - task.time[-1], task.grid[-1] - task.time[0], _SCAN))
