"""Clocks that are late, and events under ``sync`` that are exchanged."""

from __future__ import annotations

from collections.abc import Iterator, Sequence, Set
from itertools import combinations

import numpy as np

from steelyard.arrays import Array
from steelyard.inspection.agreements.excerpt import Excerpt, instruments_by_clock
from steelyard.inspection.agreements.judgement import Judged, evaluated
from steelyard.inspection.agreements.motion import is_of_motion
from steelyard.inspection.mistakes.amendment import SIMPLE, USUAL, Amendment, Subject, shifted
from steelyard.inspection.mistakes.settings import CLOCKS, ClockSettings

SYNC_AUTO = "sync: auto"
"""What to write where nobody has said how the clocks of a run are apart."""


def of_clocks(
    now: Judged,
    suspects: Set[str],
    settings: ClockSettings = CLOCKS,
    before: Set[str] = frozenset(),
) -> Iterator[Amendment]:
    """Clocks of suspected instruments.

    Args:
        now: What contradicts what.
        suspects: Instruments.
        settings: Which delays are tried.
        before: Suspects whose clocks have been looked at.
    """
    excerpt = now.excerpt
    experiment, run = excerpt.experiment, excerpt.run
    own = instruments_by_clock(experiment, run)
    # Instruments that are said to share a clock may not.
    alone = [(name,) for name in run.streams] if run.sync else []
    groups = dict.fromkeys([*own, *alone])
    force = experiment.force_instrument(run)
    for names in groups:
        if force in names or not suspects & set(names) or before & set(names):
            continue
        delay = _best_delay(now, names, settings)
        if delay is not None:
            yield _late(excerpt, names, delay)
    if run.sync:
        yield from _exchanged(excerpt, list(groups), settings)


def _late(excerpt: Excerpt, names: tuple[str, ...], delay: float) -> Amendment:
    """A clock that is late by a delay [s]."""
    key = SYNC_AUTO
    if excerpt.run.sync:
        times = {**excerpt.run.sync}
        times.update({name: excerpt.run.sync[name] + delay for name in names})
        key = "sync: {" + ", ".join(f"{name}: {time:.3f}" for name, time in times.items()) + "}"
    late = "late" if delay > 0 else "early"
    what = f"the clock of {' and '.join(names)} is {late} by {abs(delay):.2f} s"
    change = shifted(dict.fromkeys(names, delay))
    return Subject(names[0], "t").amendment("clock", what, key, change, USUAL, beside=names)


def _best_delay(now: Judged, names: tuple[str, ...], settings: ClockSettings) -> float | None:
    """By how much a clock would have to be late, roughly, if at all [s]."""
    relations = []
    for relation in now.agreements:
        own = [name in names for name, _ in relation[1]]
        if any(own) and not all(own):
            relations.append(relation)
    # Against other motion instruments where there are some: it is quicker, and no body needs to be
    # known.
    relations.sort(key=lambda r: (not is_of_motion(r), -now.agreements[r].worst))
    relations = relations[: settings.relations]
    if not relations:
        return None

    def best_of(delays: Array) -> float:
        best, least = 0.0, np.inf
        for delay in delays.tolist():
            amended, total = shifted(dict.fromkeys(names, delay))(now.excerpt), 0.0
            for relation in relations:
                found = evaluated(amended, relation)
                total += np.inf if found is None else found.cost
                if total >= least:
                    break
            if total < least:
                best, least = delay, total
        return best

    length = float(now.excerpt.time[-1] - now.excerpt.time[0])
    most, coarse, fine = min(settings.largest, length / 2), settings.coarse, settings.fine
    best = best_of(np.arange(-most, most + coarse / 2, coarse))
    if not now.excerpt.run.sync and abs(best) > settings.coarse:
        # That the clocks are apart is enough: they are found from the data then.
        return best
    best = best_of(best + np.arange(-coarse, coarse + fine / 2, fine))
    return best if abs(best) > settings.least else None


def _exchanged(
    excerpt: Excerpt, groups: Sequence[Sequence[str]], settings: ClockSettings
) -> Iterator[Amendment]:
    """Events of two clocks that were written for each other."""
    sync = excerpt.run.sync
    for first, second in combinations(groups, 2):
        apart = sync[first[0]] - sync[second[0]]
        if abs(apart) < settings.least or set(first) & set(second):
            continue
        delays = {**dict.fromkeys(first, -apart), **dict.fromkeys(second, apart)}
        what = f"the events of {first[0]} and {second[0]} under 'sync' are exchanged"
        times = (f"{name}: {sync[name] + delay:.6g}" for name, delay in delays.items())
        key = "sync: {" + ", ".join(times) + "}"
        subject = Subject(first[0], "sync")
        yield subject.amendment("clock", what, key, shifted(delays), SIMPLE, beside=delays)
