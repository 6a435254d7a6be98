"""The estimate while samples arrive."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from steelyard.estimates.estimate import Estimate
from steelyard.experiment.model import Experiment
from steelyard.live.record import Record
from steelyard.live.session import Session
from steelyard.live.settings import LIVE, LiveSettings
from steelyard.live.sources.source import SampleSource
from steelyard.processes.heap import give_back

_GIVEN_BACK = 60.0
"""Of recorded time between two instants at which memory that is free is given to the system [s]: a
verdict takes much of it for a moment, and what is given back is slower when it is taken again."""
_LOOK = 0.05
"""How long a source is waited for before what has arrived is looked at [s]."""


@dataclass(frozen=True, eq=False)
class Watched:
    """What has become known since the last look."""

    session: Session
    records: tuple[Record, ...] = ()
    remarks: tuple[str, ...] = ()
    """What has happened to the connection, and what was refused, in words."""
    estimate: Estimate | None = None
    """Of all that was seen, at the end."""


def watch(
    experiment: Experiment,
    source: SampleSource,
    name: str = "live",
    settings: LiveSettings = LIVE,
    stopped: Callable[[], bool] = lambda: False,
) -> Iterator[Watched]:
    """Follow samples as they arrive, until the source ends.

    Args:
        experiment: Robot and instruments; of a replay with its run.
        source: Where samples come from.
        name: Of the run that they make; of one that the experiment has, its clocks count.
        settings: How samples are taken.
        stopped: Whether to end before the source does.

    Yields:
        What is new, at least every :data:`_LOOK`.
    """
    runs = {run.name: run for run in experiment.runs}
    sync = runs[name].sync if name in runs else {}
    session = Session(replace(experiment, runs=()), name, sync, settings=settings)
    refused, given_back, said = 0, -np.inf, ""
    while True:
        received = source.receive(_LOOK)
        session, records = session.taken(received.arrivals, received.refused).advanced()
        if session.judged - given_back >= _GIVEN_BACK:
            given_back = session.judged
            give_back()
        remarks = list(received.remarks)
        if received.refused and not refused:
            # One sentence for all that are alike; how many there were is said at the end.
            remarks.append(received.why)
        refused += received.refused
        if session.following is None and session.why != said:
            said = session.why
            remarks.append(f"no estimate yet: {said}")
        yield Watched(session, tuple(records), tuple(remarks))
        if received.ended or stopped():
            return


def ended(session: Session) -> Watched:
    """What is known after all that has arrived."""
    session, estimate = session.ended()
    return Watched(session, estimate=estimate)
