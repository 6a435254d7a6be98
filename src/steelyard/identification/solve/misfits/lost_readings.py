"""Motion instruments that have lost the motion: a tracker that holds its last value, a channel that
runs away.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array, stretches
from steelyard.experiment.faults.stuck import repeats
from steelyard.experiment.model import Experiment
from steelyard.identification.model.motion_residuals import motion_residuals
from steelyard.identification.model.segment import Label
from steelyard.identification.solve.fit_state import FitState
from steelyard.identification.solve.settings import FIT, FitSettings


def without_lost(
    experiment: Experiment, state: FitState, *, arrived: bool, settings: FitSettings = FIT
) -> tuple[FitState, list[str]]:
    """Without readings that stand far from the motion many times in a row: a tracker that holds its
    last value, a frozen channel.
    """
    nowhere = np.full(len(state.calibration.calibration_parameters), -1)
    segments, notes = [], []
    for segment in state.segments:
        readings = {reading.source: [reading] for reading in segment.readings}
        masks: dict[Label, list[NDArray[np.bool_]]] = {}
        if not segment.static:
            for rows in motion_residuals(
                experiment, segment, state.calibration, nowhere, state.factors, None
            ):
                if rows.label in readings:
                    # Huber's weights have been taken into the residual: one that stands far has
                    # length above its limit.
                    masks.setdefault(rows.label, []).append(
                        np.any(np.abs(rows.residual) > settings.lost, axis=1)
                    )
        kept = []
        for reading in segment.readings:
            far = np.concatenate(
                masks.get(reading.source, [np.zeros(len(reading.time), dtype=bool)])
            )
            # What repeats itself is lost as a whole; of a motion that is not yet right sound
            # readings stand far too.
            lost = _frozen(reading.values, far)
            if arrived:
                lost |= _runs_of(far, settings)
            if not lost.any() or lost.mean() > 0.5:
                kept.append(reading)
                continue
            time = reading.time[lost]
            notes.append(
                f"run '{segment.run}': {reading.source[1].replace('_', ' ')} of {reading.source[0]}"
                f" has lost the motion between {time[0]:.2f} and {time[-1]:.2f} s ({lost.sum()}"
                " samples): left out"
            )
            tension = None if reading.tension is None else reading.tension[~lost]
            kept.append(
                replace(
                    reading, time=reading.time[~lost], values=reading.values[~lost], tension=tension
                )
            )
        segments.append(replace(segment, readings=tuple(kept)))
    return replace(state, segments=tuple(segments)), notes


def _frozen(values: Array, far: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Readings that stay the same many times in a row and stand far at least once, shape (n,)."""
    found = np.zeros(len(values), dtype=bool)
    # The first of them was still a reading.
    for first, last in repeats(values.reshape(len(values), -1)):
        if far[first:last].any():
            found[first:last] = True
    return found


def _runs_of(far: NDArray[np.bool_], settings: FitSettings) -> NDArray[np.bool_]:
    """Where many in a row are far, and those beside them."""
    found = np.zeros(len(far), dtype=bool)
    for first, last in stretches(far):
        if last - first >= settings.lost_samples:
            found[max(0, first - settings.lost_margin) : last + settings.lost_margin] = True
    return found
