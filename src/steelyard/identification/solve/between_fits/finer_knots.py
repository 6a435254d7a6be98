"""Finer knots, where forces and accelerometer feel a vibration that the knots do not follow, or
where forces resolve more of the motion than its own instruments ask for.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from steelyard.identification.model.balance import Forces
from steelyard.identification.model.calibration_parameters import clock_of
from steelyard.identification.model.motion_segment import Segment
from steelyard.identification.model.sources import Source
from steelyard.identification.samples.first_poses.spline_through_poses import resampled
from steelyard.identification.samples.segmentation import recorded
from steelyard.identification.solve.beginning.begin import Beginning
from steelyard.identification.solve.beginning.motion_task import motion_task
from steelyard.identification.solve.beginning.readings import Readings
from steelyard.identification.solve.fit_state import FitState, linearise, smooth
from steelyard.identification.solve.fitted import Fitted
from steelyard.identification.solve.misfits.coherence import coherence
from steelyard.identification.solve.misfits.jitter import with_jitter
from steelyard.identification.solve.newton_step import step_of
from steelyard.identification.solve.noise_levels import ratios_of, spent_by
from steelyard.identification.solve.stated_processes import with_stated
from steelyard.instruments.equations import order_of

_ACCELERATION = 2
"""Order of the derivative of the pose that an accelerometer reads."""
_KNOTS = 5.0
"""In a period of what vibrates; two are the least that follow it at all."""


@dataclass(frozen=True)
class FinerKnots:
    """How a run is to be followed more closely."""

    spacing: float
    """Of the knots [s]."""
    clock: str
    lag: float
    """By how much that clock is later than thought [s]."""


def on_finer_knots(readings: Readings, vibrations: Mapping[str, FinerKnots]) -> Readings:
    """The readings on finer knots where something vibrates."""
    experiment = readings.experiment
    records = tuple(
        recorded(
            experiment,
            run,
            each,
            readings.calibration,
            vibrations[run.name].spacing,
            readings.settings.motion,
        )
        if run.name in vibrations
        else record
        for run, each, record in zip(readings.runs, readings.samples, readings.records, strict=True)
    )
    return replace(readings, records=records)


def vibrations_of(readings: Readings, fitted: Fitted) -> dict[str, FinerKnots]:
    """Runs in which forces and accelerometer both feel what the knots do not follow."""
    settings = readings.settings
    finest = {segment.run: each.finest for each in readings.records for segment in each.segments}
    state = fitted.fit.state
    assert state.parameters is not None
    found = {}
    for segment, at in zip(state.segments, fitted.balances, strict=True):
        if segment.static:
            continue
        if finest[segment.run] >= settings.much_finer * segment.spacing:
            continue
        mass = float(state.parameters[0])
        own = coherence(readings.experiment, segment, at, state.calibration, mass, settings)
        if own.correlation > settings.coherent:
            clock = clock_of(readings.experiment, own.instrument)
            found[segment.run] = FinerKnots(finest[segment.run], clock, own.lag)
    return found


def follows(state: FitState, frequency: float) -> bool:
    """Whether the knots of all motions follow a frequency [Hz]."""
    return all(each.static or each.spacing < _spacing_for(frequency) for each in state.segments)


def unfollowed(readings: Readings, found: Fitted, frequency: float) -> dict[str, FinerKnots]:
    """Runs whose knots do not follow a frequency that the instruments of the motion resolve.

    Args:
        readings: Of the experiment.
        found: A fit.
        frequency: That vibrates [Hz]; 0: nothing does.
    """
    if not frequency:
        return {}
    return _on_closer(readings, found, lambda _, __: _spacing_for(frequency))


def coarse_runs(readings: Readings, found: Fitted) -> dict[str, FinerKnots]:
    """Runs whose forces scatter more than their stated noise does and whose instruments resolve
    finer knots, with knots half as far apart.

    Where an instrument of the motion scatters more than stated too, it is not known who is wrong
    (forces whose time stamps scatter bend the motion), and some hundredths of a variance are no
    reason: finer knots would follow the forces the more. Unless an accelerometer, which feels first
    what knots do not follow, scatters beyond chance as forces do.
    """
    scatter = scatter_of_forces(found, found.fit.ratios)
    least = found.task.settings.larger**2 if _is_open(found) and not _felt(found) else 1.0
    beyond = {
        own[0] for own, ratio in scatter.items() if ratio > least and _is_beyond(found, own, ratio)
    }
    return _on_closer(
        readings,
        found,
        lambda segment, forces: segment.spacing / (2 if forces.name in beyond else 1),
    )


def _spacing_for(frequency: float) -> float:
    """Of knots that follow a frequency [Hz], [s]."""
    return 1 / (_KNOTS * frequency)


def _on_closer(
    readings: Readings, found: Fitted, wanted: Callable[[Segment, Forces], float]
) -> dict[str, FinerKnots]:
    """Runs with knots as close as is wanted, where that is worth a fit and the instruments of the
    motion resolve it.

    Args:
        readings: Of the experiment.
        found: A fit.
        wanted: Spacing of the knots for a segment and its forces [s].
    """
    closest = {segment.run: each.closest for each in readings.records for segment in each.segments}
    closer = {}
    for segment, forces in zip(found.fit.state.segments, found.force_samples, strict=True):
        if segment.static:
            continue
        spacing = max(closest[segment.run], wanted(segment, forces))
        if spacing < readings.settings.much_finer * segment.spacing:
            clock = clock_of(readings.experiment, forces.name)
            closer[segment.run] = FinerKnots(spacing, clock, 0.0)
    return closer


def scatter_of_forces(found: Fitted, ratios: Mapping[Source, float]) -> dict[Source, float]:
    """Variance of what is left of the forces over that of their stated noise; without quantities of
    which none is stated.

    Args:
        found: A fit.
        ratios: Variance over what it counts as with the levels of this fit, see :func:`.ratios_of`.
    """
    names = {forces.name for forces in found.force_samples}
    return {own: each for own, each in _scatter(found, ratios).items() if own[0] in names}


def _scatter(found: Fitted, ratios: Mapping[Source, float]) -> dict[Source, float]:
    """The same of all quantities whose noise is stated."""
    factors, stated = found.fit.state.factors, found.fit.stated
    return {
        own: ratio * factors.get(own, 1.0) ** 2 for own, ratio in ratios.items() if own in stated
    }


def _felt(found: Fitted) -> dict[Source, float]:
    """Variance of accelerometers that scatter beyond their stated noise by more than chance, over
    that of it.
    """
    experiment = found.task.experiment
    return {
        own: scatter
        for own, scatter in _scatter(found, found.fit.ratios).items()
        if _is_beyond(found, own, scatter)
        and not experiment.instruments[own[0]].is_force
        and order_of(experiment.instruments[own[0]], own[1], experiment.robot) == _ACCELERATION
    }


def finer_explain(begun: Beginning, found: Fitted) -> bool:
    """Whether a step of the motion on other knots takes most of what is left of the forces beyond
    their stated noise, its freedom counted: noise, and errors of the description, stay. Where a
    step goes too far, or much farther down, as from a motion that was far from these forces, so may
    a further one.
    """
    task = replace(begun.task, force_samples=found.force_samples)
    task, state = with_jitter(task, with_stated(task, begun.state))
    parts, tally = linearise(task, state)
    equations = smooth(state, [each.all for each in parts])
    forces = scatter_of_forces(found, found.fit.ratios)
    felt = _felt(found) if _is_open(found) else {}
    for _ in range(task.settings.steps_to_explain):
        cost = tally.cost
        state = step_of(task, state, equations).along(task, state, 1.0)
        parts, tally = linearise(task, state)
        equations = smooth(state, [each.all for each in parts])
        after = ratios_of(task, spent_by(equations), tally)
        if _explained(found, forces, after) and (not felt or _explained(found, felt, after)):
            return True
        if task.settings.hardly * cost < tally.cost < cost:
            break
    return False


def _explained(
    found: Fitted, before: Mapping[Source, float], ratios: Mapping[Source, float]
) -> bool:
    """Whether of a quantity that scatters beyond its stated noise most of that has gone."""
    after = _scatter(found, ratios)
    return any(
        after.get(own, np.inf) - 1 < found.task.settings.explained * (scatter - 1)
        for own, scatter in before.items()
        if _is_beyond(found, own, scatter)
    )


def _is_open(found: Fitted) -> bool:
    """Whether an instrument of the motion scatters visibly more than its stated noise."""
    names = {forces.name for forces in found.force_samples}
    factors, stated = found.fit.state.factors, found.fit.stated
    return any(f > 1.0 for own, f in factors.items() if own in stated and own[0] not in names)


def _is_beyond(found: Fitted, source: Source, scatter: float) -> bool:
    """Whether a variance over that of the stated noise is beyond what chance makes of it."""
    count = found.fit.tally.count.get(source, 0.0)
    surely = found.task.settings.surely_larger
    return count > 0 and scatter > 1 + surely * float(np.sqrt(2 / count))


def begun_again(
    readings: Readings, before: Fitted, vibrations: Mapping[str, FinerKnots]
) -> Beginning:
    """What was found, on other knots; clocks where forces and accelerometers go together best,
    since what vibrates fits at many lags.
    """
    state, parameters = before.fit.state, before.task.calibration_parameters
    values = state.calibration.values.copy()
    for run, each in vibrations.items():
        place = parameters.place(each.clock, "delay", run)
        values[place] += np.where(parameters.deviation[place] > 0, each.lag, 0.0)
    moved = [
        _on_knots_of(new, old) for old, new in zip(state.segments, readings.segments, strict=True)
    ]
    state = replace(
        state, calibration=replace(state.calibration, values=values), segments=tuple(moved)
    )
    return Beginning(motion_task(readings), before.motion, state, before.lost, slack=before.slack)


def _on_knots_of(new: Segment, old: Segment) -> Segment:
    """The motion and the readings of a segment on the knots of another."""
    if len(old.knots) == len(new.knots):
        return old
    return resampled(old, replace(new, reference=old.reference, readings=old.readings))
