"""Everything at once: motion, body and every systematic error, from the raw readings at their own
times.

Gauss-Newton on a banded matrix with a border; where it does not descend, the border is held back
[Marquardt1963]_. Noise levels that are not stated (:mod:`.noise_levels`), and how smooth the motion
is, are found on the way.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from steelyard.errors import InfeasibleError
from steelyard.identification.model.segment import NormalEquations
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
from steelyard.identification.tally import Tally


class _Accepted(NamedTuple):
    """A state from which the cost fell."""

    state: FitState
    equations: tuple[NormalEquations, ...]
    step: NewtonStep
    cost: float


class _Way(NamedTuple):
    """A step that is taken."""

    origin: FitState
    step: NewtonStep
    share: float

    def end(self, task: Task) -> FitState:
        """Where it leads."""
        return self.step.along(task, self.origin, self.share)


class _Evaluated(NamedTuple):
    """All readings about a state."""

    state: FitState
    equations: tuple[NormalEquations, ...]
    tally: Tally
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
        InfeasibleError: Cables cannot be where it begins.
        numpy.linalg.LinAlgError: The motion is not determined.
    """
    settings = task.settings
    accepted: _Accepted | None = None
    share, reach = 1.0, np.inf
    uphill = 0
    converged = searched = shortened = False
    ratios: dict[Source, float] = {}
    unstated = UnstatedNoise.of(task, state)
    many = sum(segment.coefficients.size for segment in state.segments)
    turn, origin, way = 0, state, None
    for turn in range(settings.iterations_beginning if beginning else settings.iterations):
        try:
            parts, tally = linearise(task, state)
        except InfeasibleError:
            # Cables cannot be where the step leads.
            if way is None:
                raise
            way = way._replace(share=settings.shorter * way.share)
            state = way.end(task) if way.share > settings.least_share else way.origin
            continue
        readings = [each.all for each in parts]
        cost = tally.cost + prior_cost(task, state)
        if accepted is not None and not cost < accepted.cost + _rise(accepted, settings):
            if uphill < settings.uphill:
                uphill += 1
                way = _Way(state, step_of(task, state, smooth(state, readings), reach=reach), 1.0)
                state = way.end(task)
                continue
            uphill, shortened = 0, True
            if share < settings.least_share:
                break
            # The direction descends, if not as far as it seemed.
            accepted, reach, share = _shorter(task, accepted, share)
            way = _Way(accepted.state, accepted.step, share)
            state = way.end(task)
            continue
        if accepted is not None and not shortened:
            reach = _reach_after(accepted, cost, reach, settings)
        uphill, shortened = 0, False
        if reach < settings.least_share:
            break
        equations = smooth(state, readings)
        step = step_of(task, state, equations)
        settled, factors = True, state.factors
        if step.decrement < many and step.length <= reach:
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
        held = step_of(task, state, equations, reach=reach) if step.length > reach else step
        # A cost in other units is no measure of the step.
        accepted = _Accepted(state, equations, held, cost) if settled else None
        alike = last is not None and accepted is not None and held is step and np.isinf(reach)
        share = _pace(last.step, step, share, settings) if last and alike else 1.0
        reach = np.inf if held is step else reach
        origin = replace(state, factors=factors)
        way = _Way(origin, held, share)
        state = way.end(task)
        tell(min(0.95, turn / 8))
    if not converged:
        state, equations, tally, _ = _lower(task, state, origin)
        step = step_of(task, state, equations)
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


def _shorter(task: Task, accepted: _Accepted, share: float) -> tuple[_Accepted, float, float]:
    """A shorter step from where the cost fell, how far it reaches and the share of it to take.

    First the border is held back; a border that hardly moves leaves the motion, of which a part is
    taken then.
    """
    settings = task.settings
    reach = settings.shorter * share * accepted.step.length
    step = step_of(task, accepted.state, accepted.equations, reach=reach)
    if reach < settings.least_reach:
        return accepted._replace(step=step), reach, settings.shorter * share
    return accepted._replace(step=step), reach, 1.0


def _reach_after(last: _Accepted, cost: float, reach: float, settings: FitSettings) -> float:
    """How far the next step may go after one that has kept so much of its promise."""
    kept = (last.cost - cost) / max(last.step.promised, 1e-300)
    if kept > settings.well_kept:
        return settings.farther * reach
    return reach if kept > settings.badly_kept else reach / settings.farther


def _about(task: Task, state: FitState) -> _Evaluated:
    """Linearise all readings about a state, with the smoothness of its motion."""
    parts, tally = linearise(task, state)
    equations = smooth(state, [each.all for each in parts])
    return _Evaluated(state, equations, tally, tally.cost + prior_cost(task, state))


def _lower(task: Task, last: FitState, origin: FitState) -> _Evaluated:
    """Where a fit ends that has not arrived: nobody has looked at where its last step leads, and
    that may be far uphill of where the step set out from, or where no cables can be.
    """
    begun = _about(task, origin)
    try:
        ended = _about(task, last)
    except InfeasibleError:
        return begun
    return ended if ended.cost < begun.cost * (1 + task.settings.same_cost) else begun


def _rise(accepted: _Accepted, settings: FitSettings) -> float:
    """By how much the cost may rise with a step.

    Steps end where the estimating equations are fulfilled, and these are not quite the derivative
    of the cost: what nothing explains tells no gain. Near the end that is more than a step
    promises.
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


def prior_cost(task: Task, state: FitState) -> float:
    """Of what is known of the errors beforehand."""
    prior = task.calibration_parameters
    off = (state.calibration.values - prior.mean)[task.active]
    return float(off @ prior.precision[np.ix_(task.active, task.active)] @ off)
