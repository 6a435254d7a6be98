"""From the ends of searches to a motion that keeps all limits: the best one, scaled down until
every check passes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import InputError
from steelyard.excitation.limits.verification import Verified, verify
from steelyard.excitation.search.design_problem import DesignProblem, SearchResult


def feasible_motion(
    problem: DesignProblem,
    starts: Sequence[Array],
    ends: Sequence[SearchResult],
    progress: Callable[[float], None],
) -> tuple[Array, Verified]:
    """The best motion, scaled down as far as the limits ask for, and how much of them it uses.

    Args:
        problem: That was searched.
        starts: Free coefficients of the starts, shape (6 f,) each.
        ends: Of the searches.
        progress: Is given the fraction that is done.

    Raises:
        InputError: No scale keeps the limits.
    """
    settings, constraints = problem.settings, problem.motion_constraints
    x = _best(problem, starts, ends)

    def checked(scale: float, *, elastic: bool) -> Verified:
        return verify(
            constraints.robot,
            constraints.instruments,
            problem.spline.trajectory(scale * x),
            constraints.margin,
            constraints.level,
            elastic=elastic,
            settings=settings,
        )

    scale = 1.0
    for turn in range(settings.shrinks):
        # The quick check first.
        found = checked(scale, elastic=False)
        if not found.violations:
            progress(0.88 + 0.002 * turn)
            found = checked(scale, elastic=True)
        if not found.violations:
            return scale * x, found
        factor = settings.blind_shrink
        if found.fraction > 1:
            factor = settings.shrink_margin / found.fraction
        scale *= float(np.clip(factor, settings.largest_shrink, settings.least_shrink))
    raise InputError(
        f"robot '{constraints.robot.name}': expected a motion that keeps the limits, found none but"
        f" the smallest ({found.violations[0]}); choose a longer --duration or a smaller --margin"
    )


def _best(problem: DesignProblem, starts: Sequence[Array], ends: Sequence[SearchResult]) -> Array:
    """The most informative of all ends, scaled until the constraints hold, shape (6 f,).

    Searches that were broken off may have ended outside: then an iterate on the way or an enlarged
    start may be better.
    """
    settings = problem.settings
    candidates = [_scaled(problem, end.x, 1.0) for end in ends]
    if any(end.excess > settings.end_excess for end in ends):
        candidates += [end.best_feasible for end in ends if end.best_feasible is not None]
        candidates += [_scaled(problem, start, settings.enlargement) for start in starts]
    return min(candidates, key=lambda each: problem.objective(each)[0])


def _scaled(problem: DesignProblem, x: Array, most: float) -> Array:
    """A motion as large as the constraints let it be, at most by a factor."""
    if problem.constraints(most * x)[0].max() <= 1 + problem.settings.end_excess:
        return most * x
    low, high = 0.0, most
    for _ in range(problem.settings.halvings):
        middle = (low + high) / 2
        if problem.constraints(middle * x)[0].max() <= 1:
            low = middle
        else:
            high = middle
    return low * x
