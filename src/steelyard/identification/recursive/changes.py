"""Whether something has changed within a chunk of the window, and what: every chunk has a body of
its own, or a hand that pulls at it, or offsets of its force sensors, and what these say is compared
with none (a generalised likelihood ratio, [Willsky1976]_).
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
from steelyard.identification.recursive.recursion import Recursion
from steelyard.inertia import TEN

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
    own, left = _of_each_chunk(recursion, columns)
    sizes = np.tile(columns.scale, count)
    own, left = own * np.outer(sizes, sizes), left * sizes
    each = np.linalg.solve(own + np.eye(len(own)) / _WIDE**2, left)
    most = float(left @ each)
    return [_after(number, count, own, left, columns.scale, most) for number in range(count - 1)]


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


def _after(number: int, count: int, own: Array, left: Array, scale: Array, most: float) -> Change:
    """A change within one chunk.

    Args:
        number: Of it.
        count: Of chunks.
        own: What the window says of a change in each of them, in plausible sizes, shape (c n, c n).
        left: The right-hand side of it, shape (c n,).
        scale: Plausible sizes, shape (c,).
        most: Decrease of the cost by changes of all chunks by themselves.
    """
    size = len(scale)
    pick = np.zeros((size * count, 2 * size))
    pick[size * number : size * (number + 1), :size] = np.eye(size)
    pick[size * (number + 1) :, size:] = np.tile(np.eye(size), (count - number - 1, 1))
    normal, right = pick.T @ own @ pick, pick.T @ left
    inverse = np.linalg.inv(normal + np.eye(2 * size) / _WIDE**2)
    value = inverse @ right
    change, statistic = value[size:], float(right @ value)
    # The chunk itself as a part of the change.
    weighted = change @ normal[:size, :size]
    share = weighted @ value[:size] / max(float(weighted @ change), 1e-300)
    return Change(
        number,
        scale * change,
        np.outer(scale, scale) * inverse[size:, size:],
        float(np.clip(share, 0.0, 1.0)),
        statistic,
        most - statistic,
        size * (count - 2),
    )


def _of_each_chunk(recursion: Recursion, columns: _Changeable) -> tuple[Array, Array]:
    """What the window and all before it say of a change in each chunk, with body and calibration
    eliminated: matrix and right-hand side, shapes (c n, c n) and (c n,).

    Args:
        recursion: With a window.
        columns: What may change.
    """
    state, use = recursion.state, recursion.use
    assert state.parameters is not None
    # Columns that nobody estimates are asked for only where these may change.
    narrow = bool(np.isin(columns.which, use).all())
    which = np.searchsorted(use, columns.which) if narrow else columns.which
    normal, gradient = _each_by_itself(recursion, which, use if narrow else None)
    own = use if narrow else np.arange(len(recursion.point))
    size, inside = len(own), np.arange(len(use)) if narrow else use
    prior, told = recursion.prior, recursion.relative(recursion.told)
    known = (told.normal + prior.precision)[np.ix_(use, own)]
    here = np.concatenate([state.parameters, np.zeros(size - TEN)])
    shared = normal[np.ix_(inside, inside)] + known[:, inside]
    right = gradient[inside] + told.right[use] + prior.pull[use] - known @ here
    sizes = 1 / np.sqrt(np.maximum(np.diag(shared), 1e-300))
    factor = cho_factor(shared * np.outer(sizes, sizes), lower=True)
    across = normal[size:, inside] * sizes
    solved = cho_solve(factor, np.column_stack([across.T, sizes * right]))
    return normal[size:, size:] - across @ solved[:, :-1], gradient[size:] - across @ solved[:, -1]


def _each_by_itself(
    recursion: Recursion, which: NDArray[np.intp], use: NDArray[np.intp] | None
) -> tuple[Array, Array]:
    """What the window says of the border and of a change in each chunk alone, matrix and right-hand
    side about where they are, shapes (k + c n,) * 2 and (k + c n,).

    Args:
        recursion: With a window.
        which: Columns of the border that may change, of those that are told, shape (c,).
        use: Columns that are told; None: all.
    """
    window = recursion.window
    assert window is not None
    parts, places = window.told(recursion.point, use)
    count = len(window.chunks)
    before = len(parts) - count
    changed = [
        _with_change(each, which, i - before if i >= before else None, count)
        for i, each in enumerate(parts)
    ]
    return window.joined(changed, places).reduced()


def _with_change(
    equations: NormalEquations, which: NDArray[np.intp], number: int | None, count: int
) -> NormalEquations:
    """Equations with a change in each chunk in the border.

    Args:
        equations: Of one chunk.
        which: Columns of the border that may change, shape (c,).
        number: Of the chunk; None: of what was before all of them.
        count: Of chunks.
    """
    size, own = len(equations.corner), len(which)
    total = size + own * count
    place, source = np.arange(size), np.arange(size)
    if number is not None:
        place = np.concatenate([place, size + own * number + np.arange(own)])
        source = np.concatenate([source, which])
    side, corner, gradient = (
        np.zeros((len(equations.side), total)),
        np.zeros((total,) * 2),
        np.zeros(total),
    )
    side[:, place] = equations.side[:, source]
    corner[np.ix_(place, place)] = equations.corner[np.ix_(source, source)]
    gradient[place] = equations.border_gradient[source]
    return replace(equations, side=side, corner=corner, border_gradient=gradient)
