"""Where the poses of a run are looked for first: by instruments that tell them, by forces in
balance, by lengths.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from steelyard.arrays import Array
from steelyard.errors import InputError
from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run
from steelyard.identification.model.motion_segment import Reading
from steelyard.identification.samples.first_poses.first_motion import first_motion
from steelyard.identification.samples.instants_in_balance import SPACING
from steelyard.instruments.equations import solve_for
from steelyard.robot.kinematics import cables_at
from steelyard.robot.model import Robot
from steelyard.rotations import quaternions_of

_FEWEST = 6
"""Poses in which a length has to be read before one of them can be held against the others."""
_APART, _METRES = 8.0, 0.2
"""How far the lengths of a pose are off those of all others, over the usual and in metres, where
its place is wrong."""
_DEPTH = 0.4
"""Below the highest anchor, where a platform is looked for first, over the span of the anchors."""
UPRIGHT = "no orientation"
"""Name of the instrument that stands in where nothing tells how a platform is turned."""


def first_poses(
    experiment: Experiment, run: Run, readings: list[Reading], count: int
) -> tuple[Array, Mapping[str, Array]]:
    """Position and quaternion of every pose to begin with, shape (n, 7), and offsets of lengths
    where forces tell them.

    Args:
        experiment: With robot and instruments.
        run: Static.
        readings: Of it.
        count: Poses n.

    Raises:
        InputError: No instrument tells where the platform was.
    """
    position, rotation = np.full((count, 3), np.nan), np.tile(np.eye(3), (count, 1, 1))
    for part in ("rotation", "position"):
        for reading in readings:
            name, what = reading.source
            instrument = experiment.instruments[name]
            told = instrument.quantity(what, experiment.robot.m).determines
            if told != (part,) or (part == "position" and instrument.is_cable_motion):
                continue
            at = reading.time.astype(int)
            state = {"rotation": rotation[at], "position": position[at]}
            given = {key: value for key, value in state.items() if key != part}
            solved = solve_for(part, instrument, experiment.robot, {what: reading.values}, given)
            {"rotation": rotation, "position": position}[part][at] = solved
    missing = np.isnan(position).any(axis=1)
    _put_apart(experiment, readings, position, rotation)
    offsets: Mapping[str, Array] = {}
    if missing.all() and (hanging := _in_balance(experiment, run, count)) is not None:
        # Nothing but forces tells how the platform hangs.
        where, turned, number, offsets = hanging
        position[number], rotation[number] = where, turned
        missing = np.isnan(position).any(axis=1)
    if missing.any():
        lengths = [r for r in readings if experiment.instruments[r.source[0]].is_cable_motion]
        if not lengths:
            raise InputError(
                f"run '{run.name}': expected a tracker, a pose or cable lengths that tell where the"
                " platform stood, found none; add one"
            )
        _by_lengths(experiment, run, lengths[0], position, rotation, missing)
    return np.hstack([position, quaternions_of(rotation)]), offsets


def _put_apart(
    experiment: Experiment, readings: list[Reading], position: Array, rotation: Array
) -> None:
    """Put poses where their lengths say, in which these are metres off those of all other poses: a
    place that was typed wrong is no place to begin in.
    """
    robot = experiment.robot
    lengths = [r for r in readings if experiment.instruments[r.source[0]].is_cable_motion]
    numbers = lengths[0].time.astype(int) if lengths else np.zeros(0, dtype=int)
    placed = np.isfinite(position[numbers]).all(axis=1)
    if placed.sum() < _FEWEST:
        return
    numbers, seen = numbers[placed], lengths[0].values[placed]
    straight = robot.with_straight_cables()
    drawn = _drawn(straight, position[numbers], rotation[numbers])
    # Drums of any scale, with any zero.
    told = np.empty_like(drawn)
    for i in range(robot.m):
        use = np.isfinite(seen[:, i])
        if use.sum() < _FEWEST:
            return
        slope, zero = _robust_line(seen[use, i], drawn[use, i])
        told[:, i] = slope * seen[:, i] + zero
    off = np.nanmedian(np.abs(told - drawn), axis=1)
    wrong = (off > _APART * np.median(off)) & (off > _METRES)
    usual = np.median(position[numbers[~wrong]], axis=0)
    for number, own in zip(numbers[wrong], told[wrong], strict=True):
        position[number] = _placed(straight, rotation[number], own, usual)


def _drawn(robot: Robot, position: Array, rotation: Array) -> Array:
    """Lengths of straight cables that do not stretch [m], shape (n, m)."""
    taut = np.ones((len(position), robot.m))
    return cables_at(robot, position, rotation, taut).length


def _placed(robot: Robot, rotation: Array, length: Array, start: Array) -> Array:
    """Place at which straight cables have lengths [m], shape (3,); those of some may be wrong.

    Args:
        robot: With straight cables.
        rotation: R_world_platform, shape (3, 3).
        length: [m], NaN where it was not read, shape (m,).
        start: Where it is looked for first [m], shape (3,).
    """
    use = np.isfinite(length)

    def off(where: Array) -> Array:
        return np.asarray((_drawn(robot, where[None], rotation[None])[0] - length)[use])

    return np.asarray(least_squares(off, start, loss="soft_l1").x)


def _robust_line(x: Array, y: Array) -> tuple[float, float]:
    """Slope and zero of a line through most of some points."""
    spread = max(float(np.ptp(x)), 1e-9)
    first = np.polyfit(x, y, 1)

    def error(line: Array) -> Array:
        return np.asarray(line[0] * x + line[1] - y)

    scale = max(float(np.median(np.abs(error(first)))), 1e-6)
    found = least_squares(error, first, loss="cauchy", f_scale=scale, x_scale=[1.0, spread])
    return float(found.x[0]), float(found.x[1])


def _in_balance(
    experiment: Experiment, run: Run, count: int
) -> tuple[Array, Array, NDArray[np.intp], Mapping[str, Array]] | None:
    """Places, rotations, numbers of the poses and offsets of the lengths by which forces are in
    balance; None: no tensions were read.
    """
    force = experiment.force_instrument(run)
    if force is None or "tension" not in run.streams[force].values or count < 3:
        return None
    # Poses one after the other, each by itself in an instant of the first motion.
    time = np.concatenate([[0.0], SPACING * (np.arange(count) + 0.5), [SPACING * count + 1e-6]])
    twice = np.concatenate([[0], np.arange(count), [count - 1]])
    streams = {
        name: replace(
            stream, time=time, values={key: value[twice] for key, value in stream.values.items()}
        )
        for name, stream in run.streams.items()
        if name != UPRIGHT
    }
    moving = replace(run, streams=streams, static=False, sync={}, window=None)
    found = first_motion(experiment, moving)
    if found is None:
        return None
    number = (found.time / SPACING).astype(np.intp)
    return found.position, found.rotation, number, found.offsets


def _by_lengths(
    experiment: Experiment,
    run: Run,
    reading: Reading,
    position: Array,
    rotation: Array,
    missing: NDArray[np.bool_],
) -> None:
    """Put positions at which a robot as it was drawn would have the lengths; offsets of which
    nothing is known are those of the poses that are placed already, else none.
    """
    robot = experiment.robot.with_straight_cables()
    numbers = reading.time.astype(int)
    offset = np.zeros(robot.m)
    placed = ~missing[numbers]
    if placed.any():
        known = numbers[placed]
        apart = reading.values[placed] - _drawn(robot, position[known], rotation[known])
        offset = np.nanmedian(apart, axis=0)
    start = (
        np.median(position[~missing], axis=0) if (~missing).any() else robot.below_anchors(_DEPTH)
    )
    for number, seen in zip(numbers[~placed], reading.values[~placed], strict=True):
        position[number] = _placed(robot, rotation[number], seen - offset, start)
    rest = np.isnan(position).any(axis=1)
    position[rest] = start
