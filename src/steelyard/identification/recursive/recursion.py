"""The joint fit as a stream: what is known after some chunks, and a step over window and border.

A chunk is linearised as it arrives, until it has settled (:mod:`.settling`), and once more when it
leaves the window (:mod:`.passing`); then it is eliminated, and stays as it was linearised. A step
is one of Gauss and Newton over window and border, with what remains of the past [Dellaert2006]_.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.estimates.estimate import plausible_radius
from steelyard.identification.known_body import plausible
from steelyard.identification.model.balance import Forces
from steelyard.identification.model.motion_segment import Segment
from steelyard.identification.model.segment import NormalEquations, Rows
from steelyard.identification.model.sources import Source
from steelyard.identification.recursive.settings import RECURSIVE, RecursiveSettings
from steelyard.identification.recursive.window.chunk import Chunk
from steelyard.identification.recursive.window.past import Linear, Point, nothing_told, of_border
from steelyard.identification.recursive.window.walk import (
    a_step_later,
    by_mass,
    settled_steps,
    steps_of,
)
from steelyard.identification.recursive.window.window import Window
from steelyard.identification.solve.border.normal_equations import (
    BorderEquations,
    BorderPrior,
    Solution,
    solve,
)
from steelyard.identification.solve.border.segment_equations import absolute, whitened_rows
from steelyard.identification.solve.fit_state import FitState, Task
from steelyard.identification.solve.posterior import prior_of
from steelyard.inertia import TEN
from steelyard.smoothing import DEGREE

_TO_THE_END = 1 / 3
"""Variance of a walk from its mean over a chunk to its end, in that of a step."""


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
    """Columns of the border about which what was known beforehand is part of what remains of the
    past: where the mass walks, it is forgotten with it."""
    alone: Mapping[tuple[str, Source], int] = field(default_factory=dict)
    """Run and quantity -> numbers that stood alone, and were left out."""
    settings: RecursiveSettings = RECURSIVE

    @classmethod
    def begun(cls, task: Task, state: FitState, settings: RecursiveSettings) -> Recursion:
        """Before anything has arrived.

        Args:
            task: What is fitted.
            state: With a body and the calibration to linearise about.
            settings: How it goes.
        """
        return cls(task, replace(state, segments=()), nothing_told(task.columns), settings=settings)

    @property
    def point(self) -> Array:
        """The ten and all calibration parameters, shape (k,)."""
        return _point(self.state)

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
        """Inverse of the covariance of the columns that are estimated, shape (e, e), and which
        these are.

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
            told=nothing_told(border),
            passed_on=border,
        )

    def with_chunk(
        self,
        segment: Segment,
        forces: Forces,
        rows: Sequence[Rows],
        number: int,
        state: FitState | None = None,
    ) -> Recursion:
        """With a chunk of the window as it is linearised, about a state, by all columns of the
        border; None: about the present one, by those that are estimated.
        """
        assert self.window is not None
        about, every = (self.state, False) if state is None else (state, True)
        chunk = Chunk(segment, forces, rows, _point(about), self.use, self.task, about, every)
        chunks = (*self.window.chunks[:number], chunk, *self.window.chunks[number + 1 :])
        return replace(self, window=replace(self.window, chunks=chunks))

    def without_numbers(
        self, run: str, before: Mapping[Source, int], after: Mapping[Source, int]
    ) -> Recursion:
        """With numbers counted that stand alone; the very same where there are none.

        Args:
            run: Of a chunk.
            before: Quantity -> numbers of it that counted.
            after: The same without what stands alone.
        """
        fewer = {(run, own): before[own] - count for own, count in after.items()}
        found = {key: self.alone.get(key, 0) + count for key, count in fewer.items() if count}
        return replace(self, alone={**self.alone, **found}) if found else self

    def relinearised(self, number: int, segment: Segment, forces: Forces) -> Recursion:
        """With a chunk of the window linearised again where it is now.

        Args:
            number: Of it.
            segment: As it is to be taken, with any coefficients.
            forces: Within it.
        """
        assert self.window is not None
        segment = replace(segment, coefficients=self.window.motion[self.window.place(number)])
        _, rows = whitened_rows(self.task, self.state, segment, forces, border="estimated")
        return self.with_chunk(segment, forces, rows, number)

    def settled(self) -> Recursion:
        """After a step over window and border as they are linearised.

        Raises:
            numpy.linalg.LinAlgError: The motion is not determined.
        """
        return self.stepped()[0]

    def ended(self) -> Recursion:
        """With the motion ended; chunks that have not passed are as if they had not arrived."""
        assert self.window is not None
        past = self.window.past
        if past is None:
            return replace(self, window=None)
        told = past.seen_from(Point(past.at.motion, self.point))
        if self.window.walk:
            told = a_step_later(told, by_mass(self.point), 0.0, self.window.variance * _TO_THE_END)
        own = of_border(told, self.point)
        found = replace(self, window=None).with_told(own)
        return found._at(found._solved(found._told))

    def with_told(self, equations: BorderEquations) -> Recursion:
        """With readings that belong to no motion; body and calibration stay where they are.

        Args:
            equations: Of them, with calibration parameters counted from nothing.
        """
        return replace(self, told=self.told + equations)

    def relative(self, equations: BorderEquations) -> BorderEquations:
        """Equations with calibration parameters counted from where they are.

        Args:
            equations: With these counted from nothing.
        """
        values = np.concatenate([np.zeros(TEN), self.state.calibration.values])
        return replace(equations, right=equations.right - equations.normal @ values)

    def stepped(self) -> tuple[Recursion, float]:
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

    def followed(self) -> tuple[Recursion, float]:
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

    def known(self) -> Recursion:
        """With what is told of body and calibration; motion and calibration stay where they are."""
        return replace(self, solution=self._known(self.equations))

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
        own = np.ix_(self.use, self.use)
        by_noise = None if told.by_noise is None else told.by_noise[own]
        normal, right = told.normal[own], told.right[self.use]
        return replace(told, normal=normal, right=right, by_noise=by_noise)

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


def _point(state: FitState) -> Array:
    """The ten and all calibration parameters, shape (k,)."""
    assert state.parameters is not None
    return np.concatenate([state.parameters, state.calibration.values])
