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
from steelyard.identification.recursive.settings import RecursiveSettings

Found = TypeVar("Found")


class UnreadError(Exception):
    """Forces or motion have not been read for a while: a motion ends there, and may go on later."""


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
) -> tuple[list[Reading], Forces]:
    """Readings within a span of the motion's time.

    Args:
        experiment: With its instruments.
        run: With what has arrived.
        like: What they are like.
        calibration: With the delays of their clocks.
        span: Beginning and end [s].

    Raises:
        UnreadError: No forces, or nothing of the motion, have been read there.
    """
    forces = _forces(experiment, run, like, calibration, span)
    readings = list(_readings(experiment, run, like, calibration, span, forces))
    if not readings or not len(forces.time):
        raise UnreadError
    return readings, forces


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
    return own, experiment.common_time(run, name, 0.0)[own], there[own]


def _readings(
    experiment: Experiment,
    run: Run,
    like: Likeness,
    calibration: CalibrationValues,
    span: tuple[float, float],
    forces: Forces,
) -> Iterator[Reading]:
    """Of the motion instruments."""
    for each in like.segment.readings:
        name, quantity = each.source
        stream = run.streams.get(name)
        if stream is None or quantity not in stream.values:
            # It has stopped, or never began.
            continue
        own, time, there = _inside(experiment, run, like, calibration, span, name)
        values = stream.values[quantity][own]
        if not len(values):
            continue
        flat = np.isfinite(values.reshape(len(values), -1))
        use = flat.all(axis=1) if values.ndim == 3 else flat.any(axis=1)
        if not use.any():
            continue
        tension = None
        if each.tension is not None and len(forces.time):
            (pulled,) = forces.readings.values()
            tension = np.column_stack([np.interp(there[use], forces.time, c) for c in pulled.T])
        yield replace(each, time=time[use], values=values[use], tension=tension, late=None)


def _forces(
    experiment: Experiment,
    run: Run,
    like: Likeness,
    calibration: CalibrationValues,
    span: tuple[float, float],
) -> Forces:
    """Of the force instrument."""
    own, time, _ = _inside(experiment, run, like, calibration, span, like.forces.name)
    values = {q: run.streams[like.forces.name].values[q][own] for q in like.forces.readings}
    stacked = np.hstack(list(values.values()))
    missing = ~np.isfinite(stacked)
    usual = np.median(np.hstack(list(like.forces.readings.values())), axis=0)
    filled = np.where(missing, usual, stacked)
    use = np.isfinite(stacked).any(axis=1)
    ends = np.cumsum([v.shape[1] for v in values.values()])[:-1]
    unread = like.forces.guessed
    return replace(
        like.forces,
        time=time[use],
        readings=dict(zip(values, np.split(filled[use], ends, axis=1), strict=True)),
        left_out=(missing & ~unread)[use],
        late=None,
        smoothed=False,
        before=None,
    )
