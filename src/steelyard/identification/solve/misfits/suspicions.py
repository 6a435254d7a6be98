"""Errors that good devices do not have: filters in force amplifiers, scales of IMUs; and what may
pull at a platform beside its cables.

They are taken as none, so that sound recordings lose nothing, until the readings ask for them: a
step of the fit in which they may move shows by how much the cost would fall (a score test
[Rao1948]_). What is asked for most comes first.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2, norm

from steelyard.arrays import Array
from steelyard.identification.model.calibration_parameters import (
    ROBOT,
    CalibrationParameter,
    Key,
)
from steelyard.identification.solve.fit_state import Fit, FitState, Task, linearise, smooth
from steelyard.identification.solve.joint_fit import fit
from steelyard.identification.solve.newton_step import step_of


def with_suspicions(task: Task, found: Fit) -> tuple[Task, Fit]:
    """The task with the errors that its residuals ask for, and its fit.

    Raises:
        numpy.linalg.LinAlgError: The motion is not determined.
    """
    for _ in range(task.settings.suspicions):
        worst = _worst(task, found.state)
        if not worst:
            break
        task, state = _believed(task, found.state, worst)
        found = fit(task, state)
    return task, found


def _worst(task: Task, state: FitState) -> frozenset[Key]:
    """What the readings ask for most, a hose with force, stiffness and point; empty: nothing."""
    suspects: dict[Key, list[CalibrationParameter]] = {}
    for each in task.calibration_parameters.entries:
        if each.suspected is not None and not each.deviation.any():
            name = each.key.partition(".")[0] if each.owner == ROBOT else each.key
            suspects.setdefault((each.owner, name, each.run), []).append(each)
    if not suspects:
        return frozenset()
    places = task.calibration_parameters.places
    keys = {
        whole: frozenset((each.owner, each.key, each.run) for each in entries)
        for whole, entries in suspects.items()
    }
    before = task.active
    task, state = _believed(task, state, frozenset().union(*keys.values()))
    parts, _ = linearise(task, state)
    step = step_of(task, state, smooth(state, [each.all for each in parts]))
    scale = np.sqrt(np.diag(step.covariance))
    matrix = np.linalg.inv(step.covariance / np.outer(scale, scale))
    right = matrix @ (step.border / scale)
    base = np.concatenate([np.arange(state.ten), task.column_of(state)[before]])

    def gain(columns: NDArray[np.intp]) -> tuple[float, Array]:
        """Decrease of the cost where these alone may move, and how they do."""
        moved = np.linalg.solve(matrix[np.ix_(columns, columns)], right[columns])
        return float(right[columns] @ moved), np.asarray(moved * scale[columns])

    usual, _ = gain(base)
    worst, least = frozenset[Key](), 2 * float(norm.sf(task.settings.suspicious))
    for whole, entries in suspects.items():
        own = np.concatenate(
            [task.column_of(state)[places[e.owner, e.key, e.run]] for e in entries]
        )
        decrease, moved = gain(np.concatenate([base, own]))
        negligible = np.concatenate([np.full(len(e.mean), e.negligible) for e in entries])
        chance = float(chi2.sf(decrease - usual, len(own)))
        if chance < least and np.any(np.abs(moved[len(base) :]) > negligible):
            worst, least = keys[whole], chance
    return worst


def _believed(task: Task, state: FitState, asked: Collection[Key]) -> tuple[Task, FitState]:
    """Task and state with errors that may be there."""
    parameters = task.calibration_parameters.believed(asked)
    active = task.active | (parameters.deviation > task.calibration_parameters.deviation)
    calibration = replace(state.calibration, calibration_parameters=parameters)
    task = replace(task, calibration_parameters=parameters, active=active)
    return task, replace(state, calibration=calibration)
