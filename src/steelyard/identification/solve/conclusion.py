"""From a fit to a posterior: normal equations over every calibration parameter, estimated or not,
and all that follows from them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.estimates.estimate import plausible_radius
from steelyard.experiment.model import Experiment, Load
from steelyard.experiment.recording import Run
from steelyard.identification.known_body import plausible
from steelyard.identification.model.balance import Balance
from steelyard.identification.model.calibration_parameters import ROBOT, load_place
from steelyard.identification.model.fitted_motion import FittedMotion, fitted_motion
from steelyard.identification.model.motion_segment import Segment
from steelyard.identification.model.sources import Source
from steelyard.identification.samples.prepared import Samples
from steelyard.identification.solve.beginning.begin import NoBalanceError
from steelyard.identification.solve.border.normal_equations import (
    BorderEquations,
    FurtherLoad,
    Solution,
    solve,
    summed,
    together,
)
from steelyard.identification.solve.border.scatter import enlarged
from steelyard.identification.solve.border.segment_equations import (
    BalanceCourse,
    SegmentEquations,
)
from steelyard.identification.solve.bound import bound_of
from steelyard.identification.solve.fit_state import Fit, FitState
from steelyard.identification.solve.fitted import (
    Fitted,
    FittedStretch,
    by_source,
    estimated_columns,
)
from steelyard.identification.solve.posterior import Posterior, prior_of
from steelyard.inertia import TEN
from steelyard.smoothing import DEGREE


def sound(posterior: Callable[[], Posterior]) -> Posterior:
    """A posterior whose numbers are numbers.

    Raises:
        NoBalanceError: They are not.
    """
    try:
        # Numbers that end in nothing are looked at in the end, once.
        with np.errstate(all="ignore"):
            found = posterior()
            usable = bool(found.parameters[0]) and np.isfinite(found.body_covariance).all()
    except np.linalg.LinAlgError:
        usable = False
    if not usable:
        raise NoBalanceError(
            "forces and motion cannot be fitted at all; check the force columns, their units and"
            " signs, the stated noise, and the geometry of the robot"
        )
    return found


def concluded(chunks: Sequence[FittedStretch], *, courses: bool = True) -> Posterior:
    """All that follows from a fit.

    Args:
        chunks: Of one experiment, linearised about the same calibration; the last one says how the
            fit ended.
        courses: Whether the motions are drawn with their uncertainty; a verdict alone needs none.

    Raises:
        numpy.linalg.LinAlgError: The motion is not determined.
    """
    fitted = chunks[-1].fitted
    experiment, task, found = fitted.task.experiment, fitted.task, fitted.fit
    parts = [part for chunk in chunks for part in chunk.parts]
    assert found.state.parameters is not None
    equations = _by_run(parts)
    total = summed(list(equations.values()))
    radius = plausible_radius(experiment.robot)
    size = plausible(found.state.parameters, radius)
    prior = prior_of(experiment, found.state.calibration, found.state.parameters, radius)
    estimated = estimated_columns(task)
    biases = [chunk.fitted.fit.bias.sum(axis=0) for chunk in chunks if len(chunk.fitted.fit.bias)]
    bias = np.zeros(len(estimated))
    bias[estimated] = np.sum(biases, axis=0) if biases else 0.0
    loads = _further_loads(experiment, found.state, equations, radius)
    first = experiment.loads[0] if experiment.loads else None
    noise = _noise(experiment, first, equations)
    solution = solve(
        replace(total, noise=noise), prior, estimated, size, bias, task.settings, loads
    )
    sources = _force_sources(fitted)
    blocks = together([part.blocks for part in parts])
    state = found.state
    if len(chunks) > 1:
        if not len(found.bias):
            # The motion was not held.
            step = solution.value.copy()
            step[:TEN] -= found.state.parameters
            parts = [_moved(part, step, estimated) for part in parts]
        state = _whole(state, parts, solution)
    result = Posterior(
        experiment=experiment,
        fit=replace(found, state=state),
        force_samples=tuple(part.force_samples for part in parts),
        samples=tuple(_samples(run, chunks) for run in experiment.runs),
        motion_ratios=_motion_ratios(fitted, sources),
        motion_converged=fitted.motion.converged or (found.converged and not found.motions),
        stated=sources <= task.stated,
        equations=equations,
        prior=prior,
        solution=solution,
        blocks=blocks,
        bound=bound_of(solution),
        weights=_weights(parts, fitted.held_out),
        motion=(),
        contacts={name: tuple(each) for name, each in fitted.contacts.items() if each},
        spikes={name: count for name, count in fitted.spikes.items() if count},
        held_out=fitted.held_out,
        slack=tuple(each for chunk in chunks for each in chunk.fitted.slack),
        notes=tuple(dict.fromkeys(_notes(chunks))),
        further_loads=tuple(loads),
        by_source=by_source(parts),
    )
    solution = replace(solution, ratio=_force_ratio(found, sources, frozenset()))
    freedom = max(total.freedom, 1.0)
    wide = enlarged(solution, blocks, result.told, freedom, task.settings)
    # What the verdict asks is how the forces compare with what was stated of them.
    wide = replace(wide, ratio=_force_ratio(found, sources, task.stated))
    # Balances of an hour take as much memory as the motion that is drawn now: nobody else has them.
    moving = [replace(part, balances=()) for part in parts if courses and not part.segment.static]
    del chunks, parts
    moving.reverse()
    # Each is drawn from matrices that take as much memory, and are done with then.
    motion = tuple(
        _motion_of(moving.pop(), state, wide.covariance, estimated, task.experiment.origin)
        for _ in range(len(moving))
    )
    return replace(result, solution=wide, motion=motion)


def _further_loads(
    experiment: Experiment,
    state: FitState,
    equations: Mapping[str, BorderEquations],
    radius: float,
) -> list[FurtherLoad]:
    """Those beside the first, with what is needed to see what the data do not tell of them."""
    assert state.parameters is not None
    found = []
    for load in experiment.loads[1:]:
        place = load_place(state.calibration.calibration_parameters, load)
        value = state.calibration.values[place]
        found.append(
            FurtherLoad(
                TEN + np.arange(place.start, place.stop, dtype=np.intp),
                value,
                _noise(experiment, load, equations),
                plausible(state.parameters + value, radius),
            )
        )
    return found


def _noise(
    experiment: Experiment, load: Load | None, equations: Mapping[str, BorderEquations]
) -> Array:
    """What a motion of nothing but noise would tell of a load in its runs, shape (10, 10)."""
    own = [each.noise for run, each in equations.items() if experiment.load_of(run) is load]
    return np.sum(own, axis=0) if own else np.zeros((TEN, TEN))


def _moved(part: SegmentEquations, step: Array, estimated: NDArray[np.bool_]) -> SegmentEquations:
    """A window whose motion follows the border, shape (k,), to where the whole has it."""
    segment = part.segment
    along = _followed(part, estimated) @ step[estimated]
    coefficients = segment.coefficients - along.reshape(segment.coefficients.shape)
    return replace(part, segment=replace(segment, coefficients=coefficients))


def _followed(part: SegmentEquations, estimated: NDArray[np.bool_]) -> Array:
    """How the motion follows what is estimated, with the opposite sign, shape (N, e)."""
    every = part.followed.shape[1] == len(estimated)
    return part.followed[:, estimated] if every else part.followed


def _whole(state: FitState, parts: Sequence[SegmentEquations], solution: Solution) -> FitState:
    """The state of all windows together."""
    # About the calibration of a part; the step that the whole makes is small.
    values = state.calibration.values + solution.value[TEN:]
    segments = tuple(part.segment for part in parts)
    calibration = replace(state.calibration, values=values)
    return replace(
        state, segments=segments, calibration=calibration, parameters=solution.value[:TEN]
    )


def _notes(chunks: Sequence[FittedStretch]) -> Iterator[str]:
    """What a reader should know of the readings."""
    for chunk in chunks:
        for samples in chunk.readings.samples:
            # A gap is left out by a filter; here the motion goes on across it, and what is left out
            # has a note of its own.
            yield from (note for note in samples.notes if "gap" not in note)
        yield from chunk.readings.notes
        yield from chunk.fitted.lost
        yield from map(str, chunk.fitted.slack)


def _by_run(parts: Sequence[SegmentEquations]) -> dict[str, BorderEquations]:
    """Run -> its normal equations."""
    found: dict[str, BorderEquations] = {}
    for part in parts:
        run = part.segment.run
        found[run] = found[run] + part.equations if run in found else part.equations
    return found


def _force_sources(fitted: Fitted) -> frozenset[Source]:
    """Quantities of the force instruments, as their noise is kept."""
    return frozenset(
        segment.label(forces.name, quantity)
        for segment, forces in zip(fitted.fit.state.segments, fitted.force_samples, strict=True)
        for quantity in forces.readings
    )


def _motion_ratios(fitted: Fitted, forces: frozenset[Source]) -> dict[Source, float]:
    """Residuals of the motion instruments in units of what was stated of their noise."""
    # Where the motion was held it alone says how its instruments agree.
    fit = fitted.motion if fitted.fit.motions else fitted.fit
    found = {}
    for source, ratio in fit.ratios.items():
        if source in forces or source[0] == ROBOT:
            continue
        # A stated noise that did not hold counts as it is, but the verdict asks how it compares
        # with what was stated.
        stated = source in fitted.task.stated
        found[source] = float(np.sqrt(ratio)) * (
            fit.state.factors.get(source, 1.0) if stated else 1.0
        )
    return found


def _weights(parts: Sequence[SegmentEquations], held_out: frozenset[str]) -> dict[str, Array]:
    """Run -> weight of every sample; those that have been left out and named are none that stand
    out.
    """
    found: dict[str, list[Array]] = {}
    for part in parts:
        if part.segment.run in held_out:
            continue
        inside = np.concatenate([each.told for each in part.balances])
        named = part.force_samples.left_out.any(axis=1) | ~inside
        found.setdefault(part.segment.run, []).append(np.where(named, 1.0, part.weight))
    return {run: np.concatenate(each) for run, each in found.items()}


def _motion_of(
    part: SegmentEquations,
    state: FitState,
    covariance: Array,
    estimated: NDArray[np.bool_],
    origin: Array,
) -> FittedMotion:
    """The motion of a segment in common time: the clock that tells it may have a delay of its own.

    Args:
        part: With its segment.
        state: With the calibration.
        covariance: Of the border parameters, shape (k, k).
        estimated: Which of them are estimated, shape (k,).
        origin: Point of the platform whose motion it is, platform frame [m], shape (3,).
    """
    segment, parameters = part.segment, state.calibration.calibration_parameters
    border = covariance[np.ix_(estimated, estimated)]
    followed = _followed(part, estimated)
    motion = fitted_motion(segment, part.covariance, followed, border, point=origin)
    assert segment.reference is not None
    own = parameters.place(segment.reference, "delay", segment.run)
    delay = float((state.calibration.values[own] - parameters.mean[own])[0])
    return replace(motion, time=motion.time - delay)


def _force_ratio(found: Fit, sources: frozenset[Source], stated: frozenset[Source]) -> float:
    """Variance of what is left of the forces over what their noise explains, that of some
    quantities as it was stated.
    """
    square = freedom = 0.0
    for label in sources:
        count = found.tally.count.get(label, 0.0)
        level = found.state.factors.get(label, 1.0) if label in stated else 1.0
        square += found.ratios.get(label, 1.0) * level**2 * count
        freedom += count
    return square / max(freedom, 1.0)


def _samples(run: Run, chunks: Sequence[FittedStretch]) -> Samples:
    """Samples of a run at the times of the force readings, with the fitted motion and the forces as
    they were read.
    """
    prepared: Samples | None = None
    segments: list[Segment] = []
    own: list[Balance | BalanceCourse] = []
    for chunk in chunks:
        for each, samples in zip(chunk.readings.runs, chunk.readings.samples, strict=True):
            prepared = prepared or (samples if each.name == run.name else None)
        for part in chunk.parts:
            if part.segment.run == run.name:
                segments.append(part.segment)
                own += part.balances
    assert prepared is not None
    if not own:
        return prepared
    grid = segments[0].knots
    cables = prepared.tension is not None
    motion = {name: np.concatenate([at.motion[name] for at in own]) for name in own[0].motion}
    return replace(
        prepared,
        time=np.concatenate([at.time for at in own]),
        wrench=np.concatenate([at.wrench for at in own]),
        tension=np.concatenate([at.carried for at in own]) if cables else None,
        # Nobody asks for it, and of an hour it takes more than all readings.
        structure=None,
        spacing=0.0 if prepared.static else float(grid[DEGREE + 1] - grid[DEGREE]),
        omega=motion["omega"],
        alpha=motion["alpha"],
        specific_force=motion["specific_force"],
        position=motion["position"],
        rotation=motion["rotation"],
        velocity=motion["velocity"],
    )
