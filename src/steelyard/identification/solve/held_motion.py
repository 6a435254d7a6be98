"""The balance over a motion that is held as the motion instruments alone give it.

What the linear methods have in common: forces tell the body and the calibration parameters, not the
motion. The motion has a covariance; with it the residuals of the balance are weighted exactly, all
instants together (generalised least squares), by the normal equations of the joint fit whose
motion does not take its own step. Noise of the motion stands in the regressor too: what that does
to the estimate in the mean is taken off, to first order [Soderstrom2018]_.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from steelyard.arrays import Array
from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run
from steelyard.experiment.unread import without_constant_lengths
from steelyard.identification.model.balance import balance_of, parts_of
from steelyard.identification.model.calibration_parameters import ROBOT
from steelyard.identification.model.force_residuals import force_residuals, tally_forces
from steelyard.identification.model.segment import NormalEquations
from steelyard.identification.model.sources import Source
from steelyard.identification.samples.dense_streams import average_dense
from steelyard.identification.solve.beginning.begin import begin
from steelyard.identification.solve.beginning.readings import Tell, read
from steelyard.identification.solve.conclusion import concluded, sound
from steelyard.identification.solve.fit_state import (
    Fit,
    FitState,
    Linearised,
    Task,
    linearise,
    smooth,
)
from steelyard.identification.solve.fitted import (
    Fitted,
    FittedStretch,
    stretch_of,
    without_knots,
)
from steelyard.identification.solve.long_recording import (
    fitted_windows,
    lively_parts,
    moving_length,
    window_about,
    windows,
)
from steelyard.identification.solve.misfits.suspicions import with_suspicions
from steelyard.identification.solve.newton_step import NewtonStep, step_of
from steelyard.identification.solve.noise_levels import (
    UnstatedNoise,
    changed,
    first_sigmas,
    larger,
    ratios_of,
    spent_by,
)
from steelyard.identification.solve.posterior import Posterior, Progress
from steelyard.identification.solve.settings import FIT, FitSettings
from steelyard.identification.solve.shared_windows import attempts
from steelyard.identification.solve.stated_processes import with_stated
from steelyard.identification.tally import Tally, robust_weight
from steelyard.inertia import TEN


def fit_with_held_motion(
    experiment: Experiment,
    progress: Progress = None,
    held_out: frozenset[str] = frozenset(),
    settings: FitSettings = FIT,
) -> Posterior:
    """Fit body and calibration parameters over a motion that is held as its instruments give it.

    Args:
        experiment: With at least one run.
        progress: Is called with what is being done and the fraction that is done.
        held_out: Runs whose forces are not looked at; their motion is.
        settings: How to fit.

    Raises:
        InputError: A run lacks what the method needs.
        NoBalanceError: Forces and motion cannot be balanced.
    """
    tell = progress or (lambda what, fraction: None)
    # How cables stretch, only a motion tells that follows what it carries.
    dense = average_dense(without_constant_lengths(experiment), settings.motion)
    return sound(lambda: _posterior(dense, tell, held_out, settings))


def _posterior(
    experiment: Experiment, tell: Tell, held_out: frozenset[str], settings: FitSettings
) -> Posterior:
    """Of the whole at once, or of a long recording chunk by chunk."""
    if moving_length(experiment) <= settings.long:
        return concluded([_fitted(experiment, tell, held_out, settings)])
    lively = lively_parts(experiment, settings.part, settings)
    part = _fitted(lively, tell, held_out, settings).fitted
    runs = list(windows(experiment, settings))
    return concluded(
        fitted_windows(
            runs,
            attempts(_about, part, experiment, runs, settings.jobs),
            lambda done: tell("balancing the whole recording", 0.6 + 0.35 * done),
        )
    )


def _fitted(
    experiment: Experiment, tell: Tell, held_out: frozenset[str], settings: FitSettings
) -> FittedStretch:
    """The fit of an experiment that is not too long."""
    readings = read(experiment, None, tell, settings=settings)
    begun = begin(readings, tell, thorough=True, held_out=held_out)
    task = replace(begun.task, force_samples=readings.looked_at(held_out))
    tell("balancing forces and motion", 0.5)
    alone = replace(task, active=np.zeros_like(task.active))
    body = fit_held(alone, with_stated(task, begun.state), beginning=True)
    found = fit_held(
        task, body.state, lambda part: tell("balancing forces and motion", 0.5 + 0.3 * part)
    )
    task, found = with_suspicions(task, found, fit_held, held=True)
    fitted = Fitted(task, found, begun.motion, readings.force_samples, begun.lost, {}, {}, held_out)
    return stretch_of(readings, fitted)


def _about(part: Fitted, experiment: Experiment, run: Run) -> list[FittedStretch]:
    """A stretch of a long recording, about the calibration, noise and smoothness of a part."""
    begun = window_about(part, experiment, run)
    if begun is None:
        return []
    readings, state = begun
    task = replace(
        part.task,
        experiment=experiment,
        force_samples=readings.looked_at(part.held_out),
    )
    parts, _ = linearise(task, state, held=True)
    bias = gradient_bias(task, state, parts)
    fit = replace(part.fit, state=state, motions=_covariances(parts), bias=bias)
    fitted = replace(part, task=task, fit=fit, force_samples=readings.force_samples, lost=())
    return [without_knots(stretch_of(readings, fitted))]


def fit_held(
    task: Task,
    state: FitState,
    tell: Callable[[float], None] = lambda fraction: None,
    *,
    beginning: bool = False,
) -> Fit:
    """Fit body and calibration parameters to forces over a motion that is held.

    Args:
        task: What to fit.
        state: With the motion as its instruments alone give it.
        tell: Is called with the fraction that is done, roughly.
        beginning: Whether it is only a beginning for another fit, so that less will do.

    Raises:
        numpy.linalg.LinAlgError: The motion is not determined.
    """
    settings = task.settings
    unstated = UnstatedNoise.of(task, state)
    bias = np.zeros((len(state.segments), task.border(state)))
    share, last = 1.0, np.inf
    for turn in range(settings.bias_iterations if beginning else settings.held_iterations):
        parts, tally = linearise(task, state, held=True)
        equations = smooth(state, [each.all for each in parts])
        if turn < settings.bias_iterations and not beginning:
            bias = gradient_bias(task, state, parts)
        step = step_of(
            task,
            state,
            equations,
            follow=_motions(parts),
            further=bias.sum(axis=0),
            least=1 / settings.moving**2,
        )
        if not np.isfinite(step.border).all():
            raise np.linalg.LinAlgError
        factors = state.factors
        if turn < settings.level_iterations:
            followed = step_of(task, state, equations)
            ratios = ratios_of(task, spent_by(equations), _followed(task, state, followed, tally))
            levels, unstated = unstated.followed(state, ratios)
            factors = _of_forces(task, state, levels)
            if turn:
                # Only about a body that is nearly right can a noise not be as stated.
                stated = larger(task, state, ratios)
                factors |= {source: stated[source] for source in task.stated & stated.keys()}
        settled = not changed(task, state.factors, factors)
        converged = settled and _distance(task, step) < settings.held_arrived
        if converged:
            break
        # Where what is left out of the curvature throws it to and fro, half of a step arrives.
        if settled and _distance(task, step) > last:
            share = max(share / 2, settings.held_share)
        last = _distance(task, step)
        state = replace(step.along(task, state, share), factors=factors)
        tell(min(0.95, turn / 5))
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
        _covariances(parts),
        bias,
    )


def _distance(task: Task, step: NewtonStep) -> float:
    """Largest step of one of the ten, in its 1-sigma; of those that are not identifiable none."""
    deviation = np.sqrt(np.maximum(np.diag(step.covariance)[:TEN], 0.0))
    known = (deviation > 0) & (deviation < task.settings.moving * task.sizes)
    return float(np.max(np.abs(step.border[:TEN][known]) / deviation[known], initial=0.0))


def _motions(parts: Sequence[Linearised]) -> list[NormalEquations]:
    """Equations of the motion of every segment by its instruments alone."""
    return [each.held for each in parts if each.held is not None]


def _covariances(parts: Sequence[Linearised]) -> tuple[Array, ...]:
    """Covariance of the motion of every segment as its instruments alone leave it."""
    return tuple(each.inverse for each in _motions(parts))


def _of_forces(task: Task, state: FitState, factors: Mapping[Source, float]) -> dict[Source, float]:
    """Noise levels with those of the motion instruments as they are: forces tell nothing of
    them.
    """
    names = {each.name for each in task.force_samples if each is not None} | {ROBOT}
    return {k: v if k[0] in names else state.factors.get(k, 1.0) for k, v in factors.items()}


def _followed(task: Task, state: FitState, step: NewtonStep, tally: Tally) -> Tally:
    """The tally with what is left of the forces once the motion follows them: that, not the noise
    of the held motion, tells the noise of the force readings.
    """
    moved = step.along(task, state, 1.0)
    found = Tally()
    for segment, samples in zip(moved.segments, task.force_samples, strict=True):
        if samples is None:
            continue
        assert moved.parameters is not None
        for part in parts_of(task.experiment, segment, samples, moved.calibration):
            at = balance_of(
                task.experiment, segment, part, moved.calibration, moved.parameters, moved.factors
            )
            weight = at.told * robust_weight(at.size, 6)
            tally_forces(found, segment, part, at, weight, at.size)
    return Tally(
        {**tally.square, **found.square},
        {**tally.count, **found.count},
        {**tally.far, **found.far},
        {**tally.rarest, **found.rarest},
        {**tally.held, **found.held},
    )


def gradient_bias(task: Task, state: FitState, parts: Sequence[Linearised]) -> Array:
    """What noise of the held motion does to the gradient by the border in the mean, with the
    opposite sign, segment by segment, shape (s, b).

    A held motion stands with its noise in the regressor, in the derivatives by the calibration
    parameters and in the residual; where these meet, the gradient has a mean. It is the even part
    of the gradient about the motion under draws of that noise.

    Args:
        task: With forces.
        state: With the held motion.
        parts: Equations about it.
    """
    border, column_of = task.border(state), task.column_of(state)
    rng = np.random.default_rng(0)
    found = np.zeros((len(state.segments), border))
    for i, (segment, samples, part) in enumerate(
        zip(state.segments, task.force_samples, parts, strict=True)
    ):
        held = part.held
        if samples is None or part.forces is None or held is None:
            continue
        assert state.parameters is not None
        # The motion instruments are content with the motion that they have given.
        still = replace(
            held,
            motion_gradient=np.zeros_like(held.motion_gradient),
            border_gradient=np.zeros_like(held.border_gradient),
        )
        here = _reduced_gradient(still + part.forces)
        for _ in range(task.settings.bias_draws):
            noise = held.drawn(rng).reshape(-1, segment.block)
            for sign in (1, -1):
                moved = replace(segment, coefficients=segment.coefficients + sign * noise)
                rows = force_residuals(
                    task.experiment,
                    moved,
                    samples,
                    state.calibration,
                    column_of,
                    state.parameters,
                    state.factors,
                    None,
                    held.inverse,
                )
                there = still + segment.equations(border, rows)
                found[i] -= (_reduced_gradient(there) - here) / 2
    return found / task.settings.bias_draws


def _reduced_gradient(equations: NormalEquations) -> Array:
    """Gradient by the border once the motion has followed, shape (b,)."""
    return np.asarray(equations.border_gradient - equations.side.T @ equations.settled)
