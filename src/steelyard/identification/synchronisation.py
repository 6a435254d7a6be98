"""``sync: auto``: how far the clocks of a run are apart, from the physics that their streams share.

First the motion instruments among each other (:mod:`steelyard.clocks`), then the forces against the
motion (:mod:`steelyard.identification.force_clock`), in the end all of it at once: the joint fit
knows the delay of every clock to a fraction of a sample.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from steelyard.arrays import Array
from steelyard.clocks.clock_signals import (
    POSITION,
    RATE,
    ROTATION,
    SPECIFIC_FORCE,
    LogClock,
    clocks_of,
)
from steelyard.clocks.offsets import (
    Offset,
    ambiguous,
    chained,
    drift_of,
    joined,
    liveliest,
    uncertain,
)
from steelyard.clocks.search import candidates
from steelyard.clocks.shift import Shift
from steelyard.errors import InputError
from steelyard.experiment.equivalent.platform_frame import centred
from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run, Stream
from steelyard.identification.force_clock import force_clock_problem, likeliest, near, scanned
from steelyard.identification.model.calibration_parameters import gather
from steelyard.identification.settings import SYNCHRONISATION, SynchronisationSettings
from steelyard.identification.solve.beginning.begin import NoBalanceError
from steelyard.identification.solve.joint_motion import fit_jointly
from steelyard.instruments import Instrument


@dataclass(frozen=True)
class Synchronised:
    """An experiment whose clocks have been found."""

    experiment: Experiment
    """With numbers under ``sync``."""
    offsets: Mapping[str, tuple[Offset, ...]]
    """Run -> its clocks, that of the forces first; of runs that were not synchronised."""


Progress = Callable[[str, float], None] | None


def synchronised(
    experiment: Experiment,
    progress: Progress = None,
    *,
    settings: SynchronisationSettings = SYNCHRONISATION,
) -> Experiment:
    """An experiment with numbers under ``sync``; see :func:`synchronise`."""
    return synchronise(experiment, progress, settings=settings).experiment


def synchronise(
    experiment: Experiment,
    progress: Progress = None,
    *,
    settings: SynchronisationSettings = SYNCHRONISATION,
) -> Synchronised:
    """Find how far the clocks of runs with ``sync: auto`` are apart; others stay as they are.

    Args:
        experiment: With at least one run.
        progress: Is told what is being done and the fraction that is done.
        settings: When a clock counts as found.

    Raises:
        InputError: The motion of a run does not tell; the sentence says between which clocks, and
            why.
    """
    if not any(run.unsynchronised for run in experiment.runs):
        return Synchronised(experiment, {})
    tell = progress or (lambda what, fraction: None)
    runs, offsets = [], {}
    for i, run in enumerate(experiment.runs):
        if not run.unsynchronised:
            runs.append(run)
            continue
        tell("finding the clocks", 0.5 * i / len(experiment.runs))
        own = offsets_of(experiment, run, settings=settings)
        lost = next((offset for offset in own if not offset.known), None)
        if lost is not None:
            raise InputError(
                f"{experiment.source or experiment.name}: run '{run.name}': expected a motion that"
                f" tells how far the clocks are apart, found {lost.reason}; write the time of one"
                " common event on each clock under 'sync'"
            )
        offsets[run.name] = own
        runs.append(_with_offsets(experiment, run, own))
    tell("finding the clocks", 0.5)
    rough = replace(experiment, runs=tuple(runs), instruments=_own_clocks(experiment, offsets))
    return _by_all_at_once(rough, offsets, tell, settings)


def offsets_of(
    experiment: Experiment, run: Run, *, settings: SynchronisationSettings = SYNCHRONISATION
) -> tuple[Offset, ...]:
    """How the clocks of a run stand to that of the forces, whatever ``sync`` says.

    Args:
        experiment: With its instruments.
        run: One of its runs, in motion.
        settings: When a clock counts as found.

    Returns:
        One for each clock, that of the forces first.
    """
    clocks = clocks_of(experiment, run, settings.offset.search.smoothing)
    if len(clocks) < 2:
        return tuple(joined(clocks, settings.offset))
    first = clocks[0]
    if not first.forces or any(kind in first.signals for kind in _MOTION):
        return tuple(joined(clocks, settings.offset))
    motion = joined(clocks[1:], settings.offset)
    forces = _against_motion(experiment, run, clocks, motion, settings)
    return (
        Offset(first.instruments, 0.0, 0.0, True),
        *(chained(forces, each, each.instruments) for each in motion),
    )


_MOTION = (POSITION, ROTATION, RATE, SPECIFIC_FORCE)


def _against_motion(
    experiment: Experiment,
    run: Run,
    clocks: tuple[LogClock, ...],
    motion: list[Offset],
    settings: SynchronisationSettings,
) -> Offset:
    """Time of the first motion clock less that of the forces."""
    first, reference = clocks[0], clocks[1]
    start, end = reference.span
    # Common time is that of the first motion clock, and that of the forces for the forces.
    zero = {name: offset.value for offset in motion for name in offset.instruments}
    placed = replace(
        run, sync={**zero, **dict.fromkeys(first.instruments, 0.0)}, unsynchronised=False
    )
    part = None
    if end - start > settings.long:
        part = liveliest(reference, start, end, settings.offset)
    names = f"{' and '.join(first.instruments)} against {' and '.join(reference.instruments)}"
    nothing = Offset(
        first.instruments,
        0.0,
        np.inf,
        False,
        f"{names}: the motion tells too little of where the cables pull",
    )
    problem = force_clock_problem(experiment, placed, part, settings=settings)
    if problem is None:
        return nothing
    shifts = scanned(problem)
    if np.ptp(shifts) > 2 * settings.long:
        shifts = _near_candidates(first, clocks[1:], motion, settings)
    best, rival = likeliest(problem, shifts)
    if best is None:
        return nothing
    if rival is not None:
        return replace(nothing, reason=f"{names}: {ambiguous(best, rival)}")
    if not best.sigma < settings.offset.largest_sigma:
        return replace(nothing, reason=f"{names}: {uncertain(best)}")

    def at(middle: float, reach: float) -> Shift | None:
        half = settings.offset.part / 2
        around = (middle - half, middle + half)
        there = force_clock_problem(experiment, placed, around, settings=settings)
        return None if there is None else near(there, best.value, reach)

    drift, deviation = drift_of(at, (start, end), settings.offset)
    return Offset(first.instruments, best.value, best.sigma, True, "", drift, deviation)


def _near_candidates(
    first: LogClock,
    others: tuple[LogClock, ...],
    motion: list[Offset],
    settings: SynchronisationSettings,
) -> Array:
    """Shifts of a long recording that a rough look at forces and motion finds worth while [s]."""
    search = settings.offset.search
    found = []
    for clock, offset in zip(others, motion, strict=True):
        for candidate in candidates(first, clock, settings.offset.tried, search):
            found.append(candidate.shift - offset.value)
    around = np.arange(-settings.beside, settings.beside, search.step)
    return np.unique(np.concatenate([guess + around for guess in found])) if found else np.zeros(0)


def _with_offsets(experiment: Experiment, run: Run, offsets: tuple[Offset, ...]) -> Run:
    """A run with the event of all clocks where the forces begin, and clocks of one rate."""
    force = experiment.force_instrument(run)
    assert force is not None  # the reader has made sure
    event = run.sync.get(force, float(run.streams[force].time[0]))
    streams, sync = dict(run.streams), {}
    for offset in offsets:
        for name in offset.instruments:
            # What a delay known beforehand explains is not explained twice.
            late = experiment.delay(run, name).value
            known = float(np.mean(late)) if late is not None else 0.0
            sync[name] = event + offset.value - known
            if offset.drift:
                streams[name] = _slowed(streams[name], event + offset.value, offset.drift)
    placed = replace(run, streams=streams, sync=sync, unsynchronised=False, found=True)
    span = [experiment.common_time(placed, name) for name in streams]
    if max(t[0] for t in span) >= min(t[-1] for t in span):
        raise InputError(
            f"{experiment.source or experiment.name}: run '{run.name}': expected streams that"
            " overlap in time, found none once their clocks agree; check that the files are of the"
            " same recording"
        )
    return placed


def _slowed(stream: Stream, event: float, drift: float) -> Stream:
    """On a clock that runs as fast as that of the forces."""
    return replace(stream, time=event + (stream.time - event) / (1 + drift))


def _own_clocks(
    experiment: Experiment, offsets: Mapping[str, tuple[Offset, ...]]
) -> dict[str, Instrument]:
    """Instruments whose errors of time are those of what was found: shared within a file, and
    nowhere else.
    """
    groups = {
        name: found.instruments[0] if len(found.instruments) > 1 else None
        for run in offsets.values()
        for found in run
        for name in found.instruments
    }
    return {
        name: (
            instrument.model_copy(update={"clock": groups[name]}) if name in groups else instrument
        )
        for name, instrument in experiment.instruments.items()
    }


def _by_all_at_once(
    rough: Experiment,
    offsets: Mapping[str, tuple[Offset, ...]],
    tell: Callable[[str, float], None],
    settings: SynchronisationSettings,
) -> Synchronised:
    """Correct the clocks by what the joint fit says of their delays."""
    experiment, found = rough, dict(offsets)
    for _ in range(settings.fits):
        try:
            posterior = fit_jointly(
                centred(experiment),
                lambda what, fraction: tell(f"finding the clocks: {what}", 0.5 + 0.5 * fraction),
            )
        except (InputError, NoBalanceError):
            # What cannot be fitted as a whole still has the clocks that pairs of streams have told.
            return Synchronised(experiment, found)
        moved = 0.0
        calibration_parameters, deviation = (
            gather(experiment),
            posterior.deviations,
        )
        runs = []
        for run in experiment.runs:
            if run.name not in offsets:
                runs.append(run)
                continue
            sync, own = dict(run.sync), []
            for offset in found[run.name]:
                clock = experiment.instruments[offset.instruments[0]].clock or offset.instruments[0]
                place = calibration_parameters.place(clock, "delay", run.name)
                delay = float(
                    posterior.calibration.values[place][0] - calibration_parameters.mean[place][0]
                )
                sigma = float(deviation[place][0])
                prior = float(calibration_parameters.deviation[place][0])
                if not 0 < sigma < settings.informed * prior:
                    own.append(offset)
                    continue
                moved = max(moved, abs(delay))
                for name in offset.instruments:
                    sync[name] += delay
                own.append(replace(offset, value=offset.value + delay, sigma=sigma))
            found[run.name] = tuple(own)
            runs.append(replace(run, sync=sync))
        experiment = replace(experiment, runs=tuple(runs))
        if moved < settings.moved:
            break
    return Synchronised(experiment, found)
