"""A step of Gauss and Newton: the border is solved for with its priors, the motion follows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from steelyard.arrays import Array
from steelyard.identification.model.segment import NormalEquations
from steelyard.identification.solve.fit_state import FitState, Task
from steelyard.identification.solve.normal_equations import weak_directions
from steelyard.inertia import TEN


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
) -> NewtonStep:
    """Step of Gauss and Newton.

    Args:
        task: What is fitted.
        state: Where the equations have been linearised.
        equations: Of all segments.
        follow: Equations by which the motion moves, where it does not follow all readings.
        further: What is added to the gradient by the border, shape (b,).
        least: Information in units of plausible sizes below which directions of the ten are held at
            zero; None: all move that the data tell anything of.
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
    inverse = np.linalg.inv((matrix + matrix.T) / 2)
    step, gained = scale * (inverse @ right), float(right @ inverse @ right)
    return NewtonStep(
        border=step,
        motion=tuple(each.motion_step(step) for each in follow or equations),
        decrement=gained + sum(float(each.motion_gradient @ each.settled) for each in equations),
        constant=gained,
        covariance=scale[:, None] * inverse * scale,
    )


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
