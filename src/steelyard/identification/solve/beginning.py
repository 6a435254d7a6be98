"""Where a fit begins: segments of all runs, the motion as its instruments alone give it, a first
body.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.dynamics import platform_regressor
from steelyard.estimates.estimate import plausible_radius
from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run
from steelyard.experiment.unread import is_unread
from steelyard.identification.known_body import KnownBody, known_bodies, plausible
from steelyard.identification.model.balance import Forces, balance_of, parts_of
from steelyard.identification.model.calibration_parameters import (
    ROBOT,
    CalibrationParameters,
    CalibrationValues,
    clock_of,
    gather,
)
from steelyard.identification.model.force_residuals import sample_weight
from steelyard.identification.model.motion_residuals import reference_clocks, time_of
from steelyard.identification.model.motion_segment import AT_REST, Segment
from steelyard.identification.model.sources import Source
from steelyard.identification.samples.first_motion import (
    FirstMotion,
    first_motion,
    lacks_pose,
    turns_are_told,
    with_first_motion,
)
from steelyard.identification.samples.preparation import Samples, prepare, with_every_cable
from steelyard.identification.samples.segmentation import Recorded, recorded
from steelyard.identification.solve.fit_state import Fit, FitState, Task
from steelyard.identification.solve.joint_fit import fit
from steelyard.identification.solve.misfits.disturbances import too_large, with_disturbances
from steelyard.identification.solve.misfits.jitter import with_jitter, with_jitter_found
from steelyard.identification.solve.misfits.lost_readings import without_lost
from steelyard.identification.solve.misfits.slack_cables import SlackCables
from steelyard.identification.solve.misfits.suspicions import with_suspicions
from steelyard.identification.solve.settings import FIT, FitSettings
from steelyard.identification.solve.stated_processes import with_stated
from steelyard.inertia import TEN

Tell = Callable[[str, float], None]


class NoBalanceError(ArithmeticError):
    """Forces and motion cannot be balanced, so that there is no estimate."""


@dataclass(frozen=True, eq=False)
class Readings:
    """The runs of an experiment, cut into segments."""

    experiment: Experiment
    calibration: CalibrationValues
    """Values to begin with."""
    runs: tuple[Run, ...]
    """That were looked at."""
    samples: tuple[Samples, ...]
    """Of all runs."""
    records: tuple[Recorded, ...]
    """Of all runs."""
    settings: FitSettings = FIT

    @property
    def segments(self) -> tuple[Segment, ...]:
        """Of all runs, one after the other."""
        return tuple(segment for each in self.records for segment in each.segments)

    @property
    def force_samples(self) -> tuple[Forces, ...]:
        """Of each segment."""
        return tuple(forces for each in self.records for forces in each.force_samples)

    def looked_at(self, held_out: frozenset[str]) -> tuple[Forces | None, ...]:
        """Forces of each segment; None of runs that are held out."""
        return tuple(
            None if segment.run in held_out else forces
            for segment, forces in zip(self.segments, self.force_samples, strict=True)
        )

    @property
    def louder(self) -> dict[Source, float]:
        """Quantity -> by how much it scatters more than stated, to begin with."""
        found: dict[Source, float] = {}
        for each in self.records:
            for source, factor in each.louder.items():
                found[source] = max(found.get(source, 1.0), factor)
        return found

    @property
    def notes(self) -> list[str]:
        """What a reader should know of them."""
        return [note for each in self.records for note in each.notes]


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


def read(
    experiment: Experiment,
    start: CalibrationValues | None,
    tell: Tell,
    runs: Sequence[Run] | None = None,
    settings: FitSettings = FIT,
) -> Readings:
    """Cut the runs of an experiment into segments.

    Args:
        experiment: With at least one run.
        start: Values of the calibration parameters to begin with; None: as known beforehand.
        tell: Is called with what is being done and the fraction that is done.
        runs: Those to look at, or parts of them; None: all.
        settings: How to fit.

    Raises:
        InputError: A run lacks what the fit needs.
    """
    parameters = gather(experiment)
    runs = experiment.runs if runs is None else runs
    begun = {
        run.name: found
        for run in (with_every_cable(experiment, each) for each in runs)
        if lacks_pose(experiment, run)
        and turns_are_told(experiment, run)
        and (found := first_motion(experiment, run)) is not None
    }
    calibration = start or _first_values(parameters, begun)
    samples = []
    for i, run in enumerate(runs):
        tell(f"reading {run.name}", 0.2 * i / len(runs))
        poses = begun.get(run.name)
        samples.append(
            prepare(
                *(
                    (experiment, run)
                    if poses is None
                    else with_first_motion(experiment, run, poses)
                ),
                thin=True,
                calibration=calibration,
                commanded=True,
                settings=settings.motion.preparation,
            )
        )
    records = tuple(
        recorded(experiment, run, each, calibration, settings=settings.motion)
        for run, each in zip(runs, samples, strict=True)
    )
    return Readings(experiment, calibration, tuple(runs), tuple(samples), records, settings)


def _first_values(
    parameters: CalibrationParameters, begun: Mapping[str, FirstMotion]
) -> CalibrationValues:
    """What is known beforehand, and the offsets of lengths that nothing else tells a pose from."""
    values = parameters.mean.copy()
    for run, found in begun.items():
        for name, offset in found.offsets.items():
            values[parameters.place(name, "offset", run)] = offset
    return CalibrationValues(parameters, values)


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


def motion_task(readings: Readings) -> Task:
    """The fit of the motion to its instruments alone."""
    experiment, segments = readings.experiment, readings.segments
    parameters = readings.calibration.calibration_parameters
    least = {
        (name, quantity + rest): value
        for each in readings.records
        for (name, quantity), value in each.least.items()
        for rest in ("", AT_REST)
    }
    return Task(
        experiment,
        parameters,
        (None,) * len(segments),
        read_by(experiment, parameters, segments),
        stated_noise(experiment),
        plausible(np.ones(TEN), plausible_radius(experiment.robot)),
        least=least,
        settings=readings.settings,
    )


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
        parameters, state = _first_bodies(readings, state, readings.looked_at(held_out))
    if not parameters[0] or not np.isfinite(parameters).all():
        raise np.linalg.LinAlgError
    size = plausible_radius(experiment.robot)
    task = replace(
        begun.task,
        active=(begun.task.calibration_parameters.deviation > 0)
        & ~_untimed(experiment, begun.task.calibration_parameters, readings.segments),
        sizes=plausible(parameters, size),
        known=lambda at: _known_bodies(experiment, at, size),
    )
    state = replace(on_force_clock(experiment, state), parameters=parameters)
    return replace(begun, task=task, state=state)


def _known_bodies(experiment: Experiment, at: FitState, size: float) -> Sequence[KnownBody]:
    """What is known beforehand of all loads, about a state with bodies."""
    assert at.parameters is not None
    return known_bodies(experiment, at.calibration, at.parameters, size)


def _first_bodies(
    readings: Readings, state: FitState, force_samples: Sequence[Forces | None]
) -> tuple[Array, FitState]:
    """The ten linear parameters of the first load, and a state with what further ones are more."""
    experiment, settings = readings.experiment, readings.settings
    parameters = state.calibration.calibration_parameters
    values = state.calibration.values.copy()
    found: list[tuple[slice | None, Array | None]] = []
    for load in experiment.loads or (None,):
        own = [
            forces if experiment.load_of(segment.run) is load else None
            for segment, forces in zip(state.segments, force_samples, strict=True)
        ]
        known = experiment.known if load is None else load.known
        runs = [run.name for run in experiment.runs if experiment.load_of(run.name) is load]
        place = parameters.place_of_load(runs[0]) if runs else None
        there = any(each is not None for each in own)
        found.append(
            (place, first_body(experiment, state, own, known, settings) if there else None)
        )
    first = next(body for _, body in found if body is not None)
    first = first if found[0][1] is None else found[0][1]
    for place, body in found:
        if place is not None and body is not None:
            values[place] = body - first
    return first, replace(state, calibration=replace(state.calibration, values=values))


def on_force_clock(experiment: Experiment, state: FitState) -> FitState:
    """The same motion, told in the time of the forces."""
    segments = tuple(
        _by_force_clock(experiment, segment, state.calibration) for segment in state.segments
    )
    return replace(state, segments=segments)


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


def read_by(
    experiment: Experiment,
    calibration_parameters: CalibrationParameters,
    segments: Sequence[Segment],
) -> NDArray[np.bool_]:
    """Calibration parameters that act on the readings of the motion and are not known exactly, shape
    (u,).

    Args:
        experiment: With its instruments.
        calibration_parameters: All there are.
        segments: With the readings.
    """
    active = np.zeros(len(calibration_parameters), dtype=bool)
    for segment in segments:
        for reading in segment.readings:
            name = reading.source[0]
            if experiment.instruments[name].is_cable_motion:
                for key in ("anchor", "attachment"):
                    active[calibration_parameters.places[ROBOT, key, None]] = True
            for term in experiment.instruments[name].terms(calibration_parameters.m):
                active[calibration_parameters.place(name, term.key, segment.run)] = True
            if not segment.static:
                active[
                    calibration_parameters.place(clock_of(experiment, name), "delay", segment.run)
                ] = True
                if latency := calibration_parameters.place_of_latency(name):
                    active[latency] = True
    active[calibration_parameters.places[ROBOT, "gravity", None]] = True
    untimed = _untimed(experiment, calibration_parameters, segments)
    return active & (calibration_parameters.deviation > 0) & ~untimed


def _untimed(
    experiment: Experiment,
    calibration_parameters: CalibrationParameters,
    segments: Sequence[Segment],
) -> NDArray[np.bool_]:
    """Delays of clocks by which nothing moves, as that of the encoders of locked winches, shape (u,):
    no reading tells them, and what is left of the readings would be taken for a delay.
    """
    timed: dict[tuple[str, str], bool] = {}
    for segment in segments:
        if segment.static:
            continue
        run = next(each for each in experiment.runs if each.name == segment.run)
        force = experiment.force_instrument(run)
        if force is not None:
            timed[segment.run, clock_of(experiment, force)] = True
        for reading in segment.readings:
            place = segment.run, clock_of(experiment, reading.source[0])
            timed[place] = timed.get(place, False) or not reading.still
    found = np.zeros(len(calibration_parameters), dtype=bool)
    for (name, clock), moves in timed.items():
        if not moves:
            found[calibration_parameters.place(clock, "delay", name)] = True
    return found


def stated_noise(experiment: Experiment) -> frozenset[Source]:
    """Quantities whose noise is stated; that of a command that stands in for a measurement is no
    noise, and is not asked for either.

    Args:
        experiment: With its instruments.
    """
    return frozenset(
        (name, quantity.name + rest)
        for rest in ("", AT_REST)
        for name, instrument in experiment.instruments.items()
        for quantity in instrument.quantities(experiment.robot.m)
        if quantity.noise or instrument.commanded
    )


def first_body(
    experiment: Experiment,
    state: FitState,
    force_samples: Sequence[Forces | None],
    known: Mapping[str, tuple[float, float]],
    settings: FitSettings,
) -> Array:
    """The ten linear parameters that balance forces and a given motion, samples that stand far
    counting less.

    Args:
        experiment: With its robot.
        state: With motion and calibration.
        force_samples: Of each segment; None: not looked at.
        known: Body parameter -> value and 1-sigma beforehand.
        settings: How often to weigh the samples anew.
    """
    parameters = np.zeros(TEN)
    for _ in range(settings.first_body_iterations):
        normal, right = np.zeros((TEN, TEN)), np.zeros(TEN)
        parts = (
            (segment, part)
            for segment, forces in zip(state.segments, force_samples, strict=True)
            if forces is not None
            for part in parts_of(experiment, segment, forces, state.calibration)
        )
        for segment, forces in parts:
            at = balance_of(
                experiment, segment, forces, state.calibration, parameters, state.factors
            )
            regressor = platform_regressor(
                at.motion["specific_force"], at.motion["omega"], at.motion["alpha"]
            )
            residual = at.residual
            weight = sample_weight(residual) * ~forces.touched
            A = -at.whitener @ regressor
            normal += np.einsum("nki,n,nkj->ij", A, weight, A, optimize=True)
            right += np.einsum(
                "nki,n,nk->i",
                A,
                weight,
                np.einsum("nki,i->nk", A, parameters) - residual,
                optimize=True,
            )
        if "mass" in known:
            # Without forces it is all that tells how large the body is.
            mass, sigma = known["mass"]
            weight_of_mass = max(sigma, 1e-3 * mass) ** -2
            normal[0, 0] += weight_of_mass
            right[0] += weight_of_mass * mass
        scale = 1 / np.sqrt(np.maximum(np.diag(normal), 1e-300))
        solution, *_ = np.linalg.lstsq(normal * np.outer(scale, scale), scale * right, rcond=1e-9)
        parameters = scale * solution
        if is_unread(experiment) and parameters[0]:
            # It is told in multiples of the mass.
            parameters = parameters * (known["mass"][0] / parameters[0])
    return np.asarray(parameters)


def _by_force_clock(
    experiment: Experiment, segment: Segment, calibration: CalibrationValues
) -> Segment:
    """The same motion, told in the time of the forces."""
    if segment.static:
        return segment
    calibration_parameters = calibration.calibration_parameters
    name = experiment.force_instrument(
        next(run for run in experiment.runs if run.name == segment.run)
    )
    assert name is not None
    nothing = np.zeros(1)
    (there,), *_ = time_of(
        experiment,
        segment,
        calibration,
        reference_clocks(experiment, calibration_parameters, segment),
        name,
        nothing,
    )
    told = replace(segment, reference=clock_of(experiment, name))
    (here,), *_ = time_of(experiment, told, calibration, {}, name, nothing)
    return replace(told, knots=segment.knots + (here - there))
