"""Everything at once: motion, body and every systematic error, from the raw readings at their own
times.

Gauss-Newton on a banded matrix with a border, with shorter steps where it does not descend. Noise
levels that are not stated (:mod:`.noise_levels`), and how smooth the motion is, are found on the
way.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from steelyard.identification.model.smoothness import smoothness
from steelyard.identification.model.sources import Source
from steelyard.identification.solve.fit_state import Fit, FitState, Task, linearise, smooth
from steelyard.identification.solve.newton_step import NewtonStep, step_of
from steelyard.identification.solve.noise_levels import (
    UnstatedNoise,
    changed,
    first_sigmas,
    larger,
    ratios_of,
    spent_by,
)
from steelyard.identification.solve.settings import FitSettings


class _Accepted(NamedTuple):
    """A state from which the cost fell."""

    state: FitState
    step: NewtonStep
    cost: float


def fit(
    task: Task,
    state: FitState,
    tell: Callable[[float], None] = lambda fraction: None,
    *,
    beginning: bool = False,
    levels: bool = True,
) -> Fit:
    """Fit.

    Args:
        task: What to fit.
        state: Where to begin.
        tell: Is told the fraction that is done, roughly.
        beginning: Whether it is only a beginning for another fit, so that less will do.
        levels: Whether noise that is not stated is found on the way; else it stays as it is.

    Raises:
        numpy.linalg.LinAlgError: The motion is not determined.
    """
    settings = task.settings
    accepted: _Accepted | None = None
    share = 1.0
    uphill = 0
    converged = searched = False
    ratios: dict[Source, float] = {}
    unstated = UnstatedNoise.of(task, state)
    many = sum(segment.coefficients.size for segment in state.segments)
    turn = 0
    for turn in range(settings.iterations_beginning if beginning else settings.iterations):
        parts, tally = linearise(task, state)
        readings = [each.all for each in parts]
        cost = tally.cost + _prior_cost(task, state)
        if accepted is not None and not cost < accepted.cost + _rise(accepted, settings):
            if uphill < settings.uphill:
                uphill += 1
                state = step_of(task, state, smooth(state, readings)).along(task, state, 1.0)
                continue
            uphill = 0
            if share < settings.least_share:
                state = accepted.state
                break
            # The direction descends, if not as far as it seemed.
            share *= settings.shorter
            state = accepted.step.along(task, accepted.state, share)
            continue
        uphill = 0
        equations = smooth(state, readings)
        step = step_of(task, state, equations)
        settled, factors = True, state.factors
        if step.decrement < many:
            # Noise and smoothness, once the residual is no longer that of a wrong motion.
            enough = settings.beginning_arrived if beginning else settings.arrived
            arrived = step.constant < settings.border_arrived and step.decrement < enough
            if any(segment.smoothness for segment in state.segments) and (arrived or not searched):
                level, settled = smoothness(
                    state.segments, readings, anew=not searched, settings=settings.motion
                )
                searched = True
                if not settled:
                    state = _smoothed(state, level)
                    equations = smooth(state, readings)
                    step = step_of(task, state, equations)
            ratios = ratios_of(task, spent_by(equations), tally)
            if levels:
                factors, unstated = unstated.followed(state, ratios)
                settled = settled and not changed(task, state.factors, factors)
            if levels and settled and (arrived or step.decrement < settings.nearly_arrived * cost):
                # Only a motion that is as free as it wants to be can say that a noise is not as
                # stated.
                factors = larger(task, state, ratios)
                settled = not changed(task, state.factors, factors)
            converged = settled and arrived
            if converged:
                break
        last = accepted
        # A cost in other units is no measure of the step.
        accepted = _Accepted(state, step, cost) if settled else None
        share = _pace(last.step, step, share, settings) if last and accepted else 1.0
        state = replace(step.along(task, state, share), factors=factors)
        tell(min(0.95, turn / 8))
    ratios = ratios or ratios_of(task, spent_by(equations), tally)
    return Fit(
        state,
        equations,
        tally,
        ratios,
        converged,
        turn + 1,
        step.covariance,
        task.stated,
        first_sigmas(task, state),
    )


def _rise(accepted: _Accepted, settings: FitSettings) -> float:
    """By how much the cost may rise with a step.

    Steps end where the estimating equations are fulfilled, and these are not quite the derivative of
    the cost: what nothing explains tells no gain. Near the end that is more than a step promises.
    """
    near = accepted.step.decrement < settings.nearly_arrived * accepted.cost
    return (settings.nearly_arrived if near else settings.same_cost) * accepted.cost


def _smoothed(state: FitState, level: Mapping[str, float]) -> FitState:
    """The same with another smoothness where the motion has one."""
    segments = tuple(
        each if each.smoothness is None else replace(each, smoothness=level)
        for each in state.segments
    )
    return replace(state, segments=segments)


def _pace(last: NewtonStep, step: NewtonStep, share: float, settings: FitSettings) -> float:
    """Share of a step that arrives at once where a share of the last one, in the same direction,
    fell short or overshot.

    What Gauss-Newton leaves out of the curvature makes steps that are a constant factor of the one
    before [Aitken1926]_.
    """
    weight = 1 / np.maximum(np.diag(step.covariance), 1e-300)
    ratio = float((weight * last.border) @ step.border) / max(
        float((weight * last.border) @ last.border), 1e-300
    )
    if abs(ratio) < settings.slow:
        return 1.0
    return float(np.clip(share / max(1 - ratio, 1e-3), settings.least_pace, settings.largest_pace))


def _prior_cost(task: Task, state: FitState) -> float:
    prior = task.calibration_parameters
    off = (state.calibration.values - prior.mean)[task.active]
    return float(off @ prior.precision[np.ix_(task.active, task.active)] @ off)
