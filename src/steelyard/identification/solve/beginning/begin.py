"""Where a fit begins: segments of all runs, the motion as its instruments alone give it, a first
body.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from steelyard.estimates.estimate import plausible_radius
from steelyard.experiment.model import Experiment
from steelyard.identification.known_body import KnownBody, known_bodies, plausible
from steelyard.identification.solve.beginning.first_body import first_bodies, on_force_clock
from steelyard.identification.solve.beginning.motion_task import motion_task, untimed
from steelyard.identification.solve.beginning.readings import Readings, Tell
from steelyard.identification.solve.fit_state import Fit, FitState, Task
from steelyard.identification.solve.joint_fit import fit
from steelyard.identification.solve.misfits.along_segments import too_large
from steelyard.identification.solve.misfits.disturbances import with_disturbances
from steelyard.identification.solve.misfits.jitter import with_jitter, with_jitter_found
from steelyard.identification.solve.misfits.lost_readings import without_lost
from steelyard.identification.solve.misfits.slack_cables import SlackCables
from steelyard.identification.solve.misfits.suspicions import with_suspicions
from steelyard.identification.solve.stated_processes import with_stated


class NoBalanceError(ArithmeticError):
    """Forces and motion cannot be balanced, so that there is no estimate."""


@dataclass(frozen=True, eq=False)
class Beginning:
    """What a fit of motion and forces begins with."""

    task: Task
    """With all uncertain calibration parameters active, and no forces."""
    motion: Fit
    """Of the motion instruments alone."""
    state: FitState
    """With a first body, told in the time of the forces."""
    lost: Sequence[str]
    """Notes of instruments that have lost the motion."""
    touched: Mapping[str, Sequence[tuple[float, float]]] = field(default_factory=dict)
    """Run -> stretches in which a hand touched the platform, which are left out [s]."""
    slack: tuple[SlackCables, ...] = ()
    """Cables that may hang slack for a while, of runs that have such ones."""


def begin(
    readings: Readings,
    tell: Tell,
    *,
    thorough: bool,
    held_out: frozenset[str] = frozenset(),
) -> Beginning:
    """Fit the motion to its instruments alone, and a first body to the forces over it.

    Args:
        readings: Of the experiment.
        tell: Is called with what is being done and the fraction that is done.
        thorough: Whether the motion will be held; else it is only a beginning.
        held_out: Runs whose forces are not looked at.

    Raises:
        NoBalanceError: No run has a segment.
        numpy.linalg.LinAlgError: The motion is not determined, or there is no body.
    """
    segments = readings.segments
    if not segments:
        raise NoBalanceError("; ".join(readings.notes))
    task = motion_task(readings)
    state = FitState(segments, readings.calibration, None, readings.louder)
    begun = _motion(task, state, tell, beginning=not thorough)
    return with_body(readings, begun, held_out)


def with_body(
    readings: Readings, begun: Beginning, held_out: frozenset[str] = frozenset()
) -> Beginning:
    """A beginning of motion and forces, from a motion.

    Raises:
        numpy.linalg.LinAlgError: There is no body that balances it.
    """
    experiment, state = readings.experiment, begun.state
    parameters = state.parameters
    if parameters is None:
        parameters, state = first_bodies(readings, state, readings.looked_at(held_out))
    if not parameters[0] or not np.isfinite(parameters).all():
        raise np.linalg.LinAlgError
    size = plausible_radius(experiment.robot)
    task = replace(
        begun.task,
        active=(begun.task.calibration_parameters.deviation > 0)
        & ~untimed(experiment, begun.task.calibration_parameters, readings.segments),
        sizes=plausible(parameters, size),
        known=lambda at: _known_bodies(experiment, at, size),
    )
    state = replace(on_force_clock(experiment, state), parameters=parameters)
    return replace(begun, task=task, state=state)


def _known_bodies(experiment: Experiment, at: FitState, size: float) -> Sequence[KnownBody]:
    """What is known beforehand of all loads, about a state with bodies."""
    assert at.parameters is not None
    return known_bodies(experiment, at.calibration, at.parameters, size)


def _motion(
    task: Task,
    state: FitState,
    tell: Tell,
    *,
    beginning: bool,
) -> Beginning:
    """Motion alone; where its instruments do not agree on one, the errors are begun with as known
    beforehand.

    A motion that will be held takes up what its residuals ask for here: with the forces it is too
    late. One that is only a beginning does so with all readings together.
    """
    settings = task.settings
    task, state = with_jitter(task, state)
    tell("fitting the motion", 0.25)
    if not beginning:
        state = replace(state, segments=tuple(each.wandering for each in state.segments))
        state = with_stated(task, state)
    motion = fit(
        task,
        state,
        lambda part: tell("fitting the motion", 0.25 + 0.25 * part),
        beginning=beginning,
    )
    found, lost = motion.state, list[str]()
    if any(far >= settings.lost_samples for far in motion.tally.far.values()):
        found, lost = without_lost(
            task.experiment, found, arrived=motion.converged, settings=settings
        )
    if lost:
        motion = fit(task, found, beginning=beginning)
        found = motion.state
    off = np.abs(found.calibration.values - task.calibration_parameters.mean)[task.active]
    sound = bool(
        np.all(off < settings.far_off * task.calibration_parameters.deviation[task.active])
    )
    if not sound and not (beginning and motion.converged):
        found = replace(
            state,
            segments=tuple(
                replace(a, readings=b.readings)
                for a, b in zip(state.segments, found.segments, strict=True)
            ),
        )
        if not beginning:
            nothing = np.zeros_like(task.active)
            motion = fit(replace(task, active=nothing), found, beginning=beginning)
            found = motion.state
    elif not beginning:
        task, motion = _explained(task, motion)
        found = motion.state
    return Beginning(task, motion, found, lost)


def _explained(task: Task, motion: Fit) -> tuple[Task, Fit]:
    """The motion with what its residuals ask for; the very same where that is more than devices do,
    so that the verdict finds what contradicts, or is not determined.
    """
    try:
        tried, found = with_suspicions(*with_jitter_found(task, motion))
        found = with_disturbances(tried, found)
    except np.linalg.LinAlgError:
        return task, motion
    return (task, motion) if too_large(tried, found.state) else (tried, found)
