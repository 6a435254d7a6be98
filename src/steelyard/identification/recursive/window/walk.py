"""A mass that walks at random: sand that runs out, a tank that is filled.

Every chunk has a mass of its own, which is that of the one before and a step of which nothing is
known but its variance, the density of the walk squared times the time between them (a random walk
[Kalman1960]_). What is estimated is the mass of the last chunk. Steps within the window are columns
of the border beside its own; what has passed is told about the next chunk, less sure by one step.
What comes and goes is at the centre of gravity, so that this and the inertia about it stay.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.identification.model.segment import NormalEquations
from steelyard.identification.solve.border.normal_equations import BorderEquations
from steelyard.inertia import TEN, point_inertia, six


def by_mass(border: Array) -> Array:
    """How the border follows the mass while centre of gravity and inertia about it stay, shape
    (k,).

    Args:
        border: The ten of :data:`steelyard.inertia.LINEAR_PARAMETERS`, then all else, shape (k,).
    """
    cog = border[1:4] / border[0]
    own = np.concatenate([[1.0], cog, six(point_inertia(1.0, cog))])
    return np.concatenate([own, np.zeros(len(border) - TEN)])


def with_steps(
    equations: NormalEquations, direction: Array, later: NDArray[np.bool_]
) -> NormalEquations:
    """Equations of a border that was there before some steps, about the present one and the steps.

    Args:
        equations: Over k columns.
        direction: See :func:`by_mass`, shape (k,).
        later: Which of the steps came after it, shape (s,).
    """
    steps = -np.outer(direction, later)
    across = equations.corner @ steps
    return replace(
        equations,
        side=np.hstack([equations.side, equations.side @ steps]),
        corner=np.block([[equations.corner, across], [across.T, steps.T @ across]]),
        border_gradient=np.concatenate(
            [equations.border_gradient, steps.T @ equations.border_gradient]
        ),
    )


def with_known_steps(equations: NormalEquations, steps: Array, variance: float) -> NormalEquations:
    """Equations with what is known of the steps, which are the last columns of the border.

    Args:
        equations: Over border and steps.
        steps: As they are now [kg], shape (s,).
        variance: Of each [kg^2].
    """
    corner, gradient = equations.corner.copy(), equations.border_gradient.copy()
    own = np.arange(len(gradient) - len(steps), len(gradient))
    corner[own, own] += 1 / variance
    gradient[own] -= steps / variance
    return replace(equations, corner=corner, border_gradient=gradient)


def without_columns(equations: NormalEquations, count: int) -> NormalEquations:
    """Equations with the last columns of the border held.

    Args:
        equations: Over border and steps.
        count: Of these columns.
    """
    kept = len(equations.corner) - count
    return replace(
        equations,
        side=equations.side[:, :kept],
        corner=equations.corner[:kept, :kept],
        border_gradient=equations.border_gradient[:kept],
    )


def settled_steps(normal: Array, gradient: Array, count: int) -> tuple[Array, Array]:
    """Matrix and right-hand side of the border once the steps, its last columns, have followed
    (Schur complement), shapes (k, k) and (k,).

    Args:
        normal: Of border and steps.
        gradient: The same.
        count: Of the steps.
    """
    kept = len(gradient) - count
    across = normal[kept:, :kept]
    solved = np.linalg.solve(normal[kept:, kept:], np.column_stack([across, gradient[kept:]]))
    return (
        normal[:kept, :kept] - across.T @ solved[:, :-1],
        gradient[:kept] - across.T @ solved[:, -1],
    )


def steps_of(normal: Array, gradient: Array, border: Array) -> Array:
    """By how much the steps change with a step of the border, shape (s,).

    Args:
        normal: Of border and steps.
        gradient: The same.
        border: Its step, shape (k,).
    """
    kept = len(border)
    right = gradient[kept:] - normal[kept:, :kept] @ border
    return np.asarray(np.linalg.solve(normal[kept:, kept:], right))


def a_step_later(
    equations: NormalEquations, direction: Array, step: float, variance: float
) -> NormalEquations:
    """Equations of few functions, about a border that has gone one step further, of which no more
    is known.

    Args:
        equations: Over no more functions than depend on each other.
        direction: See :func:`by_mass`, shape (k,).
        step: As it is now [kg].
        variance: Of it [kg^2].
    """
    side, corner = equations.side @ direction, equations.corner @ direction
    gradient = float(equations.border_gradient @ direction) + step / variance
    whole = float(corner @ direction) + 1 / variance
    # Columns of the step are the negative of these: the signs cancel.
    size = len(side)
    band = equations.band.copy()
    for row in range(min(len(band), size)):
        band[row, : size - row] -= side[row:] * side[: size - row] / whole
    return replace(
        equations,
        band=band,
        side=equations.side - np.outer(side, corner) / whole,
        corner=equations.corner - np.outer(corner, corner) / whole,
        motion_gradient=equations.motion_gradient - side * gradient / whole,
        border_gradient=equations.border_gradient - corner * gradient / whole,
        parts={},
    )


def blind_to_mass(normal: Array, right: Array, direction: Array) -> tuple[Array, Array]:
    """Equations that say nothing of the mass itself, which was another one then, shapes (k, k) and
    (k,).

    Args:
        normal: Of a chunk.
        right: The same.
        direction: See :func:`by_mass`, shape (k,).
    """
    own = normal @ direction
    whole = float(own @ direction)
    if not whole > 0:
        return normal, right
    return normal - np.outer(own, own) / whole, right - own * float(direction @ right) / whole


def as_in_the_end(
    parts: Sequence[BorderEquations], end: BorderEquations, direction: Array
) -> BorderEquations:
    """What is to be added to equations of chunks, each of which is about its own mass, so that
    their sum is about the last one.

    Args:
        parts: Of all chunks.
        end: All that they say of the last mass.
        direction: See :func:`by_mass`, shape (k,).
    """
    normal = sum((each.normal for each in parts), np.zeros_like(end.normal))
    right = sum((each.right for each in parts), np.zeros_like(end.right))
    noise = sum((each.noise for each in parts), np.zeros((TEN, TEN)))
    # What noise tells of the mass is forgotten as what the readings tell of it is.
    own = normal[:TEN, :TEN] @ direction[:TEN]
    whole = max(float(own @ direction[:TEN]), 1e-300)
    kept = float(direction @ end.normal @ direction) / whole
    change = np.eye(TEN) - (1 - np.sqrt(np.clip(kept, 0.0, 1.0))) * np.outer(
        direction[:TEN], own / whole
    )
    return BorderEquations(
        end.normal - normal, end.right - right, change.T @ noise @ change - noise, 0.0
    )
