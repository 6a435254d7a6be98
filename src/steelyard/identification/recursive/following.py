"""A motion that is followed as it arrives: chunks are taken, pass, and make a posterior in the
end.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import InfeasibleError
from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run
from steelyard.identification.model.motion_segment import Segment
from steelyard.identification.recursive.arriving.arrivals import (
    Likeness,
    Stuck,
    once_moving,
    within,
)
from steelyard.identification.recursive.arriving.settling import arrived
from steelyard.identification.recursive.new_load import FIRST
from steelyard.identification.recursive.parts import (
    summed_up,
    with_further,
)
from steelyard.identification.recursive.passing import passed
from steelyard.identification.recursive.recursion import Recursion
from steelyard.identification.recursive.window.grid import KnotGrid, coefficients_on
from steelyard.identification.recursive.window.window import Window
from steelyard.identification.samples.prepared import Samples
from steelyard.identification.solve.beginning.begin import NoBalanceError
from steelyard.identification.solve.beginning.first_body import on_force_clock
from steelyard.identification.solve.beginning.readings import read
from steelyard.identification.solve.border.segment_equations import SegmentEquations
from steelyard.identification.solve.fit_state import FitState
from steelyard.identification.solve.fitted import Fitted
from steelyard.identification.solve.long_recording import span_of
from steelyard.inertia import Inertia, body_jacobian


class NotFollowedError(Exception):
    """A chunk of a motion did not settle, on no knots: what was read does not go on from before."""


LOST = (InfeasibleError, np.linalg.LinAlgError, NotFollowedError)
"""Errors of a motion that cannot be followed."""
_MOST_UNFOLLOWED = 0.1
"""Part of all chunks that cannot be followed, up to which the rest tells what is carried."""
_KEPT = 1.25
"""How many parts are kept before the oldest are summed up, in those that stay."""


@dataclass(frozen=True, eq=False)
class Instant:
    """What was known at an instant."""

    run: str
    time: float
    """In the time of the forces of the run [s]."""
    value: Array
    """Of what the platform carries then: the ten of :data:`steelyard.inertia.BODY_PARAMETERS`,
    shape (10,)."""
    covariance: Array
    """Shape (10, 10)."""

    @classmethod
    def of(cls, run: str, time: float, found: Recursion) -> Instant:
        """What a recursion knows."""
        parameters, linear = found.body_of(run)
        J = body_jacobian(parameters)
        value = Inertia.from_parameters(parameters).body_parameters
        return cls(run, time, value, np.asarray(J @ linear @ J.T))


@dataclass(frozen=True, eq=False)
class Event:
    """Something that has changed, as it was seen first."""

    kind: Literal["load", "contact"]
    """Whether the platform carries something else since then, or something touches it."""
    run: str
    """As which the recording goes on."""
    load: str
    """Name of what is carried from then on."""
    time: float
    """In the time of the forces of the run [s]."""
    mass: float | None = None
    """Of a load: by how much it weighs more than what was carried before [kg]."""
    sigma: float | None = None
    """1-sigma [kg]."""


@dataclass(frozen=True, eq=False)
class RunBeginning:
    """The beginning of a further run, as it is fitted by itself."""

    state: FitState
    """What is known after the runs before, with the clocks of this one and what it carries."""
    segment: Segment
    """With its motion and disturbances."""


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
    """What has left the window, calibration parameters counted from nothing; the last one says what
    the readings of every quantity bring in all of them."""
    instants: tuple[Instant, ...] = ()
    events: tuple[Event, ...] = ()
    """What has changed."""
    scatter: float = 1.0
    """How much more the bodies of single chunks differ than noise explains, as a factor of their
    chi-square."""
    suspected: bool = False
    """Whether the last chunk looked as if something had changed."""
    touched: bool = False
    """Whether something touches the platform now."""
    closest: float = np.inf
    """Between knots, as the motion's instruments resolve it [s]."""
    coarse_until: float = -np.inf
    """Until when finer knots need not be tried again, which have not helped [s]."""
    followed: float = 0.0
    """Length of all chunks so far [s]."""
    unfollowed: float = 0.0
    """Length of those that could not be followed [s]."""
    stuck: Mapping[str, Stuck] = field(default_factory=dict)
    """Run -> channels that repeated what they had read, which were left out meanwhile."""

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

    @property
    def carried(self) -> str:
        """Name of what the platform carries now."""
        load = self.experiment.load_of(self.like.segment.run)
        return FIRST if load is None else load.name

    def arrived(self, run: Run) -> Following:
        """With the next chunk.

        Args:
            run: With what has arrived.

        Raises:
            UnreadError: No forces, or no motion, have been read within it.
            numpy.linalg.LinAlgError: The motion is not determined.
            InfeasibleError: It is where cables cannot be.
        """
        grid, calibration = self.window.grid, self.recursion.state.calibration
        span = grid.span(self.number)
        readings, forces, stuck = within(self.experiment, run, self.like, calibration, span)
        recursion = arrived(self.recursion, readings, forces, self._motion(self.number))
        followed = self.followed + grid.length
        # The beginning that was fitted has notes of its own.
        noted = self.is_beginning and any(
            each.run == run.name for each in self.begun.fit.state.segments
        )
        return replace(
            self,
            recursion=recursion,
            number=self.number + 1,
            followed=followed,
            stuck=self.stuck if noted else _joined(self.stuck, run.name, stuck),
        )

    def lost(self) -> Following:
        """With the motion ended before a chunk that cannot be followed."""
        return replace(self.ended(), unfollowed=self.unfollowed + self.window.grid.length)

    def remarked(self, note: str) -> Following:
        """With a note of what is not told."""
        return replace(self, begun=replace(self.begun, lost=(*self.begun.lost, note)))

    @property
    def is_followed(self) -> bool:
        """Whether that is so of few chunks."""
        return self.unfollowed <= _MOST_UNFOLLOWED * (self.followed + self.unfollowed)

    def noted(self) -> Following:
        """With what is known after the last chunk."""
        _, end = self.window.grid.span(self.number - 1)
        instant = Instant.of(self.window.like.run, end, self.recursion)
        return replace(self, instants=(*self.instants, instant))

    def relieved(self) -> Following:
        """Without the oldest chunk where the window is longer than the lag: what is known stays the
        same until the next one arrives.
        """
        window = self.window
        is_long = len(window.chunks) * window.grid.length > self.recursion.settings.lag
        return self.passed() if is_long else self

    def summed(self, most: int) -> Following:
        """The same with the oldest parts summed up, and without the oldest instants.

        Args:
            most: Parts that stay as they are; a quarter more may be kept until then.
        """
        if len(self.parts) <= _KEPT * most:
            return self
        old, new = self.parts[:-most], self.parts[-most:]
        by_run: dict[str, list[SegmentEquations]] = {}
        for part in old:
            by_run.setdefault(part.segment.run, []).append(part)
        summed = tuple(summed_up(each) for each in by_run.values())
        return replace(self, parts=(*summed, *new), instants=self.instants[-most:])

    def passed(self) -> Following:
        """With the oldest chunk of the window eliminated."""
        recursion, part = passed(self.recursion)
        return replace(self, recursion=recursion, parts=with_further(self.parts, part))

    def ended(self) -> Following:
        """With the motion ended; the very same where it has."""
        if self.recursion.window is None:
            return self
        found = self
        while found.window.chunks:
            found = found.passed()
        return replace(found, recursion=found.recursion.ended())

    def ended_before(self) -> Following:
        """With the motion ended where the window begins, for what may wait until the last seconds
        have passed; where nothing of a run has passed yet, with all of it.
        """
        passed = {part.segment.run for part in self.parts}
        if any(chunk.segment.run not in passed for chunk in self.window.chunks):
            return self.ended()
        return replace(self, recursion=self.recursion.ended())

    def resumed(self, run: Run, begun: RunBeginning | None = None) -> Following:
        """With the motion of another run, of which enough has arrived to begin with.

        Args:
            run: With what has arrived.
            begun: Its beginning as it is fitted by itself; None: clocks and what it carries are as
                is known.

        Raises:
            NoBalanceError: It has no motion.
        """
        own, fit = self.recursion.settings, self.begun.task.settings
        state = self.recursion.state if begun is None else begun.state
        readings, _ = once_moving(
            lambda early: read(self.experiment, state.calibration, silent, [early], fit),
            run,
            span_of(self.experiment, run),
            own.begin,
            own,
        )
        if not readings.segments:
            raise NoBalanceError("; ".join(readings.notes))
        if begun is None:
            told = on_force_clock(self.experiment, replace(state, segments=readings.segments[:1]))
            segment = told.segments[0].disturbed(self.like.segment.processes)
        else:
            segment = begun.segment
        known = any(each.run == run.name for each in self.samples)
        sigmas = {each.source: each.sigma for each in self.like.segment.readings}
        forces = self.like.forces
        if not known:
            # Another run may be noisier or less so, where nobody has stated how noisy it is.
            sigmas = {s.source: s.sigma for s in segment.readings if s.source in sigmas}
            forces = replace(forces, sigma=readings.force_samples[0].sigma)
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
            processes=segment.processes,
        )
        if not like.readings:
            raise NoBalanceError(f"run '{run.name}': no instrument tells its motion")
        samples = self.samples if known else (*self.samples, *readings.samples)
        resumed = replace(
            self,
            samples=samples,
            recursion=replace(self.recursion, state=state),
            closest=readings.records[-1].closest,
        )
        return at_beginning(resumed, Likeness(like, forces))


def _joined(before: Mapping[str, Stuck], run: str, stuck: Stuck) -> Mapping[str, Stuck]:
    """Channels that were stuck, with those of a chunk.

    Args:
        before: Run -> those so far.
        run: Name of the run of the chunk.
        stuck: Those of the chunk.
    """
    if not stuck:
        return before
    first = before.get(run, {})
    spans = {key: (first.get(key, span)[0], span[1]) for key, span in stuck.items()}
    return {**before, run: {**first, **spans}}


def at_beginning(found: Following, like: Likeness) -> Following:
    """At the beginning of a motion.

    Args:
        found: With no motion that is followed.
        like: What its readings are like; with the motion of the beginning.
    """
    segment, own = like.segment, found.recursion.settings
    spacing = min(each.spacing for each in found.begun.fit.state.segments if not each.static)
    intervals = max(1, round(own.chunk / spacing))
    first, _ = segment.span
    read_at = [float(each.time[0]) for each in segment.readings]
    start = max(first, min(read_at))
    grid = KnotGrid(start, spacing, intervals, segment.block)
    last = found.instants[-1].time if found.instants else start
    recursion = found.recursion.started(Window(grid, segment), start - last)
    return replace(
        found, like=like, recursion=recursion, first=coefficients_on(grid, segment), number=0
    )


def silent(what: str, fraction: float) -> None:
    """Tells nobody."""
