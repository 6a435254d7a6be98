"""What is wrong with a stream itself: gaps, dropped, late and repeated samples, channels that are
stuck or at their end.

Nothing here knows what the numbers mean. A channel counts as stuck where it repeats a value
although it hardly ever does, and noise or the jump at the end says that it should have changed;
coarse converters, platforms at rest and recordings without noise repeat themselves too, and are no
fault.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array, stretches
from steelyard.experiment.model import Fault, Stream
from steelyard.instruments import Instrument

_FEWEST_REPEATS = 5
"""In a row, that may be a stuck channel."""
_CHANCE = 1e-6
"""Probability of as many repeats anywhere in the stream below which they are none of chance."""
_AROUND = 20
"""Samples beside a stretch that show how the channel behaves."""
_RARE = 0.1
"""Share of repeats beside a stretch, up to which the channel is one that changes."""
_ROUGH = 1.3
"""Third over second differences of noise; those of white noise have 1.8, those of a smooth motion
far less than one."""
_JUMP = 6.0
"""Steps of the channel by which it is off when it is released."""
_MOST_STUCK = 0.5
"""Share of a channel beyond which it has not stopped but never worked; that is not ours to leave
out."""
_GAP = 0.2
"""Pause that is called a gap rather than dropped samples [s], and at least:"""
_GAP_STEPS = 6.0
_PILED = 5
"""Readings at the very extreme that may be the end of a range, and their least share:"""
_PILED_SHARE = 0.003
_EDGE = 2
"""Steps before and after a stretch that are those of a channel in motion."""
_SLOW = 0.2
"""Part of a channel's typical step with which a motion that comes to rest reaches its extreme."""


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


def timing(time: Array) -> Timing:
    """Look at the times of a stream.

    Args:
        time: Never decreasing [s], shape (n,), two at least.
    """
    steps = np.diff(time)
    there = steps[steps > 0]
    if not len(there):
        return Timing(0.0, 0.0, 0.0, len(steps), 0, 0, ())
    period = float(np.median(there))
    spread = float(np.subtract(*np.percentile(there, [75, 25]))) / 1.35
    ratio = steps / period
    # What is uneven by nature has wide steps now and then.
    wide = ratio > 1.5 + 8 * spread / period
    # What a step is too long the next ones are too short: nothing is missing, one came late.
    following = np.concatenate([ratio[1:], [1.0]])
    late = wide & (ratio + following < 2.4) & (following < 0.7)
    missing = np.where(wide & ~late, np.round(ratio) - 1, 0.0)
    gap = wide & ~late & (steps > max(_GAP, _GAP_STEPS * period))
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


def stuck(values: Array, fellows: Array | None = None) -> NDArray[np.bool_]:
    """Readings of a channel that has stopped, but for the first of them, which was still one.

    Args:
        values: Of one channel, shape (n, k); NaN where there is none.
        fellows: Share of the other channels of its instrument that move as they usually do, shape
            (n,); None: there are none.

    Returns:
        Shape (n,).
    """
    n = len(values)
    mask = np.zeros(n, dtype=bool)
    step = np.zeros(n)
    step[1:] = np.linalg.norm(np.diff(values, axis=0), axis=1)
    same = step == 0
    same[0] = False
    long = [(first, last) for first, last in stretches(same) if last - first >= _FEWEST_REPEATS]
    if not long:
        return mask
    inside = sum(last - first for first, last in long)
    # How often it repeats itself where it is not in question.
    usual = (np.sum(same) - inside + 1) / (n - inside + 2)
    moving = step[step > 0]
    typical = float(np.median(moving)) if len(moving) else 0.0
    for first, last in long:
        if n * usual ** (last - first) < _CHANCE and (
            _should_have_changed(values, step, same, first, last, typical)
            or (fellows is not None and _alone(step, same, fellows, first, last, typical))
        ):
            mask[first:last] = True
    return mask if mask.mean() < _MOST_STUCK else np.zeros_like(mask)


def _should_have_changed(
    values: Array, step: Array, same: NDArray[np.bool_], first: int, last: int, typical: float
) -> bool:
    """Whether noise, or where the channel goes on from, says that a stretch of repeats is none of
    the motion.
    """
    before, after = slice(max(1, first - _AROUND), first), slice(last + 1, last + 1 + _AROUND)
    beside = np.concatenate([same[before], same[after]])
    if len(beside) < _FEWEST_REPEATS:
        return False
    noisy = [_rough(values[part]) for part in (before, after) if len(same[part]) >= _FEWEST_REPEATS]
    if beside.mean() < _RARE and all(noisy):
        return True
    if last >= len(step):
        # Never released: a motion that ends slows down before it does.
        return bool(
            np.median(step[before]) > _JUMP * _SLOW * typical and step[first - 1] > typical > 0
        )
    near = np.concatenate([step[before], step[after]])
    near = near[near > 0]
    return len(near) > 0 and bool(step[last] > _JUMP * max(float(np.median(near)), typical))


def _alone(
    step: Array, same: NDArray[np.bool_], fellows: Array, first: int, last: int, typical: float
) -> bool:
    """Whether a channel stops and goes on in full motion, while the others of its instrument never
    did.
    """
    edges = np.concatenate([step[max(1, first - _EDGE) : first], step[last : last + _EDGE]])
    beside = np.concatenate(
        [same[max(1, first - _AROUND) : first], same[last + 1 : last + 1 + _AROUND]]
    )
    return bool(
        len(edges) == 2 * _EDGE
        and float(np.median(edges)) > _SLOW * typical
        and beside.mean() < _RARE
        and fellows[first:last].mean() > 0.5
    )


def moving_share(values: Array) -> Array:
    """Share of the other channels that move as they usually do, for every channel, shape (n, k).

    Args:
        values: Of all channels of an instrument, shape (n, k), k at least 2.
    """
    step = np.zeros(values.shape)
    step[1:] = np.abs(np.diff(values, axis=0))
    typical = np.array(
        [np.median(s[s > 0]) if np.any(s > 0) else np.inf for s in np.nan_to_num(step).T]
    )
    moves = step > _SLOW * typical
    return np.asarray((moves.sum(axis=1, keepdims=True) - moves) / (values.shape[1] - 1))


def _rough(values: Array) -> bool:
    """Whether neighbouring samples differ by noise rather than by motion."""
    second, third = (np.linalg.norm(np.diff(values, order, axis=0), axis=1) for order in (2, 3))
    scale = float(np.nanmedian(second)) if len(second) else 0.0
    return bool(len(third)) and scale > 0 and float(np.nanmedian(third)) > _ROUGH * scale


def clipped(values: Array) -> NDArray[np.bool_]:
    """Readings that pile up at the largest or the smallest value of a channel, as at the end of a
    range.

    Args:
        values: Of one channel, shape (n,); NaN where there is none.

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
        count = int(at.sum())
        if count < max(_PILED, _PILED_SHARE * len(values)) or count > 0.9 * len(values):
            continue
        # Of a coarse converter the next value is about as frequent; a motion that comes to rest
        # arrives slowly.
        others = np.abs(values[~at] - extreme)
        near = float(np.nanmin(others))
        if np.sum(others <= 1.5 * near) > count / 3 and near > 0.5 * typical:
            continue
        edges = [steps[i] for a, b in stretches(at) for i in (a - 1, b - 1) if 0 <= i < len(steps)]
        if edges and float(np.median(edges)) > _SLOW * typical and len(stretches(at)) >= 2:
            mask |= at
    return mask


def held(values: Array) -> float:
    """How many samples in a row a reading stands on average, where a slow sensor is written more
    often than it reads; 1 where it is not.

    Args:
        values: Of one channel, shape (n, k).
    """
    changes = np.any(np.diff(values, axis=0) != 0, axis=1)
    count = int(changes.sum())
    if count < _AROUND:
        return 1.0
    lengths = np.diff(np.flatnonzero(changes))
    usual = float(np.mean(lengths[lengths <= np.percentile(lengths, 95)]))
    # A platform at rest repeats itself for long; a held reading about as long every time.
    return usual if float(np.percentile(lengths, 25)) >= 2 else 1.0


def without_stuck(
    streams: Mapping[str, Stream], instruments: Mapping[str, Instrument]
) -> tuple[dict[str, Stream], tuple[Fault, ...]]:
    """Streams of a run without the readings of channels that have stopped, and what was taken out.

    Args:
        streams: Instrument -> its stream.
        instruments: All of the experiment; commands stand still when they are told to.
    """
    kept: dict[str, Stream] = {}
    faults: list[Fault] = []
    for name, stream in streams.items():
        kept[name] = stream
        if instruments[name].commanded or len(stream) < 2 * _FEWEST_REPEATS:
            continue
        values = dict(stream.values)
        shares = {q: moving_share(v) for q, v in values.items() if v.ndim == 2 and v.shape[1] > 1}
        for label, quantity, component, each in channels(stream):
            fellows = (
                shares[quantity][:, component]
                if component is not None and quantity in shares
                else None
            )
            mask = stuck(each, fellows)
            if component is not None and mask.any():
                # Readings at the end of a range stand still too, and have a name of their own.
                mask &= ~clipped(each[:, 0])
            if not mask.any() or np.all(mask | ~np.isfinite(each).all(axis=1)):
                continue
            faults += [
                Fault(
                    "stuck",
                    name,
                    label,
                    float(stream.time[first]),
                    float(stream.time[last - 1]),
                    last - first,
                )
                for first, last in stretches(mask)
            ]
            values[quantity] = _without(values[quantity], mask, component)
        if any(values[quantity] is not stream.values[quantity] for quantity in values):
            kept[name] = replace(stream, values=values)
    return kept, tuple(faults)


def _without(values: Array, mask: NDArray[np.bool_], component: int | None) -> Array:
    left = values.copy()
    if component is None:
        left[mask] = np.nan
    else:
        left[mask, component] = np.nan
    return left


def faults_of(name: str, stream: Stream) -> Iterator[Fault]:
    """Everything that is wrong with a stream in motion, but for what was taken out when it was
    read.

    Args:
        name: Instrument.
        stream: Its stream.
    """
    time = stream.time
    if len(time) < 3:
        return
    seen = timing(time)
    for start, end in seen.gaps:
        yield Fault("gap", name, "", start, end, max(1, round((end - start) * seen.rate) - 1))
    for kind, count in (
        ("dropped", seen.dropped),
        ("late", seen.late),
        ("repeated", seen.repeated),
    ):
        if count:
            yield Fault(kind, name, "", float(time[0]), float(time[-1]), count)  # type: ignore[arg-type]
    for label, _, component, values in channels(stream):
        missing = ~np.isfinite(values).all(axis=1)
        if missing.any():
            at = time[missing]
            yield Fault("missing", name, label, float(at[0]), float(at[-1]), int(missing.sum()))
        if component is not None and (mask := clipped(values[:, 0])).any():
            at = time[mask]
            yield Fault("clipped", name, label, float(at[0]), float(at[-1]), int(mask.sum()))
        if (often := held(values)) >= 1.5:
            yield Fault(
                "held",
                name,
                label,
                float(time[0]),
                float(time[-1]),
                round(len(time) * (1 - 1 / often)),
            )
