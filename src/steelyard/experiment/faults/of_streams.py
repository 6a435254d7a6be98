"""What is wrong with a stream itself: gaps, dropped, late, repeated and doubled samples, channels
at the end of their range. Nothing here knows what the numbers mean; channels that stop are in
``stuck``, readings that are written several times in ``held``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array, stretches
from steelyard.errors import InputError
from steelyard.experiment.faults.fault import Fault
from steelyard.experiment.faults.held import changes, held
from steelyard.experiment.recording import Stream

SLOW = 0.2
"""Part of a channel's typical step below which it hardly moves, as where a motion comes to rest."""


@dataclass(frozen=True)
class FaultSettings:
    """When the times of samples, or readings at an extreme, are a fault."""

    wide: float = 1.5
    """Steps in units of the period, beyond which a sample is missing or late: half way to one that
    is missing."""
    wide_scatter: float = 8.0
    """Scatters of the steps beyond that: what is uneven by nature has wide steps now and then."""
    gap: float = 0.2
    """Pause that is called a gap rather than dropped samples [s]."""
    gap_steps: float = 6.0
    """The same in samples; the longer of the two counts."""
    piled: int = 5
    """Readings at the very extreme that may be the end of a range."""
    piled_share: float = 0.003
    """The same as a share of all; the larger of the two counts."""
    doubled: float = 0.9
    """Share of the samples at the time of another one that say the same, from which on these are
    one sample written twice."""


FAULTS = FaultSettings()


@dataclass(frozen=True)
class Timing:
    """When a stream was sampled."""

    rate: float
    """[Hz]; of the median step."""
    jitter: float
    """Scatter of the steps about their median, rms without gaps [s]."""
    duration: float
    """[s]"""
    repeated: int
    """Samples at the time of the one before."""
    late: int
    """Samples so late that the next one follows close behind."""
    dropped: int
    """Samples missing in short pauses."""
    gaps: tuple[tuple[float, float], ...]
    """Beginning and end of long pauses, on the clock of the stream [s]."""


def timing(time: Array, settings: FaultSettings = FAULTS) -> Timing:
    """Look at the times of a stream.

    Args:
        time: Never decreasing [s], shape (n,), two at least.
        settings: Levels of the decision.
    """
    steps = np.diff(time)
    there = steps[steps > 0]
    if not len(there):
        return Timing(0.0, 0.0, 0.0, len(steps), 0, 0, ())
    period = float(np.median(there))
    spread = float(np.subtract(*np.percentile(there, [75, 25]))) / 1.35
    ratio = steps / period
    wide = ratio > settings.wide + settings.wide_scatter * spread / period
    # What a step is too long the next ones are too short: nothing is missing, one came late.
    following = np.concatenate([ratio[1:], [1.0]])
    late = wide & (ratio + following < 2.4) & (following < 0.7)
    missing = np.where(wide & ~late, np.round(ratio) - 1, 0.0)
    gap = wide & ~late & (steps > max(settings.gap, settings.gap_steps * period))
    usual = (steps > 0) & ~wide
    jitter = float(np.sqrt(np.mean((steps[usual] - period) ** 2))) if usual.any() else 0.0
    return Timing(
        rate=1 / period,
        jitter=jitter,
        duration=float(time[-1] - time[0]),
        repeated=int(np.sum(steps == 0)),
        late=int(np.sum(late)),
        dropped=int(np.sum(missing[~gap])),
        gaps=tuple((float(time[i]), float(time[i + 1])) for i in np.flatnonzero(gap)),
    )


def without_doubles(
    streams: Mapping[str, Stream], settings: FaultSettings = FAULTS
) -> tuple[dict[str, Stream], tuple[Fault, ...]]:
    """Streams without samples that say once more what the one before them said, as where a log was
    written or joined twice: counted twice, they would make the noise look smaller than it is.

    Samples at one time are doubles where nearly all of a stream's are; otherwise its clock is too
    coarse, and they stay.

    Args:
        streams: Instrument -> its stream, in motion.
        settings: Levels of the decision.

    Returns:
        The streams, and what was taken out.

    Raises:
        InputError: Most samples of a stream have the time of another one, with other readings.
    """
    kept = dict(streams)
    faults: list[Fault] = []
    for name, stream in streams.items():
        at_once = np.diff(stream.time) == 0
        if not at_once.any():
            continue
        same = at_once.copy()
        for values in stream.values.values():
            same &= ~changes(values.reshape(len(values), -1))[1:]
        if same.sum() >= settings.doubled * at_once.sum():
            use = np.concatenate([[True], ~same])
            kept[name] = stream.at_rows(use)
            begin, end = stream.time[1:][same][[0, -1]].tolist()
            faults.append(Fault("doubled", name, "", begin, end, int(same.sum())))
            at_once &= ~same
        if 2 * at_once.sum() > len(at_once) and len(stream) > 2:
            raise InputError(
                f"{stream.source}: expected a time of its own for every sample, found"
                f" {at_once.sum()} of {len(stream)} at the time of the one before, with other"
                " readings; name a column with finer times, or separate what two sensors wrote"
            )
    return kept, tuple(faults)


def channels(stream: Stream) -> Iterator[tuple[str, str, int | None, Array]]:
    """Channels of a stream that may fail alone: name, quantity, component (None: all of a
    rotation), and values, shape (n, k).
    """
    for quantity, values in stream.values.items():
        if values.ndim == 3:
            yield quantity, quantity, None, values.reshape(len(values), -1)
            continue
        for i in range(values.shape[1]):
            yield (
                f"{quantity} {i + 1}" if values.shape[1] > 1 else quantity,
                quantity,
                i,
                values[:, i : i + 1],
            )


def clipped(values: Array, settings: FaultSettings = FAULTS) -> NDArray[np.bool_]:
    """Readings that pile up at the largest or the smallest value of a channel, as at the end of a
    range.

    Args:
        values: Of one channel, shape (n,); NaN where there is none.
        settings: Levels of the decision.

    Returns:
        Shape (n,).
    """
    mask = np.zeros(len(values), dtype=bool)
    steps = np.abs(np.diff(values))
    moving = steps[steps > 0]
    if not len(moving):
        return mask
    typical = float(np.median(moving))
    for extreme in (np.nanmin(values), np.nanmax(values)):
        at = values == extreme
        if _is_end_of_range(values, at, extreme, typical, settings):
            # A motion that comes to rest arrives slowly.
            ends = [i for a, b in stretches(at) for i in (a - 1, b - 1) if 0 <= i < len(steps)]
            arrives_fast = float(np.median(steps[ends])) > SLOW * typical if ends else False
            if arrives_fast and len(stretches(at)) >= 2:
                mask |= at
    return mask


def _is_end_of_range(
    values: Array,
    at: NDArray[np.bool_],
    extreme: float,
    typical: float,
    settings: FaultSettings,
) -> bool:
    """Whether more readings are at an extreme than noise and a coarse converter would have there.

    Args:
        values: Shape (n,).
        at: Those at the extreme, shape (n,).
        extreme: The largest or the smallest value.
        typical: Median step of the channel.
        settings: Levels of the decision.
    """
    count = int(at.sum())
    if count < max(settings.piled, settings.piled_share * len(values)) or count > 0.9 * len(values):
        return False
    # Of a coarse converter the next value is about as frequent.
    others = np.abs(values[~at] - extreme)
    near = float(np.nanmin(others))
    return not (np.sum(others <= 1.5 * near) > count / 3 and near > 0.5 * typical)


def faults_of(name: str, stream: Stream, settings: FaultSettings = FAULTS) -> Iterator[Fault]:
    """Everything that is wrong with a stream in motion, but for channels that are stuck: these are
    taken out when it is read.

    Args:
        name: Instrument.
        stream: Its stream.
        settings: Levels of the decisions.
    """
    time = stream.time
    if len(time) < 3:
        return
    begin, end = float(time[0]), float(time[-1])
    seen = timing(time, settings)
    for start, stop in seen.gaps:
        yield Fault("gap", name, "", start, stop, max(1, round((stop - start) * seen.rate) - 1))
    if seen.dropped:
        yield Fault("dropped", name, "", begin, end, seen.dropped)
    if seen.late:
        yield Fault("late", name, "", begin, end, seen.late)
    if seen.repeated:
        yield Fault("repeated", name, "", begin, end, seen.repeated)
    for label, _, component, values in channels(stream):
        missing = ~np.isfinite(values).all(axis=1)
        if missing.any():
            at = time[missing]
            yield Fault("missing", name, label, float(at[0]), float(at[-1]), int(missing.sum()))
        if component is not None and (mask := clipped(values[:, 0], settings)).any():
            at = time[mask]
            yield Fault("clipped", name, label, float(at[0]), float(at[-1]), int(mask.sum()))
        if (often := held(values)) is not None:
            count = round(len(time) * (1 - 1 / often))
            yield Fault("held", name, label, begin, end, count)
