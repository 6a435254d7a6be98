"""Each stream by itself: how often and how evenly it was sampled, what is missing, how much it
scatters at rest and in motion.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array, binned_means, stretches
from steelyard.estimates.estimate import plain
from steelyard.experiment.faults.fault import Fault
from steelyard.experiment.faults.of_streams import Timing, faults_of, timing
from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run, Stream
from steelyard.identification.samples.motion_noise import by_differences
from steelyard.inspection.settings import STREAMS, StreamSettings
from steelyard.instruments import Instrument, Quantity
from steelyard.spectra import density


@dataclass(frozen=True, eq=False)
class QuantityReport:
    """One quantity of a stream."""

    name: str
    unit: str
    smallest: Array
    """Of every column; of rotations of the matrix, NaN where there is no reading, shape (k,)."""
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


def stream_reports(
    experiment: Experiment, run: Run, settings: StreamSettings = STREAMS
) -> list[StreamReport]:
    """Look at every stream of a run.

    Args:
        experiment: With its instruments.
        run: One of its runs.
        settings: What is noise, and what is rest.
    """
    rest = {} if run.static else resting(experiment, run, settings)
    m = experiment.robot.m
    read = [name for name in run.streams if not experiment.instruments[name].stands_in(m)]
    return [_report(experiment, run, name, rest.get(name), settings) for name in read]


def _report(
    experiment: Experiment,
    run: Run,
    name: str,
    rest: NDArray[np.bool_] | None,
    settings: StreamSettings,
) -> StreamReport:
    """What one stream shows; ``rest``: samples at which the platform rests, shape (n,)."""
    instrument, stream = experiment.instruments[name], run.streams[name]
    excluded = tuple(fault for fault in run.excluded if fault.instrument == name)
    faults = () if run.static else _faults(instrument, name, stream, excluded)
    recorded = [q for q in instrument.quantities(experiment.robot.m) if q.name in stream.values]
    quantities = tuple(_quantity(q, stream, rest, settings) for q in recorded)
    times = None if run.static or len(stream) < 2 else timing(stream.time)
    return StreamReport(
        run.name,
        name,
        instrument.kind,
        stream.source,
        instrument.commanded,
        len(stream),
        times,
        (*excluded, *faults),
        quantities,
    )


def _faults(
    instrument: Instrument, name: str, stream: Stream, excluded: tuple[Fault, ...]
) -> tuple[Fault, ...]:
    """Faults of a stream beside what has been taken out."""
    taken = {fault.channel for fault in excluded}
    found = []
    for fault in faults_of(name, stream):
        on_purpose = fault.kind == "missing" and fault.channel in taken
        # Commands stand still and end at their limits on purpose.
        as_commanded = instrument.commanded and fault.kind in {"held", "clipped"}
        if not on_purpose and not as_commanded:
            found.append(fault)
    return tuple(found)


def _quantity(
    quantity: Quantity, stream: Stream, rest: NDArray[np.bool_] | None, settings: StreamSettings
) -> QuantityReport:
    """Range, noise at rest and in motion, and spectrum of one quantity; without the spectrum where
    it is not known when the platform rests.
    """
    values = stream.values[quantity.name]
    flat = values.reshape(len(values), -1)
    there = np.isfinite(flat)
    read = there.any(axis=0)
    at_rest, moving = None, None
    frequency, density = np.zeros(0), np.zeros(0)
    if rest is not None:
        # A channel without a single reading has no noise, and takes none from the others.
        few, resting = flat[: settings.most, read], rest[: settings.most]
        # Nine elements of a rotation matrix scatter by sqrt(6 / 9) of the rotation vector.
        scale = float(np.sqrt(1.5)) if quantity.rotation else 1.0
        at_rest, moving = (_scatter(few, rows, scale, settings) for rows in (resting, ~resting))
        frequency, density = _spectrum(stream.time[: settings.most], few, settings)
    return QuantityReport(
        name=quantity.name,
        unit=quantity.unit,
        smallest=np.where(read, np.where(there, flat, np.inf).min(axis=0), np.nan),
        largest=np.where(read, np.where(there, flat, -np.inf).max(axis=0), np.nan),
        noise_at_rest=at_rest,
        noise_in_motion=moving,
        stated=quantity.noise,
        frequency=frequency,
        density=density,
    )


def white_noise(stream: Stream, quantity: str, settings: StreamSettings = STREAMS) -> float | None:
    """1-sigma of samples of a vector about their neighbours, at rest or not; None where there are
    too few, or where it is no white noise, so that neighbours do not show all of it.

    Args:
        stream: Of an instrument.
        quantity: Of its readings.
        settings: How many samples are looked at, and what is white.
    """
    values = stream.values[quantity][: settings.most]
    third = np.diff(values[:, np.isfinite(values).any(axis=0)], 3, axis=0)
    third = third[np.isfinite(third).all(axis=1)]
    if len(third) < settings.fewest:
        return None
    power = np.mean(third**2, axis=0)
    if not power.all():
        return None
    # Third differences of white noise follow each other with -15 / 20.
    next_one = np.mean(third[1:] * third[:-1], axis=0) / power
    if abs(float(np.median(next_one)) + 0.75) > settings.white:
        return None
    return float(np.sqrt(np.mean(by_differences(third) ** 2)))


def _scatter(
    flat: Array, rows: NDArray[np.bool_], scale: float, settings: StreamSettings
) -> float | None:
    """1-sigma of samples about their neighbours, by third differences; None where there are too
    few.
    """
    third = np.diff(flat, 3, axis=0)[rows[3:] & rows[:-3]]
    third = third[np.isfinite(third).all(axis=1)]
    if len(third) < settings.fewest:
        return None
    return scale * float(np.sqrt(np.mean(by_differences(third) ** 2)))


def _spectrum(time: Array, flat: Array, settings: StreamSettings) -> tuple[Array, Array]:
    """Amplitude density on an even grid [Hz], unit per root of Hz."""
    complete = np.isfinite(flat).all(axis=1)
    time, flat = time[complete], flat[complete]
    step = float(np.median(np.diff(time))) if len(time) >= 64 else 0.0
    if step <= 0:
        return np.zeros(0), np.zeros(0)
    grid = time[0] + step * np.arange(min(len(time), settings.most))
    even = np.column_stack([np.interp(grid, time, column) for column in flat.T])
    frequency, power = density(even, step, min(settings.segment, len(grid)), trend=True)
    return frequency, np.sqrt(power.mean(axis=1))


def resting(
    experiment: Experiment, run: Run, settings: StreamSettings = STREAMS
) -> dict[str, NDArray[np.bool_]]:
    """Samples of every stream at which the platform rests, as all motion instruments and commands
    see it.

    Args:
        experiment: With its instruments.
        run: One in motion.
        settings: What is rest.
    """
    times = {name: experiment.common_time(run, name) for name in run.streams}
    start = max(float(t[0]) for t in times.values())
    end = min(float(t[-1]) for t in times.values())
    edges = np.arange(start, end, settings.bin)
    if len(edges) < 2 * settings.fewest_still:
        return {name: np.zeros(len(t), dtype=bool) for name, t in times.items()}
    still = np.ones(len(edges), dtype=bool)
    for name, stream in run.streams.items():
        if experiment.is_force(name):
            continue
        for values in stream.values.values():
            still &= _still(times[name], values.reshape(len(values), -1), edges, settings)
    for first, last in stretches(still):
        if last - first < settings.fewest_still:
            still[first:last] = False
    found = {}
    for name, t in times.items():
        bins = np.searchsorted(edges, t, side="right") - 1
        found[name] = (bins >= 0) & (t <= end) & still[np.clip(bins, 0, len(edges) - 1)]
    return found


def _still(time: Array, flat: Array, edges: Array, settings: StreamSettings) -> NDArray[np.bool_]:
    """Bins in which the means of a quantity do not move, shape (bins,)."""
    good = np.isfinite(flat).all(axis=1)
    bins = np.searchsorted(edges, time, side="right") - 1
    use = good & (bins >= 0)
    still = np.ones(len(edges), dtype=bool)
    third = np.diff(flat[good], 3, axis=0)
    if not len(third):
        return still
    mean, count = binned_means(bins[use], flat[use], len(edges))
    by_noise = settings.still * by_differences(third) * np.sqrt(2 / np.maximum(count[1:, None], 1))
    by_motion = settings.still_share * mean.std(axis=0)
    step = np.abs(np.diff(mean, axis=0))
    moving = (step > by_noise + by_motion + 1e-9 * np.abs(mean).max(axis=0)).any(axis=1)
    still[1:] &= ~moving
    still[:-1] &= ~moving
    return still


def as_dict(report: StreamReport) -> Mapping[str, object]:
    """Plain values."""
    times: dict[str, object] = dict.fromkeys(field.name for field in fields(Timing))
    if report.timing is not None:
        gaps = [list(gap) for gap in report.timing.gaps]
        times = {**vars(report.timing), "gaps": gaps}
    return {
        "run": report.run,
        "instrument": report.instrument,
        "kind": report.kind,
        "samples": report.samples,
        **times,
        "faults": [vars(fault) for fault in report.faults],
        "quantities": {
            q.name: {
                "unit": q.unit,
                "smallest": plain(q.smallest),
                "largest": plain(q.largest),
                "noise_at_rest": q.noise_at_rest,
                "noise_in_motion": q.noise_in_motion,
                "stated_noise": q.stated,
            }
            for q in report.quantities
        },
    }
