"""The balance of forces along a stretch of motion, whitened, without what is unmodelled: what a
test of something that moves looks at.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.identification.model.balance import (
    UNMODELLED_PARTS,
    Forces,
    balance_of,
    regressor_at,
)
from steelyard.identification.model.balance.bending import felt_at
from steelyard.identification.model.motion_segment import Segment
from steelyard.identification.model.segment import motion_at
from steelyard.identification.solve.posterior import Posterior
from steelyard.inertia import TEN
from steelyard.robot.model import DIRECTIONS

STEP = 0.01
"""Between the instants at which a response is followed [s]."""
INDEPENDENT = 1e-9
"""Part of the largest singular value below which columns tell the same."""
_WHOLE = 60.0
"""Stretch of all runs that is looked at [s]: a resonance that matters shows in it."""
_SAMPLES = 60.0
"""Of them a second: four of every period."""


@dataclass(frozen=True, eq=False)
class ForceStretch:
    """The balance of forces along a segment, without processes, whitened, n samples."""

    time: Array
    """Within the segment [s], shape (n,)."""
    duration: float
    """[s]"""
    instants: Array
    """Every .01 s [s], shape (t,)."""
    acceleration: Array
    """World frame [m/s^2], shape (t, 3)."""
    gravity: Array
    """World frame [m/s^2], shape (3,)."""
    felt: Array
    """Specific force [m/s^2] over angular acceleration [rad/s^2], platform frame, shape (t, 6)."""
    omega: Array
    """Angular velocity at the samples, platform frame [rad/s], shape (n, 3)."""
    rotation: Array
    """R_world_platform at the samples, shape (n, 3, 3)."""
    whitener: Array
    """Shape (n, 6, 6)."""
    use: NDArray[np.bool_]
    """Shape (n,)."""
    kept: float
    """Correlation of what is left over from sample to sample."""
    base: Array
    """Orthonormal columns of the body and of offsets, shape (6 n - 6, b)."""
    by_body: Array
    """How the residual follows the body, shape (6 n - 6, 10)."""
    over: Array
    """What is left over, in units of its scatter, shape (6 n - 6,)."""
    scatter: float
    is_disturbed: bool
    """Whether an unmodelled wrench that nobody has stated is part of the fit."""

    @property
    def level(self) -> Array:
        """Acceleration across gravity, world frame [m/s^2], shape (t, 3)."""
        down = self.gravity / np.linalg.norm(self.gravity)
        return np.asarray(self.acceleration - np.outer(self.acceleration @ down, down))

    @cached_property
    def _between(self) -> tuple[NDArray[np.intp], Array]:
        """Instant before each sample, and part of the step to the next one, shapes (n,) and
        (n, 1).
        """
        steps = np.clip((self.time - self.instants[0]) / STEP, 0.0, len(self.instants) - 1)
        before = np.minimum(steps.astype(np.intp), max(len(self.instants) - 2, 0))
        return before, (steps - before)[:, None]

    def at_samples(self, instants: Array) -> Array:
        """What is at the instants, at the samples, shape (n, k) from (t, k)."""
        before, share = self._between
        after = np.minimum(before + 1, len(instants) - 1)
        return np.asarray(instants[before] * (1 - share) + instants[after] * share)


def innovations(rows: Array, use: NDArray[np.bool_], kept: float) -> Array:
    """What is new of each sample, shape (6 n - 6, …), from shape (n, 6, …)."""
    new = -kept * rows[:-1]
    new += rows[1:]
    new[~(use[1:] & use[:-1])] = 0.0
    return np.asarray(new.reshape(-1, *rows.shape[2:]))


def force_stretches(found: Posterior) -> Iterator[ForceStretch]:
    """Of the segments in motion of rigid bodies, a minute in all."""
    left = _WHOLE
    for segment, forces in zip(found.fit.state.segments, found.force_samples, strict=True):
        if segment.static or forces is None or forces.guessed.all() or left <= 0:
            continue
        if found.experiment.moves_within(segment.run):
            continue
        stretch = _stretch(found, segment, forces, left)
        if stretch is not None:
            left -= stretch.duration
            yield stretch


def _stretch(
    found: Posterior, segment: Segment, forces: Forces, longest: float
) -> ForceStretch | None:
    """The beginning of a segment; None: there is too little of it."""
    state = found.fit.state
    assert state.parameters is not None
    fewest = 2 * (TEN + found.calibration.calibration_parameters.m)
    if len(forces.time) < fewest:
        return None
    start, end = segment.span
    step = max(float(np.median(np.diff(forces.time))), 1e-9)
    every = max(1, round(1 / (_SAMPLES * step)))
    # Means, since what is faster would show at another frequency if single samples were taken.
    part = forces.part(slice(0, int(longest / step))).means(every)
    at = balance_of(
        found.experiment, segment, part, state.calibration, state.parameters, state.factors
    )
    use = at.told & ~part.touched
    if np.sum(use) < fewest:
        return None
    end = min(end, float(at.time[-1]))
    instants = np.arange(start, end, STEP)
    _, _, acceleration, _ = motion_at(segment.basis(instants), segment.coefficients)
    gravity = state.calibration.gravity
    felt, _ = felt_at(segment, instants, state.calibration)
    white = np.einsum("nij,nj->ni", at.whitener, at.left_over + at.by_processes)
    body = -regressor_at(found.experiment, segment, at.time, state.calibration)
    columns = at.whitener @ np.concatenate([body, at.by_reading], axis=2)
    columns = columns / np.maximum(np.sqrt(np.mean(columns**2, axis=(0, 1))), 1e-300)
    # First as if it were white, then as it is correlated.
    own = beside(orthonormal(innovations(columns, use, 0.0)), innovations(white, use, 0.0))
    own = own.reshape(-1, DIRECTIONS)
    kept = float(np.sum(own[1:] * own[:-1]) / max(float(np.sum(own**2)), 1e-300))
    base = orthonormal(innovations(columns, use, kept))
    residual = beside(base, innovations(white, use, kept))
    square = float(residual @ residual) / (DIRECTIONS * int(np.sum(use)))
    scatter = max(np.sqrt(square), 1e-300)
    by_body = innovations(at.whitener @ body, use, kept) / scatter
    return ForceStretch(
        at.time,
        end - start,
        instants,
        acceleration[:, :3],
        gravity,
        felt,
        np.asarray(at.motion["omega"]),
        np.asarray(at.motion["rotation"]),
        at.whitener,
        use,
        kept,
        base,
        by_body,
        np.asarray(residual / scatter),
        float(scatter),
        any(each.source in UNMODELLED_PARTS and not each.is_stated for each in segment.processes),
    )


def orthonormal(columns: Array) -> Array:
    """A basis of what columns span, shape (n, b)."""
    left, size, _ = np.linalg.svd(columns, full_matrices=False)
    return np.asarray(left[:, size > INDEPENDENT * size[0]])


def beside(base: Array, rows: Array) -> Array:
    """Rows less what is in a basis."""
    within = base @ (base.T @ rows)
    return np.asarray(np.subtract(rows, within, out=within))
