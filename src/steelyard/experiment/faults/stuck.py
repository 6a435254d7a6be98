"""Channels that have stopped: what they repeat is no reading, and is taken out.

Nothing here knows what the numbers mean. A channel counts as stuck where it repeats a value
although it hardly ever does, and noise, the jump at the end or the other channels of its instrument
say that it should have changed; coarse converters, platforms at rest and recordings without noise
repeat themselves too, and are no fault.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array, stretches
from steelyard.experiment.faults.fault import Fault
from steelyard.experiment.faults.of_streams import SLOW, channels, clipped
from steelyard.experiment.recording import Stream
from steelyard.instruments import Instrument

FEWEST_REPEATS = 5
"""Readings in a row that repeat the one before them, from which on a channel may be stuck: fewer
happen by chance in any converter."""


@dataclass(frozen=True)
class StuckSettings:
    """When repeated readings are those of a channel that has stopped. The levels were chosen on
    simulated and recorded streams such that coarse converters, rest and smooth motion are none.
    """

    chance: float = 1e-6
    """Probability of as many repeats anywhere in the stream, below which they are none of chance:
    one false alarm in a million streams."""
    around: int = 20
    """Samples beside a stretch that show how the channel behaves: enough for a median."""
    rare: float = 0.1
    """Share of repeats beside a stretch, up to which the channel is one that changes."""
    rough: float = 1.3
    """Third over second differences of noise: those of white noise have the ratio sqrt(20/6) = 1.8,
    those of a smooth motion far less than one."""
    jump: float = 6.0
    """Steps of the channel by which it is off when it is released; in motion it makes one."""
    edge: int = 2
    """Steps before and after a stretch that are those of a channel in motion."""
    most: float = 0.5
    """Share of a channel beyond which more is needed to call it stopped than itself: other channels
    of its instrument that read noise, where it reads none."""
    fewest: int = 100
    """Samples from which on a channel that never changes has never worked, beside others that read
    noise."""


STUCK = StuckSettings()


def repeats(values: Array) -> list[tuple[int, int]]:
    """Stretches of readings that all repeat the one before them: the first, and the one after the
    last.

    Args:
        values: Of one channel, shape (n, k).
    """
    same = np.zeros(len(values), dtype=bool)
    same[1:] = np.all(values[1:] == values[:-1], axis=1)
    return [(first, last) for first, last in stretches(same) if last - first >= FEWEST_REPEATS]


@dataclass(frozen=True, eq=False)
class Fellows:
    """The other channels of an instrument, beside one."""

    moving: Array
    """Share of them that move as they usually do, shape (n,)."""
    noisy: bool
    """Whether most of them read noise from sample to sample, so that one that reads the same all
    the time is no reading."""


def stuck(
    values: Array, fellows: Fellows | None = None, settings: StuckSettings = STUCK
) -> NDArray[np.bool_]:
    """Readings of a channel that has stopped, but for the first of them, which was still one; all
    of a channel that has never worked.

    Args:
        values: Of one channel, shape (n, k); NaN where there is none.
        fellows: The other channels of its instrument; None: there are none.
        settings: Levels of the decision.

    Returns:
        Shape (n,).
    """
    mask = np.zeros(len(values), dtype=bool)
    long = repeats(values)
    if not long:
        return mask
    among_noisy = fellows is not None and fellows.noisy
    if long == [(1, len(values))]:
        return np.full(len(values), among_noisy and len(values) >= settings.fewest)
    channel = _Channel.of(values, settings)
    inside = sum(last - first for first, last in long)
    # How often it repeats itself where it is not in question.
    usual = (np.sum(channel.same) - inside + 1) / (len(values) - inside + 2)
    for first, last in long:
        by_chance = len(values) * usual ** (last - first) >= settings.chance
        if not by_chance and (
            channel.should_have_changed(first, last)
            or (fellows is not None and channel.is_alone(first, last, fellows.moving))
        ):
            mask[first:last] = True
    return mask if among_noisy or mask.mean() < settings.most else np.zeros_like(mask)


def stuck_alone(
    values: Array, settings: StuckSettings = STUCK, *, may_rest: bool = False
) -> NDArray[np.bool_]:
    """Readings of channels that have stopped while others of their instrument go on.

    Args:
        values: Of all channels of an instrument, shape (n, k), k at least 2; NaN where there is
            none.
        settings: Levels of the decision.
        may_rest: As for :func:`fellows_of`.

    Returns:
        Shape (n, k).
    """
    if not any(repeats(each[:, None]) for each in values.T):
        return np.zeros(values.shape, dtype=bool)
    beside = fellows_of(values, settings, may_rest=may_rest)
    each = [stuck(values[:, [i]], beside[i], settings) for i in range(values.shape[1])]
    mask = np.column_stack(each)
    mask[mask.all(axis=1)] = False
    return mask


@dataclass(frozen=True, eq=False)
class _Channel:
    """A channel and its steps from sample to sample."""

    values: Array
    """Shape (n, k)."""
    step: Array
    """Length of the step to each sample; 0 to the first, shape (n,)."""
    same: NDArray[np.bool_]
    """Where a sample repeats the one before it, shape (n,)."""
    typical: float
    """Median of the steps that are none of length 0; 0: there are none."""
    settings: StuckSettings

    @classmethod
    def of(cls, values: Array, settings: StuckSettings) -> _Channel:
        step = np.zeros(len(values))
        step[1:] = np.linalg.norm(np.diff(values, axis=0), axis=1)
        same = step == 0
        same[0] = False
        moving = step[step > 0]
        typical = float(np.median(moving)) if len(moving) else 0.0
        return cls(values, step, same, typical, settings)

    def should_have_changed(self, first: int, last: int) -> bool:
        """Whether noise, or where the channel goes on from, says that a stretch of repeats is none
        of the motion.
        """
        around, same, step = self.settings.around, self.same, self.step
        before = slice(max(1, first - around), first)
        after = slice(last + 1, last + 1 + around)
        beside = np.concatenate([same[before], same[after]])
        if len(beside) < FEWEST_REPEATS:
            return False
        if beside.mean() < self.settings.rare and self._is_noisy(before) and self._is_noisy(after):
            return True
        if last >= len(step):
            # Never released: a motion that ends slows down before it does.
            fast = np.median(step[before]) > self.settings.jump * SLOW * self.typical
            return bool(fast and step[first - 1] > self.typical > 0)
        near = np.concatenate([step[before], step[after]])
        near = near[near > 0]
        if not len(near):
            return False
        usual = max(float(np.median(near)), self.typical)
        return bool(step[last] > self.settings.jump * usual)

    def _is_noisy(self, part: slice) -> bool:
        """Whether a part reads noise; few samples say nothing against it."""
        values = self.values[part]
        return len(values) < FEWEST_REPEATS or _is_noise(values, self.settings)

    def is_alone(self, first: int, last: int, fellows: Array) -> bool:
        """Whether the channel stops and goes on in full motion, while the others of its instrument,
        of which a share moves, shape (n,), never did.
        """
        edge, around = self.settings.edge, self.settings.around
        edges = np.concatenate(
            [self.step[max(1, first - edge) : first], self.step[last : last + edge]]
        )
        before = self.same[max(1, first - around) : first]
        after = self.same[last + 1 : last + 1 + around]
        return bool(
            len(edges) == 2 * edge
            and float(np.median(edges)) > SLOW * self.typical
            and np.concatenate([before, after]).mean() < self.settings.rare
            and fellows[first:last].mean() > 0.5
        )


def _is_noise(values: Array, settings: StuckSettings) -> bool:
    """Whether neighbouring samples, shape (n, k), differ by noise rather than by motion."""
    second = np.linalg.norm(np.diff(values, 2, axis=0), axis=1)
    third = np.linalg.norm(np.diff(values, 3, axis=0), axis=1)
    if not (np.isfinite(second).any() and np.isfinite(third).any()):
        return False
    scale = float(np.nanmedian(second))
    return scale > 0 and float(np.nanmedian(third)) > settings.rough * scale


def fellows_of(
    values: Array, settings: StuckSettings = STUCK, *, may_rest: bool = False
) -> list[Fellows]:
    """The other channels beside every one of an instrument.

    Args:
        values: Of all its channels, shape (n, k), k at least 2; NaN where there is none.
        settings: Levels of the decision.
        may_rest: Whether one may rightly stand still while others move and read noise.
    """
    step = np.zeros(values.shape)
    step[1:] = np.abs(np.diff(values, axis=0))
    typical = np.full(values.shape[1], np.inf)
    for i, steps in enumerate(np.nan_to_num(step).T):
        if np.any(steps > 0):
            typical[i] = np.median(steps[steps > 0])
    moves = step > SLOW * typical
    others = moves.sum(axis=1, keepdims=True) - moves
    shares = others / (values.shape[1] - 1)
    noisy = np.array(
        [
            not may_rest
            and float(np.mean(step[1:, i] == 0)) < settings.rare
            and _is_noise(values[:, [i]], settings)
            for i in range(values.shape[1])
        ]
    )
    most = (noisy.sum() - noisy) > 0.5 * (values.shape[1] - 1)
    return [Fellows(shares[:, i], bool(most[i])) for i in range(values.shape[1])]


def without_stuck(
    streams: Mapping[str, Stream],
    instruments: Mapping[str, Instrument],
    settings: StuckSettings = STUCK,
) -> tuple[dict[str, Stream], tuple[Fault, ...]]:
    """Streams of a run without the readings of channels that have stopped, and what was taken out.

    Args:
        streams: Instrument -> its stream.
        instruments: All of the experiment; commands may stand still.
        settings: Levels of the decision.
    """
    kept = dict(streams)
    faults: list[Fault] = []
    for name, stream in streams.items():
        if instruments[name].commanded or len(stream) < 2 * FEWEST_REPEATS:
            continue
        values = dict(stream.values)
        may_rest = instruments[name].may_rest
        for label, quantity, component, mask in _stopped(stream, settings, may_rest):
            if quantity not in values:
                continue
            if mask.all() and not instruments[name].per_cable and len(values) > 1:
                # A vector is told by all of its components or not at all.
                del values[quantity]
            else:
                left = values[quantity].copy()
                left[mask if component is None else (mask, component)] = np.nan
                values[quantity] = left
            kind: Literal["stuck", "dead"] = "dead" if mask.all() else "stuck"
            for first, last in stretches(mask):
                start, end = float(stream.time[first]), float(stream.time[last - 1])
                faults.append(Fault(kind, name, label, start, end, last - first))
            kept[name] = replace(stream, values=values)
    return kept, tuple(faults)


def _stopped(
    stream: Stream, settings: StuckSettings, may_rest: bool
) -> Iterator[tuple[str, str, int | None, NDArray[np.bool_]]]:
    """Channels of a stream that have stopped: name, quantity, component, and readings to take out,
    shape (n,).
    """
    beside = {
        quantity: fellows_of(values, settings, may_rest=may_rest)
        for quantity, values in stream.values.items()
        if values.ndim == 2 and values.shape[1] > 1
    }
    for label, quantity, component, values in channels(stream):
        others = beside.get(quantity)
        fellows = None if component is None or others is None else others[component]
        mask = stuck(values, fellows, settings)
        if component is not None and mask.any() and not mask.all():
            # Readings at the end of a range stand still too, and have a name of their own.
            mask &= ~clipped(values[:, 0])
        nothing_left = np.all(mask | ~np.isfinite(values).all(axis=1))
        if mask.any() and (fellows is not None or not nothing_left):
            yield label, quantity, component, mask
