"""Parts of long recordings: the lively one that tells calibration, noise and smoothness, and
windows that a fit has the memory for, about these.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from steelyard.arrays import Array
from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import BESIDE, Run
from steelyard.identification.model.motion_segment import Segment
from steelyard.identification.model.processes import integrals_of
from steelyard.identification.model.sources import Source, choose_sources
from steelyard.identification.solve.beginning.first_body import on_force_clock
from steelyard.identification.solve.beginning.motion_task import motion_task
from steelyard.identification.solve.beginning.readings import Readings, read
from steelyard.identification.solve.fit_state import FitState, Task, linearise, smooth
from steelyard.identification.solve.fitted import Fitted, FittedStretch, handed_on
from steelyard.identification.solve.misfits.jitter import with_jitter
from steelyard.identification.solve.newton_step import step_of
from steelyard.identification.solve.settings import FIT, FitSettings
from steelyard.identification.solve.shared_windows import Attempt
from steelyard.processes.heap import give_back


def moving_length(experiment: Experiment) -> float:
    """Length of all runs in motion [s]."""
    spans = [span_of(experiment, run) for run in experiment.runs if not run.static]
    return sum(end - start for start, end in spans)


def lively_parts(experiment: Experiment, length: float, settings: FitSettings = FIT) -> Experiment:
    """The experiment with the stretch of every run where most happens.

    Args:
        experiment: With all of its runs.
        length: Of all stretches in motion together [s].
        settings: With the least length of a stretch.
    """
    moving = sum(not run.static for run in experiment.runs)
    longest = max(settings.shortest_part, length / max(1, moving))
    runs = [
        run if run.static else _stretch(experiment, run, longest, settings)
        for run in experiment.runs
    ]
    return replace(experiment, runs=tuple(runs))


def windows(experiment: Experiment, settings: FitSettings = FIT) -> Iterator[Run]:
    """The runs, cut into windows of about a minute."""
    for run in experiment.runs:
        if run.static:
            yield run
            continue
        start, end = span_of(experiment, run)
        edges = np.linspace(start, end, max(1, round((end - start) / settings.window)) + 1)
        for first, last in pairwise(edges):
            yield _within(experiment, run, float(first), float(last))


def _within(experiment: Experiment, run: Run, first: float, last: float) -> Run:
    """A window of a run, with what of its streams is read of one: what looks at a whole stream, as
    for jumps, would look at all of it again for each.
    """
    streams = {}
    for name, stream in run.streams.items():
        time = experiment.common_time(run, name)
        own = slice(
            int(np.searchsorted(time, first - BESIDE)),
            int(np.searchsorted(time, last + BESIDE, side="right")),
        )
        if own.start < own.stop:
            streams[name] = stream.at_rows(own)
    return replace(run, streams=streams, sync=experiment.event_times(run), window=(first, last))


def fitted_windows(
    runs: Sequence[Run], attempted: Iterator[Attempt], tell: Callable[[float], None]
) -> list[FittedStretch]:
    """All windows that tell a motion; of the others the last one has a note: an hour is not lost
    for a minute without a tracker, or one in which the platform rests.

    Args:
        runs: Windows of a long recording, of which a part has been fitted.
        attempted: What each of them tells, or why it does not.
        tell: Is told the fraction that is done.

    Raises:
        InputError: None tells a motion.
        numpy.linalg.LinAlgError: Likewise.
    """
    found: list[FittedStretch] = []
    left_out: list[Run] = []
    why: Exception | None = None
    for i, window in enumerate(runs):
        tell(i / len(runs))
        attempt = next(attempted)
        if isinstance(attempt, Exception):
            if window.static:
                raise attempt
            why = attempt
        own = () if isinstance(attempt, Exception) else attempt
        if not own:
            left_out.append(window)
        for chunk in own:
            if found:
                found[-1], chunk = handed_on(found[-1], chunk)
            found.append(chunk)
    if not found:
        raise why or np.linalg.LinAlgError
    fitted = found[-1].fitted
    fitted = replace(fitted, lost=(*fitted.lost, *_notes_of(left_out)))
    found[-1] = replace(found[-1], fitted=fitted)
    give_back()
    return found


def _notes_of(left_out: Sequence[Run]) -> Iterator[str]:
    """Notes of windows that tell no motion, those that follow each other in one."""
    ends: list[tuple[str, float, float]] = []
    for window in left_out:
        if window.window is None:
            continue
        start, end = window.window
        if ends and ends[-1][0] == window.name and ends[-1][2] == start:
            start = ends.pop()[1]
        ends.append((window.name, start, end))
    for run, start, end in ends:
        yield (
            f"run '{run}': {start:.0f} to {end:.0f} s are left out, where not all streams that are"
            " needed have data or nothing moves"
        )


def window_about(
    part: Fitted, experiment: Experiment, run: Run
) -> tuple[Readings, FitState] | None:
    """A window with its motion as the motion instruments alone give it, about calibration, noise
    and smoothness of a part, in the time of the forces; None: it has no segment.
    """
    known = part.fit.state
    readings = read(
        experiment, known.calibration, lambda what, fraction: None, [run], part.task.settings
    )
    if not readings.segments:
        return None
    like = next((each for each in known.segments if not each.static), None)
    segments = tuple(
        segment if segment.static or like is None else _alike(segment, like)
        for segment in readings.segments
    )
    task = replace(
        motion_task(readings), experiment=experiment, active=np.zeros_like(part.task.active)
    )
    state = FitState(segments, known.calibration, None, known.factors, known.jitters)
    state = _motion_about(*with_jitter(task, state))
    return readings, replace(on_force_clock(experiment, state), parameters=known.parameters)


def _alike(segment: Segment, like: Segment) -> Segment:
    """A segment as smooth as another, with the same disturbances."""
    integrals = integrals_of(segment.knots)
    processes = tuple(replace(each, integrals=integrals) for each in like.processes)
    return replace(segment, smoothness=like.smoothness).disturbed(processes)


def _motion_about(task: Task, state: FitState) -> FitState:
    """The motion with the calibration held."""
    for _ in range(task.settings.stretch_iterations):
        parts, _tally = linearise(task, state)
        step = step_of(task, state, smooth(state, [each.all for each in parts]))
        state = step.along(task, state, 1.0)
        if step.decrement < task.settings.beginning_arrived:
            break
    return state


def span_of(experiment: Experiment, run: Run) -> tuple[float, float]:
    """Beginning and end of the forces of a run in common time, within its window [s]."""
    name = experiment.force_instrument(run)
    if name is None:
        return 0.0, 0.0
    time = experiment.common_time(run, name)
    start, end = run.window or (float(time[0]), float(time[-1]))
    return max(start, float(time[0])), min(end, float(time[-1]))


def _stretch(experiment: Experiment, run: Run, longest: float, settings: FitSettings) -> Run:
    """The most lively stretch of a run, as its first turning instrument shows it, of those in which
    the instruments that are needed have about as many readings as anywhere.
    """
    sources = choose_sources(experiment, run, None)
    name, quantity = sources.omega or sources.rotation or sources.used()[0]
    time, values = experiment.common_time(run, name), run.streams[name].values[quantity]
    start, end = run.window or (float(time[0]), float(time[-1]))
    start, end = max(start, float(time[0])), min(end, float(time[-1]))
    if end - start <= 1.5 * longest:
        return run
    # Means over tenths of the stretch: what is lively scatters about them.
    edges = np.arange(start, end, longest / 10)
    edges = edges[edges + longest <= end]
    flat = np.nan_to_num(values.reshape(len(values), -1))
    square = np.concatenate([[0.0], np.cumsum(np.sum((flat - flat.mean(axis=0)) ** 2, axis=1))])
    lively = np.diff(square[np.searchsorted(time, [edges, edges + longest])], axis=0)[0]
    forces = [(sources.force, each) for each in run.streams[sources.force].values]
    read = _least_read(experiment, run, [*sources.used(), *forces], edges, longest)
    lively[read < settings.well_read * read.max()] = -1.0
    best = edges[int(np.argmax(lively))]
    return replace(run, window=(float(best), float(best) + longest))


def _least_read(
    experiment: Experiment, run: Run, sources: Sequence[Source], starts: Array, length: float
) -> Array:
    """Share of the readings of some seconds that are there, of the quantity of which least are,
    shape (s,).

    Args:
        experiment: With the clocks.
        run: One of its runs.
        sources: Quantities that are needed.
        starts: Of stretches in common time [s], shape (s,).
        length: Of each [s].
    """
    shares = []
    for name, quantity in sources:
        time, values = experiment.common_time(run, name), run.streams[name].values[quantity]
        there = np.isfinite(values.reshape(len(values), -1)).any(axis=1)
        count = np.diff(np.searchsorted(time[there], [starts, starts + length]), axis=0)[0]
        shares.append(count / max(count.max(), 1))
    return np.asarray(np.min(shares, axis=0))
