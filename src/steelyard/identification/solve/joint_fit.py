"""Everything at once: motion, body and every systematic error, from the raw readings at their own
times.

Gauss-Newton on a banded matrix with a border, with shorter steps where it does not descend. Noise
levels that are not stated, and how smooth the motion is, are those under which what is left of the
readings is as large as it should be, counted without the freedom that motion and constants have
taken: the restricted likelihood's maximum [Patterson1971]_.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.experiment.model import Experiment
from steelyard.identification.model.balance import UNMODELLED, Forces
from steelyard.identification.model.calibration_parameters import (
    ROBOT,
    CalibrationParameters,
    CalibrationValues,
    columns_of,
)
from steelyard.identification.model.force_residuals import BALANCE, force_residuals
from steelyard.identification.model.motion_residuals import (
    AT_REST,
    Segment,
    Tally,
    motion_residuals,
)
from steelyard.identification.model.segment import Label, NormalEquations
from steelyard.identification.model.smoothness import smoothness
from steelyard.identification.model.sources import Source
from steelyard.identification.solve.normal_equations import weak_directions
from steelyard.identification.solve.settings import FIT, FitSettings
from steelyard.inertia import TEN


@dataclass(frozen=True, eq=False)
class FitState:
    """Present values of everything."""

    segments: tuple[Segment, ...]
    calibration: CalibrationValues
    parameters: Array | None
    """The ten of :data:`steelyard.inertia.LINEAR_PARAMETERS`, shape (10,); None: forces are not
    looked at."""
    factors: Mapping[Source, float] = field(default_factory=dict)
    """Quantity -> noise in units of what its readings say."""

    @property
    def ten(self) -> int:
        """Columns of the border that belong to the body."""
        return 0 if self.parameters is None else TEN


@dataclass(frozen=True, eq=False)
class Task:
    """What is to be fitted."""

    experiment: Experiment
    calibration_parameters: CalibrationParameters
    force_samples: tuple[Forces | None, ...]
    """Of each segment; None: its forces are not looked at."""
    active: NDArray[np.bool_]
    """Systematic errors that are estimated, shape (u,)."""
    stated: frozenset[Source]
    """Quantities whose noise is stated."""
    sizes: Array
    """Plausible sizes of the ten linear parameters, shape (10,)."""
    least: Mapping[Source, float] = field(default_factory=dict)
    """Quantity -> least 1-sigma that its noise may be estimated at."""
    settings: FitSettings = FIT
    """How to fit."""
    known: Callable[[Array], tuple[Array, Array]] | None = None
    """Parameters -> precision and pull of what is known about the body beforehand, shapes (10, 10)
    and (10,)."""


@dataclass(frozen=True, eq=False)
class Linearised:
    """Normal equations of one segment about a state."""

    motion: NormalEquations
    """Of the motion instruments and what is known of its smoothness."""
    forces: NormalEquations | None
    """Of the balance; None: it is not looked at."""
    held: NormalEquations | None = None
    """Of the motion with its smoothness, where it is held; None: it follows the forces."""

    @cached_property
    def all(self) -> NormalEquations:
        """Of all readings."""
        return self.motion if self.forces is None else self.motion + self.forces


@dataclass(frozen=True, eq=False)
class Fit:
    """Where it ended."""

    state: FitState
    equations: tuple[NormalEquations, ...]
    """Of each segment, about the state."""
    tally: Tally
    ratios: Mapping[Source, float]
    """Variance of the residuals over what they count as, freedom taken off."""
    converged: bool
    turns: int
    covariance: Array
    """Of the border: the ten, where forces are looked at, and then the active errors."""
    stated: frozenset[Source]
    """Quantities whose noise is stated."""
    first_sigmas: Mapping[Source, float]
    """1-sigma of every quantity that factors multiply."""
    motions: tuple[Array | None, ...] = ()
    """Covariance of the motion of each segment where it was held, see :func:`.force_residuals`."""
    bias: Array = field(default_factory=lambda: np.zeros((0, TEN)))
    """What noise of the held motion does to the gradient by the border in the mean, with the
    opposite sign, segment by segment, shape (s, b)."""


def linearise(
    task: Task,
    state: FitState,
    column_of: NDArray[np.intp],
    border: int,
    *,
    held: bool = False,
) -> tuple[tuple[Linearised, ...], Tally]:
    """Normal equations of every segment about a state, over columns of the border that may be more
    than are estimated.

    Args:
        task: What is to be fitted.
        state: Where to linearise.
        column_of: Column of each calibration parameter in the border; -1: not there; shape (u,).
        border: Number of columns of the border.
        held: Whether the motion is held as its instruments alone give it, so that its covariance
            weights the forces; else it follows them.
    """
    tally = Tally()
    found = []
    for segment, force_samples in zip(state.segments, task.force_samples, strict=True):
        rows = motion_residuals(
            task.experiment, segment, state.calibration, column_of, state.factors, tally
        )
        by_motion = segment.equations(border, rows)
        alone = segment.smooth(by_motion) if held else None
        forces = None
        if force_samples is not None and state.parameters is not None:
            balanced = force_residuals(
                task.experiment,
                segment,
                force_samples,
                state.calibration,
                column_of,
                state.parameters,
                state.factors,
                tally,
                None if alone is None else alone.inverse,
            )
            forces = segment.equations(border, balanced)
        found.append(Linearised(by_motion, forces, alone))
    return tuple(found), tally


def fit(
    task: Task,
    state: FitState,
    tell: Callable[[float], None] = lambda fraction: None,
    *,
    beginning: bool = False,
) -> Fit:
    """Fit.

    Args:
        task: What to fit.
        state: Where to begin.
        tell: Is told the fraction that is done, roughly.
        beginning: Whether it is only a beginning for another fit, so that less will do.

    Raises:
        numpy.linalg.LinAlgError: The motion is not determined.
    """
    settings = task.settings
    border = state.ten + int(task.active.sum())
    column_of = columns_of(task.active, state.ten)
    accepted: tuple[FitState, NewtonStep, float] | None = None
    share, converged, searched = 1.0, False, False
    ratios: dict[Source, float] = {}
    unstated = Unstated(task, state)
    many = sum(segment.coefficients.size for segment in state.segments)
    turn = 0
    for turn in range(settings.iterations_beginning if beginning else settings.iterations):
        parts, tally = linearise(task, state, column_of, border)
        readings = [each.all for each in parts]
        cost = tally.cost + _prior_cost(task, state)
        if accepted is not None and not cost < accepted[2] * (1 + settings.same_cost):
            if share < settings.least_share:
                state = accepted[0]
                break
            # The direction descends, if not as far as it seemed.
            share *= settings.shorter
            state = accepted[1].along(task, accepted[0], share)
            continue
        equations = smooth(state, readings)
        step = step_of(task, state, equations)
        near, settled, factors = step.decrement < many, True, state.factors
        if near:
            # Noise and smoothness, once the residual is no longer that of a wrong motion.
            enough = settings.beginning_arrived if beginning else settings.arrived
            arrived = step.constant < settings.border_arrived and step.decrement < enough
            if any(segment.smoothness for segment in state.segments) and (arrived or not searched):
                level, settled = smoothness(
                    state.segments, readings, anew=not searched, settings=settings.motion
                )
                searched = True
                if not settled:
                    state = replace(
                        state,
                        segments=tuple(
                            a if a.smoothness is None else replace(a, smoothness=level)
                            for a in state.segments
                        ),
                    )
                    equations = smooth(state, readings)
                    step = step_of(task, state, equations)
            ratios = ratios_of(task, equations, tally)
            factors = unstated(state, ratios)
            settled = settled and not changed(task, state.factors, factors)
            if settled and (arrived or step.decrement < settings.nearly_arrived * cost):
                # Only a motion that is as free as it wants to be can say that a noise is not as
                # stated.
                factors = larger(task, state, ratios)
                settled = not changed(task, state.factors, factors)
                converged = settled and arrived
            if converged:
                break
        # A cost in other units is no measure of the step.
        pace = (
            _pace(accepted[1], step, share, settings) if settled and accepted is not None else 1.0
        )
        accepted = (state, step, cost) if settled else None
        share = pace
        state = replace(step.along(task, state, share), factors=factors)
        tell(min(0.95, turn / 8))
    ratios = ratios or ratios_of(task, equations, tally)
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


def smooth(state: FitState, readings: Sequence[NormalEquations]) -> tuple[NormalEquations, ...]:
    """Normal equations of every segment with what is known of its smoothness."""
    return tuple(
        segment.smooth(each) for segment, each in zip(state.segments, readings, strict=True)
    )


def ratios_of(
    task: Task, equations: Sequence[NormalEquations], tally: Tally
) -> dict[Source, float]:
    """Of every quantity, variance of the residual over what it counts as now.

    A stated noise is looked at without what stands far, which is not its doing; one that is not
    stated has what tails it has.
    """
    spent: dict[Label, float] = {}
    for each in equations:
        for label, freedom in each.spent().items():
            spent[label] = spent.get(label, 0.0) + freedom
    counts: dict[tuple[str, bool], float] = {}
    for (name, quantity), count in tally.count.items():
        counts[name, quantity.endswith(AT_REST)] = (
            counts.get((name, quantity.endswith(AT_REST)), 0.0) + count
        )
    ratios: dict[Source, float] = {}
    for (name, quantity), square in tally.square.items():
        count = tally.count[name, quantity]
        if (name, quantity) not in task.stated:
            square, count = tally.held[name, quantity]
        # Quantities of a force instrument share the freedom that its balance has lost.
        balance = spent.get(
            (name, BALANCE + AT_REST if quantity.endswith(AT_REST) else BALANCE), 0.0
        )
        whole = max(counts[name, quantity.endswith(AT_REST)], 1.0)
        taken = spent.get((name, quantity), balance * count / whole)
        ratios[name, quantity] = square / max(
            count - taken, task.settings.least_freedom * count, 1.0
        )
    return ratios


class Unstated:
    """Levels of noise that is not stated, followed turn by turn: more slowly where two pull at each
    other, faster where one creeps.
    """

    def __init__(self, task: Task, state: FitState) -> None:
        self._task, self._first = task, first_sigmas(task, state)
        self._last: dict[Source, float] = {}
        self._pace: dict[Source, float] = {}

    def __call__(self, state: FitState, ratios: Mapping[Source, float]) -> dict[Source, float]:
        """Factors that the ratios ask for."""
        settings = self._task.settings
        factors = dict(state.factors)
        for source, ratio in ratios.items():
            if source in self._task.stated:
                continue
            change = float(np.clip(np.log(ratio) / 2, -settings.most_change, settings.most_change))
            last, pace = self._last.get(source, 0.0), self._pace.get(source, 1.0)
            if change * last < 0:
                self._pace[source] = pace / 2
            elif abs(change) > settings.slow * abs(last) > 0:
                self._pace[source] = min(pace * settings.faster, settings.fastest)
            self._last[source] = change
            level = factors.get(source, 1.0) * float(np.exp(change * self._pace.get(source, 1.0)))
            factors[source] = max(
                level, self._task.least.get(source, 0.0) / self._first.get(source, np.inf)
            )
        return factors


def first_sigmas(task: Task, state: FitState) -> dict[Source, float]:
    """1-sigma that factors multiply."""
    found = {
        segment.label(*reading.source): reading.sigma
        for segment in state.segments
        for reading in segment.readings
    }
    for segment, force_samples in zip(state.segments, task.force_samples, strict=True):
        if force_samples is not None:
            if force_samples.unmodelled is not None:
                found[segment.label(ROBOT, UNMODELLED)] = float(force_samples.unmodelled[0])
            ends = np.cumsum([0, *(v.shape[1] for v in force_samples.readings.values())])
            found |= {
                segment.label(force_samples.name, q): float(force_samples.sigma[i])
                for q, i in zip(force_samples.readings, ends, strict=False)
            }
    return found


def larger(task: Task, state: FitState, ratios: Mapping[Source, float]) -> dict[Source, float]:
    """Levels of stated noise that is visibly larger than stated."""
    factors = dict(state.factors)
    for source in task.stated & ratios.keys():
        level = factors.get(source, 1.0) * float(np.sqrt(ratios[source]))
        factors[source] = level if level > task.settings.larger else 1.0
    return factors


def changed(task: Task, old: Mapping[Source, float], new: Mapping[Source, float]) -> bool:
    """Whether a level of noise has not settled yet."""
    return any(
        abs(np.log(level / old.get(source, 1.0))) > task.settings.level
        for source, level in new.items()
    )


def _prior_cost(task: Task, state: FitState) -> float:
    off = (state.calibration.values - task.calibration_parameters.mean)[
        task.active
    ] / task.calibration_parameters.deviation[task.active]
    return float(off @ off)


def border_system(task: Task, state: FitState, reduced: tuple[Array, Array]) -> tuple[Array, Array]:
    """Matrix and right-hand side of the border with the priors, in units of plausible sizes and
    prior 1-sigma.
    """
    matrix, gradient = reduced[0].copy(), reduced[1].copy()
    ten = state.ten
    deviation = task.calibration_parameters.deviation[task.active]
    scale = np.concatenate([task.sizes[:ten], deviation])
    if ten and task.known is not None and state.parameters is not None:
        precision, pull = task.known(state.parameters)
        matrix[:ten, :ten] += precision
        gradient[:ten] += pull - precision @ state.parameters
    matrix = matrix * np.outer(scale, scale)
    matrix[ten:, ten:] += np.eye(len(deviation))
    right = scale * gradient
    right[ten:] += (task.calibration_parameters.mean - state.calibration.values)[
        task.active
    ] / deviation
    return matrix, right


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
        return FitState(
            segments, replace(state.calibration, values=values), parameters, state.factors
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
    gradient = np.sum([g for _, g in reduced], axis=0)
    ten = state.ten
    gradient += further
    matrix, right = border_system(task, state, (np.sum([m for m, _ in reduced], axis=0), gradient))
    if least is not None and state.parameters is not None:
        held, _ = weak_directions(matrix, np.zeros((TEN, TEN)), np.ones(TEN), task.settings, least)
        matrix[:TEN, :TEN] += held
        right[:TEN] -= held @ (state.parameters / task.sizes)
    scale = np.concatenate([task.sizes[:ten], task.calibration_parameters.deviation[task.active]])
    inverse = np.linalg.inv((matrix + matrix.T) / 2)
    step, gained = scale * (inverse @ right), float(right @ inverse @ right)
    return NewtonStep(
        border=step,
        motion=tuple(each.motion_step(step) for each in follow or equations),
        decrement=gained + sum(float(each.motion_gradient @ each.settled) for each in equations),
        constant=gained,
        covariance=scale[:, None] * inverse * scale,
    )
