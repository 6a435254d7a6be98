"""A chunk that arrives: it finds its motion, and is linearised until it has settled."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from steelyard.arrays import Array
from steelyard.identification.model.balance import UNMODELLED, Forces
from steelyard.identification.model.calibration_parameters import ROBOT
from steelyard.identification.model.motion_residuals import motion_residuals
from steelyard.identification.model.motion_segment import Reading, Segment
from steelyard.identification.model.segment import Rows
from steelyard.identification.recursive.recursion import Recursion
from steelyard.identification.recursive.window.past import scaled
from steelyard.identification.solve.fit_state import FitState
from steelyard.identification.solve.misfits.jitter import with_jitter
from steelyard.identification.solve.segment_equations import whitened_rows

_WIDE = 1e4
"""By how much readings are taken as noisier where none of them is to stand far; what they say counts
the same."""


def arrived(
    recursion: Recursion, readings: Sequence[Reading], forces: Forces, motion: Array | None = None
) -> Recursion:
    """With one more chunk.

    Args:
        recursion: With a window.
        readings: Of the motion instruments within it.
        forces: Within it.
        motion: Coefficients as the beginning has them, shape (f, block): body and calibration,
            which the beginning knows better than the chunks so far, stay where they are; None:
            the motion goes on as it does.

    Raises:
        numpy.linalg.LinAlgError: The motion is not determined.
    """
    assert recursion.window is not None
    longer = recursion.window.longer(motion)
    number = len(longer.chunks)
    segment = longer.segment(number, tuple(readings))
    here, held = replace(recursion, window=longer), motion is not None
    if not held:
        here = _foreseen(here, segment, forces)
    settled = False
    for _ in range(recursion.settings.turns):
        assert here.window is not None
        segment = replace(segment, coefficients=here.window.motion[longer.place(number)])
        segment, forces = _with_jitter(here, segment, forces)
        if not held and here.window.lively is not None:
            segment = here.window.lively.at_least(segment, longer.grid.intervals)
        _, rows = whitened_rows(here.task, here.state, segment, forces, border="estimated")
        here = here.with_chunk(segment, forces, rows, number)
        here, promised = here.followed() if held else here.stepped()
        settled = promised < recursion.settings.arrived
        if settled:
            break
    if held:
        here = here.known()
    return here if settled else replace(here, unsettled=here.unsettled + 1)


def _foreseen(recursion: Recursion, segment: Segment, forces: Forces) -> Recursion:
    """With a motion of the last chunk that its own instruments show, and then the forces with them;
    what a motion that merely goes on is off by must not count as a reading that stands far.

    Args:
        recursion: With a window that has coefficients for it.
        segment: The chunk.
        forces: Within it.
    """
    assert recursion.window is not None
    here, number = recursion, len(recursion.window.chunks)
    task, place = recursion.task, recursion.window.place(number)
    wide = _wide(recursion.state, segment, forces)
    held = np.full(len(task.calibration_parameters), -1, dtype=np.intp)
    for _ in range(recursion.settings.foresights):
        assert here.window is not None
        segment = replace(segment, coefficients=here.window.motion[place])
        rows = motion_residuals(
            task.experiment, segment, wide.calibration, held, wide.factors, None, narrow=True
        )
        here = here.with_chunk(segment, forces, _told(rows), number)
        here, promised = here.followed()
        if promised < recursion.settings.arrived:
            break
    assert here.window is not None
    if len(forces.time):
        # Readings of the motion hardly tell how it accelerates at its end, where forces do.
        segment = replace(segment, coefficients=here.window.motion[place])
        _, balanced = whitened_rows(task, wide, segment, forces, border="held")
        here = here.with_chunk(segment, forces, _told(balanced), number)
        here, _ = here.followed()
    assert here.window is not None
    return replace(here, window=replace(here.window, chunks=recursion.window.chunks))


def _told(rows: Iterable[Rows]) -> list[Rows]:
    """What readings that are taken as noisier say as they are; what holds a motion that no instrument
    tells is none of them.
    """
    return [each if each.label is None else scaled(each, _WIDE) for each in rows]


def _wide(state: FitState, segment: Segment, forces: Forces) -> FitState:
    """A state in which all readings of a chunk are so noisy that none of them stands far."""
    sources = [each.source for each in segment.readings]
    sources += [(forces.name, quantity) for quantity in forces.readings]
    sources.append((ROBOT, UNMODELLED))
    wide = {each: _WIDE * state.factors.get(each, 1.0) for each in sources}
    return replace(state, factors={**state.factors, **wide})


def _with_jitter(recursion: Recursion, segment: Segment, forces: Forces) -> tuple[Segment, Forces]:
    """Readings as noisy as their time stamps make them along a motion that is nearly right."""
    task, state = with_jitter(
        replace(recursion.task, force_samples=(forces,)),
        replace(recursion.state, segments=(segment,)),
    )
    return state.segments[0], task.force_samples[0] or forces
