"""The motion of a chunk that has just arrived, before its readings are taken as they count: what a
motion that merely goes on is off by must not count as a reading that stands far.

Where a reading stands far about that motion, it may have bent it; the motion is found again without
what stands alone then.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from steelyard.arrays import Array
from steelyard.identification.model.balance import UNMODELLED, Forces
from steelyard.identification.model.calibration_parameters import ROBOT
from steelyard.identification.model.force_residuals import WhitenedBalance
from steelyard.identification.model.motion_residuals import motion_residuals
from steelyard.identification.model.motion_segment import Segment
from steelyard.identification.model.segment import Rows
from steelyard.identification.recursive.arriving.deletion import Deletion, Foreknown
from steelyard.identification.recursive.arriving.spikes import (
    TURNS,
    Mask,
    any_of,
    few_or_none,
    left_out_of,
    without_readings,
)
from steelyard.identification.recursive.recursion import Recursion
from steelyard.identification.recursive.window.past import scaled
from steelyard.identification.solve.border.segment_equations import whitened_rows
from steelyard.identification.solve.fit_state import FitState

_WIDE = 1e4
"""By how much readings are taken as noisier where none of them is to stand far; what they say
counts the same."""
_TURNS = 2
"""Linearisations of what the motion's own instruments read: along the first it merely goes on."""


def foreseen(recursion: Recursion, segment: Segment, forces: Forces) -> Recursion:
    """With a motion of the last chunk that its own instruments show, and then the forces with them.

    Args:
        recursion: With a window that has coefficients for it.
        segment: The chunk.
        forces: Within it.
    """
    here, wide = recursion, _wide(recursion.state, segment, forces)
    for _ in range(recursion.settings.foresights):
        here, promised = _followed(here, segment, forces, _of_motion(here, segment, wide))
        if promised < recursion.settings.arrived:
            break
    if len(forces.time):
        # Readings of the motion hardly tell how it accelerates at its end, where forces do.
        _, rows = _of_all(here, segment, forces, wide)
        here, _ = _followed(here, segment, forces, rows)
    return here


def foreseen_without_spikes(
    recursion: Recursion, segment: Segment, forces: Forces
) -> tuple[Recursion, Segment, Forces] | None:
    """The same without readings that stand alone, and chunk and forces without these; None: none
    does.

    Args:
        recursion: As of :func:`foreseen`.
        segment: The chunk.
        forces: Within it.

    Raises:
        numpy.linalg.LinAlgError: The motion is not determined.
    """
    wide, level = _wide(recursion.state, segment, forces), recursion.task.settings.alone
    here, jumped = _without_jump(recursion, segment, forces, wide)
    whole, segment = segment, without_readings(segment, jumped)
    alone = list[Mask]()
    for _ in range(_TURNS):
        rows = _of_motion(here, segment, wide)
        asked = Deletion.of(_foreknown(here, segment, forces, rows), _read(rows), ())
        alone = _few(asked.alone(level).motion, _read(rows))
        here, _ = _followed(here, segment, forces, _without(rows, alone))
    single = np.zeros_like(forces.left_out)
    # With the forces it is seen better what the motion's instruments have read.
    for _ in range(TURNS if len(forces.time) else 0):
        shown = forces.bridged(single)
        balances, rows = _of_all(here, segment, shown, wide)
        read, known = _read(rows)[: len(alone)], _foreknown(here, segment, forces, rows)
        beside = _apart(forces, shown) / forces.sigmas(segment, recursion.state.factors)
        found = Deletion.of(known, read, balances, _WIDE, beside).alone(level)
        alone, before, single = _few(found.motion, read), single, found.single & ~forces.left_out
        if np.array_equal(single, before):
            break
    none = np.zeros(len(forces.time), dtype=bool)
    kept = left_out_of(forces, single, none, recursion.task.settings)
    if segment is whole and kept is forces and not any_of(alone):
        return None
    if len(forces.time):
        _, rows = _of_all(here, segment, kept, wide)
        here, _ = _followed(here, segment, kept, _without(rows, alone))
    return here, without_readings(segment, alone), kept


def _without_jump(
    recursion: Recursion, segment: Segment, forces: Forces, wide: FitState
) -> tuple[Recursion, list[Mask]]:
    """The motion without what has been read while an instrument had jumped, and those numbers, of
    each of the readings of a chunk, shape (n, k) each.

    Args:
        recursion: As of :func:`foreseen`.
        segment: The chunk.
        forces: Within it.
        wide: State in which no reading stands far.

    Raises:
        numpy.linalg.LinAlgError: The motion is not determined.
    """
    here, level = recursion, recursion.task.settings.alone
    jumped = list[Mask]()
    for _ in range(_TURNS):
        rows = _of_motion(here, segment, wide)
        read = _read(rows)
        asked = Deletion.of(_foreknown(here, segment, forces, rows), read, ())
        jumped = _in_parts(asked.jumped(level), read)
        if not any_of(jumped):
            return recursion, jumped
        # What an instrument has read at one time has jumped as a whole.
        jumped = [np.broadcast_to(each.any(axis=1, keepdims=True), each.shape) for each in jumped]
        here, _ = _followed(here, segment, forces, _without(rows, jumped))
    return here, jumped


def _apart(forces: Forces, other: Forces) -> Array:
    """By how much readings are more than others, shape (n, r)."""
    both = (np.hstack(list(each.readings.values())) for each in (forces, other))
    return np.asarray(np.subtract(*both))


def _few(alone: Mask, rows: Sequence[Rows]) -> list[Mask]:
    """What stands alone in each of some rows, shape (n, k) each; nothing where that is the rule.

    Args:
        alone: Of all of them, number by number.
        rows: Of the motion's instruments.
    """
    return [few_or_none(each) for each in _in_parts(alone, rows)]


def _in_parts(numbers: Mask, rows: Sequence[Rows]) -> list[Mask]:
    """What is said of all numbers of some rows, of each of these, shape (n, k) each."""
    # Behind the last of them nothing is left.
    *parts, _ = np.split(numbers, np.cumsum([int(each.residual.size) for each in rows]).astype(int))
    return [own.reshape(each.residual.shape) for own, each in zip(parts, rows, strict=True)]


def _read(rows: Sequence[Rows]) -> list[Rows]:
    """Rows of readings, without what holds a motion that no instrument tells."""
    return [each for each in rows if each.label is not None]


def _without(rows: Sequence[Rows], alone: Sequence[Mask]) -> list[Rows]:
    """Rows without numbers that stand alone.

    Args:
        rows: Those of the motion's instruments first.
        alone: Of these, shape (n, k) each.
    """
    kept = [
        replace(
            each,
            residual=np.where(mask, 0.0, each.residual),
            by_motion=np.where(mask[:, :, None], 0.0, each.by_motion),
        )
        for each, mask in zip(rows, alone, strict=False)
    ]
    return [*kept, *rows[len(alone) :]]


def _foreknown(
    recursion: Recursion, segment: Segment, forces: Forces, rows: Sequence[Rows]
) -> Foreknown:
    """What is known of the motion of a chunk without its readings."""
    held = [each for each in rows if each.label is None]
    window = recursion.window
    assert window is not None
    here = recursion.with_chunk(_placed(recursion, segment), forces, held, _number(recursion))
    return Foreknown.of(here.equations, window.grid.functions)


def _followed(
    recursion: Recursion, segment: Segment, forces: Forces, rows: Sequence[Rows]
) -> tuple[Recursion, float]:
    """With the motion that rows of a chunk show, which is not in the window yet; and the decrease
    of the cost that this promised.
    """
    before = recursion.window
    assert before is not None
    here = recursion.with_chunk(_placed(recursion, segment), forces, rows, _number(recursion))
    here, promised = here.followed()
    assert here.window is not None
    return replace(here, window=replace(here.window, chunks=before.chunks)), promised


def _number(recursion: Recursion) -> int:
    """Of the chunk in the window that arrives."""
    assert recursion.window is not None
    return len(recursion.window.chunks)


def _placed(recursion: Recursion, segment: Segment) -> Segment:
    """The chunk along the motion as it is now."""
    window = recursion.window
    assert window is not None
    return replace(segment, coefficients=window.motion[window.place(_number(recursion))])


def _of_motion(recursion: Recursion, segment: Segment, wide: FitState) -> list[Rows]:
    """Rows of the motion's own instruments."""
    task = recursion.task
    held = np.full(len(task.calibration_parameters), -1, dtype=np.intp)
    rows = motion_residuals(
        task.experiment,
        _placed(recursion, segment),
        wide.calibration,
        held,
        wide.factors,
        None,
        narrow=True,
    )
    return _told(rows)


def _of_all(
    recursion: Recursion, segment: Segment, forces: Forces, wide: FitState
) -> tuple[tuple[WhitenedBalance, ...], list[Rows]]:
    """Rows of all instruments, those of the motion first, and the balances."""
    balances, rows = whitened_rows(
        recursion.task, wide, _placed(recursion, segment), forces, border="held"
    )
    return balances, _told(rows)


def _told(rows: Iterable[Rows]) -> list[Rows]:
    """What readings that are taken as noisier say as they are; what holds a motion that no
    instrument tells is none of them.
    """
    return [each if each.label is None else scaled(each, _WIDE) for each in rows]


def _wide(state: FitState, segment: Segment, forces: Forces) -> FitState:
    """A state in which all readings of a chunk are so noisy that none of them stands far."""
    sources = [each.source for each in segment.readings]
    sources += [(forces.name, quantity) for quantity in forces.readings]
    sources.append((ROBOT, UNMODELLED))
    wide = {each: _WIDE * state.factors.get(each, 1.0) for each in sources}
    return replace(state, factors={**state.factors, **wide})
