"""Whether something has changed within a chunk of the window, and what: every chunk has a body of its
own, or a hand that pulls at it, or offsets of its force sensors, and what these say is compared with
none (a generalised likelihood ratio, [Willsky1976]_).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from steelyard.arrays import Array
from steelyard.estimates.estimate import plausible_radius
from steelyard.identification.known_body import plausible
from steelyard.identification.model.calibration_parameters import ATTACHED, ROBOT
from steelyard.identification.model.segment import NormalEquations
from steelyard.identification.recursive.past import Point, together
from steelyard.identification.recursive.recursion import Recursion
from steelyard.identification.solve.posterior import prior_of
from steelyard.inertia import TEN
from steelyard.smoothing import DEGREE

Cause = Literal["load", "contact", "sensor"]
"""Another body, a hand or an obstacle, a force sensor that has jumped."""
FREEDOM = 2 * TEN
"""Of the body of the chunk in which it changes, and of that after it."""
_WIDE = 10.0
"""1-sigma of a change of which nothing is known, in plausible sizes."""
_HAND = tuple(key for key, size in ATTACHED if size in (3, 9) and "stiffness" not in key)
"""Of a force that is constant in the world, and its moments."""
_OFFSET = "offset"
"""Of force sensors."""


@dataclass(frozen=True, eq=False)
class Change:
    """Something that is another one after a chunk of the window."""

    number: int
    """Of the chunk in the window: anything may have acted in it."""
    value: Array
    """By how much it is another one after that chunk; of a load the ten of
    :data:`steelyard.inertia.LINEAR_PARAMETERS`, shape (c,)."""
    covariance: Array
    """Shape (c, c)."""
    share: float
    """Part of that chunk in which it was so already, from 0 to 1."""
    statistic: float
    """Decrease of the cost: chi-square of 2 c degrees of freedom where nothing has changed."""
    rest: float
    """What changes of all chunks by themselves would decrease it further: a chi-square, where this
    one is all that has changed."""
    rest_freedom: int
    """Its degrees of freedom."""


@dataclass(frozen=True, eq=False)
class _Changeable:
    """What may change, as columns of the border."""

    which: NDArray[np.intp]
    """Shape (c,)."""
    scale: Array
    """Plausible sizes, shape (c,)."""


def changes(recursion: Recursion, cause: Cause = "load") -> list[Change]:
    """What a change within each chunk of the window but the last would be; none of what the model
    does not have.

    Args:
        recursion: With a window.
        cause: What may have changed.

    Raises:
        numpy.linalg.LinAlgError: The motion is not determined.
    """
    assert recursion.window is not None
    columns, count = _columns(recursion, cause), len(recursion.window.chunks)
    if count < 2 or not len(columns.which):
        return []
    own, left = _of_each_chunk(recursion, *_each_by_itself(recursion, columns))
    sizes = np.tile(columns.scale, count)
    own, left = own * np.outer(sizes, sizes), left * sizes
    return [_after(number, count, own, left, columns.scale) for number in range(count - 1)]


def _columns(recursion: Recursion, cause: Cause) -> _Changeable:
    """What may change."""
    task, state = recursion.task, recursion.state
    assert state.parameters is not None
    radius = plausible_radius(task.experiment.robot)
    sizes = plausible(state.parameters, radius)
    if cause == "load":
        return _Changeable(np.arange(TEN, dtype=np.intp), sizes)
    weight = sizes[0] * float(np.linalg.norm(state.calibration.gravity))
    places = task.calibration_parameters.places
    found, scale = list[NDArray[np.intp]](), list[float]()
    for (owner, key, _), place in places.items():
        hand = cause == "contact" and owner == ROBOT and key in _HAND
        offset = cause == "sensor" and owner in task.experiment.instruments and key == _OFFSET
        if hand or (offset and task.experiment.is_force(owner)):
            found.append(TEN + np.arange(place.start, place.stop, dtype=np.intp))
            scale += [weight * (radius if key == _HAND[-1] else 1.0)] * (place.stop - place.start)
    which = np.concatenate(found) if found else np.zeros(0, dtype=np.intp)
    return _Changeable(which, np.array(scale))


def _after(number: int, count: int, own: Array, left: Array, scale: Array) -> Change:
    """A change within one chunk.

    Args:
        number: Of it.
        count: Of chunks.
        own: What the window says of a change in each of them, in plausible sizes, shape (c n, c n).
        left: The right-hand side of it, shape (c n,).
        scale: Plausible sizes, shape (c,).
    """
    size = len(scale)
    pick = np.zeros((size * count, 2 * size))
    pick[size * number : size * (number + 1), :size] = np.eye(size)
    pick[size * (number + 1) :, size:] = np.tile(np.eye(size), (count - number - 1, 1))
    normal, right = pick.T @ own @ pick, pick.T @ left
    inverse = np.linalg.inv(normal + np.eye(2 * size) / _WIDE**2)
    value = inverse @ right
    change, statistic = value[size:], float(right @ value)
    each = np.linalg.solve(own + np.eye(len(own)) / _WIDE**2, left)
    # The chunk itself as a part of the change.
    weighted = change @ normal[:size, :size]
    share = weighted @ value[:size] / max(float(weighted @ change), 1e-300)
    return Change(
        number,
        scale * change,
        np.outer(scale, scale) * inverse[size:, size:],
        float(np.clip(share, 0.0, 1.0)),
        statistic,
        float(left @ each) - statistic,
        size * (count - 2),
    )


def _of_each_chunk(recursion: Recursion, normal: Array, gradient: Array) -> tuple[Array, Array]:
    """What the window and all before it say of a change in each chunk, with body and calibration
    eliminated: matrix and right-hand side, shapes (c n, c n) and (c n,).

    Args:
        recursion: With a window.
        normal: Of border and changes as the window has it.
        gradient: The same, as the right-hand side.
    """
    task, state, point = recursion.task, recursion.state, recursion.point
    assert state.parameters is not None
    radius = plausible_radius(task.experiment.robot)
    prior = prior_of(task.experiment, state.calibration, state.parameters, radius)
    told, size = recursion.relative(recursion.told), len(point)
    known = told.normal + prior.precision
    here = np.concatenate([state.parameters, np.zeros(size - TEN)])
    shared = normal[:size, :size] + known
    right = gradient[:size] + told.right + prior.pull - known @ here
    use = np.flatnonzero(np.concatenate([np.ones(TEN, dtype=bool), task.active]))
    sizes = 1 / np.sqrt(np.maximum(np.diag(shared)[use], 1e-300))
    factor = cho_factor(shared[np.ix_(use, use)] * np.outer(sizes, sizes), lower=True)
    across = normal[size:, use] * sizes
    solved = cho_solve(factor, np.column_stack([across.T, sizes * right[use]]))
    return normal[size:, size:] - across @ solved[:, :-1], gradient[size:] - across @ solved[:, -1]


def _each_by_itself(recursion: Recursion, columns: _Changeable) -> tuple[Array, Array]:
    """What the window says of the border and of a change in each chunk alone, matrix and right-hand
    side about where they are, shapes (k + c n,) * 2 and (k + c n,).
    """
    window, point = recursion.window, recursion.point
    assert window is not None
    count = len(window.chunks)
    parts, places = list[NormalEquations](), list[int]()
    if window.past is not None:
        past = window.past.seen_from(Point(window.motion[:DEGREE], point))
        parts.append(_with_change(past, columns, None, count))
        places.append(0)
    for i, chunk in enumerate(window.chunks):
        own = window.place(i)
        told = chunk.linear.seen_from(Point(window.motion[own], point))
        parts.append(_with_change(told, columns, i, count))
        places.append(own.start)
    whole = together(parts, places)
    if window.like.processes:
        whole = whole.stiffened([window.ends], window.motion)
    return whole.reduced()


def _with_change(
    equations: NormalEquations, columns: _Changeable, number: int | None, count: int
) -> NormalEquations:
    """Equations with a change in each chunk in the border.

    Args:
        equations: Of one chunk.
        columns: What may change.
        number: Of the chunk; None: of what was before all of them.
        count: Of chunks.
    """
    size, own = len(equations.corner), len(columns.which)
    pick = np.zeros((size, size + own * count))
    pick[:, :size] = np.eye(size)
    if number is not None:
        pick[columns.which, size + own * number + np.arange(own)] = 1.0
    return replace(
        equations,
        side=equations.side @ pick,
        corner=pick.T @ equations.corner @ pick,
        border_gradient=pick.T @ equations.border_gradient,
    )
