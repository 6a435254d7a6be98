"""Poses at rest as a segment: what all instruments read in each of them, and where to begin."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from steelyard.arrays import Array
from steelyard.calibration.settings import CALIBRATION, CalibrationSettings
from steelyard.errors import InputError
from steelyard.experiment.model import Experiment, Run
from steelyard.identification.model.balance import Forces
from steelyard.identification.model.motion_residuals import Reading, Segment
from steelyard.identification.model.settings import MOTION
from steelyard.identification.samples.first_motion import SPACING, first_motion
from steelyard.instruments import Attitude
from steelyard.instruments.equations import solve_for
from steelyard.robot.kinematics import cables_at
from steelyard.robot.model import DIRECTIONS, Robot

_FEWEST = 6
"""Poses in which a length has to be read before one of them can be held against the others."""
_APART, _METRES = 8.0, 0.2
"""How far the lengths of a pose are off those of all others, over the usual and in metres, where its
place is wrong."""
_DEPTH = 0.4
"""Below the highest anchor, where a platform is looked for first, over the span of the anchors."""
_FIRST_NOISE = 1e-3
"""1-sigma of readings whose noise is not stated, to begin with: the residuals tell it."""
UPRIGHT = "no orientation"
"""Name of the instrument that stands in where nothing tells how a platform is turned."""


def with_upright(experiment: Experiment, settings: CalibrationSettings = CALIBRATION) -> Experiment:
    """The experiment with a vague orientation in runs whose instruments do not tell one: the platform
    hangs upright, to about a radian.

    Args:
        experiment: With poses at rest.
        settings: How vague.
    """
    upright = Attitude.model_validate(
        {
            "kind": "attitude",
            "noise": settings.upright,
            "calibration": {"misalignment": 0.0, "reference": 0.0, "delay": 0.0},
        }
    )
    runs = []
    for run in experiment.runs:
        told = any("orientation" in each.values for each in run.streams.values())
        if run.static and not told:
            first = next(iter(run.streams.values()))
            n = len(first)
            stream = replace(first, values={"orientation": np.tile(np.eye(3), (n, 1, 1))})
            run = replace(run, streams={**run.streams, UPRIGHT: stream})
        runs.append(run)
    instruments = dict(experiment.instruments)
    if any(UPRIGHT in run.streams for run in runs):
        instruments[UPRIGHT] = upright
    return replace(experiment, instruments=instruments, runs=tuple(runs))


def segment_of(experiment: Experiment, run: Run) -> tuple[Segment, Mapping[str, Array]]:
    """The poses of a static run, with all readings of how the platform stands; and offsets of lengths
    to begin with, where nothing else than forces tells them.

    Args:
        experiment: With robot and instruments.
        run: Static.

    Raises:
        InputError: No instrument tells where the platform was.
    """
    count = min(len(each) for each in run.streams.values())
    tension = tensions(experiment, run, count)
    readings: list[Reading] = []
    for name, stream in run.streams.items():
        instrument = experiment.instruments[name]
        if not (instrument.is_motion or instrument.is_cable_motion) or instrument.commanded:
            continue
        for quantity in instrument.quantities(experiment.robot.m):
            values = stream.values.get(quantity.name)
            if values is None or quantity.name in {"angular_velocity", "specific_force"}:
                continue
            sigma = quantity.noise or MOTION.at_rest(quantity.unit) or _FIRST_NOISE
            flat = values.reshape(len(values), -1)
            use = np.isfinite(flat).any(axis=1)
            if quantity.rotation:
                use = np.isfinite(flat).all(axis=1)
            own = tension[use] if instrument.is_cable_motion else None
            numbers = np.arange(len(values), dtype=np.float64)[use]
            readings.append(Reading((name, quantity.name), numbers, values[use], sigma, own))
    pose, offsets = _first_poses(experiment, run, readings, count)
    numbers = np.arange(count, dtype=np.float64)
    return Segment(run.name, numbers, tuple(readings), pose, static=True), offsets


def forces_of(experiment: Experiment, run: Run, settings: CalibrationSettings) -> Forces | None:
    """Tensions that were read in the poses of a run; None: there are none.

    Args:
        experiment: With the force instrument.
        run: Static.
        settings: Noise to begin with, where it is not stated.
    """
    name = experiment.force_instrument(run)
    if name is None or "tension" not in run.streams[name].values:
        return None
    instrument, m = experiment.instruments[name], experiment.robot.m
    values = run.streams[name].values["tension"]
    missing = ~np.isfinite(values)
    without = np.array([f"f{i + 1}" in instrument.unread for i in range(m)])
    unread = without | missing.all(axis=0)
    usual = np.nanmedian(np.where(missing, np.nan, values), axis=0) if len(values) else np.ones(m)
    usual = np.where(np.isfinite(usual), usual, float(np.nanmedian(values)))
    noise = instrument.quantity("tension", m).noise
    sigma = np.full(m, noise or settings.force * float(np.median(np.abs(usual))))
    unmodelled = None
    if int(np.sum(~unread)) < DIRECTIONS:
        unmodelled = float(sigma[0]) * np.array([1.0] * 3 + [experiment.robot.size or 1.0] * 3)
    return Forces(
        name=name,
        time=np.arange(len(values), dtype=np.float64),
        readings={"tension": np.where(missing, usual, values)},
        sigma=sigma,
        left_out=missing & ~unread,
        unmodelled=unmodelled,
        unread=unread if unread.any() else None,
    )


def tensions(experiment: Experiment, run: Run, count: int) -> Array:
    """Of the cables at the platform [N], as read, else their share of the weight, shape (n, m): how
    far they stretch and sag.
    """
    robot = experiment.robot
    name = experiment.force_instrument(run)
    mass = experiment.known["mass"][0] if "mass" in experiment.known else None
    if mass is None:
        mass = robot.platform.mass if robot.platform is not None else 1.0
    share = mass * float(np.linalg.norm(robot.gravity)) / max(1, robot.m)
    found = np.full((count, robot.m), share)
    if name is not None and "tension" in run.streams[name].values:
        read = run.streams[name].values["tension"][:count]
        found = np.where(np.isfinite(read) & (read > 0), read, found)
    return found


def _first_poses(
    experiment: Experiment, run: Run, readings: list[Reading], count: int
) -> tuple[Array, Mapping[str, Array]]:
    """Position and quaternion of every pose to begin with, shape (n, 7), and offsets of lengths."""
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
    return np.hstack([position, _quaternions(rotation)]), offsets


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
    taut = np.ones((len(numbers), robot.m))
    drawn = cables_at(straight, position[numbers], rotation[numbers], taut).length
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
        use = np.isfinite(own)

        def error(
            where: Array, n: int = int(number), o: Array = own, u: NDArray[np.bool_] = use
        ) -> Array:
            at = cables_at(straight, where[None], rotation[n][None], np.ones((1, robot.m)))
            return np.asarray((at.length[0] - o)[u])

        position[number] = least_squares(error, usual, loss="soft_l1").x


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


def _quaternions(rotation: Array) -> Array:
    """Of rotations, w first, shape (n, 4)."""
    return np.asarray(Rotation.from_matrix(rotation).as_quat(scalar_first=True, canonical=True))


def _by_lengths(
    experiment: Experiment,
    run: Run,
    reading: Reading,
    position: Array,
    rotation: Array,
    missing: NDArray[np.bool_],
) -> None:
    """Put positions at which a robot as it was drawn would have the lengths; offsets of which nothing
    is known are those of the poses that are placed already, else none.
    """
    robot = experiment.robot
    numbers = reading.time.astype(int)

    def drawn(where: Array, turned: Array) -> Array:
        straight = robot.with_straight_cables()
        length = cables_at(straight, where[None], turned[None], np.ones(robot.m)).length
        return np.asarray(length[0])

    placed = [i for i, number in enumerate(numbers) if not missing[number]]
    offset = np.zeros(robot.m)
    if placed:
        apart = [
            reading.values[i] - drawn(position[numbers[i]], rotation[numbers[i]]) for i in placed
        ]
        offset = np.nanmedian(apart, axis=0)
    start = np.median(position[~missing], axis=0) if (~missing).any() else _middle(robot)
    for i, number in enumerate(numbers):
        if not missing[number]:
            continue
        seen = reading.values[i] - offset
        use = np.isfinite(seen)

        def off(where: Array, n: int = number, s: Array = seen, u: Array = use) -> Array:
            return np.asarray((drawn(where, rotation[n]) - s)[u])

        found = least_squares(off, start, loss="soft_l1")
        position[number] = found.x
    rest = np.isnan(position).any(axis=1)
    position[rest] = start


def _middle(robot: Robot) -> Array:
    """A place among the anchors and well below the highest, [m], shape (3,): there is another answer
    to the same lengths above them.
    """
    place = robot.anchors.mean(axis=0)
    span = float(np.ptp(robot.anchors[:, :2], axis=0).max())
    place[2] = robot.anchors[:, 2].max() - _DEPTH * span
    return np.asarray(place)
