"""Errors that good devices do not have, put into a fit and taken out of it, and whether what came
out can be.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy.optimize import least_squares

from steelyard.arrays import Array
from steelyard.dynamics import FLEXIBILITY
from steelyard.estimates.quantiles import chi2_exceeded
from steelyard.identification.model.calibration_parameters import (
    AIR,
    ATTACHED,
    BENDING,
    BENDING_KEYS,
    ROBOT,
    CalibrationParameter,
    CalibrationParameters,
    Key,
)
from steelyard.identification.solve.fit_state import Fit, FitState, Task
from steelyard.instruments.base import LATENCY

_SURE = 3.0
"""1-sigma by which a stiffness, an area or a time constant must not be negative."""
_REACH = 2.0
"""1-sigma of the point at which a hose pulls, in sizes of the platform."""
_CHANCE = 1e-3
"""Probability with which a hose is refused that pulls at one point."""


def taken_back(
    task: Task, state: FitState, gone: Mapping[Key, CalibrationParameter]
) -> tuple[Task, FitState]:
    """Task and state without these errors."""
    parameters = task.calibration_parameters
    values, active = state.calibration.values.copy(), task.active.copy()
    for key, each in gone.items():
        place = parameters.places[key]
        values[place], active[place] = each.mean, False
    entries = tuple(gone.get(u.full_key, u) for u in parameters.entries)
    parameters = replace(parameters, entries=entries)
    calibration = replace(state.calibration, calibration_parameters=parameters, values=values)
    task = replace(task, calibration_parameters=parameters, active=active)
    return task, replace(state, calibration=calibration)


def is_possible(task: Task, found: Fit, asked: frozenset[Key], *, with_twin: bool = False) -> bool:
    """Whether what was asked for came out as it can be: a hose pulls at one point, and pulls back;
    air brakes; a filter does not read ahead.

    Args:
        task: What was fitted.
        found: How.
        asked: For what.
        with_twin: Whether a latency stands beside its filter, and so need not be sure of itself.
    """
    places = task.calibration_parameters.places
    ten, column_of = found.state.ten, task.column_of(found.state)
    if asked & set(BENDING_KEYS):
        return _bends(task, found)
    for key in asked:
        least = -_SURE if with_twin else _least(task, key)
        sigma = np.sqrt(np.diag(found.covariance)[column_of[places[key]]])
        if np.any(found.state.calibration.values[places[key]] < least * sigma):
            return False
    keys = [(ROBOT, key, None) for key, _ in (*ATTACHED, *AIR) if (ROBOT, key, None) in asked]
    if not keys:
        return True
    own = np.concatenate([column_of[places[key]] for key in keys])
    values = np.concatenate([found.state.calibration.values[places[key]] for key in keys])
    covariance = found.covariance[np.ix_(own, own)]
    sigma = np.sqrt(np.diag(covariance))
    assert own.min(initial=ten) >= ten
    if keys[0][1] == AIR[0][0]:
        return bool(np.all(values > -_SURE * sigma))
    stiffness, reach = values[3], _REACH * task.experiment.robot.size
    if stiffness < -_SURE * sigma[3]:
        return False
    whiten = np.linalg.inv(np.linalg.cholesky(covariance / np.outer(sigma, sigma))) / sigma

    def beside(hose: Array) -> Array:
        """What a hose at one point would be, beside what was found."""
        force, stiff, point = hose[:3], hose[3], hose[4:]
        there = np.concatenate([hose[:4], np.outer(force, point).ravel(), stiff * point])
        return np.concatenate([whiten @ (values - there), point / reach])

    nearest = least_squares(beside, np.concatenate([values[:4], np.zeros(3)]))
    return bool(2 * nearest.cost < chi2_exceeded(_CHANCE, len(values) - 4))


def _bends(task: Task, found: Fit) -> bool:
    """Whether what was found of parts that bend is some: all of them stand off the way in which
    they are pulled, so that their matrix is positive.
    """
    places, size = task.calibration_parameters.places, task.experiment.robot.size
    own = np.concatenate([np.r_[places[key]] for key in BENDING_KEYS])
    columns = task.column_of(found.state)[own]
    scale = np.repeat([1.0, size, size**2], [count for _, count in BENDING])
    values = found.state.calibration.values[own] / scale
    covariance = found.covariance[np.ix_(columns, columns)] / np.outer(scale, scale)
    rows, others = np.array(FLEXIBILITY).T
    matrix = np.zeros((6, 6))
    matrix[rows, others] = matrix[others, rows] = values
    sizes, directions = np.linalg.eigh(matrix)
    for least, along in zip(sizes, directions.T, strict=True):
        by_value = along[rows] * along[others] * np.where(rows == others, 1.0, 2.0)
        if least < -_SURE * np.sqrt(by_value @ covariance @ by_value):
            return False
    return True


def _least(task: Task, asked: Key) -> float:
    """Where an error has to be at least, in its 1-sigma: what no device has below zero may be there
    by chance only; a latency, which a filter imitates, has to be sure of itself.
    """
    owner, key, _ = asked
    if key == LATENCY:
        return _SURE
    if owner not in task.experiment.instruments:
        return -np.inf
    terms = task.experiment.instruments[owner].terms(task.calibration_parameters.m)
    return -_SURE if any(each.key == key and each.positive for each in terms) else -np.inf


def with_priors_of(
    task: Task, state: FitState, parameters: CalibrationParameters
) -> tuple[Task, FitState]:
    """Task and state with other priors, under which more may move."""
    active = task.active | (parameters.deviation > task.calibration_parameters.deviation)
    calibration = replace(state.calibration, calibration_parameters=parameters)
    task = replace(task, calibration_parameters=parameters, active=active)
    return task, replace(state, calibration=calibration)
