"""Forces that are late and forces that are filtered: about no time both are the same, and what reads late
is easily taken for filtered.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from steelyard.identification.model.calibration_parameters import (
    CalibrationParameter,
    Key,
    gather,
)
from steelyard.identification.model.sources import Source
from steelyard.identification.solve.fit_state import Fit, Task, linearise
from steelyard.identification.solve.joint_fit import prior_cost
from steelyard.instruments.base import LATENCY, TIME_CONSTANT

_TWIN = {LATENCY: TIME_CONSTANT, TIME_CONSTANT: LATENCY}


def alternatives(task: Task, asked: frozenset[Key]) -> list[frozenset[Key]]:
    """What may explain residuals: what they ask for, and a filter in the place of a latency or the other
    way round, if neither is stated.
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


def price(task: Task, found: Fit, factors: Mapping[Source, float], *, held: bool) -> float:
    """Of a fit, every noise being as large as it is said to be.

    Readings whose filter is put right are noisier, and count as that; what the motion takes up of that
    noise makes a long filter look a little cheaper than it is.

    Args:
        task: What was fitted.
        found: How.
        factors: Quantity -> by how much its noise exceeds what its readings say.
        held: Whether the motion is held.
    """
    state = replace(found.state, factors=factors)
    return linearise(task, state, held=held)[1].cost + prior_cost(task, state)
