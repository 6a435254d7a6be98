"""Forces that are late and forces that are filtered: about no time both are the same, and what reads late
is easily taken for filtered.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from steelyard.identification.model.balance import Forces, forgotten, time_constant
from steelyard.identification.model.calibration_parameters import (
    CalibrationParameter,
    Key,
    gather,
)
from steelyard.identification.model.motion_segment import Segment
from steelyard.identification.model.sources import Source
from steelyard.identification.solve.fit_state import Fit, FitState, Task, linearise
from steelyard.identification.solve.joint_fit import prior_cost
from steelyard.instruments.base import LATENCY, TIME_CONSTANT

ALIKE = 9.0
"""Difference of the costs of a latency and of a filter below which the data do not tell one from the
other, by three of their 1-sigma: then both may be there."""
_SHARED, _OPEN = 0.7, 0.25
"""Time constant of a filter beside a latency and its 1-sigma, in how far readings are behind: the square
of the first is half of the whole, and two of the second take that to nothing and to the whole."""
_MARGIN = 0.1
"""By which clocks may differ, beside [s]."""
_TWIN = {LATENCY: TIME_CONSTANT, TIME_CONSTANT: LATENCY}


def alternatives(task: Task, asked: frozenset[Key], *, held: bool) -> list[frozenset[Key]]:
    """What may explain residuals: what they ask for, and a filter in the place of a latency or the other
    way round; what contradicts a stated delay only where the costs of both are exact.

    Args:
        task: What is fitted.
        asked: For which they ask.
        held: Whether the motion is held.
    """
    return [
        asked,
        *(
            frozenset(key for key in asked if key[:2] != (owner, _TWIN[kind]))
            | {(owner, kind, run)}
            for (owner, kind, run), none in twins_of(task, asked).items()
            if not (held and none.instead)
        ),
    ]


def twins_of(task: Task, asked: frozenset[Key]) -> dict[Key, CalibrationParameter]:
    """Filters where latencies are asked for, latencies where filters are, of the same instruments, as
    they are when they are none; those that are stated are not there.
    """
    wanted = {(owner, _TWIN[key]) for owner, key, _ in asked if key in _TWIN}
    if not wanted:
        return {}
    return {
        (each.owner, each.key, each.run): each
        for each in gather(task.experiment).entries
        if (each.owner, each.key) in wanted and each.is_absent
    }


def join_twins(groups: dict[Key, list[Key]]) -> None:
    """Put latency and filter of an instrument into one group where both are there: each alone would
    seem needless beside the other.

    Args:
        groups: Name of what belongs together -> its keys.
    """
    for owner, key, run in list(groups):
        twin = next((each for each in groups if each[:2] == (owner, _TWIN.get(key))), None)
        if key == LATENCY and twin is not None:
            groups[twin] += groups.pop((owner, key, run))


def shared(
    task: Task, state: FitState, asked: frozenset[Key], alone: FitState
) -> tuple[Task, FitState]:
    """Task and state with what forces are behind shared between latency and filter, where the readings do
    not tell one from the other: what is smoothed goes with the square of the time constant, and is
    believed to be anything between nothing and what the whole would smooth as a filter. Without that
    a time constant near zero would be told by nothing.

    Args:
        task: With both.
        state: Where to begin.
        asked: What the residuals ask for, with both.
        alone: Of a fit with one of them.
    """
    parameters, values = task.calibration_parameters, state.calibration.values.copy()
    entries = {(each.owner, each.key, each.run): each for each in parameters.entries}
    for key in asked:
        twin = next((each for each in asked if each[:2] == (key[0], LATENCY)), None)
        if key[1] != TIME_CONSTANT or twin is None:
            continue
        own, other = parameters.places[key], parameters.places[twin]
        behind = np.abs(alone.calibration.values[own] + alone.calibration.values[other])
        values[own], values[other] = _SHARED * behind, (1 - _SHARED) * behind
        entries[key] = replace(entries[key], mean=_SHARED * behind, deviation=_OPEN * behind)
    parameters = replace(parameters, entries=tuple(entries.values()))
    calibration = replace(state.calibration, calibration_parameters=parameters, values=values)
    return replace(task, calibration_parameters=parameters), replace(state, calibration=calibration)


def prices(
    fits: Sequence[tuple[Task, Fit]], factors: Mapping[Source, float], *, held: bool
) -> list[float]:
    """Of fits, every noise being as large as it is said to be, and without the forces of which one of them
    does not know what its filter remembers.

    Args:
        fits: What was fitted, and how.
        factors: Quantity -> by how much its noise exceeds what its readings say.
        held: Whether the motion is held.
    """
    begins = max(forgotten(constant) for each in fits for constant in _constants(*each))
    found = []
    for task, own in fits:
        forces = [
            samples if samples is None or segment.static else _since(samples, segment, begins)
            for segment, samples in zip(own.state.segments, task.force_samples, strict=True)
        ]
        state, less = (
            replace(own.state, factors=factors),
            replace(task, force_samples=tuple(forces)),
        )
        found.append(linearise(less, state, held=held)[1].cost + prior_cost(task, state))
    return found


def _constants(task: Task, found: Fit) -> Iterator[float]:
    """Time constants of the filters of all segments, 0 where there is none [s]."""
    for segment, forces in zip(found.state.segments, task.force_samples, strict=True):
        own = 0.0
        if forces is not None:
            own = time_constant(task.experiment, segment, forces, found.state.calibration)
        yield own


def _since(forces: Forces, segment: Segment, begins: float) -> Forces:
    """Forces of which those before some time after the beginning of the motion [s] are left out."""
    early = forces.time < segment.span[0] + begins + (_MARGIN if begins else 0.0)
    return replace(forces, left_out=forces.left_out | early[:, None])
