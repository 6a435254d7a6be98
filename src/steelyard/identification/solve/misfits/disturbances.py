"""Disturbances that nothing explains: coloured noise of an instrument, an unmodelled wrench on the
platform.

Residuals of a fit that follow each other ask for a process beside the motion. The instrument that
asks for it most is tried first, together with the wrench on the platform where that asks too: one
pulls the motion to where the other is wrong. What the marginal likelihood wants stays, and what the
others still ask for is looked at again. Where nothing is asked for, nothing changes.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from steelyard.arrays import Array
from steelyard.estimates.quantiles import normal_quantile
from steelyard.identification.model.balance import (
    UNMODELLED,
    UNMODELLED_PARTS,
    Forces,
)
from steelyard.identification.model.calibration_parameters import ROBOT
from steelyard.identification.model.motion_segment import Segment
from steelyard.identification.model.process_levels import (
    ProcessLevel,
    ProcessLevels,
    likeliest,
    on_levels,
)
from steelyard.identification.model.processes import Process, integrals_of
from steelyard.identification.model.sources import Source
from steelyard.identification.solve.fit_state import Fit, FitState, Task, linearise
from steelyard.identification.solve.joint_fit import fit
from steelyard.identification.solve.misfits.colours import Colour, colours
from steelyard.identification.solve.newton_step import border_prior
from steelyard.identification.solve.settings import FitSettings
from steelyard.identification.solve.stated_processes import denied, size_of


def with_disturbances(
    task: Task,
    found: Fit,
    tell: Callable[[float], None] = lambda fraction: None,
    *,
    anew: bool = False,
) -> Fit:
    """A fit with the processes that its residuals ask for.

    Args:
        task: What has been fitted.
        found: How.
        tell: Is called with the fraction that is done, roughly.
        anew: Whether levels that are there already are looked at again, since the readings are
            others.

    Raises:
        numpy.linalg.LinAlgError: The motion is not determined.
    """
    refused: set[Source] = set(denied(task.experiment))
    first = found
    processes = [each for segment in found.state.segments for each in segment.processes]
    free = [each for each in processes if not (each.level_stated and each.time_stated)]
    if free and (anew or any(each.is_stated for each in free)):
        # What is stated in part: the rest by the readings.
        found = _settled(task, found.state) or found
    for i in range(task.settings.most_processes):
        present = _processes_of(found.state)
        found_colours = colours(task, found.state)
        asked = {
            source: colour
            for source, colour in found_colours.items()
            if colour.score > task.settings.coloured and source not in present | refused
        }
        if not asked:
            break
        tell(i / task.settings.most_processes)
        tried = _tried(task, found.state, asked, found_colours, present)
        settled = _settled(task, tried)
        found = found if settled is None else settled
        refused |= _processes_of(tried) - _processes_of(found.state)
    return found if found is first else fit(task, found.state)


def _tried(
    task: Task,
    state: FitState,
    asked: Mapping[Source, Colour],
    known: Mapping[Source, Colour],
    present: Collection[Source],
) -> FitState:
    """With what is tried next: of the instruments the one with the largest score, and the wrench.

    Where two instruments tell the same part of the pose, the residuals are those of the worse one,
    whichever is wrong: the marginal likelihood decides between them. So it does between a wrench
    and noise of the tensions.
    """
    # Force and torque come together: an arm turns one into the other.
    pulls = _of_pulls(task, asked, known, present)
    instruments = sorted(
        (each for each in asked if _is_of_motion(task, each)), key=lambda each: -asked[each].score
    )
    choices: list[dict[Source, Colour]] = [{}]
    if instruments:
        most = instruments[0]
        parts, choices = _parts(task, most), []
        for each in known:
            if each in present or not _is_of_motion(task, each):
                continue
            if not parts & _parts(task, each):
                continue
            own = known[each]
            if own.score < task.settings.coloured:
                own = own._replace(
                    level=_same(task, state, most, each, known), time=known[most].time
                )
            choices.append({each: own})
    if len(choices) * len(pulls) == 1:
        return _with(task, state, {**choices[0], **pulls[0]})
    # First which instrument, then which pull beside it: not each with each.
    best = max(
        (_on_likeliest(task, state, {**each, **pulls[0]}) for each in choices), key=_evidence
    )
    chosen = {source: best.sources[source] for source in best.sources if source not in pulls[0]}
    others = (_on_likeliest(task, state, {**chosen, **pull}) for pull in pulls[1:])
    return max((best, *others), key=_evidence).state


class _TriedProcesses(NamedTuple):
    """Processes on their likeliest levels."""

    sources: Mapping[Source, Colour]
    state: FitState
    evidence: float


def _evidence(trial: _TriedProcesses) -> float:
    return trial.evidence


def _on_likeliest(task: Task, state: FitState, sources: Mapping[Source, Colour]) -> _TriedProcesses:
    """A state with these processes more, all on their likeliest levels."""
    state = _with(task, state, sources)
    levels = _levels(task, state)
    return _TriedProcesses(sources, _on_levels(state, levels.of), levels.evidence)


def _of_pulls(
    task: Task,
    asked: Mapping[Source, Colour],
    known: Mapping[Source, Colour],
    present: Collection[Source],
) -> list[dict[Source, Colour]]:
    """What the balance asks for: a wrench on the platform, or noise of the tensions, of which the
    cables make one; nothing where neither is asked for.
    """
    tensions = [
        each for each in known if each not in UNMODELLED_PARTS and not _is_of_motion(task, each)
    ]
    found = []
    if asked.keys() & UNMODELLED_PARTS.keys():
        found.append({source: known[source] for source in UNMODELLED_PARTS})
    found += [{each: asked[each]} for each in tensions if each in asked]
    return found or [{}]


def _is_of_motion(task: Task, source: Source) -> bool:
    """Whether a quantity is read of the motion: neither of forces nor an unmodelled wrench."""
    return source not in UNMODELLED_PARTS and not task.experiment.instruments[source[0]].is_force


def _same(
    task: Task, state: FitState, one: Source, other: Source, known: Mapping[Source, Colour]
) -> float:
    """Level of one quantity in units of the noise of another one; 1 where they are not alike."""
    units, sigmas = set(), []
    for source in (one, other):
        quantity = task.experiment.instruments[source[0]].quantity(
            source[1], task.experiment.robot.m
        )
        units.add(quantity.unit)
        sigmas += [
            reading.sigma * state.factors.get(source, 1.0)
            for segment in state.segments
            for reading in segment.readings
            if reading.source == source
        ][:1]
    if len(units) > 1 or len(sigmas) < len((one, other)):
        return 1.0
    return known[one].level * sigmas[0] / sigmas[1]


def _parts(task: Task, source: Source) -> frozenset[str]:
    """Parts of the pose that readings tell."""
    instrument = task.experiment.instruments[source[0]]
    return frozenset(instrument.quantity(source[1], task.experiment.robot.m).determines)


def as_noise(
    segment: Segment, forces: Forces, times: Array, factors: Mapping[Source, float]
) -> tuple[Segment, Forces]:
    """A segment and its forces with the unmodelled wrench as white noise of its usual size.

    What touches the platform for a moment stands out of it; the process would follow it, and its
    level with it.

    Args:
        segment: With its processes.
        forces: Within it.
        times: Of the force samples within the segment [s], shape (n,).
        factors: Quantity -> by how much its noise exceeds what the readings say.
    """
    parts = [each for each in segment.processes if each.source in UNMODELLED_PARTS]
    if not parts:
        return segment, forces
    square = forces.unmodelled_sigma(segment, factors) ** 2
    local = segment.basis(times)
    for each in parts:
        usual = np.median(np.abs(segment.disturbance(each, local, 0))) / normal_quantile(0.75)
        square[UNMODELLED_PARTS[each.source]] += usual**2
    factor = factors.get(segment.label(ROBOT, UNMODELLED), 1.0)
    others = tuple(each for each in segment.processes if each not in parts)
    return segment.disturbed(others), replace(
        forces, unmodelled=np.sqrt(square) / factor, everywhere=True
    )


def _with(task: Task, state: FitState, sources: Mapping[Source, Colour]) -> FitState:
    """A state with these processes more."""
    segments = []
    for segment, forces in zip(state.segments, task.force_samples, strict=True):
        new = _processes(task, state, segment, forces, sources)
        segments.append(segment.disturbed((*segment.processes, *new)) if new else segment)
    return replace(state, segments=tuple(segments))


def _processes(
    task: Task,
    state: FitState,
    segment: Segment,
    forces: Forces | None,
    sources: Mapping[Source, Colour],
) -> list[Process]:
    """Processes to begin with, of what is in a segment; poses at rest have none."""
    if segment.static:
        return []
    integrals, found = integrals_of(segment.knots), []
    for source, colour in sources.items():
        sizes = size_of(task, state, segment, forces, source)
        if sizes is not None:
            # Of a wrench in its own units, of readings in those of their noise.
            unit = sizes[0] if source in UNMODELLED_PARTS else 1.0
            level = max(colour.level / unit, task.settings.motion.least_level)
            found.append(Process(source, sizes, level, colour.time, integrals))
    return found


def _settled(task: Task, state: FitState) -> Fit | None:
    """Motion, body and levels in turn; None: no process is asked for."""
    settings = task.settings
    last: Mapping[Source, ProcessLevel] = {}
    found: Fit | None = None
    for _ in range(settings.level_fits):
        levels = _levels(task, state).of
        while unwanted := _least_wanted(levels, settings):
            state = _without(state, unwanted)
            levels = _levels(task, state).of
        if not levels:
            return None
        found = fit(task, _on_levels(state, levels), beginning=True)
        state = found.state
        if levels.keys() == last.keys() and all(
            abs(np.log(each.level / last[source].level)) < settings.level_settled
            for source, each in levels.items()
        ):
            break
        last = levels
    return found


def _processes_of(state: FitState) -> set[Source]:
    return {each.source for segment in state.segments for each in segment.processes}


def _on_levels(state: FitState, levels: Mapping[Source, ProcessLevel]) -> FitState:
    return replace(state, segments=tuple(on_levels(each, levels) for each in state.segments))


def _levels(task: Task, state: FitState) -> ProcessLevels:
    parts, _ = linearise(task, state)
    return likeliest(
        state.segments,
        [each.all for each in parts],
        task.settings.motion,
        prior=border_prior(task, state),
        largest=_largest_of_forces(task, state),
    )


def _largest_of_forces(task: Task, state: FitState) -> dict[Source, float]:
    """Source -> level that coloured noise of its readings has at most: cells that drift by a large
    part of what they read would carry the body by themselves.
    """
    found: dict[Source, float] = {}
    if not task.experiment.robot.m:
        # A sensor on a wrist may read nothing but noise along some of its axes.
        return found
    for segment, forces in zip(state.segments, task.force_samples, strict=True):
        if forces is None or segment.static:
            continue
        for each in segment.processes:
            if each.source in UNMODELLED_PARTS or each.level_stated:
                continue
            owner, name = each.disturbs
            if owner != forces.name:
                continue
            usual = float(np.nanmedian(np.abs(forces.readings[name])))
            most = task.settings.largest_drift * usual / float(np.median(each.sizes))
            if most > 0:
                found[each.source] = max(found.get(each.source, 0.0), most)
    return found


def _least_wanted(
    levels: Mapping[Source, ProcessLevel], settings: FitSettings
) -> tuple[Source, ...]:
    """The processes that the marginal likelihood does without most easily; none where it wants all.

    One after the other: two may stand in for each other. Of the wrench both parts or none.
    """
    wrench = tuple(each for each in UNMODELLED_PARTS if each in levels)
    alone = [(each,) for each in levels if each not in wrench]
    gains = {
        sources: max(levels[each].gain for each in sources)
        for sources in (*alone, wrench)
        if sources
    }
    least = min(gains, key=lambda each: gains[each], default=())
    return least if least and gains[least] < settings.asked_for else ()


def _without(state: FitState, sources: Collection[Source]) -> FitState:
    """A state without these processes."""
    segments = tuple(
        segment.disturbed(tuple(each for each in segment.processes if each.source not in sources))
        for segment in state.segments
    )
    return replace(state, segments=segments)
