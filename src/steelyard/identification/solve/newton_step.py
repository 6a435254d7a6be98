"""A step of Gauss and Newton: the border is solved for with its priors, the motion follows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from steelyard.arrays import Array
from steelyard.identification.model.segment import NormalEquations
from steelyard.identification.solve.border.directions import weak_directions
from steelyard.identification.solve.fit_state import FitState, Task
from steelyard.inertia import TEN

_RANGE = 40.0
"""Of the logarithm of how firmly a step is held, beyond which it is as good as not held."""
_HALVINGS = 20
"""Of this range: to a ten thousandth."""


@dataclass(frozen=True, eq=False)
class NewtonStep:
    """A step of Gauss and Newton."""

    border: Array
    """Of the border parameters."""
    motion: tuple[Array, ...]
    """Of the coefficients of every segment."""
    decrement: float
    """By how much the cost should fall."""
    constant: float
    """The part of it that the border brings."""
    covariance: Array
    """Of the border."""
    promised: float
    """By how much the cost should fall with this step: less than the decrement where it is held
    back."""
    length: float
    """Of the border's step, in plausible sizes and prior 1-sigma: the largest of its parts."""

    def along(self, task: Task, state: FitState, share: float) -> FitState:
        """A state so much of the step further."""
        ten = state.ten
        values = state.calibration.values.copy()
        values[task.active] += share * self.border[ten:]
        segments = tuple(
            replace(
                segment, coefficients=segment.coefficients + share * each.reshape(-1, segment.block)
            )
            for segment, each in zip(state.segments, self.motion, strict=True)
        )
        parameters = (
            None if state.parameters is None else state.parameters + share * self.border[:ten]
        )
        return replace(
            state,
            segments=segments,
            calibration=replace(state.calibration, values=values),
            parameters=parameters,
        )


def step_of(
    task: Task,
    state: FitState,
    equations: Sequence[NormalEquations],
    *,
    follow: Sequence[NormalEquations] | None = None,
    further: Array | float = 0.0,
    least: float | None = None,
    reach: float = np.inf,
) -> NewtonStep:
    """Step of Gauss and Newton, or one that is held back [Marquardt1963]_.

    What is known badly may step far, beyond where the equations hold; held back, it stays where it
    is while what is known well goes on.

    Args:
        task: What is fitted.
        state: Where the equations have been linearised.
        equations: Of all segments.
        follow: Equations by which the motion moves, where it does not follow all readings.
        further: What is added to the gradient by the border, shape (b,).
        least: Information in units of plausible sizes below which directions of the ten are held at
            zero; None: all move that the data tell anything of.
        reach: How far the border may go, in plausible sizes and prior 1-sigma.
    """
    reduced = [each.reduced() for each in equations]
    information = np.sum([matrix for matrix, _ in reduced], axis=0)
    gradient = np.sum([gradient for _, gradient in reduced], axis=0) + further
    deviation = task.calibration_parameters.deviation[task.active]
    scale = np.concatenate([task.sizes[: state.ten], deviation])
    matrix, right = _with_priors(task, state, information, gradient, scale)
    if least is not None and state.parameters is not None:
        held, _ = weak_directions(matrix, np.zeros((TEN, TEN)), np.ones(TEN), task.settings, least)
        matrix[:TEN, :TEN] += held
        right[:TEN] -= held @ (state.parameters / task.sizes)
    matrix = (matrix + matrix.T) / 2
    inverse = np.linalg.inv(matrix)
    whole = inverse @ right
    gained = float(right @ whole)
    held = _held_back(matrix, right, whole, reach)
    by_motion = sum(float(each.motion_gradient @ each.settled) for each in equations)
    step = scale * held
    return NewtonStep(
        border=step,
        motion=tuple(each.motion_step(step) for each in follow or equations),
        decrement=gained + by_motion,
        constant=gained,
        covariance=scale[:, None] * inverse * scale,
        promised=float(2 * right @ held - held @ matrix @ held) + by_motion,
        length=float(np.max(np.abs(held), initial=0.0)),
    )


def _held_back(matrix: Array, right: Array, whole: Array, reach: float) -> Array:
    """The step of the border that promises most of those that reach so far, shape (b,)."""
    if not np.max(np.abs(whole), initial=0.0) > reach:
        return whole
    values, vectors = np.linalg.eigh(matrix)
    values, along = np.maximum(values, 0.0), vectors.T @ right

    def held(logarithm: float) -> Array:
        return np.asarray(vectors @ (along / (values + np.exp(logarithm))))

    # Held by so much it certainly reaches no farther.
    firmest = float(np.log(np.linalg.norm(right) / reach))
    loosest = firmest - _RANGE
    for _ in range(_HALVINGS):
        middle = (firmest + loosest) / 2
        if np.max(np.abs(held(middle))) > reach:
            loosest = middle
        else:
            firmest = middle
    return held(firmest)


def border_prior(task: Task, state: FitState) -> tuple[Array, Array]:
    """Precision of what is known beforehand of body and calibration, and its pull from where they
    are now, shapes (b, b) and (b,).
    """
    deviation = task.calibration_parameters.deviation[task.active]
    scale = np.concatenate([task.sizes[: state.ten], deviation])
    nothing = np.zeros((len(scale), len(scale)))
    matrix, right = _with_priors(task, state, nothing, np.zeros(len(scale)), scale)
    return matrix / np.outer(scale, scale), right / scale


def _with_priors(
    task: Task, state: FitState, information: Array, gradient: Array, scale: Array
) -> tuple[Array, Array]:
    """Matrix and right-hand side of the border with the priors, in units of plausible sizes and
    prior 1-sigma, shapes (b, b) and (b,).
    """
    matrix, right, ten = information.copy(), gradient.copy(), state.ten
    if ten and task.known is not None and state.parameters is not None:
        for each in task.known(state):
            own = each.columns(task.column_of(state))
            for rows in own:
                right[rows] += each.gradient
                for columns in own:
                    matrix[np.ix_(rows, columns)] += each.precision
    matrix *= np.outer(scale, scale)
    sigma = scale[ten:]
    precision = task.calibration_parameters.precision[np.ix_(task.active, task.active)]
    scaled = precision * np.outer(sigma, sigma)
    matrix[ten:, ten:] += scaled
    right *= scale
    off = (task.calibration_parameters.mean - state.calibration.values)[task.active]
    right[ten:] += scaled @ (off / sigma)
    return matrix, right
