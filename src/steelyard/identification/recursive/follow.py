"""A recording taken as if it arrived while the robot moves: a beginning that is fitted as a whole,
then chunk by chunk.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import InfeasibleError
from steelyard.experiment.model import Experiment, Run
from steelyard.identification.model.motion_residuals import Segment
from steelyard.identification.model.segment import basis, values_at
from steelyard.identification.recursive.arrivals import Likeness, within
from steelyard.identification.recursive.grid import KnotGrid
from steelyard.identification.recursive.parts import (
    counted_from,
    counted_up,
    motions_of,
    summed_up,
)
from steelyard.identification.recursive.recursion import Recursion, Window
from steelyard.identification.recursive.settings import RECURSIVE, RecursiveSettings
from steelyard.identification.samples.preparation import Samples
from steelyard.identification.solve.beginning import (
    NoBalanceError,
    Readings,
    Tell,
    on_force_clock,
    read,
)
from steelyard.identification.solve.beginning import begin as started
from steelyard.identification.solve.conclusion import Fitted, FittedStretch, concluded
from steelyard.identification.solve.joint_motion import fit_readings
from steelyard.identification.solve.long_recording import span_of
from steelyard.identification.solve.noise_levels import ratios_of
from steelyard.identification.solve.posterior import Posterior
from steelyard.identification.solve.segment_equations import SegmentEquations, segment_equations
from steelyard.identification.solve.settings import FIT, FitSettings
from steelyard.inertia import TEN, Inertia, body_jacobian
from steelyard.smoothing import DEGREE

LOST = (InfeasibleError, np.linalg.LinAlgError)
"""Errors of a motion that cannot be followed."""
_DENSE = 6
"""Instants between two knots at which a motion is taken over to other knots."""


@dataclass(frozen=True, eq=False)
class Instant:
    """What was known at an instant."""

    run: str
    time: float
    """In the time of the forces of the run [s]."""
    value: Array
    """The ten of :data:`steelyard.inertia.BODY_PARAMETERS`, shape (10,)."""
    covariance: Array
    """Shape (10, 10)."""

    @classmethod
    def of(cls, run: str, time: float, found: Recursion) -> Instant:
        """What a recursion knows."""
        assert found.solution is not None
        parameters = found.solution.value[:TEN]
        J = body_jacobian(parameters)
        linear = found.solution.covariance[:TEN, :TEN]
        value = Inertia.from_parameters(parameters).body_parameters
        return cls(run, time, value, np.asarray(J @ linear @ J.T))


@dataclass(frozen=True, eq=False)
class Following:
    """A motion that is followed as it arrives."""

    experiment: Experiment
    begun: Fitted
    """The fit of the beginning."""
    like: Likeness
    samples: tuple[Samples, ...]
    """Of the runs so far, as they began."""
    recursion: Recursion
    first: Array
    """Coefficients of the beginning of the motion on its grid, shape (f, block)."""
    number: int = 0
    """Of the next chunk."""
    parts: tuple[SegmentEquations, ...] = ()
    """What has left the window, calibration parameters counted from nothing."""
    instants: tuple[Instant, ...] = ()

    @property
    def window(self) -> Window:
        """The motion as far as it is still fitted."""
        assert self.recursion.window is not None
        return self.recursion.window

    @property
    def is_beginning(self) -> bool:
        """Whether the next chunk is of the beginning, which knows more than the chunks so far."""
        return self._motion(self.number) is not None

    def _motion(self, number: int) -> Array | None:
        """Coefficients of a chunk as the beginning has them, shape (f, block)."""
        grid = self.window.grid
        own = self.first[number * grid.intervals :][: grid.functions]
        return own if len(own) == grid.functions else None

    def advanced(self, run: Run) -> Following:
        """With the next chunk.

        Args:
            run: With what has arrived.
        """
        grid, settings = self.window.grid, self.recursion.settings
        span = grid.span(self.number)
        readings, forces = within(
            self.experiment, run, self.like, self.recursion.state.calibration, span
        )
        recursion = self.recursion.arrived(readings, forces, self._motion(self.number))
        found = replace(self, recursion=recursion, number=self.number + 1)
        if len(found.window.chunks) * grid.length > settings.lag:
            found = found.passed()
        instant = Instant.of(run.name, span[1], found.recursion)
        return replace(found, instants=(*found.instants, instant))

    def has(self, run: Run) -> bool:
        """Whether forces and motion have been read within the next chunk.

        Args:
            run: With what has arrived.
        """
        span = self.window.grid.span(self.number)
        calibration = self.recursion.state.calibration
        readings, forces = within(self.experiment, run, self.like, calibration, span)
        return bool(readings) and len(forces.time) > 0

    def summed(self, most: int) -> Following:
        """The same with the oldest parts summed up, and without the oldest instants.

        Args:
            most: Parts that stay as they are; twice as many may be kept until then.
        """
        if len(self.parts) <= 2 * most:
            return self
        old, new = self.parts[:-most], self.parts[-most:]
        return replace(self, parts=(summed_up(old), *new), instants=self.instants[-most:])

    def passed(self) -> Following:
        """With the oldest chunk of the window eliminated."""
        recursion, part = self.recursion.passed()
        return replace(self, recursion=recursion, parts=(*self.parts, part))

    def ended(self) -> Following:
        """With the motion ended."""
        found = self
        while found.window.chunks:
            found = found.passed()
        return replace(found, recursion=found.recursion.ended())

    def resumed(self, run: Run) -> Following:
        """With the motion of another run, of which enough has arrived to begin with.

        Args:
            run: With what has arrived.

        Raises:
            NoBalanceError: It has no motion.
        """
        state, begin = self.recursion.state, self.recursion.settings.begin
        start, end = span_of(self.experiment, run)
        early = replace(run, window=(start, min(end, start + begin)))
        readings = read(
            self.experiment, state.calibration, _silent, [early], self.begun.task.settings
        )
        if not readings.segments:
            raise NoBalanceError("; ".join(readings.notes))
        told = on_force_clock(self.experiment, replace(state, segments=readings.segments[:1]))
        segment = told.segments[0].disturbed(self.like.segment.processes)
        sigmas = {each.source: each.sigma for each in self.like.segment.readings}
        like = replace(
            self.like.segment,
            run=run.name,
            knots=segment.knots,
            coefficients=segment.coefficients,
            readings=tuple(
                replace(each, sigma=sigmas[each.source])
                for each in segment.readings
                if each.source in sigmas
            ),
            reference=segment.reference,
        )
        number = [each.name for each in self.experiment.runs].index(run.name)
        known = any(each.run == run.name for each in self.samples)
        samples = self.samples if known else (*self.samples, *readings.samples)
        return _at_beginning(
            replace(self, samples=samples), number, Likeness(like, self.like.forces)
        )

    @property
    def posterior(self) -> Posterior:
        """All that follows, after the last motion has ended."""
        fitted, recursion = self.begun, self.recursion
        here = recursion.state.calibration.values
        parts = [counted_from(part, -here) for part in motions_of(self.parts)]
        tally, spent = counted_up(parts)
        state = replace(recursion.state, segments=tuple(part.segment for part in parts))
        fit = replace(
            fitted.fit,
            state=state,
            equations=(),
            tally=tally,
            ratios=ratios_of(recursion.task, spent, tally),
            turns=len(self.parts),
            converged=fitted.fit.converged and not recursion.unsettled,
        )
        forces = tuple(part.force_samples for part in parts)
        whole = replace(fitted, task=recursion.task, fit=fit, force_samples=forces)
        readings = Readings(
            self.experiment,
            recursion.state.calibration,
            self.experiment.runs,
            self.samples,
            (),
            recursion.task.settings,
        )
        return concluded([FittedStretch(readings, whole, tuple(parts))])


def begin(
    experiment: Experiment,
    tell: Tell = lambda what, fraction: None,
    settings: FitSettings = FIT,
    own: RecursiveSettings = RECURSIVE,
) -> Following:
    """Fit the poses at rest and the beginning of the first run in motion as a whole.

    Args:
        experiment: With a run in motion, of which enough has arrived.
        tell: Is called with what is being done and the fraction that is done.
        settings: How to fit.
        own: How the recursion goes.

    Raises:
        InputError: The run lacks what the fit needs.
        NoBalanceError: Forces and motion cannot be fitted.
    """
    run = next(each for each in experiment.runs if not each.static)
    start, end = span_of(experiment, run)
    length = own.begin
    while True:
        early = replace(run, window=(start, min(end, start + length)))
        found = _begun(experiment, early, tell, settings, own)
        if found.begun.fit.converged or start + length >= end:
            break
        length *= own.longer
    number = [each.name for each in experiment.runs].index(run.name)
    return _at_beginning(found, number, found.like)


def _begun(
    experiment: Experiment,
    early: Run,
    tell: Tell,
    settings: FitSettings,
    own: RecursiveSettings,
) -> Following:
    """Levels and values to begin with, from the poses at rest and the beginning of a run in motion.

    Raises:
        InputError: A run lacks what the fit needs.
        NoBalanceError: Forces and motion cannot be fitted.
    """
    at_rest = [each for each in experiment.runs if each.static]
    taken = read(experiment, None, tell, [*at_rest, early], settings)
    fitted = fit_readings(taken, started(taken, tell, thorough=False), tell)
    task, state = fitted.task, fitted.fit.state
    moving = [
        Likeness(segment, forces)
        for segment, forces in zip(state.segments, fitted.force_samples, strict=True)
        if not segment.static
    ]
    if not moving:
        raise NoBalanceError("; ".join(taken.notes))
    like = min(moving, key=lambda each: _spacing(each.segment))
    recursion = Recursion.begun(task, state, own)
    names = [each.name for each in experiment.runs]
    parts = []
    for segment, forces in zip(state.segments, fitted.force_samples, strict=True):
        if segment.static:
            part = segment_equations(
                task, state, segment, forces, None, run=names.index(segment.run)
            )
            parts.append(counted_from(part, state.calibration.values))
            recursion = recursion.with_told(parts[-1].equations)
    return Following(
        experiment,
        fitted,
        like,
        taken.samples,
        recursion,
        np.zeros((0, like.segment.block)),
        parts=tuple(parts),
    )


def follow(
    experiment: Experiment,
    tell: Tell = lambda what, fraction: None,
    settings: FitSettings = FIT,
    own: RecursiveSettings = RECURSIVE,
) -> Iterator[Following]:
    """A whole recording, chunk by chunk; the last is after all motions have ended.

    Args:
        experiment: With a run in motion.
        tell: Is called with what is being done and the fraction that is done.
        settings: How to fit.
        own: How the recursion goes.

    Raises:
        InputError: A run lacks what the fit needs.
        NoBalanceError: Forces and motion cannot be fitted.
    """
    moving = [each for each in experiment.runs if not each.static]
    found = begin(experiment, tell, settings, own)
    for i, run in enumerate(moving):
        found = found.resumed(run) if i else found
        _, end = span_of(experiment, run)
        while found.window.grid.span(found.number)[0] < end:
            try:
                found = found.advanced(run)
            except LOST as error:
                when = found.window.grid.span(found.number)[0]
                raise NoBalanceError(
                    f"run '{run.name}': the motion was lost at {when:.1f} s, where what was read does"
                    " not go on from before; use maximum-likelihood, which takes a recording as a whole"
                ) from error
            done = found.window.grid.span(found.number)[0] / max(end, 1e-9)
            tell(f"following {run.name}", 0.4 + 0.5 * (i + min(1.0, done)) / len(moving))
            yield found
        found = found.ended()
    yield found


def _at_beginning(found: Following, number: int, like: Likeness) -> Following:
    """At the beginning of a motion.

    Args:
        found: With no motion that is followed.
        number: Of its run.
        like: What its readings are like; with the motion of the beginning.
    """
    segment, own = like.segment, found.recursion.settings
    spacing = min(_spacing(each) for each in found.begun.fit.state.segments if not each.static)
    intervals = max(1, round(own.chunk / spacing))
    first, _ = segment.span
    read_at = [float(each.time[0]) for each in segment.readings]
    start = max(first, min(read_at))
    grid = KnotGrid(start, spacing, intervals, segment.block)
    window = Window(number, grid, segment)
    recursion = replace(found.recursion, window=window)
    return replace(found, like=like, recursion=recursion, first=_on_grid(segment, grid), number=0)


def _spacing(segment: Segment) -> float:
    """Of the knots [s]."""
    return float(segment.knots[DEGREE + 1] - segment.knots[DEGREE])


def _on_grid(segment: Segment, grid: KnotGrid) -> Array:
    """Coefficients of a segment on a grid, of the chunks that it covers, shape (f, block)."""
    count = int((segment.span[1] - grid.start) // grid.length)
    if not count:
        return np.zeros((0, segment.block))
    knots = grid.knots(0, count)
    end = grid.start + count * grid.length
    times = np.linspace(grid.start, end, _DENSE * count * grid.intervals + 1)
    local = basis(knots, times)
    matrix = np.zeros((len(times), len(knots) - DEGREE - 1))
    np.put_along_axis(matrix, local.first[:, None] + np.arange(DEGREE + 1), local.values[0], axis=1)
    values = values_at(segment.basis(times), segment.coefficients)
    coefficients, *_ = np.linalg.lstsq(matrix, values, rcond=None)
    return np.asarray(coefficients)


def _silent(what: str, fraction: float) -> None:
    """Tells nobody."""
