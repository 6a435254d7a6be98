"""Watching from Python: an experiment and an address, and what becomes known on the way."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from steelyard.experiment.given import experiment_of
from steelyard.experiment.model import Experiment
from steelyard.experiment.read import read_plan
from steelyard.identification.synchronisation import synchronise
from steelyard.live.settings import LIVE, LiveSettings
from steelyard.live.sources.replay import asked_for
from steelyard.live.sources.table import REPLAY, check_source, open_source
from steelyard.live.watch import Watched, ended
from steelyard.live.watch import watch as follow


def watch(
    experiment: Experiment | str | Path,
    source: str,
    *,
    until: float | None = None,
    settings: LiveSettings = LIVE,
) -> Iterator[Watched]:
    """Estimate while samples arrive.

    Args:
        experiment: Robot and instruments, as a value or the path of its file; of a replay with the
            run.
        source: Address of the samples: ``replay:RUN``, ``replay:RUN@max``, ``udp://HOST:PORT`` and
            others, see the page on watching.
        until: End after so many seconds of recorded time; None: with the source.
        settings: How samples are taken.

    Yields:
        What has become known since the last time, in ``records``; at last the ``estimate`` of all
        that was seen.

    Raises:
        InputError: The address is of no kind, or the file is wrong.
    """
    plan, name = planned(experiment, source)
    samples = open_source(source, plan, settings)
    session = None
    try:
        for each in follow(plan, samples, name, settings):
            session = each.session
            yield each
            if until is not None and session.seconds >= until:
                break
    finally:
        samples.close()
    if session is not None:
        yield ended(session)


def planned(experiment: Experiment | str | Path, source: str) -> tuple[Experiment, str]:
    """What samples are of, and the name of the run that they make.

    Args:
        experiment: Robot and instruments, as a value or the path of its file; of a replay with the
            run.
        source: Address of the samples.

    Raises:
        InputError: The address is of no kind, or the file is wrong.
    """
    check_source(source)
    if source.startswith(REPLAY):
        return synchronise(experiment_of(experiment)).experiment, asked_for(source)[0]
    whole = experiment if isinstance(experiment, Experiment) else read_plan(experiment)
    return replace(whole, runs=()), "live"
