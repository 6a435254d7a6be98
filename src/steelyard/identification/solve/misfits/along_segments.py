"""What the disturbances of a fit are along its segments."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from steelyard.arrays import Array
from steelyard.identification.model.motion_segment import Reading, Segment
from steelyard.identification.model.processes import Process
from steelyard.identification.solve.fit_state import FitState, Task

_INSTANTS = 500
"""Along a segment, at which the size of its disturbances is looked at."""


def every_along(segment: Segment) -> Iterator[tuple[Process, Array]]:
    """Disturbances of a segment, and what they are at instants along it in SI units, shape (t, p)
    each.
    """
    if segment.static:
        return
    local = segment.basis(np.linspace(*segment.span, _INSTANTS))
    for each in segment.processes:
        yield each, np.asarray(segment.disturbance(each, local))


def unstated_along(segment: Segment) -> Iterator[tuple[Process, Array]]:
    """Those that nobody has stated, see :func:`every_along`."""
    return ((each, along) for each, along in every_along(segment) if not each.is_stated)


def disturbed_readings(
    segment: Segment, process: Process
) -> Iterator[tuple[Reading, Array, Array, Array]]:
    """What a process disturbs along its segment: a reading, its n times within it [s], its values
    there, shape (n, k), and by how much these depart for the process, shape (n, k); nothing of
    rotations.
    """
    for reading in segment.readings:
        if reading.source != process.disturbs or reading.values.ndim != 2:
            continue
        inside = segment.holds(reading.time) & np.isfinite(reading.values).all(axis=1)
        time = reading.time[inside]
        # Residuals are readings less what the motion has, and a disturbance is added to them.
        departs = -np.asarray(segment.disturbance(process, segment.basis(time)))
        yield reading, time, reading.values[inside], departs


def root_mean_square(along: Array) -> Array:
    """Of something along a segment, shape (p,).

    Args:
        along: At instants, shape (t, p).
    """
    return np.asarray(np.sqrt(np.mean(along**2, axis=0)))


def too_large(task: Task, state: FitState) -> bool:
    """Whether a motion instrument is disturbed by more than devices are: its description is
    wrong.
    """
    for segment in state.segments:
        for process, along in unstated_along(segment):
            rms = root_mean_square(along)
            owner, name = process.disturbs
            unit = task.experiment.instruments[owner].quantity(name, task.experiment.robot.m).unit
            if rms.max() > task.settings.largest_disturbance.get(unit, np.inf):
                return True
    return False
