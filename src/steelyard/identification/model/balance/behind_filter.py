"""Forces against motion behind the filter of the force amplifier, and how that follows the
motion.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.dynamics import platform_regressor
from steelyard.experiment.model import Experiment
from steelyard.identification.model.balance.amplifier_filter import (
    Panels,
    beginning,
    rates_by_motion,
    times_before,
)
from steelyard.identification.model.balance.equations import motion_and_wrench
from steelyard.identification.model.balance.force_readings import Forces
from steelyard.identification.model.balance.measured_force import measured_force
from steelyard.identification.model.balance.moving_body import moving_body
from steelyard.identification.model.balance.rollers import remembered
from steelyard.identification.model.balance.slopes import slopes
from steelyard.identification.model.calibration_parameters import CalibrationValues
from steelyard.identification.model.motion_segment import Segment
from steelyard.identification.model.segment import Basis
from steelyard.robot.model import DIRECTIONS

_NODES = 40
"""Instants in the past at which a filter looks: they pass what is six times as fast as it within a
hundredth."""
_LEAST = 1e-7
"""Weight of an instant, below which it is of no account."""
_FORGOTTEN = 5.0
"""After so long a filter has forgotten what was before, in its time constant: all but a
hundredth."""
_FAST = 0.01
"""Time constant up to which all filters are looked at from the same time on [s]."""
_BEGINNING = 40
"""Readings that tell how they change where they begin."""
_LOOKED_BACK = 4.0
"""How far back the functions of a row reach, in the time constant: a fiftieth of what a filter
leaves is of before."""
_MOST = 8
"""Functions of a row beside those that are not zero at a time: matrices of a motion grow with
them."""


@dataclass(frozen=True, eq=False)
class BehindFilter:
    """What is left over behind the filter, without processes [N], [N m], and how that changes."""

    left_over: Array
    """Shape (n, 6)."""
    by_constant: Array
    """Its derivative by the time constant of the filter, shape (n, 6)."""
    by_delay: Array
    """Its derivative by how far the readings are behind beside that, shape (n, 6)."""
    regressor: Array
    """What the filter leaves of the regressor of the body, shape (n, 6, 10)."""
    told: NDArray[np.bool_]
    """Readings by which the filter has forgotten what was before the motion began, shape (n,)."""

    @classmethod
    def of(
        cls,
        experiment: Experiment,
        segment: Segment,
        force_samples: Forces,
        calibration: CalibrationValues,
        parameters: Array,
        late: Array,
        constant: float,
    ) -> BehindFilter:
        """See :mod:`.amplifier_filter`.

        Args:
            experiment: With robot and instruments.
            segment: With its motion.
            force_samples: Force readings within it, less what processes add to them.
            calibration: Present values of the systematic errors.
            parameters: The ten of the first load, shape (10,).
            late: Times of the readings less the time constant [s], ascending, shape (n,).
            constant: Time constant T of the filter [s], above zero.
        """
        times = late + constant
        before = times_before(times, segment.span[0], constant)
        grid = np.concatenate([before, times])
        own = slice(len(before), None)
        panels = Panels.of(grid, constant, segment.spacing)
        nodes = panels.nodes.ravel()
        local = segment.basis(np.concatenate([nodes, grid]))
        inputs = moving_body(segment, local, calibration, parameters)
        motion = motion_and_wrench(experiment.robot, *calibration.pulling)(**inputs)
        needed = _with_regressor(motion)
        along, here = needed[: len(nodes)], needed[len(nodes) :]
        smoothed, twice = panels.filtered(
            along.reshape(*panels.nodes.shape, -1), beginning(grid, here, constant)
        )
        on_grid = {key: each[len(nodes) :] for key, each in motion.items()}
        read, rates = _pulling(experiment, segment, force_samples, calibration, grid, on_grid)
        slope = slopes(grid[: _BEGINNING + len(before)], rates[: _BEGINNING + len(before)])[:1]
        first = np.concatenate([rates[:1] - constant * slope, rates[:1] - 2 * constant * slope])
        turned, turned_twice = (each[own] for each in panels.filtered_changes(rates, first))
        w, once, again = (each[own, :DIRECTIONS] for each in (here, smoothed, twice))
        return cls(
            read[own] - constant * turned - once,
            (once - again) / constant - turned_twice,
            (w - once) / constant - turned,
            smoothed[own, DIRECTIONS:].reshape(len(times), DIRECTIONS, -1),
            times >= segment.span[0] + forgotten(constant),
        )


def forgotten(constant: float) -> float:
    """How long after the beginning of a motion a filter has forgotten what was before [s]: the same
    for all of up to twice a time constant, so that a fit does not look at fewer readings from step
    to step.

    Args:
        constant: Time constant of the filter [s]; 0: there is none.
    """
    if constant <= 0:
        return 0.0
    doubled = max(0.0, np.ceil(np.log2(constant / _FAST)))
    return float(_FORGOTTEN * _FAST * 2**doubled)


def _pulling(
    experiment: Experiment,
    segment: Segment,
    force_samples: Forces,
    calibration: CalibrationValues,
    grid: Array,
    motion: Mapping[str, Array],
) -> tuple[Array, Array]:
    """Wrench of the readings at some times, of which the last are theirs, and how fast it changes
    because the platform moves, shape (n, 6) each.

    A filter remembers what lies about a reading that is left out, and before the first one that
    they changed as they do there.
    """
    bridged = force_samples.bridged(force_samples.left_out)
    read = np.hstack(list(bridged.readings.values()))
    count = len(grid) - len(read)
    slope = slopes(grid[count:][:_BEGINNING], read[:_BEGINNING])[0]
    ahead = read[0] + slope * (grid[:count] - grid[count])[:, None]
    whole = np.concatenate([ahead, read])
    ends = np.cumsum([each.shape[1] for each in bridged.readings.values()])[:-1]
    readings = dict(zip(bridged.readings, np.split(whole, ends, axis=1), strict=True))
    later = {key: motion[key][count:] for key in ("position", "rotation")}
    rolled = remembered(experiment, segment, bridged, calibration, later)
    if rolled is not None:
        still = np.repeat(rolled.value[:1], count, axis=0)
        motion = {**motion, "rolling": np.concatenate([still, rolled.value])}
    every = replace(bridged, time=grid, readings=readings)
    measured = measured_force(experiment, segment, every, calibration, motion)
    turning = rates_by_motion(grid, measured.wrench, measured.wrench_by_reading, whole)
    return measured.wrench, turning


def _with_regressor(motion: Mapping[str, Array]) -> Array:
    """Wrench that moves the body, and its regressor row by row, shape (n, 66)."""
    regressor = platform_regressor(*(motion[k] for k in ("specific_force", "omega", "alpha")))
    return np.hstack([motion["wrench"], regressor.reshape(len(regressor), -1)])


def functions_behind(
    segment: Segment, late: Array, constant: float, *, wide: bool
) -> tuple[Basis, Basis]:
    """Spline functions by which the balance follows the motion, and those at the late times
    themselves, by which it follows processes; both begin with the same function. Forces and motion
    that balance at an instant are what the filter leaves of both, and how they follow the motion
    changes slowly.

    Of functions before and after those of a row it knows nothing, and takes them for a motion that
    goes on without accelerating: a step is a little off where the filter looks far back, and ends
    at the same motion.

    Args:
        segment: With its knots.
        late: Times of the readings less the time constant [s], shape (n,).
        constant: Time constant T of the filter [s].
        wide: Whether a row has more functions than the six that are not zero at a time, as far as
            the filter looks back.
    """
    back, weights = _instants()
    here = segment.basis(late)
    n, k, width = len(late), len(back), here.values.shape[2]
    first, more = here.first, 0
    if wide:
        more = int(np.ceil(_LOOKED_BACK * constant / segment.spacing))
        more = min(more, _MOST, len(segment.coefficients) - width)
        first = np.maximum(segment.basis(late + constant).first - more, 0)
    asked = late[:, None] + constant * (1 - back)
    past = segment.basis(asked.ravel())
    # Before the beginning all changes as it does there.
    known = (
        past.values[:3] + past.values[1:] * np.minimum(asked.ravel() - segment.span[0], 0)[:, None]
    )
    away = past.first.reshape(n, k) - first[:, None]
    smoothed = known.reshape(3, n, k, width) * weights[:, None]
    values = np.zeros((4, n, width + more))
    for each in np.unique(away):
        own = np.where((away == each)[:, :, None], smoothed, 0.0).sum(axis=2)
        values[:3] += own @ _placed(int(each), width, width + more)
    plain = np.zeros_like(values)
    for each in np.unique(here.first - first):
        own = here.first - first == each
        plain[:, own] = here.values[:, own] @ _placed(int(each), width, width + more)
    return Basis(first, values), Basis(first, plain)


@cache
def _instants() -> tuple[Array, Array]:
    """How long before a reading a filter looks, in its time constant, and the weight of each
    instant, by Gauss and Laguerre's quadrature, shape (k,) each.
    """
    back, weights = np.polynomial.laguerre.laggauss(_NODES)
    own: NDArray[np.bool_] = weights > _LEAST
    return back[own], weights[own]


@cache
def _placed(away: int, width: int, among: int) -> Array:
    """Coefficients of some functions in a row by those of the functions that are known, shape
    (width, among), if nothing accelerates before and after these.

    Args:
        away: Number of the first one among those that are known; negative: before.
        width: Number of functions.
        among: Number of those that are known.
    """
    rows = dict(enumerate(np.eye(among)))
    for i in range(-1, away - 1, -1):
        rows[i] = 2 * rows[i + 1] - rows[i + 2]
    for i in range(among, away + width):
        rows[i] = 2 * rows[i - 1] - rows[i - 2]
    return np.array([rows[away + i] for i in range(width)])
