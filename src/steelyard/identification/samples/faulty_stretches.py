"""Stretches of streams that are left out of a fit: channels that are stuck, trackers that have
jumped.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from steelyard.experiment.faults.jumps import jumps
from steelyard.experiment.faults.stuck import FEWEST_REPEATS, stuck_alone
from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run


def without_stuck(experiment: Experiment, run: Run) -> tuple[Run, list[str]]:
    """The run without readings that stay the same in one channel while the others of the instrument
    change.
    """
    streams, notes = dict(run.streams), []
    for name, stream in run.streams.items():
        values = dict(stream.values)
        for quantity, each in stream.values.items():
            if each.ndim != 2 or each.shape[1] < 2 or len(each) < 2 * FEWEST_REPEATS:
                continue
            mask = stuck_alone(each, may_rest=experiment.instruments[name].may_rest)
            for channel in np.flatnonzero(mask.any(axis=0)):
                own = np.flatnonzero(mask[:, channel])
                time = experiment.common_time(run, name)[own]
                notes.append(
                    f"run '{run.name}': {quantity.replace('_', ' ')} {channel + 1} of {name} is"
                    f" stuck between {time[0]:.2f} and {time[-1]:.2f} s: left out"
                )
            values[quantity] = np.where(mask, np.nan, each)
        streams[name] = replace(stream, values=values)
    return replace(run, streams=streams), notes


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
