"""Readings of a chunk that stand alone: a cell that spikes, a glitch of a converter.

A force reading stands alone where its own correction explains what is left of its sample. What many
samples in a row show is none: the platform carries something else then, or something touches it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from steelyard.arrays import Array, stretches
from steelyard.estimates.quantiles import chi2_quantile
from steelyard.identification.model.balance import Balance, Forces
from steelyard.identification.model.force_residuals import WhitenedBalance
from steelyard.identification.model.motion_segment import Reading, Segment
from steelyard.identification.model.segment import Rows
from steelyard.identification.model.sources import Source
from steelyard.identification.solve.misfits.outliers import farthest
from steelyard.identification.solve.settings import FitSettings
from steelyard.identification.tally import limit
from steelyard.robot.model import DIRECTIONS

Mask = NDArray[np.bool_]
LEAST_OWN = 1e-3
"""Part of a reading's variance that the motion leaves it, at least: what it tells alone is never
held against it."""
TURNS = 4
"""At most, in each of which one reading of a sample is left out: more of them are rare."""
MOST_FAR = 0.1
"""Part of the numbers of a quantity beyond which none of them is a spike: the motion is not right,
or their noise is another one."""
_FEW = 2
"""Samples of which all numbers may be far, however few there are."""
_NEAR = 0.5
"""Part of a correction that may be left of its sample, until that reading is replaced: a cable sags
by what it reads."""
_MOST_OF_SAMPLE = 1 / 3
"""Part of the readings of one sample beyond which it is off as a whole."""
_ALIKE = 0.5
"""Part of the samples in a row in which the same is off, from which on they may have one cause."""
_MOST_OF_CHANNEL = 0.5
"""Part of the samples of a chunk beyond which what is off in a cell is no spike but an error that
stays."""
_OFF = float(np.sqrt(chi2_quantile(1 - 5e-7, DIRECTIONS)))
"""Length of a residual that chance reaches as seldom as a reading its five 1-sigma."""
_USUAL = float(np.sqrt(chi2_quantile(0.5, DIRECTIONS)))
"""Median length of a residual that is noise."""
_AROUND = 4
"""Samples before and after one that it is held against: where these are off, too, it does not stand
alone."""
_AT_THE_EDGE = 2.0
"""By how much further the first and the last sample of a chunk may be off as a whole: the motion is
told from one side only there."""
_WHOLE = 2
"""Samples in a row that may be off as a whole, as where a message is damaged: a hand takes
longer."""


def without_spikes(
    look: Callable[[Forces], Sequence[WhitenedBalance]],
    balances: Sequence[WhitenedBalance],
    forces: Forces,
    settings: FitSettings,
) -> Forces:
    """Forces of a chunk without readings that stand alone about a motion that is known; the very
    same where none does.

    Args:
        look: Makes the balances of forces about that motion.
        balances: Those of the forces as they are.
        forces: Of the chunk.
        settings: With what stands out.
    """
    found = forces
    whole = np.zeros(len(forces.time), dtype=bool)
    for _ in range(TURNS):
        every = _off(balances)
        if not any(each.stands_out(settings) for each in every):
            break
        single = np.concatenate([each.single(settings) for each in every]) & ~found.left_out
        whole = np.concatenate([each.whole for each in every]) & ~single.any(axis=1)
        if not single.any():
            break
        found = replace(found.bridged(single), left_out=found.left_out | single)
        balances = look(found)
    return left_out_of(forces, found.left_out & ~forces.left_out, whole, settings)


def stands_out(balances: Sequence[WhitenedBalance], settings: FitSettings) -> bool:
    """Whether any sample of a chunk is so far off that a reading of it may stand alone."""
    return any(each.stands_out(settings) for each in _off(balances))


def left_out_of(forces: Forces, single: Mask, whole: Mask, settings: FitSettings) -> Forces:
    """Forces without what is off, as far as no change of the load, no hand and no cell that has
    gone wrong may look like that; the very same where nothing is left out.

    Args:
        forces: Of a chunk.
        single: Readings that stand alone, shape (n, r).
        whole: Samples that are off as a whole, shape (n,).
        settings: With what stands out.
    """
    single = single & ~forces.left_out
    single &= single.mean(axis=0) <= _MOST_OF_CHANNEL
    many = single.sum(axis=1) > max(1.0, _MOST_OF_SAMPLE * single.shape[1])
    whole = (whole | many) & ~forces.touched
    single &= ~whole[:, None]
    off = single.any(axis=1) | whole
    for first, last in stretches(off):
        own, every = single[first:last], bool(whole[first:last].mean() >= _ALIKE)
        one = np.count_nonzero(own.any(axis=0)) == 1 and not whole[first:last].any()
        if one or not (every or own.mean(axis=0).max() >= _ALIKE):
            # Of one cell, or of another one in every sample.
            continue
        at_the_end = last == len(off) and last - first >= settings.contact_samples
        if at_the_end or last - first >= 2 * settings.contact_samples:
            single[first:last], whole[first:last] = False, False
    for first, last in stretches(whole):
        # What goes on, or may do so in the next chunk, is another load or a hand.
        if last - first > (_WHOLE if last < len(off) else 1):
            whole[first:last] = False
    left_out = forces.left_out | single | whole[:, None]
    if np.array_equal(left_out, forces.left_out):
        return forces
    return replace(forces.bridged(left_out & ~forces.left_out), left_out=left_out)


def any_of(alone: Sequence[Mask]) -> bool:
    """Whether anything is left out of some readings."""
    return any(bool(each.any()) for each in alone)


def without_readings(segment: Segment, alone: Sequence[Mask]) -> Segment:
    """A chunk without readings of its motion instruments; the very same where all stay.

    Args:
        segment: The chunk.
        alone: What is left out of each of its readings, shape (n, k), k numbers a sample.
    """
    if not any_of(alone):
        return segment
    readings = zip(segment.readings, alone, strict=True)
    return replace(segment, readings=tuple(_fewer(each, mask) for each, mask in readings))


def _fewer(reading: Reading, alone: Mask) -> Reading:
    """A reading without some of its numbers; a rotation is there as a whole or not at all."""
    if reading.values.ndim == alone.ndim:
        return replace(reading, values=np.where(alone, np.nan, reading.values))
    kept = ~alone.any(axis=1)
    late, tension = reading.late, reading.tension
    return replace(
        reading,
        time=reading.time[kept],
        values=reading.values[kept],
        late=None if late is None else late[kept],
        tension=None if tension is None else tension[kept],
    )


def numbers_of(segment: Segment, forces: Forces) -> dict[Source, int]:
    """How many numbers of every quantity of a chunk count; a rotation is one."""
    found = {}
    for each in segment.readings:
        rotations = each.values.ndim > 2
        found[each.source] = len(each.time) if rotations else int(np.isfinite(each.values).sum())
    for quantity, own in forces.places.items():
        found[forces.name, quantity] = int((~forces.left_out[:, own]).sum())
    return found


def forces_alone(alone: Mapping[tuple[str, Source], int], force: str) -> dict[str, int]:
    """Run -> force readings that stood alone.

    Args:
        alone: Run and quantity -> numbers that did.
        force: Name of the force instrument.
    """
    found: dict[str, int] = {}
    for (run, (name, _)), count in alone.items():
        if name == force:
            found[run] = found.get(run, 0) + count
    return found


def motion_alone_in_words(alone: Mapping[tuple[str, Source], int], force: str) -> Iterator[str]:
    """What was left out of the motion's instruments; arguments as of :func:`forces_alone`."""
    for (run, (name, quantity)), count in alone.items():
        if name != force:
            yield (
                f"run '{run}': {count} numbers of {name}, {quantity.replace('_', ' ')}, stand alone"
                " against all others: left out"
            )


def far_from(segment: Segment, rows: Sequence[Rows], settings: FitSettings) -> list[Mask]:
    """Numbers of the motion instruments that stand far from a motion that is known, of each of the
    readings of a chunk, shape (n, k) each; where many of one quantity do and those of all others
    are near, it has jumped, else none of that quantity.

    Args:
        segment: The chunk.
        rows: Of it; Huber's weights have been taken into the residuals.
        settings: With what is far.
    """
    # Those of the motion instruments are the first, in the order of the readings.
    far = [np.abs(each.residual) > settings.lost for each in rows[: len(segment.readings)]]
    few = [few_or_none(each) for each in far]
    many = [i for i, each in enumerate(far) if each.any() and not few[i].any()]
    if len(many) == 1 and len(far) > 1:
        (jumped,) = many
        few[jumped] = far[jumped]
    return few


def few_or_none(far: Mask) -> Mask:
    """Numbers of a quantity that are far; none where many are.

    Args:
        far: Shape (n, k).
    """
    few = max(_FEW * far.shape[1], MOST_FAR * far.size)
    return far if np.count_nonzero(far) <= few else np.zeros_like(far)


@dataclass(frozen=True, eq=False)
class _Off:
    """How far samples are off, in units of what is usual where that is more than noise makes."""

    alone: Array
    """Correction of every reading by itself, in its own 1-sigma, shape (n, r)."""
    size: Array
    """Length of the residual of every sample, shape (n,)."""

    @classmethod
    def of(cls, at: Balance, heard: Mask) -> _Off:
        """About a motion.

        Args:
            at: The balance there.
            heard: Samples that count, shape (n,).
        """
        count = at.noise.readings
        size = np.where(heard, at.size, 0.0)
        own = np.maximum(at.noise.decided[:, :count], LEAST_OWN)
        alone = np.where(heard[:, None], np.abs(at.correction[:, :count]), 0.0) / np.sqrt(own)
        level = np.maximum(1.0, usual(size, heard))
        return cls(alone / level[:, None], size / level)

    @property
    def whole(self) -> Mask:
        """Samples that are off as a whole, shape (n,)."""
        edge = np.isin(np.arange(len(self.size)), [0, len(self.size) - 1])
        return np.asarray(self.size > np.where(edge, _AT_THE_EDGE * _OFF, _OFF))

    def stands_out(self, settings: FitSettings) -> bool:
        """Whether any sample is so far off that a reading of it may stand alone."""
        return bool((self.alone > settings.alone).any() or self.whole.any())

    def single(self, settings: FitSettings) -> Mask:
        """Readings that explain all that is left of their sample, shape (n, r)."""
        worst, largest, rest = farthest(self.alone, self.size)
        near = np.maximum(limit(DIRECTIONS - 1), _NEAR * largest)
        explains = (largest > settings.alone) & (rest < near)
        found = np.zeros(self.alone.shape, dtype=bool)
        found[np.flatnonzero(explains), worst[explains]] = True
        return found


def usual(size: Array, heard: Mask) -> Array:
    """What is usual for samples, in that of noise: in their chunk and about them, shape (n,).

    Args:
        size: Length of the residual of every sample, shape (n,).
        heard: Samples that count, shape (n,).
    """
    if not heard.any():
        return np.ones(len(size))
    shown = np.where(heard, size, np.nan)
    about = sliding_window_view(np.pad(shown, _AROUND, constant_values=np.nan), 2 * _AROUND + 1)
    return np.asarray(np.fmax(np.nanmedian(shown), np.nanmedian(about, axis=1)) / _USUAL)


def _off(balances: Sequence[WhitenedBalance]) -> list[_Off]:
    """How far the samples of balances are off."""
    return [_Off.of(each.at, each.root > 0) for each in balances]
