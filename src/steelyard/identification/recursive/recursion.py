"""The joint fit as a stream: chunk by chunk, a window of the motion that is still fitted, and what
remains of all before it.

A chunk is linearised as it arrives, until it has settled, and once more when it leaves the window;
then it is eliminated, and stays as it was linearised. A step is one of Gauss and Newton over window
and border, with what remains of the past [Dellaert2006]_.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.estimates.estimate import plausible_radius
from steelyard.identification.banded import banded_trace
from steelyard.identification.known_body import plausible
from steelyard.identification.model.balance import Forces
from steelyard.identification.model.motion_residuals import motion_residuals
from steelyard.identification.model.motion_segment import Reading, Segment
from steelyard.identification.model.processes import SplineIntegrals, embedded
from steelyard.identification.model.segment import POSE, NormalEquations, Rows, basis, values_at
from steelyard.identification.recursive.grid import KnotGrid
from steelyard.identification.recursive.levels import Liveliness
from steelyard.identification.recursive.past import (
    Linear,
    Point,
    eliminated,
    in_one,
    scaled,
    together,
)
from steelyard.identification.recursive.settings import RECURSIVE, RecursiveSettings
from steelyard.identification.recursive.walk import (
    a_step_later,
    blind_to_mass,
    by_mass,
    settled_steps,
    steps_of,
    with_known_steps,
    with_steps,
    without_columns,
)
from steelyard.identification.solve.fit_state import FitState, Task
from steelyard.identification.solve.misfits.jitter import with_jitter
from steelyard.identification.solve.normal_equations import (
    Blocks,
    BorderEquations,
    BorderPrior,
    Solution,
    solve,
)
from steelyard.identification.solve.posterior import prior_of
from steelyard.identification.solve.segment_equations import (
    SegmentEquations,
    absolute,
    border_of,
    by_stretches,
    left_noise,
    whitened_rows,
)
from steelyard.identification.tally import Tally
from steelyard.inertia import TEN
from steelyard.smoothing import DEGREE

_WIDE = 1e4
"""By how much readings are taken as noisier where none of them is to stand far; what they say counts
the same."""


_TO_THE_END = 1 / 3
"""Variance of a walk from its mean over a chunk to its end, in that of a step."""


@dataclass(frozen=True, eq=False)
class Chunk:
    """Readings of a short stretch of the motion."""

    segment: Segment
    forces: Forces
    rows: Sequence[Rows]
    """Their residuals with derivatives by all columns of the border."""
    border: Array
    """The ten and all calibration parameters where they were linearised, shape (k,)."""
    use: NDArray[np.intp]
    """Columns of the border that are estimated, shape (e,)."""

    @cached_property
    def linear(self) -> Linear:
        """Equations with the smoothness of the motion, over the columns that are estimated: most are
        not, and steps ask for none of these.
        """
        own = in_one(self.rows, self.use, len(self.border))
        if own.columns is None:
            return self._of([own], self.border[self.use])
        # Rows that follow no column of the border: the columns stay empty.
        return self._of([own], np.zeros(0)).with_empty_border(self.border[self.use])

    @cached_property
    def whole(self) -> Linear:
        """The same over all columns."""
        return self._of(self.rows, self.border)

    def _of(self, rows: Sequence[Rows], border: Array) -> Linear:
        """Equations of rows with what is known of motion and processes."""
        equations = self.segment.smooth(self.segment.equations(len(border), rows))
        return Linear(equations, Point(self.segment.coefficients, border))


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
        """What is known of processes at the end of what has arrived, lower banded form: they go on."""
        grid, functions = self.grid, len(self.motion)
        whole = np.zeros((grid.block * (DEGREE + 1), functions * grid.block))
        start = (functions - DEGREE - 1) * grid.block
        last = grid.ends[1][:, -DEGREE - 1 :]
        for each in self.like.processes:
            place = self.like.process_places[each.source]
            for i in range(place.start, place.stop):
                whole[:, start:] += embedded(last / (2 * each.level**2), i, grid.block)
        return whole


@dataclass(frozen=True, eq=False)
class Recursion:
    """What is known after some chunks."""

    task: Task
    state: FitState
    """With body, calibration and levels; the motion is that of the window."""
    told: BorderEquations
    """Of all motions that have ended, with calibration parameters counted from nothing."""
    window: Window | None = None
    """None: no motion is followed now."""
    solution: Solution | None = None
    """Of all that has arrived."""
    unsettled: int = 0
    """Chunks in which the steps did not settle."""
    passed_on: int = 0
    """Columns of the border about which what was known beforehand is part of what remains of the past:
    where the mass walks, it is forgotten with it."""
    settings: RecursiveSettings = RECURSIVE

    @classmethod
    def begun(cls, task: Task, state: FitState, settings: RecursiveSettings) -> Recursion:
        """Before anything has arrived.

        Args:
            task: What is fitted.
            state: With a body and the calibration to linearise about.
            settings: How it goes.
        """
        return cls(task, replace(state, segments=()), _nothing(border_of(task)), settings=settings)

    @property
    def point(self) -> Array:
        """The ten and all calibration parameters, shape (k,)."""
        assert self.state.parameters is not None
        return np.concatenate([self.state.parameters, self.state.calibration.values])

    @cached_property
    def use(self) -> NDArray[np.intp]:
        """Columns of the border that are estimated, shape (e,)."""
        return np.flatnonzero(np.concatenate([np.ones(TEN, dtype=bool), self.task.active]))

    def body_of(self, run: str) -> tuple[Array, Array]:
        """What a run carries: the ten of :data:`steelyard.inertia.LINEAR_PARAMETERS` and their
        covariance, shapes (10,) and (10, 10).

        Args:
            run: Its name.
        """
        assert self.solution is not None
        pick = self.picked(run)[:, self.use]
        value = self.state.calibration.body(self.solution.value[:TEN], run)
        covariance = pick @ self.solution.covariance @ pick.T
        if self.window is not None and self.window.walk:
            own = by_mass(self.point)[:TEN]
            covariance = covariance + np.outer(own, own) * self.window.variance * _TO_THE_END
        return value, np.asarray(covariance)

    def weighs_more(self, before: str, after: str) -> tuple[float, float]:
        """By how much what one run carries weighs more than what another does, and 1-sigma [kg].

        Args:
            before: Name of that other run.
            after: Name of the one.
        """
        assert self.solution is not None
        first, calibration = self.solution.value[:TEN], self.state.calibration
        value = calibration.body(first, after)[0] - calibration.body(first, before)[0]
        row = (self.picked(after)[0] - self.picked(before)[0])[self.use]
        return float(value), float(np.sqrt(row @ self.solution.covariance @ row))

    def picked(self, run: str) -> Array:
        """How what a run carries follows the border, shape (10, k)."""
        pick = np.eye(TEN, len(self.point))
        place = self.state.calibration.calibration_parameters.place_of_load(run)
        if place is not None:
            pick[:, TEN + place.start : TEN + place.stop] = np.eye(TEN)
        return pick

    def information(self) -> tuple[Array, NDArray[np.intp]]:
        """Inverse of the covariance of the columns that are estimated, shape (e, e), and which these
        are.

        Raises:
            numpy.linalg.LinAlgError: The motion is not determined.
        """
        assert self.window is not None
        window, _ = self._reduced(self.equations)
        known = self.told.normal + self.prior.precision
        return known[np.ix_(self.use, self.use)] + window, self.use

    @property
    def prior(self) -> BorderPrior:
        """What is known beforehand and no part of the past, about where all is."""
        task, state = self.task, self.state
        assert state.parameters is not None
        radius = plausible_radius(task.experiment.robot)
        whole = prior_of(task.experiment, state.calibration, state.parameters, radius)
        new = np.arange(len(self.point)) >= self.passed_on
        if new.all():
            return whole
        here = absolute(self.state)
        precision = np.where(np.outer(new, new), whole.precision, 0.0)
        pull = np.where(new, whole.pull - whole.precision @ here + precision @ here, 0.0)
        return BorderPrior(precision, pull)

    def started(self, window: Window, since: float = 0.0) -> Recursion:
        """At the beginning of a motion.

        Args:
            window: Of it, without chunks.
            since: What was told before is as old then [s].
        """
        walk = self.task.experiment.mass_walk
        if not walk:
            return replace(self, window=window)
        prior, told, here = self.prior, self.relative(self.told), absolute(self.state)
        normal = told.normal + prior.precision
        block, border = window.grid.block, len(here)
        past = NormalEquations(
            np.zeros((block * (DEGREE + 1), block * DEGREE)),
            np.zeros((block * DEGREE, border)),
            normal,
            np.zeros(block * DEGREE),
            told.right + prior.pull - normal @ here,
            block=block,
        )
        if since > 0:
            past = a_step_later(past, by_mass(self.point), 0.0, walk**2 * since)
        at = Point(np.zeros((DEGREE, block)), self.point)
        return replace(
            self,
            window=replace(window, walk=walk, past=Linear(past, at)),
            told=_nothing(border),
            passed_on=border,
        )

    def arrived(
        self, readings: Sequence[Reading], forces: Forces, motion: Array | None = None
    ) -> Recursion:
        """With one more chunk.

        Args:
            readings: Of the motion instruments within it.
            forces: Within it.
            motion: Coefficients as the beginning has them, shape (f, block): body and calibration,
                which the beginning knows better than the chunks so far, stay where they are; None:
                the motion goes on as it does.

        Raises:
            numpy.linalg.LinAlgError: The motion is not determined.
        """
        assert self.window is not None
        longer = self.window.longer(motion)
        number = len(longer.chunks)
        segment = longer.segment(number, tuple(readings))
        here, held = replace(self, window=longer), motion is not None
        if not held:
            here = here._foreseen(segment, forces)
        settled = False
        for turn in range(self.settings.turns):
            assert here.window is not None
            segment = replace(segment, coefficients=here.window.motion[longer.place(number)])
            segment, forces = here._with_jitter(segment, forces)
            if turn and not held and here.window.lively is not None:
                segment = here.window.lively.at_least(segment, longer.grid.intervals)
            _, rows = whitened_rows(here.task, here.state, segment, forces)
            here = here._with_chunk(segment, forces, rows, number)
            here, promised = here._followed() if held else here._stepped()
            settled = promised < self.settings.arrived
            if settled:
                break
        if held:
            assert here.window is not None
            here = replace(here, solution=here._known(here.equations))
        return here if settled else replace(here, unsettled=here.unsettled + 1)

    def _foreseen(self, segment: Segment, forces: Forces) -> Recursion:
        """With a motion of the last chunk that its own instruments show; what a motion that merely
        goes on is off by must not count as a reading that stands far.

        Args:
            segment: The chunk.
            forces: Within it.
        """
        assert self.window is not None
        here, number = self, len(self.window.chunks)
        task, place = self.task, self.window.place(number)
        # The border is held.
        column_of = np.full(len(task.calibration_parameters), -1, dtype=np.intp)
        wide = {
            each.source: _WIDE * self.state.factors.get(each.source, 1.0)
            for each in segment.readings
        }
        for _ in range(self.settings.foresights):
            assert here.window is not None
            segment = replace(segment, coefficients=here.window.motion[place])
            rows = motion_residuals(
                task.experiment, segment, here.state.calibration, column_of, wide, None
            )
            told = [scaled(each, _WIDE) for each in rows]
            here = here._with_chunk(segment, forces, told, number)
            here, promised = here._followed()
            if promised < self.settings.arrived:
                break
        assert here.window is not None
        return replace(here, window=replace(here.window, chunks=self.window.chunks))

    def _with_chunk(
        self,
        segment: Segment,
        forces: Forces,
        rows: Sequence[Rows],
        number: int,
        at: Array | None = None,
    ) -> Recursion:
        """With a chunk of the window as it is linearised, about a border, shape (k,); None: the
        present one.
        """
        assert self.window is not None
        chunk = Chunk(segment, forces, rows, self.point if at is None else at, self.use)
        chunks = (*self.window.chunks[:number], chunk, *self.window.chunks[number + 1 :])
        return replace(self, window=replace(self.window, chunks=chunks))

    def relinearised(self, number: int, segment: Segment, forces: Forces) -> Recursion:
        """With a chunk of the window linearised again where it is now.

        Args:
            number: Of it.
            segment: As it is to be taken, with any coefficients.
            forces: Within it.
        """
        assert self.window is not None
        segment = replace(segment, coefficients=self.window.motion[self.window.place(number)])
        _, rows = whitened_rows(self.task, self.state, segment, forces)
        return self._with_chunk(segment, forces, rows, number)

    def settled(self) -> Recursion:
        """After a step over window and border as they are linearised.

        Raises:
            numpy.linalg.LinAlgError: The motion is not determined.
        """
        return self._stepped()[0]

    def passed(self) -> tuple[Recursion, SegmentEquations]:
        """With the first chunk of the window eliminated, and what it says, calibration parameters
        counted from nothing.

        Raises:
            numpy.linalg.LinAlgError: The motion is not determined.
        """
        assert self.window is not None
        window, first = self.window, self.window.chunks[0]
        point = window.at(self.point, 0)
        then = replace(self.state, parameters=point[:TEN])
        grid, tally = window.grid, Tally()
        segment = replace(first.segment, coefficients=window.motion[window.place(0)])
        balances, rows = whitened_rows(self.task, then, segment, first.forces, tally=tally)
        here = self._with_chunk(segment, first.forces, rows, 0, point)
        assert here.window is not None
        own = here.window.chunks[0].whole.equations
        # The verdict asks all columns, also those that nobody estimates.
        every = here.window.equations(self.point, None)
        every = without_columns(every, len(window.steps)) if window.walk else every
        parts, before = [replace(own, parts={})], _nothing(len(point))
        if window.past is not None:
            past = window.past.seen_from(Point(window.motion[:DEGREE], window.at(self.point, -1)))
            if window.walk:
                step = float(window.steps[0])
                past = a_step_later(past, by_mass(point), step, window.variance)
            parts.append(past)
            before = _of_border(past, point)
        remains = eliminated(together(parts, [0] * len(parts)), DEGREE)
        after = _of_border(remains, point)
        # What it adds to what was known before: independent of that by construction.
        normal, right = after.normal - before.normal, after.right - before.right
        whole = replace(segment, coefficients=window.motion)
        noise = left_noise(self.task, then, whole, balances, every)
        freedom = float(np.sum(~first.forces.touched))
        one = np.zeros(grid.intervals, dtype=np.intp)
        size = segment.coefficients.size
        inverse = every.inverse[:, :size]
        part = SegmentEquations(
            segment,
            first.forces,
            tuple(each.at for each in balances),
            np.concatenate([each.root**2 for each in balances]),
            BorderEquations(normal, right, noise, freedom),
            self._block(normal, right, segment.run),
            by_stretches(segment, rows, every, one)[2],
            inverse,
            every.followed[:size],
            tally,
            {label: banded_trace(each, inverse) for label, each in own.parts.items()},
        )
        lively = window.lively or Liveliness.of(segment, self.settings.forgets / grid.spacing)
        kept = window.motion[grid.intervals : grid.functions]
        left = replace(
            window,
            first=window.first + 1,
            chunks=window.chunks[1:],
            motion=window.motion[grid.intervals :],
            past=Linear(remains, Point(kept, point)),
            steps=window.steps[1:],
            lively=lively.followed(segment, inverse, grid.intervals, self.settings),
        )
        return replace(self, window=left), part

    def _block(self, normal: Array, right: Array, run: str) -> Blocks:
        """What a chunk says, as far as it may be compared with others."""
        if self.task.experiment.mass_walk:
            normal, right = blind_to_mass(normal, right, by_mass(self.point))
        return Blocks(normal[None], right[None], np.array([self._number_of(run)]))

    def ended(self) -> Recursion:
        """With the motion ended; chunks that have not passed are as if they had not arrived."""
        assert self.window is not None
        past = self.window.past
        if past is None:
            return replace(self, window=None)
        told = past.seen_from(Point(past.at.motion, self.point))
        if self.window.walk:
            told = a_step_later(told, by_mass(self.point), 0.0, self.window.variance * _TO_THE_END)
        own = _of_border(told, self.point)
        return replace(self, window=None).with_told(own)

    def with_told(self, equations: BorderEquations) -> Recursion:
        """With readings that belong to no motion.

        Args:
            equations: Of them, with calibration parameters counted from nothing.
        """
        found = replace(self, told=self.told + equations)
        return found._at(found._solved(found._told))

    def relative(self, equations: BorderEquations) -> BorderEquations:
        """Equations with calibration parameters counted from where they are.

        Args:
            equations: With these counted from nothing.
        """
        values = np.concatenate([np.zeros(TEN), self.state.calibration.values])
        return replace(equations, right=equations.right - equations.normal @ values)

    def _number_of(self, run: str) -> int:
        """Of a run in the experiment."""
        return [each.name for each in self.task.experiment.runs].index(run)

    def _with_jitter(self, segment: Segment, forces: Forces) -> tuple[Segment, Forces]:
        """Readings as noisy as their time stamps make them along a motion that is nearly right."""
        task, state = with_jitter(
            replace(self.task, force_samples=(forces,)), replace(self.state, segments=(segment,))
        )
        return state.segments[0], task.force_samples[0] or forces

    def _stepped(self) -> tuple[Recursion, float]:
        """After a step over window and border, and the decrease of the cost that it promised."""
        assert self.window is not None
        every = self.equations
        solution = self._known(every)
        step, walked = solution.value - absolute(self.state)[self.use], None
        if self.window.walk:
            walked = steps_of(*every.reduced(), step)
            step = np.concatenate([step, walked])
        motion = every.motion_step(step)
        promised = float(motion @ every.motion_gradient + step @ every.border_gradient)
        found = replace(self, window=self.window.moved(motion, walked))
        return found._at(solution), abs(promised)

    def _followed(self) -> tuple[Recursion, float]:
        """The same with the border as it is."""
        assert self.window is not None
        every = self.equations
        promised = float(every.settled @ every.motion_gradient)
        return replace(self, window=self.window.moved(every.settled)), abs(promised)

    @property
    def equations(self) -> NormalEquations:
        """Of the window, over the columns that are estimated."""
        assert self.window is not None
        return self.window.equations(self.point, self.use)

    def _reduced(self, every: NormalEquations) -> tuple[Array, Array]:
        """Matrix and right-hand side of the border with motion and steps of the mass eliminated.

        Args:
            every: Equations of the window.
        """
        assert self.window is not None
        normal, gradient = every.reduced()
        if not self.window.walk:
            return normal, gradient
        return settled_steps(normal, gradient, len(self.window.steps))

    def _known(self, every: NormalEquations) -> Solution:
        """Body and calibration from all that has arrived.

        Args:
            every: Equations of the window, over the columns that are estimated.
        """
        normal, gradient = self._reduced(every)
        told, here = self._told, absolute(self.state)[self.use]
        right = told.right + gradient + normal @ here
        return self._solved(replace(told, normal=told.normal + normal, right=right))

    @property
    def _told(self) -> BorderEquations:
        """What belongs to no motion, over the columns that are estimated, calibration parameters
        counted from where they are.
        """
        told = self.relative(self.told)
        normal = told.normal[np.ix_(self.use, self.use)]
        return replace(told, normal=normal, right=told.right[self.use])

    def _at(self, solution: Solution) -> Recursion:
        """With body and calibration as a solution has them."""
        calibration = self.state.calibration
        values = calibration.values.copy()
        values[self.task.active] += solution.value[TEN:]
        state = replace(
            self.state,
            parameters=solution.value[:TEN],
            calibration=replace(calibration, values=values),
        )
        return replace(self, state=state, solution=solution)

    def _solved(self, equations: BorderEquations) -> Solution:
        """Body and calibration.

        Args:
            equations: Over the columns that are estimated.
        """
        task, state, use = self.task, self.state, self.use
        assert state.parameters is not None
        prior = self.prior
        narrow = BorderPrior(prior.precision[np.ix_(use, use)], prior.pull[use])
        sizes = plausible(state.parameters, plausible_radius(task.experiment.robot))
        return solve(
            equations, narrow, np.ones(len(use), dtype=bool), sizes, settings=task.settings
        )


def _nothing(border: int) -> BorderEquations:
    """Equations of no reading."""
    none = np.zeros((TEN, TEN))
    return BorderEquations(np.zeros((border, border)), np.zeros(border), none, 0.0)


def _of_border(equations: NormalEquations, point: Array) -> BorderEquations:
    """What equations say of the border about a point, calibration parameters counted from nothing."""
    if equations.band.any():
        normal, gradient = equations.reduced()
    else:
        # No motion has passed.
        normal, gradient = equations.corner, equations.border_gradient
    none = np.zeros((TEN, TEN))
    return BorderEquations(normal, gradient + normal @ point, none, 0.0)
