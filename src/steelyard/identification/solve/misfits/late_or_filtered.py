"""Forces that are late and forces that are filtered: about no time both are the same, and what
reads late is easily taken for filtered.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from steelyard.identification.model.balance import Forces, forgotten, time_constant
from steelyard.identification.model.calibration_parameters import (
    CalibrationParameter,
    CalibrationParameters,
    Key,
    gather,
)
from steelyard.identification.model.motion_segment import Segment
from steelyard.identification.model.sources import Source
from steelyard.identification.solve.fit_state import Fit, FitState, Task, linearise, smooth
from steelyard.identification.solve.joint_fit import fit, prior_cost
from steelyard.identification.solve.misfits.suspected_errors import (
    is_possible,
    taken_back,
    with_priors_of,
)
from steelyard.instruments.base import LATENCY, TIME_CONSTANT

_Possible = tuple[frozenset[Key], tuple[Task, Fit]]
"""What is asked for, and the task and its fit with that."""
ALIKE = 30.0
"""Difference of the costs of a latency and of a filter below which the data do not tell one from
the other: then both may be there. By noise alone it would be a matter of three of their 1-sigma;
with what else is not quite as described, filters that were there have cost up to 27 more than
delays."""
_SHARED, _OPEN = 0.7, 0.25
"""Time constant of a filter beside a latency and its 1-sigma, in how far readings are behind: the
square of the first is half of the whole, and two of the second take that to nothing and to the
whole."""
_MARGIN = 0.1
"""By which clocks may differ, beside [s]."""
_TWIN = {LATENCY: TIME_CONSTANT, TIME_CONSTANT: LATENCY}


def alternatives(task: Task, asked: frozenset[Key]) -> list[frozenset[Key]]:
    """What may explain residuals: what they ask for, and a filter in the place of a latency or the
    other way round.

    Args:
        task: What is fitted.
        asked: For which they ask.
    """
    return [
        asked,
        *(
            frozenset(key for key in asked if key[:2] != (owner, _TWIN[kind]))
            | {(owner, kind, run)}
            for owner, kind, run in twins_of(task, asked)
        ),
    ]


def twins_of(task: Task, asked: frozenset[Key]) -> dict[Key, CalibrationParameter]:
    """Filters where latencies are asked for, latencies where filters are, of the same instruments,
    as they are when they are none; those that are stated are not there.
    """
    wanted = {(owner, _TWIN[key]) for owner, key, _ in asked if key in _TWIN}
    if not wanted:
        return {}
    return {
        each.full_key: each
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
    """Task and state with what forces are behind shared between latency and filter, where the
    readings do not tell one from the other: what is smoothed goes with the square of the time
    constant, and is believed to be anything between nothing and what the whole would smooth as a
    filter. Without that a time constant near zero would be told by nothing.

    Args:
        task: With both.
        state: Where to begin.
        asked: What the residuals ask for, with both.
        alone: Of a fit with one of them.
    """
    parameters, values = task.calibration_parameters, state.calibration.values.copy()
    entries = {each.full_key: each for each in parameters.entries}
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
    """Of fits, every noise being as large as it is said to be, and without the forces of which one
    of them does not know what its filter remembers; with what the motion takes up of the noise.

    Behind a filter forces tell less of what is fast in a motion, which then follows less of their
    noise and leaves more of it over: by that alone a delay would seem better. What is likely over
    all motions is no measure either: where a motion is smoother than its prior, it is in favour of
    the filter.

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
        parts, tally = linearise(less, state, held=held)
        found.append(tally.cost + prior_cost(task, state))
        if not held:
            equations = smooth(state, [each.all for each in parts])
            found[-1] += sum(sum(each.spent().values()) for each in equations)
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


def with_twins_settled(
    task: Task,
    found: Fit,
    before: CalibrationParameters,
    again: Callable[[Task, FitState], Fit] = fit,
) -> tuple[Task, Fit]:
    """The task with a latency of the forces in the place of a filter or the other way round, or
    with both, where that is how it is once everything else has been found; the very same where it
    stays as it is.

    Beside what is not explained yet, what costs more tells little.

    Args:
        task: What has been fitted.
        found: How, with its processes.
        before: The calibration parameters before anything was asked for.
        again: Fits once more.

    Raises:
        numpy.linalg.LinAlgError: The motion is not determined.
    """
    twins = {k: none for k, none in before.absent.items() if k[1] in _TWIN}
    believed = task.calibration_parameters.believed_since(before)
    for owner in sorted({key[0] for key in twins}):
        own = {key: none for key, none in twins.items() if key[0] == owner}
        asked = frozenset(own.keys() & believed.keys())
        if len(own) > 1 and asked:
            task, found = _settled(task, found, own, asked, again)
    return task, found


def _settled(
    task: Task,
    found: Fit,
    absent: Mapping[Key, CalibrationParameter],
    asked: frozenset[Key],
    again: Callable[[Task, FitState], Fit],
) -> tuple[Task, Fit]:
    """See :func:`with_twins_settled`, of one instrument.

    Args:
        task: What has been fitted.
        found: How.
        absent: Its latency and its filter, as they are when they are none.
        asked: Which of these are there.
        again: Fits once more.
    """
    without, state = taken_back(task, found.state, {key: absent[key] for key in asked})
    places = without.calibration_parameters.places
    behind = sum(found.state.calibration.values[places[key]] for key in asked)
    possible = list[_Possible]()
    for key in absent:
        # Both anew: how smooth the motion is, is found again, and has its price.
        own = frozenset({key})
        parameters = without.calibration_parameters.believed(own)
        tried, start = with_priors_of(without, state, parameters)
        values = start.calibration.values.copy()
        values[places[key]] = behind
        start = replace(start, calibration=replace(start.calibration, values=values))
        fitted = again(tried, start)
        if fitted.converged and is_possible(tried, fitted, own):
            possible.append((own, (tried, fitted)))
    if not possible:
        return task, found
    best, chosen = of_twins(without, replace(found, state=state), possible, again, held=False)
    return (task, found) if best == asked else chosen


def of_twins(
    task: Task,
    found: Fit,
    possible: Sequence[_Possible],
    again: Callable[[Task, FitState], Fit],
    *,
    held: bool,
) -> _Possible:
    """Which of some fits costs least, or one with all that two ask for that cost alike.

    Args:
        task: What has been fitted.
        found: How.
        possible: What is asked for, with its task and its fit, at least one.
        again: Fits once more.
        held: Whether the motion is held.
    """
    if len(possible) == 1:
        return possible[0]
    costs = prices([there for _, there in possible], found.state.factors, held=held)
    (cost, first), (more, second) = sorted(zip(costs, possible, strict=True), key=lambda e: e[0])[
        :2
    ]
    if more - cost < ALIKE:
        both = first[0] | second[0]
        there = _with_both(task, found, both, first[1][1], again)
        if there[1].converged and is_possible(*there, both, with_twin=True):
            return both, there
    return first


def _with_both(
    task: Task,
    found: Fit,
    both: frozenset[Key],
    alone: Fit,
    again: Callable[[Task, FitState], Fit],
) -> tuple[Task, Fit]:
    """Task and fit with a latency and a filter that the readings do not tell apart.

    Args:
        task: What has been fitted.
        found: How.
        both: What is asked for.
        alone: The fit with one of them.
        again: Fits once more.
    """
    believed = task.calibration_parameters.believed(both)
    tried, state = shared(*with_priors_of(task, found.state, believed), both, alone.state)
    return tried, again(tried, state)
