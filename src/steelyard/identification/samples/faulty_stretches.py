"""Stretches of streams that are left out of a fit: channels that are stuck, trackers that have
jumped.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.experiment.faults.jumps import jumps
from steelyard.experiment.faults.stuck import FEWEST_REPEATS, stuck_alone
from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run
from steelyard.identification.model.sources import Source


def without_stuck(experiment: Experiment, run: Run) -> tuple[Run, list[str]]:
    """The run without readings that stay the same in one channel while the others of the instrument
    change.
    """
    streams, notes = dict(run.streams), []
    for name, stream in run.streams.items():
        values, common = dict(stream.values), experiment.common_time(run, name)
        for quantity, each in stream.values.items():
            mask = stuck_in(each, may_rest=experiment.instruments[name].may_rest)
            for channel, (first, last) in spans_of(mask, common).items():
                notes.append(stuck_in_words(run.name, (name, quantity), channel, first, last))
            values[quantity] = np.where(mask, np.nan, each) if mask.any() else each
        streams[name] = replace(stream, values=values)
    return replace(run, streams=streams), notes


def stuck_in(values: Array, *, may_rest: bool) -> NDArray[np.bool_]:
    """Readings of channels that stay the same while the others of their instrument change; none of
    a quantity that has no channels beside each other, or few readings.

    Args:
        values: Of a quantity, shape (n, ...); NaN where there is none.
        may_rest: Whether a channel may rightly stand still while others move.

    Returns:
        Of the shape of the values.
    """
    if values.ndim != 2 or values.shape[1] < 2 or len(values) < 2 * FEWEST_REPEATS:
        return np.zeros(values.shape, dtype=bool)
    return stuck_alone(values, may_rest=may_rest)


def spans_of(mask: NDArray[np.bool_], time: Array) -> dict[int, tuple[float, float]]:
    """Channel -> when it was stuck first and last [s]; those that never were are not in it.

    Args:
        mask: Of :func:`stuck_in`.
        time: Of the readings [s], shape (n,).
    """
    if not mask.any():
        return {}
    found = {}
    for channel in np.flatnonzero(mask.any(axis=0)):
        own = time[mask[:, channel]]
        found[int(channel)] = (float(own[0]), float(own[-1]))
    return found


def stuck_in_words(run: str, source: Source, channel: int, first: float, last: float) -> str:
    """A note of a channel that was stuck.

    Args:
        run: Name of the run.
        source: Instrument and quantity.
        channel: Its number from zero.
        first: When it was so first [s].
        last: When it was so last [s].
    """
    name, quantity = source
    return (
        f"run '{run}': {quantity.replace('_', ' ')} {channel + 1} of {name} is"
        f" stuck between {first:.2f} and {last:.2f} s: left out"
    )


def without_jumps(experiment: Experiment, run: Run) -> tuple[Run, list[str]]:
    """The run without stretches in which an instrument shows another place."""
    streams, notes = dict(run.streams), []
    for name, stream in run.streams.items():
        for quantity in experiment.instruments[name].quantities(experiment.robot.m):
            values = stream.values.get(quantity.name)
            if values is None or quantity.determines != ("position",) or quantity.unit != "m":
                continue
            time = experiment.common_time(run, name)
            found = jumps(time, values)
            left_out = np.zeros(len(values), dtype=bool)
            for each in found:
                left_out[each.first : each.end] = True
                notes.append(
                    f"run '{run.name}': {quantity.name} of {name} jumps by {1e3 * each.size:.0f} mm"
                    f" between {time[each.first]:.2f} and {time[each.end - 1]:.2f} s: left out"
                )
            if found:
                # What looks at another place has no orientation of this one either.
                streams[name] = replace(
                    stream,
                    values={
                        q: np.where(left_out.reshape(-1, *[1] * (v.ndim - 1)), np.nan, v)
                        for q, v in stream.values.items()
                    },
                )
                break
    return replace(run, streams=streams), notes
