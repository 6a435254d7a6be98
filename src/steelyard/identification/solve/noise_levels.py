"""Levels of noise, as what is left of the readings says.

They are those under which it is as large as it should be, counted without the freedom that motion
and constants have taken: the restricted likelihood's maximum [Patterson1971]_.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from steelyard.identification.model.balance import UNMODELLED
from steelyard.identification.model.calibration_parameters import ROBOT
from steelyard.identification.model.force_residuals import BALANCE
from steelyard.identification.model.motion_segment import AT_REST
from steelyard.identification.model.segment import Label, NormalEquations
from steelyard.identification.model.sources import Source
from steelyard.identification.solve.fit_state import FitState, Task
from steelyard.identification.tally import Tally


def spent_by(equations: Sequence[NormalEquations]) -> dict[Label, float]:
    """What rows are of -> degrees of freedom that the motion takes of them."""
    spent: dict[Label, float] = {}
    for each in equations:
        for label, freedom in each.spent().items():
            spent[label] = spent.get(label, 0.0) + freedom
    return spent


def ratios_of(task: Task, spent: Mapping[Label, float], tally: Tally) -> dict[Source, float]:
    """Of every quantity, variance of the residual over what it counts as now.

    A stated noise is looked at without what stands far, which is not its doing; one that is not
    stated has what tails it has.

    Args:
        task: What is fitted.
        spent: See :func:`spent_by`.
        tally: Of the residuals.
    """
    counts: dict[tuple[str, bool], float] = {}
    for (name, quantity), count in tally.count.items():
        resting = quantity.endswith(AT_REST)
        counts[name, resting] = counts.get((name, resting), 0.0) + count
    ratios: dict[Source, float] = {}
    for (name, quantity), square in tally.square.items():
        count = tally.count[name, quantity]
        if (name, quantity) not in task.stated:
            square, count = tally.held[name, quantity]
        # Quantities of a force instrument share the freedom that its balance has lost.
        resting = quantity.endswith(AT_REST)
        balance = spent.get((name, BALANCE + AT_REST if resting else BALANCE), 0.0)
        whole = max(counts[name, resting], 1.0)
        taken = spent.get((name, quantity), balance * count / whole)
        left = max(count - taken, task.settings.least_freedom * count, 1.0)
        ratios[name, quantity] = square / left
    return ratios


@dataclass(frozen=True, eq=False)
class UnstatedNoise:
    """Levels of noise that is not stated, followed turn by turn: more slowly where two pull at each
    other, faster where one creeps.
    """

    task: Task
    first: Mapping[Source, float]
    """1-sigma of every quantity that factors multiply."""
    last: Mapping[Source, float] = field(default_factory=dict)
    """Last change of a level, as a logarithm."""
    pace: Mapping[Source, float] = field(default_factory=dict)
    """Part of a change that is made; 1 where nothing is said."""

    @classmethod
    def of(cls, task: Task, state: FitState) -> UnstatedNoise:
        """Before the first turn of a fit."""
        return cls(task, first_sigmas(task, state))

    def followed(
        self, state: FitState, ratios: Mapping[Source, float]
    ) -> tuple[dict[Source, float], UnstatedNoise]:
        """Factors that the ratios ask for, and the same after this turn."""
        settings = self.task.settings
        factors, changes, paces = dict(state.factors), dict(self.last), dict(self.pace)
        for source, ratio in ratios.items():
            if source in self.task.stated:
                continue
            change = float(np.clip(np.log(ratio) / 2, -settings.most_change, settings.most_change))
            last, pace = self.last.get(source, 0.0), self.pace.get(source, 1.0)
            if change * last < 0:
                pace /= 2
            elif abs(change) > settings.slow * abs(last) > 0:
                pace = min(pace * settings.faster, settings.fastest)
            level = factors.get(source, 1.0) * float(np.exp(change * pace))
            least = self.task.least.get(source, 0.0) / self.first.get(source, np.inf)
            factors[source] = max(level, least)
            changes[source], paces[source] = change, pace
        return factors, replace(self, last=changes, pace=paces)


def first_sigmas(task: Task, state: FitState) -> dict[Source, float]:
    """1-sigma that factors multiply."""
    found = {
        segment.label(*reading.source): reading.sigma
        for segment in state.segments
        for reading in segment.readings
    }
    for segment, force_samples in zip(state.segments, task.force_samples, strict=True):
        if force_samples is not None:
            if force_samples.unmodelled is not None:
                found[segment.label(ROBOT, UNMODELLED)] = float(force_samples.unmodelled[0])
            found |= {
                segment.label(force_samples.name, q): float(force_samples.sigma[own.start])
                for q, own in force_samples.places.items()
            }
    return found


def larger(task: Task, state: FitState, ratios: Mapping[Source, float]) -> dict[Source, float]:
    """Levels of stated noise that is visibly larger than stated."""
    factors = dict(state.factors)
    for source in task.stated & ratios.keys():
        level = factors.get(source, 1.0) * float(np.sqrt(ratios[source]))
        factors[source] = level if level > task.settings.larger else 1.0
    return factors


def changed(task: Task, old: Mapping[Source, float], new: Mapping[Source, float]) -> bool:
    """Whether a level of noise has not settled yet."""
    return any(
        abs(np.log(level / old.get(source, 1.0))) > task.settings.level
        for source, level in new.items()
    )
