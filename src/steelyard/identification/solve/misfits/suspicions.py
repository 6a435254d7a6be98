"""Errors that good devices do not have: filters in force amplifiers, scales of IMUs.

They are taken as none, so that sound recordings lose nothing, until the readings ask for them: a
step of the fit in which they may move shows by how much they would (a score test [Rao1948]_). The
one that is asked for most comes first.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from steelyard.identification.model.calibration_parameters import Key
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
        if worst is None:
            break
        task, state = _believed(task, found.state, {worst})
        found = fit(task, state)
    return task, found


def _worst(task: Task, state: FitState) -> Key | None:
    """The error that the readings ask for most; None: for none."""
    suspects = {
        (each.owner, each.key, each.run): each.negligible
        for each in task.calibration_parameters.entries
        if each.suspected is not None and not each.deviation.any()
    }
    if not suspects:
        return None
    task, state = _believed(task, state, suspects.keys())
    parts, _ = linearise(task, state)
    step = step_of(task, state, smooth(state, [each.all for each in parts]))
    moved, variance = np.zeros((2, len(task.calibration_parameters)))
    moved[task.active] = step.border[state.ten :]
    variance[task.active] = np.diag(step.covariance)[state.ten :]
    # Where there is no such error, noise alone moves it by so much.
    prior = np.maximum(task.calibration_parameters.deviation**2, 1e-300)
    score = np.abs(moved) / np.sqrt(np.maximum(variance * (1 - variance / prior), 1e-300))
    scores = {}
    for key, negligible in suspects.items():
        place = task.calibration_parameters.places[key]
        scores[key] = float(np.max(score[place] * (np.abs(moved[place]) > negligible)))
    worst = max(scores, key=lambda key: scores[key])
    return worst if scores[worst] > task.settings.suspicious else None


def _believed(task: Task, state: FitState, asked: Collection[Key]) -> tuple[Task, FitState]:
    """Task and state with errors that may be there."""
    parameters = task.calibration_parameters.believed(asked)
    active = task.active | (parameters.deviation > task.calibration_parameters.deviation)
    calibration = replace(state.calibration, calibration_parameters=parameters)
    task = replace(task, calibration_parameters=parameters, active=active)
    return task, replace(state, calibration=calibration)
