"""Readings of a sensor that is logged more often than it reads: between two of them the log says
once more what the last one was.

Counted as readings, they would be late by up to the time between two of them, and the noise would
look smaller than it is. Nothing here knows what the numbers mean.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.experiment.faults.fault import Fault
from steelyard.experiment.recording import Stream
from steelyard.instruments import Instrument


@dataclass(frozen=True)
class HeldSettings:
    """When a sensor is one that is logged more often than it reads."""

    times: float = 1.5
    """Samples in a row that a reading stands on average, from which on it is."""
    fewest: int = 20
    """Changes of a reading that show how often a sensor reads."""
    usual: float = 95.0
    """Percentile of the times that a reading stands, beyond which it is no matter of the sensor: a
    platform at rest repeats itself for long."""
    alike: tuple[float, float] = (10.0, 90.0)
    """Percentiles between which a reading stands about as long every time. Coarse encoders repeat
    themselves too, the longer the slower the motion is."""
    apart: float = 0.5
    """Distance of these percentiles, as a part of the median; one sample at least."""
    long: float = 1.75
    """Times the median, from which on a reading that stands is one that was made more than once."""


HELD = HeldSettings()


def held(values: Array, settings: HeldSettings = HELD) -> float | None:
    """How many samples in a row a reading stands on average, where a slow sensor is logged more
    often than it reads; None where it is not.

    Args:
        values: Of one channel or quantity, shape (n, k).
        settings: Levels of the decision.
    """
    starts = np.flatnonzero(changes(values))
    if len(starts) < settings.fewest:
        return None
    lengths = np.diff(starts)
    usual = float(np.mean(lengths[lengths <= np.percentile(lengths, settings.usual)]))
    least, most = np.percentile(lengths, settings.alike)
    alike = most - least <= max(1.0, settings.apart * float(np.median(lengths)))
    # Readings that repeat themselves by chance now and then are no matter of the sensor.
    often = float(np.percentile(lengths, 25)) >= 2
    return usual if alike and often and usual >= settings.times else None


def without_held(
    streams: Mapping[str, Stream],
    instruments: Mapping[str, Instrument],
    settings: HeldSettings = HELD,
) -> tuple[dict[str, Stream], tuple[Fault, ...]]:
    """Streams with every reading of a sensor once, at the time at which the log first has it; what
    is commanded holds until the next command and stays.

    Args:
        streams: Instrument -> its stream, in motion.
        instruments: Of the experiment.
        settings: Levels of the decision.

    Returns:
        The streams, and what was taken out.
    """
    kept = dict(streams)
    faults: list[Fault] = []
    for name, stream in streams.items():
        if instruments[name].commanded:
            continue
        again = {
            quantity: mask
            for quantity, values in stream.values.items()
            if (mask := _again(values.reshape(len(values), -1), settings)).any()
        }
        if not again:
            continue
        kept[name] = _without(stream, again)
        masks = list(again.values())
        alike = all(np.array_equal(each, masks[0]) for each in masks)
        whole = alike and len(again) == len(stream.values)
        for label, mask in {"": masks[0]}.items() if whole else again.items():
            begin, end = stream.time[mask][[0, -1]].tolist()
            faults.append(Fault("held", name, label, begin, end, int(mask.sum())))
    return kept, tuple(faults)


def changes(values: Array) -> NDArray[np.bool_]:
    """Whether a sample says something else than the one before it, shape (n,).

    Args:
        values: Of one channel or quantity, shape (n, k); NaN where there is none.
    """
    changed = np.ones(len(values), dtype=bool)
    before, after = values[:-1], values[1:]
    both = np.isnan(before) & np.isnan(after)
    changed[1:] = np.any((before != after) & ~both, axis=1)
    return changed


def _again(values: Array, settings: HeldSettings) -> NDArray[np.bool_]:
    """Samples that say once more what a sensor has read, shape (n,), shape of values (n, k)."""
    if held(values, settings) is None:
        return np.zeros(len(values), dtype=bool)
    starts = np.flatnonzero(changes(values))
    lengths = np.diff(np.append(starts, len(values)))
    median = int(np.median(lengths))
    place = np.arange(len(values)) - np.repeat(starts, lengths)
    stands_long = np.repeat(lengths >= settings.long * median, lengths)
    # What stands for long was read more than once, as often as usual.
    return np.asarray(np.where(stands_long, place % median != 0, place != 0), dtype=bool)


def _without(stream: Stream, again: Mapping[str, NDArray[np.bool_]]) -> Stream:
    """A stream without what quantities say once more; samples that say nothing else are left
    out.
    """
    values = dict(stream.values)
    for quantity, mask in again.items():
        values[quantity] = values[quantity].copy()
        values[quantity][mask] = np.nan
    nothing = [~np.isfinite(v.reshape(len(v), -1)).any(axis=1) for v in values.values()]
    masks = [again.get(quantity, nothing[i]) for i, quantity in enumerate(values)]
    use = ~np.logical_and.reduce(masks)
    return replace(stream, values=values).at_rows(use)
