"""A chunk that arrives: it finds its motion, and is linearised until it has settled; readings that
stand alone are left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from steelyard.arrays import Array
from steelyard.identification.model.balance import Forces, balance_of
from steelyard.identification.model.force_residuals import WhitenedBalance
from steelyard.identification.model.motion_segment import Reading, Segment
from steelyard.identification.model.segment import Rows
from steelyard.identification.recursive.arriving.foresight import foreseen, foreseen_without_spikes
from steelyard.identification.recursive.arriving.spikes import (
    far_from,
    numbers_of,
    stands_out,
    without_readings,
    without_spikes,
)
from steelyard.identification.recursive.recursion import Recursion
from steelyard.identification.solve.border.segment_equations import whitened_rows
from steelyard.identification.solve.misfits.jitter import with_jitter
from steelyard.identification.solve.settings import FitSettings

_SAME_MEMORY = 0.02
"""By how much what rollers remember may differ from what a chunk was linearised with: of some
newtons of friction that is less than noise."""


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
    number, fit = len(longer.chunks), recursion.task.settings
    segment = longer.segment(number, tuple(readings))
    here, held = replace(recursion, window=longer), motion is not None
    forces = _remembering(here, number, forces)
    before, every = here, numbers_of(segment, forces)
    if motion is not None:
        # The beginning has found it as a whole, without what stands far.
        along = _AlongMotion.of(here, segment, forces, motion, held=True)
        forces = along.without_spikes(here, fit)
        segment = without_readings(segment, far_from(segment, along.rows, fit))
    else:
        here = foreseen(here, segment, forces)
    settled = known = False
    own = recursion.settings
    for turn in range(own.turns_of_beginning if held else own.turns):
        chunk = _AlongMotion.of(here, segment, forces, held=held)
        if turn == 0 and not held and chunk.may_be_bent(fit):
            again = foreseen_without_spikes(before, segment, forces)
            if again is not None:
                here, segment, forces = again
                chunk = _AlongMotion.of(here, segment, forces, held=held)
        if known:
            heard = chunk.without_spikes(here, fit)
            if heard is not chunk.forces:
                chunk = _AlongMotion.of(here, chunk.segment, heard, held=held)
            elif settled:
                break
        segment, forces = chunk.segment, chunk.forces
        here = here.with_chunk(segment, forces, chunk.rows, number)
        here, promised = here.followed() if held else here.stepped()
        settled = promised < recursion.settings.arrived
        remembering = forces if held else _remembering(here, number, forces)
        if remembering is not forces:
            # The chunk has told better how the one before ended.
            forces, settled = remembering, False
        # About a motion that has settled it is looked once more what stands alone.
        if settled and (known or not stands_out(chunk.balances, fit)):
            break
        known = known or settled
    if held:
        here = here.known()
    here = here.without_numbers(segment.run, every, numbers_of(segment, forces))
    return here if settled else replace(here, unsettled=here.unsettled + 1)


def beyond_noise(recursion: Recursion) -> float:
    """Variance of what the last chunk leaves of the instruments of the motion, beyond that of their
    noise and in units of it, of all quantities together.
    """
    assert recursion.window is not None
    last = recursion.window.chunks[-1]
    read = last.rows[: len(last.segment.readings)]
    return sum(max(float(np.mean(each.residual**2)) - 1.0, 0.0) for each in read)


@dataclass(frozen=True, eq=False)
class _AlongMotion:
    """The last chunk, linearised along a motion."""

    segment: Segment
    forces: Forces
    balances: Sequence[WhitenedBalance]
    rows: Sequence[Rows]

    @classmethod
    def of(
        cls,
        recursion: Recursion,
        segment: Segment,
        forces: Forces,
        motion: Array | None = None,
        *,
        held: bool,
    ) -> _AlongMotion:
        """About the motion of a window, or another one, as noisy and as lively as it is there."""
        window = recursion.window
        assert window is not None
        own = window.motion[-window.grid.functions :] if motion is None else motion
        segment, forces = _with_jitter(recursion, replace(segment, coefficients=own), forces)
        if not held and window.lively is not None:
            segment = window.lively.at_least(segment, window.grid.intervals)
        balances, rows = whitened_rows(
            recursion.task, recursion.state, segment, forces, border="estimated"
        )
        return cls(segment, forces, balances, rows)

    def without_spikes(self, recursion: Recursion, settings: FitSettings) -> Forces:
        """The forces without readings that stand alone about this motion; the very same where none
        does.
        """

        def look(forces: Forces) -> Sequence[WhitenedBalance]:
            task, state = recursion.task, recursion.state
            return whitened_rows(task, state, self.segment, forces, border="held")[0]

        return without_spikes(look, self.balances, self.forces, settings)

    def may_be_bent(self, settings: FitSettings) -> bool:
        """Whether any reading stands so far from the motion that it may have bent it."""
        read = self.rows[: len(self.segment.readings)]
        far = any(bool((np.abs(each.residual) > settings.lost).any()) for each in read)
        return far or stands_out(self.balances, settings)


def _remembering(recursion: Recursion, number: int, forces: Forces) -> Forces:
    """Forces of a chunk with what rollers remember of the one before; the very same where that is
    known already.

    Args:
        recursion: With a window.
        number: Of the chunk in it.
        forces: Within it.
    """
    window, experiment, state = recursion.window, recursion.task.experiment, recursion.state
    assert window is not None
    if not number or not experiment.instruments[forces.name].remembers:
        return forces
    before = window.chunks[number - 1]
    segment = replace(before.segment, coefficients=window.motion[window.place(number - 1)])
    assert state.parameters is not None
    calibration, body = state.calibration, state.parameters
    at = balance_of(experiment, segment, before.forces, calibration, body, state.factors)
    if at.rolled is None or not len(at.time):
        return forces
    now, last = at.rolled.last, forces.before
    if last is not None and np.abs(now.value - last.value).max() < _SAME_MEMORY:
        return forces
    return replace(forces, before=now)


def _with_jitter(recursion: Recursion, segment: Segment, forces: Forces) -> tuple[Segment, Forces]:
    """Readings as noisy as their time stamps make them along a motion that is nearly right."""
    task, state = with_jitter(
        replace(recursion.task, force_samples=(forces,)),
        replace(recursion.state, segments=(segment,)),
    )
    return state.segments[0], task.force_samples[0] or forces
