"""What has arrived within a chunk, as the fit takes it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import AtRestError
from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run
from steelyard.identification.model.balance import Forces
from steelyard.identification.model.calibration_parameters import CalibrationValues
from steelyard.identification.model.motion_segment import Reading, Segment
from steelyard.identification.model.reading_times import reference_clocks, time_of
from steelyard.identification.model.sources import Source
from steelyard.identification.recursive.settings import RecursiveSettings
from steelyard.identification.samples.faulty_stretches import spans_of, stuck_in

Found = TypeVar("Found")


_BEFORE = 2.0
"""Of what a channel has read before a chunk, by which it is seen that it is stuck [s]."""


class UnreadError(Exception):
    """Forces or motion have not been read for a while: a motion ends there, and may go on later."""


Stuck = dict[tuple[Source, int], tuple[float, float]]
"""Quantity and channel -> when it was stuck first and last [s]."""


@dataclass(frozen=True, eq=False)
class Likeness:
    """What readings are like: sources, 1-sigma, which cables have none."""

    segment: Segment
    """With readings of every quantity that is looked at."""
    forces: Forces


def once_moving(
    look: Callable[[Run], Found],
    run: Run,
    span: tuple[float, float],
    length: float,
    settings: RecursiveSettings,
) -> tuple[Found, float]:
    """What a look at the beginning of a run finds, and how long that is [s]: where the platform is
    at rest in it, as long as that lasts, and as much of its motion.

    Args:
        look: At the run within a window; raises :class:`.AtRestError` where nothing moves.
        run: With what has arrived.
        span: Its beginning and end [s].
        length: Of the beginning [s].
        settings: By how much it is longer then.

    Raises:
        AtRestError: Nothing moves until its end.
    """
    start, end = span
    rested = False
    while True:
        until = min(end, start + length)
        since = max(start, until - settings.longest)
        try:
            found = look(replace(run, window=(since, until)))
        except AtRestError:
            if until >= end:
                raise
            rested, length = True, length * settings.longer
            continue
        if not rested or until >= end:
            return found, length
        rested, length = False, length + settings.begin


def within(
    experiment: Experiment,
    run: Run,
    like: Likeness,
    calibration: CalibrationValues,
    span: tuple[float, float],
) -> tuple[list[Reading], Forces, Stuck]:
    """Readings within a span of the motion's time, and which channels were stuck in it: what these
    repeat is no reading.

    Args:
        experiment: With its instruments.
        run: With what has arrived.
        like: What they are like.
        calibration: With the delays of their clocks.
        span: Beginning and end [s].

    Raises:
        UnreadError: No forces, or nothing of the motion, have been read there.
    """
    forces, stuck = _forces(experiment, run, like, calibration, span)
    readings = []
    for each, own in _readings(experiment, run, like, calibration, span, forces):
        readings.append(each)
        stuck |= own
    if not readings or not len(forces.time):
        raise UnreadError
    return readings, forces, stuck


def first_after(times: Mapping[str, Array], since: float) -> dict[str, float]:
    """Instrument -> time of its first sample from an instant on [s]; without those that have none.

    Args:
        times: Instrument -> times of its samples [s], shape (n,).
        since: The instant [s].
    """
    return {
        name: float(time[at])
        for name, time in times.items()
        if (at := int(np.searchsorted(time, since))) < len(time)
    }


def _times(
    experiment: Experiment, run: Run, like: Likeness, calibration: CalibrationValues, name: str
) -> Array:
    """Times of an instrument in the motion's time [s]."""
    time = experiment.common_time(run, name, 0.0)
    references = reference_clocks(experiment, calibration.calibration_parameters, like.segment)
    there, *_ = time_of(experiment, like.segment, calibration, references, name, time)
    return there


def _inside(
    experiment: Experiment,
    run: Run,
    like: Likeness,
    calibration: CalibrationValues,
    span: tuple[float, float],
    name: str,
) -> tuple[slice, Array, Array]:
    """Samples of an instrument that fall into a span, and when, by its clock and in the motion's
    time [s].
    """
    there = _times(experiment, run, like, calibration, name)
    own = slice(*(int(i) for i in np.searchsorted(there, span)))
    return own, experiment.common_time(run, name, 0.0)[own], there


def _working(
    experiment: Experiment, run: Run, source: Source, own: slice, there: Array
) -> tuple[Array, Stuck]:
    """What a quantity has read in a span, NaN where a channel was stuck, and which were.

    Args:
        experiment: With its instruments.
        run: With what has arrived.
        source: The quantity.
        own: Its samples in the span.
        there: When all of them were read, in the motion's time [s], shape (n,).
    """
    name, quantity = source
    every = run.streams[name].values[quantity]
    if own.start >= own.stop:
        return every[own], {}
    before = int(np.searchsorted(there, there[own.start] - _BEFORE))
    mask = stuck_in(every[before : own.stop], may_rest=experiment.instruments[name].may_rest)
    mask = mask[own.start - before :]
    found = {(source, channel): span for channel, span in spans_of(mask, there[own]).items()}
    return np.where(mask, np.nan, every[own]) if found else every[own], found


def _readings(
    experiment: Experiment,
    run: Run,
    like: Likeness,
    calibration: CalibrationValues,
    span: tuple[float, float],
    forces: Forces,
) -> Iterator[tuple[Reading, Stuck]]:
    """Of the motion instruments, each with its channels that are stuck."""
    for each in like.segment.readings:
        name, quantity = each.source
        stream = run.streams.get(name)
        if stream is None or quantity not in stream.values:
            # It has stopped, or never began.
            continue
        own, time, there = _inside(experiment, run, like, calibration, span, name)
        values, stuck = _working(experiment, run, each.source, own, there)
        if not len(values):
            continue
        flat = np.isfinite(values.reshape(len(values), -1))
        use = flat.all(axis=1) if values.ndim == 3 else flat.any(axis=1)
        if not use.any():
            continue
        tension = None
        if each.tension is not None and len(forces.time):
            (pulled,) = forces.readings.values()
            at = there[own][use]
            tension = np.column_stack([np.interp(at, forces.time, c) for c in pulled.T])
        told = replace(each, time=time[use], values=values[use], tension=tension, late=None)
        yield told, stuck


def _forces(
    experiment: Experiment,
    run: Run,
    like: Likeness,
    calibration: CalibrationValues,
    span: tuple[float, float],
) -> tuple[Forces, Stuck]:
    """Of the force instrument, with its channels that are stuck."""
    name = like.forces.name
    own, time, there = _inside(experiment, run, like, calibration, span, name)
    values, stuck = {}, Stuck()
    for quantity in like.forces.readings:
        values[quantity], found = _working(experiment, run, (name, quantity), own, there)
        stuck |= found
    stacked = np.hstack(list(values.values()))
    missing = ~np.isfinite(stacked)
    usual = np.median(np.hstack(list(like.forces.readings.values())), axis=0)
    filled = np.where(missing, usual, stacked)
    use = np.isfinite(stacked).any(axis=1)
    ends = np.cumsum([v.shape[1] for v in values.values()])[:-1]
    unread = like.forces.guessed
    told = replace(
        like.forces,
        time=time[use],
        readings=dict(zip(values, np.split(filled[use], ends, axis=1), strict=True)),
        left_out=(missing & ~unread)[use],
        late=None,
        smoothed=False,
        before=None,
    )
    return told, stuck
