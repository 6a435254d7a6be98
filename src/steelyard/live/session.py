"""Samples as they arrive, and what they tell: a beginning is waited for, then chunk by chunk."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from steelyard.errors import AtRestError, InputError
from steelyard.estimates.estimate import Estimate, no_estimate, plausible_radius
from steelyard.experiment.equivalent.platform_frame import centred, run_about
from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run
from steelyard.identification.methods.loads import drawn
from steelyard.identification.methods.recursive import Recursive
from steelyard.identification.recursive.arriving.arrivals import UnreadError, first_after
from steelyard.identification.recursive.concluding import posterior_of
from steelyard.identification.recursive.events import advanced, followed_on
from steelyard.identification.recursive.follow import begin
from steelyard.identification.recursive.following import LOST, Event, Following
from steelyard.identification.recursive.outlook import seconds_until
from steelyard.identification.solve.beginning.begin import NoBalanceError
from steelyard.live.buffer import Buffer
from steelyard.live.left_over import left_over
from steelyard.live.message import Arrival
from steelyard.live.record import Record
from steelyard.live.settings import LIVE, LiveSettings

_NOTHING_YET = (
    "nothing was told: expected forces and motion for some seconds, found too little; see that all"
    " instruments send, and move the platform on all six axes"
)
_AT_REST = "the platform is (nearly) at rest; move it on all six axes"


@dataclass(frozen=True, eq=False)
class Session:
    """What has arrived, and what is known of it."""

    plan: Experiment
    """Robot and instruments; its runs are of no account."""
    name: str
    """Of the run that arrives; with another load it goes on as another one."""
    sync: Mapping[str, float]
    """Instrument -> time of one common event on its clock [s]; empty: the clocks agree."""
    buffer: Buffer = field(default_factory=Buffer)
    following: Following | None = None
    before: Following | None = None
    """Without the last chunk, while that is new: see :meth:`_relieved`."""
    paused: float | None = None
    """Since when forces or motion have been missing [s]; None: they are there."""
    due: float | None = None
    """Common time until which samples must have arrived before a beginning is tried again [s];
    None: none was tried."""
    why: str = ""
    """Why it was none."""
    judged: float = -np.inf
    """When all that was seen was looked at last [s]."""
    estimate: Estimate | None = None
    """What was found then."""
    settings: LiveSettings = LIVE

    def taken(self, arrivals: Iterable[Arrival], refused: int = 0) -> Session:
        """With samples that have arrived, and messages that could not be read."""
        used: dict[str, float] = {}
        if self.following is not None and self.paused is None:
            start, _ = self.following.window.grid.span(self.following.number)
            used = {name: start + self.sync[name] for name in self.sync}
        buffer = self.buffer.with_arrivals(arrivals, used, self.settings)
        return replace(self, buffer=buffer.refused(refused) if refused else buffer)

    def advanced(self) -> tuple[Session, list[Record]]:
        """With all chunks that have arrived whole, and what is known after each."""
        # Nobody waits for a row now: the last one is out.
        found, records = self._relieved(), list[Record]()
        if found.following is None:
            found = found._begun()
        if found.following is not None and found.paused is not None:
            found = found._resumed(found.following, found.paused)
        while (
            found.following is not None
            and found.paused is None
            and found._is_ready(found.following)
        ):
            found, record = found._further()
            records += record
        return found._trimmed(), records

    @property
    def run(self) -> Run:
        """What is at hand, in the platform frame in which the motion is followed."""
        streams = {name: each for name, each in self.buffer.streams.items() if len(each)}
        sync = {name: time for name, time in self.sync.items() if name in streams}
        name = self.name if self.following is None else self.following.like.segment.run
        return run_about(Run(name, streams, sync), self.plan.instruments, -self._centred.origin)

    @cached_property
    def _centred(self) -> Experiment:
        """The plan in the platform frame in which the motion is followed."""
        return centred(self.plan)

    @property
    def last(self) -> Mapping[str, float]:
        """Instrument -> common time of its last sample [s]."""
        return {
            name: float(each.time[-1]) - self.sync.get(name, 0.0)
            for name, each in self.buffer.streams.items()
            if len(each)
        }

    @property
    def seconds(self) -> float:
        """Of recorded time since the first force [s]."""
        return max(self.last.values(), default=0.0) if self.sync else 0.0

    def ended(self) -> tuple[Session, Estimate]:
        """After all that has arrived, with an estimate from it."""
        found = self._relieved()
        if found.following is None:
            return found, no_estimate(Recursive.name, found.why or _NOTHING_YET)
        following = found.following
        if found.paused is not None:
            return found, _estimate(following)
        newest = max(found.last.values())
        with suppress(UnreadError):
            while following.window.grid.span(following.number)[0] < newest:
                following = advanced(following, found.run)
        return replace(found, following=following), _estimate(following.ended())

    def _begun(self) -> Session:
        """With a beginning, where enough for one has arrived."""
        found = self
        forces = [name for name in found.plan.instruments if found.plan.is_force(name)]
        force = next((name for name in forces if len(found.buffer.streams.get(name, ()))), None)
        if force is None:
            return found
        if not found.sync:
            origin = float(found.buffer.streams[force].time[0])
            found = replace(found, sync=dict.fromkeys(found.plan.instruments, origin))
        last = found.last
        first = float(found.buffer.streams[force].time[0]) - found.sync[force]
        length, settings = last[force] - first, found.settings.recursion
        due = first + settings.begin if found.due is None else found.due
        waited = last[force] > due + found.settings.silent
        if min(last.values()) < due and not waited:
            return found
        further = length * (settings.longer - 1)
        try:
            own = replace(settings, begin=length)
            experiment = replace(found._centred, runs=(found.run,))
            following = begin(experiment, own=own)
            if following.begun.fit.converged:
                recursion = replace(following.recursion, settings=settings)
                return replace(found, following=replace(following, recursion=recursion))
            why = "the beginning could not be fitted yet"
        except AtRestError:
            # It takes little to see that, and the robot may start at any time.
            why, further = _AT_REST, settings.begin
        except (InputError, NoBalanceError, np.linalg.LinAlgError) as error:
            why = str(error)
        return replace(found, due=last[force] + further, why=why)

    def _is_ready(self, following: Following) -> bool:
        """Whether the next chunk has arrived, and so much more that nothing of it is to come."""
        _, end = following.window.grid.span(following.number)
        last = self.last
        newest = max(last.values())
        awaited = [time for time in last.values() if newest - time < self.settings.silent]
        return min(awaited) >= end + self.settings.patience

    def _resumed(self, following: Following, since: float) -> Session:
        """With the motion going on, where forces and motion are there again."""
        run, last = self.run, self.last
        common = {name: each.time - self.sync[name] for name, each in run.streams.items()}
        again = first_after(common, since)
        newest = max(last.values())
        awaited = [name for name in again if newest - last[name] < self.settings.silent]
        if not awaited:
            return self
        start = max(again[name] for name in awaited)
        if min(last[name] for name in awaited) - start < self.settings.again:
            return self
        streams = {
            name: run.streams[name].at_rows(slice(int(np.searchsorted(common[name], start)), None))
            for name in awaited
        }
        try:
            resumed = following.resumed(replace(run, streams=streams))
        except (InputError, NoBalanceError, np.linalg.LinAlgError) as error:
            return replace(self, paused=start + self.settings.again, why=str(error))
        return replace(self, following=resumed, paused=None)

    def _relieved(self) -> Session:
        """After what the row of the last chunk does not wait for: its oldest chunk leaves the
        window, and all that was seen is judged where it is time.
        """
        following, before = self.following, self.before
        if following is None or before is None:
            return self
        found = replace(self, before=None)
        try:
            following = following.relieved().summed(self.settings.parts)
        except LOST:
            return found._ended(before, before.lost())
        found = replace(found, following=following)
        now = following.instants[-1].time
        if following.is_beginning or now - self.judged < self.settings.judged:
            return found
        # Of a copy, without the seconds that still change: the motion goes on.
        estimate = _estimate(following.ended_before(), courses=False)
        return replace(found, judged=now, estimate=estimate)

    def _ended(self, before: Following, ended: Following) -> Session:
        """With the motion ended before a chunk that tells nothing: it is followed again once forces
        and motion are there.

        Args:
            before: Without that chunk.
            ended: The same, ended.
        """
        _, end = before.window.grid.span(before.number)
        return replace(self, following=ended, paused=end)

    def _further(self) -> tuple[Session, list[Record]]:
        """With the next chunk."""
        found = self._relieved()
        before = found.following
        if before is None or found.paused is not None:
            return found, []
        try:
            following = followed_on(before, found.run)
        except UnreadError:
            return found._ended(before, before.ended()), []
        except LOST:
            return found._ended(before, before.lost()), []
        found = replace(found, following=following, before=before)
        if following.is_beginning:
            return found, []
        instant = following.instants[-1]
        verdict = None if found.estimate is None else found.estimate.verdict
        force = following.like.forces.name
        origin = found.sync[force]
        happened = following.events[len(before.events) :]
        value = instant.value.copy()
        value[1:4] -= following.experiment.origin
        record = Record.of(
            instant.time + origin,
            following.carried,
            value,
            instant.covariance,
            plausible_radius(found.plan.robot),
            None if verdict is None else verdict.accepted,
            () if verdict is None else verdict.reasons,
            tuple(_as_event(each, origin) for each in happened),
            left_over(following),
            seconds_until(following, dict(found.settings.wanted)) if found.settings.wanted else {},
        )
        return found, [record]

    def _trimmed(self) -> Session:
        """Without samples that have been used, and without a beginning that is too long."""
        if not self.sync:
            return self
        if self.following is None:
            oldest = max(self.last.values()) - self.settings.longest
        elif self.paused is not None:
            oldest = self.paused - self.settings.kept
        else:
            start, _ = self.following.window.grid.span(self.following.number)
            oldest = start - self.settings.kept
        times = {name: oldest + own for name, own in self.sync.items()}
        return replace(self, buffer=self.buffer.since(times))


def _estimate(following: Following, *, courses: bool = True) -> Estimate:
    """From all that was seen; without the courses of the motions where only the verdict counts."""
    try:
        return drawn(Recursive().of, posterior_of(following, courses=courses))
    except (NoBalanceError, np.linalg.LinAlgError) as error:
        return no_estimate(Recursive.name, str(error))


def _as_event(event: Event, origin: float) -> dict[str, Any]:
    """As a line of JSON has it.

    Args:
        event: What has changed.
        origin: Time of the common event on the clock of the forces [s].
    """
    found: dict[str, Any] = {"t": round(event.time + origin, 3), "kind": event.kind}
    if event.mass is not None and event.sigma is not None:
        found |= {"load": event.load, "mass": event.mass, "sigma_mass": event.sigma}
    return found


def in_words(session: Session) -> str:
    """What has arrived, and what was not taken."""
    counts = session.buffer.counts
    left = (
        (counts.late, "too late"),
        (counts.doubled, "doubled"),
        (counts.ahead, "far ahead in time"),
    )
    parts = [f"{count} {what}" for count, what in left if count]
    if counts.refused:
        plural = "" if counts.refused == 1 else "s"
        parts.append(f"{counts.refused} message{plural} that could not be read")
    rest = f"; not taken: {', '.join(parts)}" if parts else ""
    return f"{counts.taken} samples in {session.seconds:.1f} s{rest}"
