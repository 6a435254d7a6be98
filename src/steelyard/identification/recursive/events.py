"""What happens while a motion is followed: another load, something that touches the platform, a
platform that begins to vibrate.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Final

import numpy as np

from steelyard.estimates.quantiles import chi2_exceeded, chi2_tail
from steelyard.experiment.recording import Run
from steelyard.identification.recursive.arriving.settling import beyond_noise
from steelyard.identification.recursive.changes import FREEDOM, Cause, Change, changes
from steelyard.identification.recursive.following import LOST, Event, Following, NotFollowedError
from steelyard.identification.recursive.new_load import (
    opened,
    restarted,
    unheard_since,
    with_columns,
    with_further_load,
)
from steelyard.identification.recursive.window.finer import on_finer_knots

_OTHERS: Final[tuple[Cause, ...]] = ("contact", "sensor")
"""What may look like another load."""


def advanced(following: Following, run: Run) -> Following:
    """With the next chunk, and with what it shows to have happened; arguments and errors as of
    :func:`followed_on`.
    """
    return followed_on(following, run).relieved()


def followed_on(following: Following, run: Run) -> Following:
    """The same with the oldest chunk still in the window, however long that is: what is known now
    does not wait until it has left.

    Args:
        following: Up to now, relieved.
        run: With what has arrived.

    Raises:
        UnreadError: Nothing has been read within it.
        numpy.linalg.LinAlgError: The motion is not determined.
        InfeasibleError: It is where cables cannot be.
        NotFollowedError: It does not settle.
    """
    found = following.arrived(run)
    if not following.is_beginning:
        found = _followed_closely(following, found, run)
        if found.recursion.unsettled > following.recursion.unsettled:
            raise NotFollowedError
    # What the beginning knows of the body is not known from chunks yet.
    return (found if found.is_beginning else _asked(found)).noted()


def _followed_closely(before: Following, found: Following, run: Run) -> Following:
    """With the last chunk on finer knots, where these take most of what it leaves of the readings
    beyond their noise: the platform has begun to vibrate.

    Args:
        before: Without the chunk.
        found: With it, on the knots that there are.
        run: With what has arrived.
    """
    settings, grid = before.recursion.settings, before.window.grid
    start, _ = grid.span(before.number)
    most = int(grid.length / before.closest)
    best, least = found, beyond_noise(found.recursion)
    if start < before.coarse_until or least < settings.vibrates or most <= grid.intervals:
        return found
    # What cannot be followed on finer knots has been followed on these.
    with suppress(*LOST):
        for finer in _on_finer_knots(before, most):
            there = finer.arrived(run)
            left = beyond_noise(there.recursion)
            if left < settings.followed * least:
                best, least = there, left
    return replace(found, coarse_until=start + settings.begin) if best is found else best


def _on_finer_knots(found: Following, most: int) -> Iterator[Following]:
    """The same with all chunks of the window passed, on knots twice as close, again twice, and so
    on.

    Args:
        found: With knots that are further apart.
        most: Intervals of a chunk, at most.
    """
    while found.window.chunks:
        found = found.passed()
    if found.window.past is None:
        return
    intervals = found.window.grid.intervals
    while intervals < most:
        intervals = min(2 * intervals, most)
        window = on_finer_knots(found.window, intervals)
        yield replace(found, recursion=replace(found.recursion, window=window))


def _asked(found: Following) -> Following:
    """With another load or without a hand's forces, where chunks of the window show that something
    has changed: it is asked again with the chunk after that which shows it first.
    """
    settings = found.recursion.settings
    of_load = changes(found.recursion)
    if not of_load:
        return found
    best, usual = _clearest(of_load), max(1.0, found.scatter)
    chance = chi2_tail(best.statistic / usual, FREEDOM)
    lately = found.touched or _is_changing(found)
    if chance > (settings.lately if lately else settings.alarm):
        return replace(_learnt(found, of_load), suspected=False, touched=False)
    if chance > settings.alarm:
        # What has just changed goes on.
        return _with_contact(found, best) if found.touched else _with_load(found, best)
    if not (found.suspected or lately):
        return replace(found, suspected=True)
    others = {cause: changes(found.recursion, cause) for cause in _OTHERS}
    clearest = {cause: _clearest(each) for cause, each in others.items() if each}
    margin = chi2_exceeded(settings.alarm, FREEDOM) * usual
    cause = max(clearest, key=lambda each: clearest[each].statistic, default=None)
    if cause is not None and clearest[cause].statistic > best.statistic + margin:
        if cause == "contact":
            return _with_contact(found, clearest[cause])
    elif chi2_tail(best.rest / usual, best.rest_freedom) > settings.lately:
        if abs(best.value[0]) > settings.clear * np.sqrt(usual * best.covariance[0, 0]):
            return _with_load(found, best)
        if best.number and not found.touched:
            # It may become clear.
            return found
    if found.touched:
        return _with_contact(found, best)
    return replace(_learnt(found, of_load), suspected=False)


def _clearest(found: Sequence[Change]) -> Change:
    """That which explains most."""
    return max(found, key=lambda each: each.statistic)


def _is_changing(found: Following) -> bool:
    """Whether the window holds a change of the load."""
    run = found.window.like.run
    return any(each.segment.run != run for each in found.window.chunks)


def _time_of(found: Following, change: Change) -> float:
    """When it happened [s]."""
    grid = found.window.grid
    _, end = grid.span(found.window.first + change.number)
    return end - change.share * grid.length


def _learnt(found: Following, of_load: Sequence[Change]) -> Following:
    """With how much the bodies of chunks differ, where that is no change."""
    weight = min(1.0, found.window.grid.length / found.recursion.settings.forgets)
    now = of_load[-1].statistic / FREEDOM
    return replace(found, scatter=found.scatter + weight * (now - found.scatter))


def _with_contact(found: Following, change: Change) -> Following:
    """Without the forces since something touches the platform."""
    events = found.events
    if not found.touched:
        time, run = _time_of(found, change), found.window.like.run
        events = (*events, Event("contact", run, found.carried, time))
    recursion = unheard_since(found.recursion, change.number)
    return replace(found, recursion=recursion, events=events, touched=True)


def _with_load(found: Following, change: Change) -> Following:
    """With what the platform carries after a chunk of the window."""
    number, before = change.number, found.window.like.run
    if _is_changing(found):
        # It is still being put down or lifted: what was found first was on the way.
        recursion = restarted(found.recursion, number, change.value)
        *events, last = found.events
        (from_run,) = {each.segment.run for each in found.window.chunks} - {before}
        mass, sigma = recursion.weighs_more(from_run, before)
        again = replace(last, mass=mass, sigma=sigma)
        return replace(found, recursion=recursion, events=(*events, again), suspected=False)
    experiment = with_further_load(found.experiment, before)
    recursion = opened(found.recursion, experiment, number, change.value)
    run = experiment.runs[-1].name
    event = Event(
        "load",
        run,
        experiment.loads[-1].name,
        _time_of(found, change),
        *recursion.weighs_more(before, run),
    )
    samples = next(each for each in found.samples if each.run == before)
    return replace(
        found,
        experiment=experiment,
        recursion=recursion,
        like=replace(found.like, segment=replace(found.like.segment, run=run)),
        samples=(*found.samples, replace(samples, run=run)),
        parts=tuple(with_columns(each) for each in found.parts),
        events=(*found.events, event),
        suspected=False,
        touched=False,
    )
