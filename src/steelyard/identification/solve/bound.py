"""The Cramer-Rao bound: how well the body can be known from an experiment at all, whatever the
method.

Motion, body and every systematic error are unknown together. The information of all readings at
their own times is summed up, the motion (a spline) and the systematic errors are eliminated (Schur
complement), and what is left belongs to the body [Kay1993]_. Priors of the systematic errors count
as readings of them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.experiment.model import Experiment
from steelyard.identification.model.balance import Forces
from steelyard.identification.model.calibration_parameters import CalibrationValues, columns_of
from steelyard.identification.model.force_residuals import force_residuals
from steelyard.identification.model.motion_residuals import motion_residuals
from steelyard.identification.model.motion_segment import Segment
from steelyard.identification.model.segment import Rows
from steelyard.identification.model.tensions.carried import carried_tensions
from steelyard.identification.solve.border.normal_equations import Solution
from steelyard.inertia import BODY_PARAMETERS, TEN, body_jacobian

_EXACT = 1e-9
"""1-sigma of what is known exactly."""


@dataclass(frozen=True, eq=False)
class Bound:
    """What can be known at best."""

    covariance: Array
    """Of the ten of :data:`steelyard.inertia.BODY_PARAMETERS`, shape (10, 10)."""
    calibration: Array
    """Of all systematic errors, shape (u, u)."""

    @property
    def standard_deviation(self) -> Array:
        """1-sigma of the ten, shape (10,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))


def bound_of(solution: Solution, value: Array | None = None) -> Bound:
    """Bound of a solution over the ten linear parameters and all systematic errors: the inverse of
    its information, without anything that this estimate lacks.

    Args:
        solution: Over all columns.
        value: Where to take the body, mass first, shape (10,) or more; None: as it is estimated.
    """
    value = solution.value if value is None else value
    covariance = solution.attainable
    J = body_jacobian(value[:TEN])
    return Bound(np.asarray(J @ covariance[:TEN, :TEN] @ J.T), covariance[TEN:, TEN:])


def cramer_rao(
    experiment: Experiment,
    calibration: CalibrationValues,
    segments: Mapping[str, tuple[Segment, ...]],
    forces: Mapping[str, tuple[Forces, ...]],
    parameters: Array,
    *,
    known: Mapping[str, tuple[float, float]] | None = None,
    further: Array | float = 0.0,
) -> Bound:
    """Bound of the body's covariance.

    Args:
        experiment: Its instruments and calibration priors say what there is to know.
        calibration: Values about which to linearise.
        segments: Run -> its segments, with readings of the motion instruments and the motion
            itself.
        forces: Run -> force readings of each of these segments.
        parameters: The ten of :data:`steelyard.inertia.LINEAR_PARAMETERS`, shape (10,).
        known: Body parameters known beforehand with their 1-sigma.
        further: Information on the ten and then all systematic errors from elsewhere (poses at
            rest), shape (10 + u, 10 + u).

    Raises:
        numpy.linalg.LinAlgError: The motion is not determined by the readings.
    """
    calibration_parameters = calibration.calibration_parameters
    active = calibration_parameters.deviation > 0
    count = TEN + int(active.sum())
    matrix = np.zeros((count, count))
    matrix[TEN:, TEN:] = calibration_parameters.precision[np.ix_(active, active)]
    if isinstance(further, np.ndarray):
        wanted = np.concatenate([np.arange(TEN), TEN + np.flatnonzero(active)])
        matrix += further[np.ix_(wanted, wanted)]
    for name, own in segments.items():
        for segment, force_samples in zip(own, forces[name], strict=True):
            rows = _all_rows(experiment, segment, force_samples, calibration, active, parameters)
            matrix += segment.smooth(segment.equations(count, rows)).reduced()[0]
    J = body_jacobian(parameters)
    matrix[:TEN, :TEN] += known_information(known or {}, J)
    scale = 1 / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    inverse = np.linalg.pinv(
        matrix * np.outer(scale, scale), rcond=1e-15, hermitian=True
    ) * np.outer(scale, scale)
    covariance = np.zeros((len(calibration_parameters), len(calibration_parameters)))
    covariance[np.ix_(active, active)] = inverse[TEN:, TEN:]
    return Bound(np.asarray(J @ inverse[:TEN, :TEN] @ J.T), covariance)


def known_information(known: Mapping[str, tuple[float, float]], jacobian: Array) -> Array:
    """Information on the ten linear parameters of body parameters that are known beforehand, shape
    (10, 10).

    Args:
        known: Body parameter -> value and 1-sigma.
        jacobian: Of the body parameters by the linear ones, see
            :func:`steelyard.inertia.body_jacobian`.
    """
    rows = np.array(
        [
            jacobian[BODY_PARAMETERS.index(name)] / max(sigma, _EXACT)
            for name, (_, sigma) in known.items()
        ]
    ).reshape(-1, TEN)
    return np.asarray(rows.T @ rows)


def _all_rows(
    experiment: Experiment,
    segment: Segment,
    force_samples: Forces,
    calibration: CalibrationValues,
    active: NDArray[np.bool_],
    parameters: Array,
) -> Iterator[Rows]:
    """Rows of all instruments of one segment, motion first."""
    column_of = columns_of(active, TEN)
    carried = carried_tensions(
        experiment, segment, force_samples, calibration, column_of, parameters, {}
    )
    yield from motion_residuals(experiment, segment, calibration, column_of, {}, None, carried)
    yield from force_residuals(
        experiment,
        segment,
        force_samples,
        calibration,
        column_of,
        parameters,
        {},
        None,
        wide=True,
    )
