"""Readings of an instrument looked at where the motion of a segment is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from steelyard.arrays import Array
from steelyard.experiment.model import Experiment
from steelyard.identification.model.calibration_parameters import CalibrationValues
from steelyard.identification.model.motion_segment import Reading, Segment
from steelyard.identification.model.reading_times import time_of
from steelyard.identification.model.segment import Basis, motion_at
from steelyard.identification.model.tensions.followed import Carried
from steelyard.instruments.equations import linearised


class Seen:
    """The motion of a segment at the times at which it was looked at last: the quantities of one
    instrument are read together.
    """

    def __init__(self) -> None:
        self._segment: Segment | None = None
        self._times = np.empty(0)

    def at(self, segment: Segment, times: Array) -> tuple[Basis, tuple[Array, Array, Array, Array]]:
        """Spline functions at times, and the motion there; see :func:`.motion_at`.

        Args:
            segment: With its motion.
            times: Within it [s], shape (n,).
        """
        if self._segment is not segment or not np.array_equal(self._times, times):
            self._segment, self._times = segment, times
            self._local = segment.basis(times)
            self._motion = motion_at(self._local, segment.coefficients)
        return self._local, self._motion


def looked_at(
    experiment: Experiment,
    segment: Segment,
    reading: Reading,
    part: slice,
    calibration: CalibrationValues,
    references: Mapping[str, str],
    carried: Carried | None = None,
    seen: Seen | None = None,
    asked: frozenset[str] | None = None,
) -> tuple[Array, Basis, tuple[Array, Array, Array, Array], Mapping[str, Array]]:
    """Readings against the motion: their times within the segment [s], the spline there, the
    motion, and the linearised difference.

    See :func:`steelyard.instruments.equations.linearised` for the last.

    Args:
        experiment: With its instruments.
        segment: With its present motion.
        reading: Within it.
        part: Of its samples.
        calibration: Present values of the systematic errors.
        references: See :func:`.reference_clocks`.
        carried: See :func:`.motion_residuals`.
        seen: The motion where the readings before were looked at; is changed.
        asked: By what there are derivatives, see :func:`.difference_of`; None: by all.
    """
    name, quantity = reading.source
    instrument = experiment.instruments[name]
    times = reading.time[part]
    if not segment.static:
        times, *_ = time_of(experiment, segment, calibration, references, name, times)
    local, motion = (Seen() if seen is None else seen).at(segment, times)
    errors = list(calibration.of(name, instrument, segment.run).values())
    tension = None if reading.tension is None else reading.tension[part]
    if carried is not None and reading.follows:
        tension = carried(times).values
    linear = linearised(
        instrument,
        quantity,
        experiment.robot,
        reading.values[part],
        motion[:3],
        np.concatenate(errors) if errors else np.zeros(1),
        calibration.gravity,
        tension,
        calibration.geometry,
        asked,
    )
    return times, local, motion, linear


def rate_along(by: Sequence[Array], motion: Sequence[Array]) -> Array:
    """By how much something changes in a second as the platform moves, shape (n, k).

    Args:
        by: Its derivatives by pose, rate and acceleration, shape (n, k, 7) each.
        motion: Pose and its first three time derivatives, shape (n, 7) each.
    """
    parts = [np.einsum("nki,ni->nk", j, rate) for j, rate in zip(by, motion[1:], strict=True)]
    return np.asarray(sum(parts))
