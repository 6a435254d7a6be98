"""How long a motion must go on as it does until something is known as well as is wanted."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.linalg import eigh, solve_triangular

from steelyard.arrays import Array
from steelyard.identification.recursive.following import Following
from steelyard.inertia import BODY_PARAMETERS, body_jacobian

_CHUNKS = 25
"""That passed last, by which it is told how much a motion tells in a second."""
_FEWEST = 5
"""Of these, that tell it."""
_LONGEST = 86_400.0
"""What takes longer is not reached [s]: other things change within a day."""
_STEPS = 60
"""Of the search: to a part in 1e18 of the longest."""
_ROUNDING = 1e-12
"""Part of a whole that rounding may leave."""


def seconds_until(following: Following, wanted: Mapping[str, float]) -> dict[str, float | None]:
    """How long it will take until 1-sigma of body parameters are as small as wanted, where what the
    next seconds tell is what the last ones told [s]; None: not with this motion.

    Information adds up along a motion: the covariance after t more seconds is the inverse of the
    information now and t times that of a second [GUM2008]_.

    Args:
        following: With a motion of some seconds that have passed; before, all are None.
        wanted: Parameter (:data:`steelyard.inertia.BODY_PARAMETERS`) -> 1-sigma.
    """
    run = following.like.segment.run
    last = [each for each in following.parts[-_CHUNKS:] if each.segment.run == run]
    if len(last) < _FEWEST or following.recursion.window is None:
        return dict.fromkeys(wanted)
    seconds = len(last) * following.window.grid.length
    rate = np.sum([each.equations.normal for each in last], axis=0) / seconds
    now, use = following.recursion.information()
    sizes = 1 / np.sqrt(np.diag(now))
    root = np.linalg.cholesky(now * np.outer(sizes, sizes))
    scaled = rate[np.ix_(use, use)] * np.outer(sizes, sizes)
    half = solve_triangular(root, scaled, lower=True)
    growth, vectors = eigh(solve_triangular(root, half.T, lower=True))
    growth = np.where(growth > _ROUNDING * growth[-1], growth, 0.0)
    linear, _ = following.recursion.body_of(run)
    pick = following.recursion.picked(run)
    rows = body_jacobian(linear) @ pick[:, use] * sizes
    parts = (solve_triangular(root, rows.T, lower=True).T @ vectors) ** 2
    found = {
        name: _until(parts[BODY_PARAMETERS.index(name)], growth, sigma)
        for name, sigma in wanted.items()
    }
    if following.window.walk and found.get("mass"):
        # It is forgotten as it is told.
        found["mass"] = None
    return found


def _until(parts: Array, growth: Array, sigma: float) -> float | None:
    """When a variance, the sum of parts that fall as 1 / (1 + growth t), is small enough [s].

    Args:
        parts: Shape (k,).
        growth: Of the information of each [1/s], shape (k,).
        sigma: 1-sigma that is wanted.
    """

    def enough(t: float) -> bool:
        return float(np.sum(parts / (1 + t * growth))) <= sigma**2

    if enough(0.0):
        return 0.0
    if not enough(_LONGEST):
        return None
    before, after = 0.0, _LONGEST
    for _ in range(_STEPS):
        middle = (before + after) / 2
        before, after = (before, middle) if enough(middle) else (middle, after)
    return after
