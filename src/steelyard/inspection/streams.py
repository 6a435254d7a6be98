"""Each stream by itself: how often and how evenly it was sampled, what is missing, how much it
scatters at rest and in motion.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import welch

from steelyard.arrays import Array, stretches
from steelyard.experiment.faults import Timing, faults_of, timing
from steelyard.experiment.model import Experiment, Fault, Run, Stream
from steelyard.instruments import Instrument

_THIRD = float(np.sqrt(20.0))
"""1-sigma of third differences of white noise of 1-sigma one."""
_NORMAL = 0.6745
"""Median of the size of a standard normal number."""


@dataclass(frozen=True)
class StreamSettings:
    """How noise and rest of a stream are found."""

    most: int = 400_000
    """Samples of which the noise is looked at: more do not change two digits of it."""
    bin: float = 0.25
    """Length of which means are compared to see whether the platform moves [s]."""
    still: float = 5.0
    """Change from one mean to the next that is rest, in units of what noise makes of it."""
    still_share: float = 2e-3
    """Part of all changes that is rest as well: a platform on cables never hangs quite still."""
    fewest_still: int = 3
    """Bins in a row that make a rest."""
    fewest: int = 20
    """Third differences that are enough to find the noise."""
    segment: int = 512
    """Samples of a noise spectrum: resolves a hundredth of the rate."""


SETTINGS = StreamSettings()


@dataclass(frozen=True, eq=False)
class QuantityReport:
    """One quantity of a stream."""

    name: str
    unit: str
    smallest: Array
    """Of every column; of rotations of the matrix, shape (k,)."""
    largest: Array
    noise_at_rest: float | None
    """1-sigma of a sample about its neighbours, root mean square over the columns; None: the
    platform never rests."""
    noise_in_motion: float | None
    stated: float | None
    """1-sigma that the experiment file states."""
    frequency: Array
    """Of the spectrum [Hz], shape (f,)."""
    density: Array
    """Amplitude per root of bandwidth, mean over the columns, shape (f,)."""


@dataclass(frozen=True, eq=False)
class StreamReport:
    """One stream of one run."""

    run: str
    instrument: str
    kind: str
    source: str
    commanded: bool
    """Whether it says what was asked for."""
    samples: int
    timing: Timing | None
    """None of poses at rest."""
    faults: tuple[Fault, ...]
    """Also what was excluded when the stream was read."""
    quantities: tuple[QuantityReport, ...]


def stream_reports(experiment: Experiment, run: Run) -> list[StreamReport]:
    """Look at every stream of a run.

    Args:
        experiment: With its instruments.
        run: One of its runs.
    """
    rest = {} if run.static else resting(experiment, run)
    return [
        _report(experiment.instruments[name], name, stream, run, rest.get(name), experiment.robot.m)
        for name, stream in run.streams.items()
    ]


def _report(
    instrument: Instrument,
    name: str,
    stream: Stream,
    run: Run,
    rest: NDArray[np.bool_] | None,
    m: int,
) -> StreamReport:
    """What one stream shows; ``rest``: samples at which the platform rests, shape (n,)."""
    stuck = tuple(fault for fault in run.excluded if fault.instrument == name)
    faults = () if run.static else _faults(instrument, name, stream, stuck)
    quantities = tuple(
        _quantity(
            q.name, q.unit, q.noise, stream.values[q.name], stream.time, rest, static=run.static
        )
        for q in instrument.quantities(m)
        if q.name in stream.values
    )
    times = None if run.static or len(stream) < 2 else timing(stream.time)
    return StreamReport(
        run.name,
        name,
        instrument.kind,
        stream.source,
        instrument.commanded,
        len(stream),
        times,
        (*stuck, *faults),
        quantities,
    )


def _faults(
    instrument: Instrument, name: str, stream: Stream, stuck: tuple[Fault, ...]
) -> tuple[Fault, ...]:
    """Faults of a stream beside channels that were stuck and have been taken out."""
    taken = {fault.channel for fault in stuck}
    found = []
    for fault in faults_of(name, stream):
        on_purpose = fault.kind == "missing" and fault.channel in taken
        # Commands stand still and end at their limits on purpose.
        as_commanded = instrument.commanded and fault.kind in {"held", "clipped"}
        if not on_purpose and not as_commanded:
            found.append(fault)
    return tuple(found)


def _quantity(
    name: str,
    unit: str,
    stated: float | None,
    values: Array,
    time: Array,
    rest: NDArray[np.bool_] | None,
    *,
    static: bool,
) -> QuantityReport:
    """Range, noise at rest and in motion, and spectrum of one quantity."""
    flat = values.reshape(len(values), -1)
    nothing = np.zeros(0)
    low, high = _extremes(flat)
    if static or rest is None:
        return QuantityReport(name, unit, low, high, None, None, stated, nothing, nothing)
    # Nine elements of a rotation matrix scatter by sqrt(6 / 9) of the rotation vector.
    scale = float(np.sqrt(1.5)) if values.ndim == 3 else 1.0
    few = flat[: SETTINGS.most]
    at_rest, moving = (
        None if level is None else scale * level
        for level in (_scatter(few, rest[: SETTINGS.most]), _scatter(few, ~rest[: SETTINGS.most]))
    )
    frequency, density = _spectrum(time[: SETTINGS.most], few)
    return QuantityReport(name, unit, low, high, at_rest, moving, stated, frequency, density)


def _extremes(flat: Array) -> tuple[Array, Array]:
    there = np.isfinite(flat).any(axis=0)
    filled = np.where(np.isfinite(flat), flat, np.nanmean(flat, axis=0) if there.all() else 0.0)
    return filled.min(axis=0), filled.max(axis=0)


def _scatter(flat: Array, rows: NDArray[np.bool_]) -> float | None:
    """1-sigma of samples about their neighbours, by third differences; None where there are too
    few.
    """
    third = np.diff(flat, 3, axis=0)
    use = rows[3:] & rows[:-3]
    chosen = third[use]
    chosen = chosen[np.isfinite(chosen).all(axis=1)]
    if len(chosen) < SETTINGS.fewest:
        return None
    sigma = np.median(np.abs(chosen), axis=0) / _NORMAL / _THIRD
    return float(np.sqrt(np.mean(sigma**2)))


def _spectrum(time: Array, flat: Array) -> tuple[Array, Array]:
    """Amplitude density on an even grid [Hz], unit per root of Hz."""
    complete = np.isfinite(flat).all(axis=1)
    time, flat = time[complete], flat[complete]
    if len(time) < 64:
        return np.zeros(0), np.zeros(0)
    step = float(np.median(np.diff(time)))
    if step <= 0:
        return np.zeros(0), np.zeros(0)
    grid = time[0] + step * np.arange(min(len(time), SETTINGS.most))
    even = np.column_stack([np.interp(grid, time, column) for column in flat.T])
    frequency, power = welch(
        even, 1 / step, nperseg=min(SETTINGS.segment, len(grid)), axis=0, detrend="linear"
    )
    return frequency, np.sqrt(power.mean(axis=1))


def resting(experiment: Experiment, run: Run) -> dict[str, NDArray[np.bool_]]:
    """Samples of every stream at which the platform rests, as all motion instruments and commands
    see it.

    Args:
        experiment: With its instruments.
        run: One in motion.
    """
    times = {name: experiment.common_time(run, name) for name in run.streams}
    start, end = max(float(t[0]) for t in times.values()), min(float(t[-1]) for t in times.values())
    edges = np.arange(start, end, SETTINGS.bin)
    if len(edges) < 2 * SETTINGS.fewest_still:
        return {name: np.zeros(len(t), dtype=bool) for name, t in times.items()}
    still = np.ones(len(edges), dtype=bool)
    for name, stream in run.streams.items():
        if experiment.is_force(name):
            continue
        for values in stream.values.values():
            still &= _still(times[name], values.reshape(len(values), -1), edges)
    for first, last in stretches(still):
        if last - first < SETTINGS.fewest_still:
            still[first:last] = False
    found = {}
    for name, t in times.items():
        bins = np.searchsorted(edges, t, side="right") - 1
        found[name] = np.where(
            (bins >= 0) & (t <= end), still[np.clip(bins, 0, len(edges) - 1)], False
        )
    return found


def _still(time: Array, flat: Array, edges: Array) -> NDArray[np.bool_]:
    """Bins in which the means of a quantity do not move, shape (bins,)."""
    good = np.isfinite(flat).all(axis=1)
    bins = np.searchsorted(edges, time, side="right") - 1
    use = good & (bins >= 0)
    count = np.maximum(np.bincount(bins[use], minlength=len(edges)), 1)
    third = np.diff(flat[good], 3, axis=0)
    if not len(third):
        return np.ones(len(edges), dtype=bool)
    sigma = np.median(np.abs(third), axis=0) / _NORMAL / _THIRD
    still = np.ones(len(edges), dtype=bool)
    for i, column in enumerate(flat.T):
        mean = np.bincount(bins[use], column[use], minlength=len(edges)) / count
        step = np.abs(np.diff(mean))
        spread = float(np.std(mean))
        allowed = (
            SETTINGS.still * sigma[i] * np.sqrt(2 / count[1:])
            + SETTINGS.still_share * spread
            + 1e-9 * float(np.abs(mean).max())
        )
        moving = step > allowed
        still[1:] &= ~moving
        still[:-1] &= ~moving
    return still


def as_dict(report: StreamReport) -> Mapping[str, object]:
    """Plain values."""
    t = report.timing
    return {
        "run": report.run,
        "instrument": report.instrument,
        "kind": report.kind,
        "samples": report.samples,
        "rate": None if t is None else t.rate,
        "jitter": None if t is None else t.jitter,
        "duration": None if t is None else t.duration,
        "repeated": None if t is None else t.repeated,
        "late": None if t is None else t.late,
        "dropped": None if t is None else t.dropped,
        "gaps": None if t is None else [list(gap) for gap in t.gaps],
        "faults": [vars(fault) for fault in report.faults],
        "quantities": {
            q.name: {
                "unit": q.unit,
                "smallest": q.smallest.tolist(),
                "largest": q.largest.tolist(),
                "noise_at_rest": q.noise_at_rest,
                "noise_in_motion": q.noise_in_motion,
                "stated_noise": q.stated,
            }
            for q in report.quantities
        },
    }
