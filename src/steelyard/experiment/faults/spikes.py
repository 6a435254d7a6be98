"""Single readings that stand alone: a bit that has flipped in a file or on the way, a glitch of a
converter.

The readings before and after it agree with each other, and it is far from both; or it is no
rotation though all others of its log are: a quaternion of another length. Nothing here knows the
motion: no motion, knock or hand is seen by one reading of a channel and by none beside it, as long
as a channel is read often enough to be followed at all.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.experiment.faults.fault import Fault
from steelyard.experiment.faults.of_streams import channels
from steelyard.experiment.faults.running import running_percentile
from steelyard.experiment.recording import Stream
from steelyard.instruments import Instrument


@dataclass(frozen=True)
class SpikeSettings:
    """When a reading stands alone."""

    around: int = 41
    """Readings that show how far one is from those beside it: fewer would not show it well."""
    usual: float = 75.0
    """Percentile of these distances that is usual: those beside a spike, two of which are two
    thirds of it, are beyond it."""
    far: float = 10.0
    """Distance in units of the usual: eleven 1-sigma of white noise."""
    agree: float = 0.25
    """Part of the distance that may be left of those beside it once it is taken out: a knock goes
    on, and a step stays."""
    gap: float = 1.5
    """Step of time in units of the median beyond which readings are not beside each other."""
    off: float = 100.0
    """How far numbers are from a rotation, in units of what three quarters of a log are at most: it
    is rounding, alike in all of them."""
    least_off: float = 1e-6
    """The same at least: less changes nothing."""
    most: float = 0.005
    """Part of the readings beyond which they are the nature of the noise, and no fault."""


SPIKES = SpikeSettings()
_BESIDE = 6
"""Readings before and after that are looked at without it."""


def spikes(time: Array, values: Array, settings: SpikeSettings = SPIKES) -> NDArray[np.bool_]:
    """Readings of one channel that stand alone.

    Args:
        time: Of the readings, never decreasing [s], shape (n,).
        values: Of all that fails at once, such as the nine of a rotation, shape (n, k); NaN where
            there is none.
        settings: Levels of the decision.

    Returns:
        Shape (n,).
    """
    found = np.zeros(len(values), dtype=bool)
    there = np.flatnonzero(np.isfinite(values).all(axis=1))
    if len(there) < settings.around:
        return found
    x, step = values[there], np.diff(time[there])
    period = float(np.median(step))
    distance = _distance(x)
    smallest = 1e-12 * float(np.median(np.linalg.norm(x, axis=1)))
    candidates = np.flatnonzero(distance > settings.far * max(float(np.median(distance)), smallest))
    if not len(candidates):
        return found
    usual = running_percentile(distance, settings.around, settings.usual, candidates)
    far = distance[candidates] > settings.far * np.maximum(usual, smallest)
    for i in candidates[far].tolist():
        first = max(i - _BESIDE, 0)
        beside = x[first : i + _BESIDE + 1].copy()
        # As it would be without it.
        beside[i - first] = _between(x[i - 2], x[i - 1], x[i + 1], x[i + 2])
        alone = _distance(beside).max() <= settings.agree * distance[i]
        even = step[i - 2 : i + 2].max() <= settings.gap * period
        found[there[i]] = alone and even
    return found if found.sum() <= max(1, settings.most * len(there)) else np.zeros_like(found)


def no_rotations(off: Array, settings: SpikeSettings = SPIKES) -> NDArray[np.bool_]:
    """Rotations that are none though all others of their log are.

    Args:
        off: How far the numbers of each are from a rotation, shape (n,); NaN where there is none.
        settings: Levels of the decision.

    Returns:
        Shape (n,).
    """
    there = np.isfinite(off)
    if there.sum() < settings.around:
        return np.zeros(len(off), dtype=bool)
    usual = float(np.percentile(off[there], settings.usual))
    found = np.nan_to_num(off) > max(settings.off * usual, settings.least_off)
    return found if found.sum() <= max(1, settings.most * there.sum()) else np.zeros_like(found)


def _between(a: Array, b: Array, c: Array, d: Array) -> Array:
    """What a cubic through the two before and the two after has between them."""
    return np.asarray((4 * (b + c) - a - d) / 6)


def _distance(x: Array) -> Array:
    """How far each is from those beside it, shape (n,); 0 at the ends."""
    distance = np.zeros(len(x))
    off = x[2:-2] - _between(x[:-4], x[1:-3], x[3:-1], x[4:])
    distance[2:-2] = np.linalg.norm(off, axis=1)
    return distance


def without_spikes(
    streams: Mapping[str, Stream],
    instruments: Mapping[str, Instrument],
    settings: SpikeSettings = SPIKES,
) -> tuple[dict[str, Stream], tuple[Fault, ...]]:
    """Streams of a run without readings that stand alone, and what was taken out.

    Args:
        streams: Instrument -> its stream, in motion.
        instruments: All of the experiment; commands are no readings.
        settings: Levels of the decision.
    """
    kept = dict(streams)
    faults: list[Fault] = []
    for name, stream in streams.items():
        if instruments[name].commanded:
            continue
        values = dict(stream.values)
        for label, quantity, component, mask in _alone(stream, settings):
            left = values[quantity].copy()
            left[mask if component is None else (mask, component)] = np.nan
            values[quantity] = left
            at = stream.time[mask].tolist()
            faults.append(Fault("spike", name, label, at[0], at[-1], len(at)))
            kept[name] = replace(stream, values=values)
        kept[name] = replace(kept[name], off={})
    return kept, tuple(faults)


def _alone(
    stream: Stream, settings: SpikeSettings
) -> Iterator[tuple[str, str, int | None, NDArray[np.bool_]]]:
    """Channels with readings that stand alone: name, quantity, component, and these, shape (n,)."""
    for label, quantity, component, values in channels(stream):
        mask = spikes(stream.time, values, settings)
        if quantity in stream.off:
            mask |= no_rotations(stream.off[quantity], settings)
        if mask.any():
            yield label, quantity, component, mask
