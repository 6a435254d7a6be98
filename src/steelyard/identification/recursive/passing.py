"""A chunk that leaves the window: it is linearised once more, eliminated, and says what it has
told.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.identification.banded import banded_trace
from steelyard.identification.model.motion_segment import Segment
from steelyard.identification.model.segment import NormalEquations
from steelyard.identification.recursive.arriving.spikes import numbers_of, without_spikes
from steelyard.identification.recursive.recursion import Recursion
from steelyard.identification.recursive.window.levels import Liveliness
from steelyard.identification.recursive.window.past import (
    Linear,
    Point,
    eliminated,
    in_one,
    narrowed,
    nothing_told,
    of_border,
    together,
)
from steelyard.identification.recursive.window.walk import (
    a_step_later,
    blind_to_mass,
    by_mass,
    without_columns,
)
from steelyard.identification.recursive.window.window import Window
from steelyard.identification.solve.border.noise_in_derivatives import left_noise
from steelyard.identification.solve.border.normal_equations import Blocks, BorderEquations
from steelyard.identification.solve.border.segment_equations import SegmentEquations, whitened_rows
from steelyard.identification.solve.border.stretches import by_stretches
from steelyard.identification.tally import Tally
from steelyard.inertia import TEN
from steelyard.instruments.tension import RollerState
from steelyard.smoothing import DEGREE


@dataclass(frozen=True, eq=False)
class _Remains:
    """What is told once the first chunk of a window is eliminated."""

    equations: NormalEquations
    """Of its last functions and the border, of all that has passed."""
    normal: Array
    """What the chunk adds to what was known of the border, shape (k, k): independent of that by
    construction."""
    right: Array
    """The same, calibration parameters counted from nothing, shape (k,)."""


def passed(recursion: Recursion) -> tuple[Recursion, SegmentEquations]:
    """With the first chunk of the window eliminated, and what it says, calibration parameters
    counted from nothing.

    Args:
        recursion: With a window that has a chunk.

    Raises:
        numpy.linalg.LinAlgError: The motion is not determined.
    """
    assert recursion.window is not None
    window, first, tally = recursion.window, recursion.window.chunks[0], Tally()
    point = window.at(recursion.point, 0)
    then = replace(recursion.state, parameters=point[:TEN])
    segment = replace(first.segment, coefficients=window.motion[window.place(0)])
    forces = first.forces
    balances, rows = whitened_rows(recursion.task, then, segment, forces, tally=tally)
    heard = without_spikes(
        lambda fewer: whitened_rows(recursion.task, then, segment, fewer)[0],
        balances,
        forces,
        recursion.task.settings,
    )
    if heard is not forces:
        # What followed has told the motion better than it was known when the chunk arrived.
        before, after = (numbers_of(segment, each) for each in (forces, heard))
        recursion = recursion.without_numbers(segment.run, before, after)
        forces, tally = heard, Tally()
        balances, rows = whitened_rows(recursion.task, then, segment, forces, tally=tally)
    here = recursion.with_chunk(segment, forces, rows, 0, then).window
    assert here is not None
    # The verdict asks all columns, also those that nobody estimates, of what has passed.
    own = here.chunks[0].whole.equations
    every = here.equations(recursion.point, recursion.use)
    every = without_columns(every, len(window.steps)) if window.walk else every
    remains = _remains(recursion, window, own, point)
    whole = replace(segment, coefficients=window.motion)
    by_noise = left_noise(recursion.task, then, whole, balances, every)
    noise = recursion.task.settings.beyond_noise * by_noise[:TEN, :TEN]
    freedom = float(np.sum(~forces.touched))
    one = np.zeros(window.grid.intervals, dtype=np.intp)
    size = segment.coefficients.size
    inverse = every.inverse[:, :size]
    border, use = len(point), recursion.use
    followed = np.zeros((size, border))
    followed[:, use] = every.followed[:size]
    brought = by_stretches(segment, [narrowed(each, use) for each in rows], every, one)[2]
    part = SegmentEquations(
        segment,
        forces,
        tuple(each.at for each in balances),
        np.concatenate([each.root**2 for each in balances]),
        BorderEquations(remains.normal, remains.right, noise, freedom, by_noise),
        _compared(recursion, remains, segment),
        {source: _among(each, use, border) for source, each in brought.items()},
        inverse,
        followed,
        tally,
        {label: banded_trace(each, inverse) for label, each in own.parts.items()},
        point,
    )
    forgets, grid = recursion.settings.forgets, window.grid
    kept = Point(window.motion[grid.intervals : grid.functions], point)
    rolled = balances[-1].at.rolled if balances and len(forces.time) else None
    memory = None if rolled is None else rolled.last
    shorter = _shorter(window, Linear(remains.equations, kept), memory)
    lively = window.lively or Liveliness.of(segment, forgets / grid.spacing)
    alone = in_one(rows, np.zeros(0, dtype=np.intp), border)
    lively = lively.followed(segment, segment.equations(0, [alone]), forgets)
    return replace(recursion, window=replace(shorter, lively=lively)), part


def _remains(recursion: Recursion, window: Window, own: NormalEquations, point: Array) -> _Remains:
    """What is told of the last functions of the first chunk and of the border.

    Args:
        recursion: Before.
        window: Of it.
        own: Equations of that chunk.
        point: The border as it was in it, shape (k,).
    """
    parts, before = [replace(own, parts={})], nothing_told(len(point))
    if window.past is not None:
        at = Point(window.motion[:DEGREE], window.at(recursion.point, -1))
        past = window.past.seen_from(at)
        if window.walk:
            step = float(window.steps[0])
            past = a_step_later(past, by_mass(point), step, window.variance)
        parts.append(past)
        before = of_border(past, point)
    remains = eliminated(together(parts, [0] * len(parts)), DEGREE)
    after = of_border(remains, point)
    return _Remains(remains, after.normal - before.normal, after.right - before.right)


def _among(matrix: Array, use: NDArray[np.intp], border: int) -> Array:
    """A matrix of the columns that are estimated among those of all.

    Args:
        matrix: Shape (e, e).
        use: Which they are, shape (e,).
        border: Columns k.
    """
    found = np.zeros((border, border))
    found[np.ix_(use, use)] = matrix
    return found


def _compared(recursion: Recursion, remains: _Remains, segment: Segment) -> Blocks:
    """What a chunk says, as far as it may be compared with others."""
    normal, right = remains.normal, remains.right
    if recursion.task.experiment.mass_walk:
        normal, right = blind_to_mass(normal, right, by_mass(recursion.point))
    number = [each.name for each in recursion.task.experiment.runs].index(segment.run)
    since = np.array([segment.span[0]])
    return Blocks(normal[None], right[None], np.array([number]), since)


def _shorter(window: Window, past: Linear, memory: RollerState | None) -> Window:
    """A window without its first chunk.

    Args:
        window: With it.
        past: What remains of all before the second.
        memory: What rollers remember of it now, better than when the second arrived; None: nothing.
    """
    chunks = window.chunks[1:]
    if memory is not None and chunks:
        second = replace(chunks[0].forces, before=memory)
        chunks = (replace(chunks[0], forces=second), *chunks[1:])
    return replace(
        window,
        first=window.first + 1,
        chunks=chunks,
        motion=window.motion[window.grid.intervals :],
        past=past,
        steps=window.steps[1:],
    )
