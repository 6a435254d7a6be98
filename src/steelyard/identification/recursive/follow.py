"""A recording taken as if it arrived while the robot moves: a beginning that is fitted as a whole,
then chunk by chunk.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from steelyard.errors import InputError
from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run
from steelyard.experiment.unread import without_constant_lengths
from steelyard.identification.model.balance import UNMODELLED_PARTS
from steelyard.identification.model.calibration_parameters import load_place
from steelyard.identification.model.motion_segment import Segment
from steelyard.identification.model.processes import Process, integrals_of
from steelyard.identification.recursive.arriving.arrivals import (
    Likeness,
    UnreadError,
    first_after,
    once_moving,
)
from steelyard.identification.recursive.events import advanced
from steelyard.identification.recursive.following import (
    LOST,
    Following,
    RunBeginning,
    at_beginning,
    silent,
)
from steelyard.identification.recursive.parts import counted_from
from steelyard.identification.recursive.recursion import Recursion
from steelyard.identification.recursive.settings import RECURSIVE, RecursiveSettings
from steelyard.identification.solve.beginning.begin import NoBalanceError
from steelyard.identification.solve.beginning.begin import begin as started
from steelyard.identification.solve.beginning.readings import Tell, read
from steelyard.identification.solve.border.segment_equations import segment_equations
from steelyard.identification.solve.fit_readings import fit_readings
from steelyard.identification.solve.fit_state import FitState, Task
from steelyard.identification.solve.fitted import Fitted
from steelyard.identification.solve.joint_fit import fit
from steelyard.identification.solve.long_recording import span_of
from steelyard.identification.solve.settings import FIT, FitSettings


def begin(
    experiment: Experiment,
    tell: Tell = lambda what, fraction: None,
    settings: FitSettings = FIT,
    own: RecursiveSettings = RECURSIVE,
) -> Following:
    """Fit the poses at rest and the beginning of the first run in motion as a whole.

    Args:
        experiment: With a run in motion, of which enough has arrived.
        tell: Is called with what is being done and the fraction that is done.
        settings: How to fit.
        own: How the recursion goes.

    Raises:
        InputError: The run lacks what the fit needs.
        NoBalanceError: Forces and motion cannot be fitted.
    """
    check_walk(experiment)
    settings = settings.with_looser_motion(own.looser)
    # How cables stretch is told by tensions of a motion that is there as a whole.
    experiment = without_constant_lengths(experiment)
    run = next(each for each in experiment.runs if not each.static)
    start, end = span_of(experiment, run)
    later = _since(experiment, run, -np.inf)
    if later is not None and span_of(experiment, later)[0] > start + own.chunk:
        run, (start, end) = later, span_of(experiment, later)
    length = own.begin
    while True:
        found, length = once_moving(
            lambda early: _begun(experiment, early, tell, settings, own),
            run,
            (start, end),
            length,
            own,
        )
        if found.begun.fit.converged or start + length >= end:
            break
        length *= own.longer
    return at_beginning(found, found.like)


def check_walk(experiment: Experiment) -> None:
    """Refuse a mass that walks between recordings: nothing tells how long that took.

    Raises:
        InputError: It does.
    """
    names = [f"'{each.name}'" for each in experiment.runs]
    if experiment.mass_walk and len(names) > 1:
        raise InputError(
            "known: mass: walk: expected one run, in motion, since the time from one to the next is"
            f" not recorded, found {', '.join(names)}; use one of them (--run)"
        )


def _begun(
    experiment: Experiment,
    early: Run,
    tell: Tell,
    settings: FitSettings,
    own: RecursiveSettings,
) -> Following:
    """Levels and values to begin with, from the poses at rest and the beginning of a run in motion.

    Raises:
        InputError: A run lacks what the fit needs.
        NoBalanceError: Forces and motion cannot be fitted.
    """
    at_rest = [each for each in experiment.runs if each.static]
    taken = read(experiment, None, tell, [*at_rest, early], settings)
    fitted = fit_readings(taken, started(taken, tell, thorough=False), tell)
    task, state = fitted.task, fitted.fit.state
    moving = [
        Likeness(segment, forces)
        for segment, forces in zip(state.segments, fitted.force_samples, strict=True)
        if not segment.static
    ]
    if not moving:
        raise NoBalanceError("; ".join(taken.notes))
    like = min(moving, key=lambda each: each.segment.spacing)
    recursion = Recursion.begun(task, state, own)
    names = [each.name for each in experiment.runs]
    parts = []
    for segment, forces in zip(state.segments, fitted.force_samples, strict=True):
        if segment.static:
            part = segment_equations(
                task, state, segment, forces, None, run=names.index(segment.run)
            )
            parts.append(counted_from(part, state.calibration.values))
            recursion = recursion.with_told(parts[-1].equations)
    return Following(
        experiment,
        fitted,
        like,
        taken.samples,
        recursion,
        np.zeros((0, like.segment.block)),
        parts=tuple(parts),
        closest=taken.records[-1].closest,
    )


def _beginning_of(found: Following, run: Run) -> RunBeginning | None:
    """The beginning of a further run, fitted by itself, where its clocks or what it carries are not
    yet known; None: they are, or it does not arrive.

    Args:
        found: After the runs before.
        run: With its motion.
    """
    experiment, settings = found.experiment, found.begun.task.settings
    entries = found.recursion.task.calibration_parameters.entries
    own = any(each.run == run.name and each.deviation.any() for each in entries)
    carried = {experiment.load_of(part.segment.run) for part in found.parts}
    if not own and experiment.load_of(run.name) in carried:
        return None
    span, recursion = span_of(experiment, run), found.recursion.settings

    def fitted_alone(early: Run) -> Fitted:
        taken = read(experiment, None, silent, [early], settings)
        return fit_readings(taken, started(taken, silent, thorough=False), silent)

    try:
        fitted, _ = once_moving(fitted_alone, run, span, recursion.begin, recursion)
    except (NoBalanceError, *LOST):
        return None
    state = fitted.fit.state
    if not fitted.fit.converged:
        return None
    segment = state.segments[0].disturbed(_processes_in(found, run.name, state.segments[0]))
    known = _with_its_own(found, run.name, state)
    try:
        return RunBeginning(known, _as_known(found.recursion.task, known, segment))
    except LOST:
        return None


def _as_known(task: Task, known: FitState, segment: Segment) -> Segment:
    """A motion as its own instruments show it with what is known of them: what the beginning of its
    run has made of their calibration is off by more than noise.

    Args:
        task: What is followed.
        known: Calibration and levels.
        segment: With the motion.

    Raises:
        numpy.linalg.LinAlgError: The motion is not determined.
        InfeasibleError: It is where cables cannot be.
    """
    held = replace(task, active=np.zeros_like(task.active), force_samples=(None,))
    alone = replace(known, segments=(segment,), parameters=None)
    return fit(held, alone, beginning=True, levels=False).state.segments[0]


def _with_its_own(found: Following, run: str, began: FitState) -> FitState:
    """What is known after the runs before, with what is a run's own as its beginning has it.

    Args:
        found: After the runs before.
        run: Name of the run.
        began: Its beginning.
    """
    experiment, state = found.experiment, found.recursion.state
    parameters, first = state.calibration.calibration_parameters, state.parameters
    values = state.calibration.values.copy()
    for (_, _, own), place in parameters.places.items():
        if own == run:
            values[place] = began.calibration.values[place]
    assert first is not None
    assert began.parameters is not None
    load = experiment.load_of(run)
    if load is not None and all(
        experiment.load_of(part.segment.run) is not load for part in found.parts
    ):
        body, carried = began.calibration.body(began.parameters, run), parameters.place_of_load(run)
        if carried is not None:
            values[carried] = body - first
        else:
            # All others are told by how much they are more than the first.
            for other in experiment.loads[1:]:
                values[load_place(parameters, other)] += first - body
            first = body
    calibration = replace(state.calibration, values=values)
    return replace(state, parameters=first, calibration=calibration)


def _processes_in(found: Following, run: str, began: Segment) -> tuple[Process, ...]:
    """Disturbances of a run: those that go on, and what moves in its load.

    Args:
        found: After the runs before.
        run: Name of the run.
        began: Its beginning.
    """
    before, experiment = found.like.segment, found.experiment
    moved, moves = (experiment.moves_within(each) for each in (before.run, run))
    own = integrals_of(began.knots)
    kept = [
        replace(each, integrals=own)
        for each in before.processes
        if not (moved and each.source in UNMODELLED_PARTS)
    ]
    taken = {each.source for each in kept}
    further = began.processes if moves else ()
    return (*kept, *(p for p in further if p.source in UNMODELLED_PARTS.keys() - taken))


def follow(
    experiment: Experiment,
    tell: Tell = lambda what, fraction: None,
    settings: FitSettings = FIT,
    own: RecursiveSettings = RECURSIVE,
) -> Iterator[Following]:
    """A whole recording, chunk by chunk; the last is after all motions have ended.

    Args:
        experiment: With a run in motion.
        tell: Is called with what is being done and the fraction that is done.
        settings: How to fit.
        own: How the recursion goes.

    Raises:
        InputError: A run lacks what the fit needs.
        NoBalanceError: Forces and motion cannot be fitted.
    """
    experiment = without_constant_lengths(experiment)
    moving = [each for each in experiment.runs if not each.static]
    found = begin(experiment, tell, settings, own)
    for i, run in enumerate(moving):
        if i:
            tell(f"beginning of {run.name}", 0.4 + 0.5 * i / len(moving))
            found = found.resumed(run, _beginning_of(found, run))
        _, end = span_of(experiment, run)
        while found.window.grid.span(found.number)[0] < end:
            found = _gone_on(found, run)
            if found.recursion.window is None:
                break
            done = found.window.grid.span(found.number)[0] / max(end, 1e-9)
            tell(f"following {run.name}", 0.4 + 0.5 * (i + min(1.0, done)) / len(moving))
            yield found
        found = found.ended()
    yield found


def _gone_on(found: Following, run: Run) -> Following:
    """With the next chunk, or the motion again behind one that tells nothing; ended where there is
    none.

    Args:
        found: Up to there.
        run: With all of its readings.

    Raises:
        NoBalanceError: It cannot be followed, and little was before.
    """
    since, until = found.window.grid.span(found.number)
    try:
        return advanced(found, run)
    except UnreadError:
        ended, why, lost = found.ended(), "not all instruments read", None
    except LOST as error:
        ended, why, lost = found.lost(), "the motion could not be followed", error
    resumed = _behind(ended, run, until)
    if resumed is not None:
        later, start = resumed
        note = f"run '{run.name}': nothing is told of {since:.1f} to {start:.1f} s, where {why}"
        return later.remarked(note)
    if lost is None:
        # A run may end where one of its streams does.
        return ended
    if not ended.is_followed:
        raise NoBalanceError(
            f"run '{run.name}': the motion was lost at {since:.1f} s, where what was read does not"
            " go on from before; use maximum-likelihood, which takes a recording as a whole"
        ) from lost
    return ended.remarked(f"run '{run.name}': nothing is told from {since:.1f} s on, where {why}")


def _behind(ended: Following, run: Run, since: float) -> tuple[Following, float] | None:
    """The motion again from where all instruments that read again do, and when that is [s]; None:
    it ends where they no longer read.

    Args:
        ended: Up to there.
        run: With all of its readings.
        since: Time from which on to look [s].
    """
    while (later := _since(ended.experiment, run, since)) is not None:
        start, end = span_of(ended.experiment, later)
        try:
            return ended.resumed(later), start
        except (InputError, NoBalanceError, np.linalg.LinAlgError):
            since = start + ended.recursion.settings.begin
            if since >= end:
                break
    return None


def _since(experiment: Experiment, run: Run, since: float) -> Run | None:
    """A run from where all instruments read that read again; None: forces or motion do not.

    Args:
        experiment: With the clocks.
        run: With all of its readings.
        since: Time from which on to look [s].
    """
    times = {name: experiment.common_time(run, name) for name in run.streams}
    first = first_after(times, since)
    # A command is not waited for where the motion is measured.
    measured = [name for name in first if not experiment.instruments[name].commanded]
    first = {name: first[name] for name in measured} if len(measured) > 1 else first
    force = experiment.force_instrument(run)
    if force not in first or len(first) == 1:
        return None
    start = max(first.values())
    streams = {
        name: run.streams[name].at_rows(slice(int(np.searchsorted(each, start)), None))
        for name, each in times.items()
    }
    streams = {name: each for name, each in streams.items() if len(each)}
    return replace(run, streams=streams, sync=experiment.event_times(run))
