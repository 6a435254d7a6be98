"""Forces that are late and forces that are filtered: about no time both are the same, and what reads late
is easily taken for filtered.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from steelyard.identification.model.balance import (
    Forces,
    balance_of,
    parts_of,
    time_constant,
    uncorrected,
)
from steelyard.identification.model.calibration_parameters import (
    CalibrationParameter,
    Key,
    gather,
)
from steelyard.identification.model.force_residuals import sample_weight
from steelyard.identification.model.motion_segment import Segment
from steelyard.identification.model.sources import Source
from steelyard.identification.solve.fit_state import Fit, FitState, Task, linearise
from steelyard.identification.solve.joint_fit import prior_cost
from steelyard.instruments.base import LATENCY, TIME_CONSTANT

ALIKE = 9.0
"""Difference of the costs of a latency and of a filter below which the data do not tell one from the
other, by three of their 1-sigma: then both may be there."""
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


def price(task: Task, found: Fit, factors: Mapping[Source, float], *, held: bool) -> float:
    """Of a fit, every noise being as large as it is said to be, and what is left of forces as they were
    read.

    A filter is put right in readings and motion alike, which makes readings noisier. The motion takes
    up a part of that noise, so that a long filter looks cheaper than it is: what is left over is taken
    back to the readings, where the same noise is there whatever the filter.

    Args:
        task: What was fitted.
        found: How.
        factors: Quantity -> by how much its noise exceeds what its readings say.
        held: Whether the motion is held.
    """
    state = replace(found.state, factors=factors)
    cost = linearise(task, state, held=held)[1].cost + prior_cost(task, state)
    # The noise of a held motion is in what is left over, too.
    return cost if held else cost + _as_read(task, state)


def _as_read(task: Task, state: FitState) -> float:
    """By how much more the residuals of forces cost as they were read than behind the correction of
    their filters.
    """
    found = 0.0
    for segment, forces in zip(state.segments, task.force_samples, strict=True):
        if forces is None or segment.static or forces.changes is None:
            continue
        constant = time_constant(task.experiment, segment, forces, state.calibration)
        if constant > 0:
            found += _of_segment(task, state, segment, forces, constant)
    return found


def _of_segment(
    task: Task, state: FitState, segment: Segment, forces: Forces, constant: float
) -> float:
    """See :func:`_as_read`."""
    assert state.parameters is not None
    assert forces.changes is not None
    parts = [
        balance_of(
            task.experiment, segment, part, state.calibration, state.parameters, state.factors
        )
        for part in parts_of(task.experiment, segment, forces, state.calibration)
    ]
    left_over = np.concatenate([at.left_over for at in parts])
    as_read = uncorrected(forces.time, left_over, constant)
    louder = forces.changes.louder(constant)
    found, start = 0.0, 0
    for at in parts:
        own = as_read[start : start + len(at.time)]
        start += len(at.time)
        whitened = louder * np.einsum("nij,nj->ni", at.whitener, own)
        counts = sample_weight(at.residual) * segment.holds(at.time)
        found += float(counts @ np.sum(whitened**2 - at.residual**2, axis=1))
    return found
