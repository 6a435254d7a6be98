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
from steelyard.clocks.settings import OFFSET
from steelyard.clocks.shift import Shift
from steelyard.errors import InputError
from steelyard.experiment.model import Experiment, Run, Stream
from steelyard.identification.force_clock import carrying, likeliest, near, scanned
from steelyard.identification.model.calibration_parameters import gather
from steelyard.identification.solve.beginning import NoBalanceError
from steelyard.identification.solve.joint_motion import fit_jointly
from steelyard.instruments import Instrument

_LONG = 60.0
"""Recordings longer than that are not looked at at every shift, and not as a whole [s]."""
_BESIDE = 0.5
"""Looked at beside a shift that the rough search has found [s]."""
_MOVED = 0.01
"""A correction of a clock after which the fit is made once more [s]."""


@dataclass(frozen=True)
class Synchronised:
    """An experiment whose clocks have been found."""

    experiment: Experiment
    """With numbers under ``sync``."""
    offsets: Mapping[str, tuple[Offset, ...]]
    """Run -> its clocks, that of the forces first; of runs that were not synchronised."""


Progress = Callable[[str, float], None] | None


def synchronised(experiment: Experiment, progress: Progress = None) -> Experiment:
    """An experiment with numbers under ``sync``; see :func:`synchronise`."""
    return synchronise(experiment, progress).experiment


def synchronise(experiment: Experiment, progress: Progress = None) -> Synchronised:
    """Find how far the clocks of runs with ``sync: auto`` are apart; others stay as they are.

    Args:
        experiment: With at least one run.
        progress: Is told what is being done and the fraction that is done.

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
        own = offsets_of(experiment, run)
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
    return _by_all_at_once(rough, offsets, tell)


def offsets_of(experiment: Experiment, run: Run) -> tuple[Offset, ...]:
    """How the clocks of a run stand to that of the forces, whatever ``sync`` says.

    Args:
        experiment: With its instruments.
        run: One of its runs, in motion.

    Returns:
        One for each clock, that of the forces first.
    """
    clocks = clocks_of(experiment, run)
    if len(clocks) < 2:
        return tuple(joined(clocks))
    first = clocks[0]
    if not first.forces or any(kind in first.signals for kind in _MOTION):
        return tuple(joined(clocks))
    motion = joined(clocks[1:])
    forces = _against_motion(experiment, run, clocks, motion)
    return (
        Offset(first.instruments, 0.0, 0.0, True),
        *(chained(forces, each, each.instruments) for each in motion),
    )


_MOTION = (POSITION, ROTATION, RATE, SPECIFIC_FORCE)


def _against_motion(
    experiment: Experiment, run: Run, clocks: tuple[LogClock, ...], motion: list[Offset]
) -> Offset:
    """Time of the first motion clock less that of the forces."""
    first, reference = clocks[0], clocks[1]
    start, end = reference.span
    # Common time is that of the first motion clock, and that of the forces for the forces.
    zero = {name: offset.value for offset in motion for name in offset.instruments}
    placed = replace(
        run, sync={**zero, **dict.fromkeys(first.instruments, 0.0)}, unsynchronised=False
    )
    part = liveliest(reference, start, end) if end - start > _LONG else None
    names = f"{' and '.join(first.instruments)} against {' and '.join(reference.instruments)}"
    nothing = Offset(
        first.instruments,
        0.0,
        np.inf,
        False,
        f"{names}: the motion tells too little of where the cables pull",
    )
    task = carrying(experiment, placed, part)
    if task is None:
        return nothing
    shifts = scanned(task)
    if np.ptp(shifts) > 2 * _LONG:
        shifts = _near_candidates(first, clocks[1:], motion)
    best, rival = likeliest(task, shifts)
    if best is None:
        return nothing
    if rival is not None:
        return replace(nothing, reason=f"{names}: {ambiguous(best, rival)}")
    if not best.sigma < OFFSET.largest_sigma:
        return replace(nothing, reason=f"{names}: {uncertain(best)}")

    def at(middle: float, reach: float) -> Shift | None:
        there = carrying(experiment, placed, (middle - 20.0, middle + 20.0))
        return None if there is None else near(there, best.value, reach)

    drift, deviation = drift_of(at, (start, end))
    return Offset(first.instruments, best.value, best.sigma, True, "", drift, deviation)


def _near_candidates(first: LogClock, others: tuple[LogClock, ...], motion: list[Offset]) -> Array:
    """Shifts of a long recording that a rough look at forces and motion finds worth while [s]."""
    found = [
        c.shift - offset.value
        for clock, offset in zip(others, motion, strict=True)
        for c in candidates(first, clock, 3)
    ]
    around = np.arange(-_BESIDE, _BESIDE, 0.04)
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
    rough: Experiment, offsets: Mapping[str, tuple[Offset, ...]], tell: Callable[[str, float], None]
) -> Synchronised:
    """Correct the clocks by what the joint fit says of their delays."""
    experiment, found = rough, dict(offsets)
    for _ in range(2):
        try:
            posterior = fit_jointly(
                experiment,
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
                if not 0 < sigma < 0.5 * calibration_parameters.deviation[place][0]:
                    own.append(offset)
                    continue
                moved = max(moved, abs(delay))
                for name in offset.instruments:
                    sync[name] += delay
                own.append(replace(offset, value=offset.value + delay, sigma=sigma))
            found[run.name] = tuple(own)
            runs.append(replace(run, sync=sync))
        experiment = replace(experiment, runs=tuple(runs))
        if moved < _MOVED:
            break
    return Synchronised(experiment, found)
