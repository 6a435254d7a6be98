"""How the linearised balance follows what matters in motion only: delays of clocks, latencies, the
time constant of a filter, the inertia of the cables.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from steelyard.arrays import Array
from steelyard.identification.model.balance import unmodelled_processes
from steelyard.identification.model.balance.linearised import BalancePoint
from steelyard.identification.model.border import ByParameters
from steelyard.identification.model.calibration_parameters import DRAG, ROBOT
from steelyard.identification.model.looked_at import rate_along
from steelyard.identification.model.reading_times import reference_clocks, time_of
from steelyard.instruments.base import TIME_CONSTANT
from steelyard.robot.model import DIRECTIONS


def delays(point: BalancePoint) -> Iterator[tuple[slice, float]]:
    """Delays of clocks and latencies, and by how much of each the readings belong to a motion of
    earlier.
    """
    name, parameters = point.force_samples.name, point.calibration.calibration_parameters
    _, clock, origin = time_of(
        point.experiment,
        point.segment,
        point.calibration,
        reference_clocks(point.experiment, parameters, point.segment),
        name,
        point.force_samples.time,
    )
    if clock != origin:
        yield clock, 1.0
        yield origin, -1.0
    if latency := parameters.place_of_latency(name):
        yield latency, 1.0


def place_of_filter(point: BalancePoint) -> slice | None:
    """Of the time constant of the filter; None: there is none."""
    places = point.calibration.calibration_parameters.places_of(
        point.force_samples.name, point.instrument, point.segment.run
    )
    return places.get(TIME_CONSTANT)


def by_moving(point: BalancePoint, by: tuple[Array, Array, Array]) -> ByParameters:
    """Derivatives of the balance by what matters in motion only: delays of the clocks, the time
    constant of a filter, the inertia of the cables.
    """
    segment = point.segment
    if segment.static:
        return
    by_delay, by_filter = (each + _by_processes_of_earlier(point) for each in _by_time(point, by))
    later = by_delay[:, :, None]
    for place, sign in delays(point):
        yield place, sign * later
    if (of_filter := place_of_filter(point)) is not None:
        yield of_filter, by_filter[:, :, None]
    parameters = point.calibration.calibration_parameters
    drag = parameters.places[ROBOT, DRAG, None]
    if point.asks(drag):
        yield drag, point.derivatives["by_drag"][:, :, None]


def _by_time(point: BalancePoint, by: tuple[Array, Array, Array]) -> tuple[Array, Array]:
    """Derivatives of the balance by a delay and by the time constant of a filter, without those
    through processes, shape (n, 6) each.
    """
    behind, alone = point.at.behind, -rate_along(by, point.motion)
    if behind is None:
        return alone, alone
    by_delay, by_filter = behind.by_delay, behind.by_constant
    if point.constant < 0:
        by_delay, by_filter = 2 * alone - by_delay, 2 * alone + by_filter - 2 * by_delay
    measured = point.at.measured
    return measured.behind_filter(alone, by_delay), measured.behind_filter(alone, by_filter)


def _by_processes_of_earlier(point: BalancePoint) -> Array:
    """Derivative of the balance by a delay through the processes beside it, shape (n, 6)."""
    segment = point.segment
    found = np.zeros((len(point.at.time), DIRECTIONS))
    changes = unmodelled_processes(segment, point.local, point.at.motion["rotation"], 1)
    if changes.any():
        found += np.einsum("nij,nj->ni", point.at.measured.unmodelled.wrench, changes)
    for each, _, own in point.of_readings():
        rate = segment.disturbance(each, point.local, 1)
        found += np.einsum("nij,nj->ni", point.at.by_reading[:, :, own], rate)
    return found
