"""A window of the motion that is still fitted: chunks in a row on knots that go on, the steps of a
mass that walks, and what remains of all before.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.identification.model.motion_segment import Reading, Segment
from steelyard.identification.model.processes import SplineIntegrals, embedded
from steelyard.identification.model.segment import POSE, NormalEquations, basis, values_at
from steelyard.identification.recursive.window.chunk import Chunk
from steelyard.identification.recursive.window.grid import KnotGrid
from steelyard.identification.recursive.window.levels import Liveliness
from steelyard.identification.recursive.window.past import Linear, Point, together
from steelyard.identification.recursive.window.walk import by_mass, with_known_steps, with_steps
from steelyard.smoothing import DEGREE


@dataclass(frozen=True, eq=False)
class Window:
    """The motion of one run as far as it is still fitted."""

    grid: KnotGrid
    like: Segment
    """With name, clock, smoothness and processes of every chunk."""
    first: int = 0
    """Number of its first chunk."""
    chunks: tuple[Chunk, ...] = ()
    motion: Array = field(default_factory=lambda: np.zeros((0, 0)))
    """Coefficients, shape (f, block)."""
    past: Linear | None = None
    """What remains of the chunks before it."""
    lively: Liveliness | None = None
    """How lively the motion is; None: as the first chunk has it."""
    walk: float = 0.0
    """Density of the random walk of the mass [kg/sqrt(s)]; 0: it stays."""
    steps: Array = field(default_factory=lambda: np.zeros(0))
    """By how much the mass of each chunk is more than that of the one before, or of all before
    [kg], shape (n,); where it walks."""

    @property
    def variance(self) -> float:
        """Of a step of the mass from one chunk to the next [kg^2]."""
        return self.walk**2 * self.grid.length

    def at(self, point: Array, number: int) -> Array:
        """The border as it was in a chunk, shape (k,).

        Args:
            point: As it is now, shape (k,).
            number: Of the chunk in the window; -1: before all of them.
        """
        if not self.walk:
            return point
        return np.asarray(point - by_mass(point) * self.steps[number + 1 :].sum())

    def place(self, number: int) -> slice:
        """Where a chunk of the window has its coefficients."""
        start = number * self.grid.intervals
        return slice(start, start + self.grid.functions)

    def longer(self, motion: Array | None) -> Window:
        """With coefficients for one more chunk.

        Args:
            motion: Of that chunk, shape (f, block); None: it goes on as fast as it is.
        """
        if self.walk:
            return replace(self, walk=0.0).longer(motion)._walking(self.walk)
        own = self.motion
        if motion is not None:
            further = motion[DEGREE:] if len(own) else motion
            return replace(self, motion=np.vstack([own, further]) if len(own) else further)
        # By value and rate where it has been read last: single coefficients reach beyond. That of a
        # straight line is its value in the middle of the function [DeBoor1978]_.
        knots = self.grid.knots(self.first, len(self.chunks))
        end = knots[-DEGREE - 1]
        local = basis(knots, np.array([end]))
        value, rate = (values_at(local, own, order)[0] for order in (0, 1))
        rate[POSE:] = 0.0
        middle = (DEGREE + 1) / 2 + np.arange(self.grid.intervals)
        further = value + self.grid.spacing * middle[:, None] * rate
        return replace(self, motion=np.vstack([own, further]))

    def _walking(self, walk: float) -> Window:
        """With one more step of the mass."""
        return replace(self, walk=walk, steps=np.append(self.steps, 0.0))

    def moved(self, step: Array, walked: Array | None = None) -> Window:
        """With other coefficients.

        Args:
            step: By how much, shape (f block,).
            walked: The same of the steps of the mass [kg], shape (n,); None: these stay.
        """
        motion = self.motion + step.reshape(self.motion.shape)
        return replace(self, motion=motion, steps=self.steps + (0.0 if walked is None else walked))

    def segment(self, number: int, readings: tuple[Reading, ...]) -> Segment:
        """A chunk of the window as a segment.

        Args:
            number: Of the chunk in the window.
            readings: Of its motion instruments.
        """
        grid, whole = self.grid, self.first + number
        # It begins once; where it ends for now is told by the window.
        ends = grid.ends[0] if whole == 0 else np.zeros_like(grid.ends[0])
        integrals = SplineIntegrals(grid.integrals.value, grid.integrals.rate, ends)
        processes = tuple(replace(each, integrals=integrals) for each in self.like.processes)
        like = self.like
        if self.lively is not None and like.smoothness is not None:
            like = replace(like, smoothness=self.lively.smoothness)
        return replace(
            like,
            knots=grid.knots(whole),
            readings=readings,
            coefficients=self.motion[self.place(number)],
            jerks=grid.jerks,
            processes=processes,
        )

    def told(
        self, border: Array, use: NDArray[np.intp] | None
    ) -> tuple[list[NormalEquations], list[int]]:
        """What remains of all before, where there is something, and what every chunk says, and the
        first function of each.

        Args:
            border: Present values of the ten and all calibration parameters, shape (k,).
            use: Columns of the border that are estimated, over which to tell it, shape (e,); None:
                all.
        """
        parts, places = [], []
        point = border if use is None else border[use]
        if self.past is not None:
            past = self.past if use is None else self.past.of_columns(use)
            parts.append(past.seen_from(Point(self.motion[:DEGREE], self.at(point, -1))))
            places.append(0)
        for i, chunk in enumerate(self.chunks):
            own = self.place(i)
            linear = chunk.whole if use is None else chunk.linear
            parts.append(linear.seen_from(Point(self.motion[own], self.at(point, i))))
            places.append(own.start)
        return parts, places

    def equations(self, border: Array, use: NDArray[np.intp] | None) -> NormalEquations:
        """Normal equations of its motion with what remains of all before, and with the steps of the
        mass as the last columns of the border; arguments as of :meth:`told`.
        """
        parts, places = self.told(border, use)
        if not self.walk:
            return self.joined(parts, places)
        direction, count = by_mass(border if use is None else border[use]), len(self.steps)
        first = len(self.chunks) - len(parts)
        stepped = [
            with_steps(each, direction, np.arange(count) > number)
            for number, each in enumerate(parts, start=first)
        ]
        return with_known_steps(self.joined(stepped, places), self.steps, self.variance)

    def joined(self, parts: Sequence[NormalEquations], places: Sequence[int]) -> NormalEquations:
        """Equations of past and chunks as those of all, with what is known at the end.

        Args:
            parts: Over functions in a row each.
            places: First function of each.
        """
        whole = together(parts, places)
        return whole.stiffened([self.ends], self.motion) if self.like.processes else whole

    @property
    def ends(self) -> Array:
        """What is known of processes at the end of what has arrived, lower banded form: they go
        on.
        """
        grid, functions = self.grid, len(self.motion)
        whole = np.zeros((grid.block * (DEGREE + 1), functions * grid.block))
        start = (functions - DEGREE - 1) * grid.block
        last = grid.ends[1][:, -DEGREE - 1 :]
        for each in self.like.processes:
            place = self.like.process_places[each.source]
            for i in range(place.start, place.stop):
                whole[:, start:] += embedded(last / (2 * each.level**2), i, grid.block)
        return whole
