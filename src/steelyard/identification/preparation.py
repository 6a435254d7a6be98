"""From raw streams to samples: one time base, the platform frame, everything filtered alike.

What the classical methods stand on. Readings are turned into parts of the platform's state by the measurement equations of the
instruments themselves, with systematic errors at the values known beforehand.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from steelyard.arrays import Array
from steelyard.errors import InputError
from steelyard.experiment.model import Experiment, Run
from steelyard.identification.reading import RunReader, SmoothPart
from steelyard.identification.smoothing import Samples1D, choose_spacing, pieces, segments
from steelyard.identification.sources import Acceleration, Source, choose_sources
from steelyard.motion.state import specific_force_of

_FEWEST_SAMPLES = 10
_WIDEST_SPACING = 0.5
"""[s]"""
_LEAST_TURNING = 1e-3
"""Angular acceleration of a platform at rest, rms [rad/s^2]."""
_LEAST_MOVING = 0.05
"""Change of the specific force of a platform at rest, rms [m/s^2]."""
_LEAST_COMPARED = 0.05
"""Angular velocity about an axis at which gyro and attitude are compared, rms [rad/s]."""
_LARGEST_FACTOR = 0.5
"""Difference of their ratio from one that neither misalignment nor vibration explains."""
_JUDGED = 60.0
"""Length of the part on which the knot spacing is chosen [s]."""


@dataclass(frozen=True, eq=False)
class Samples:
    """One run in the platform frame on one time base, n samples."""

    run: str
    time: Array
    """Common time [s]; of a static run the number of the pose; shape (n,)."""
    omega: Array
    """Angular velocity [rad/s], shape (n, 3)."""
    alpha: Array
    """Angular acceleration [rad/s^2], shape (n, 3)."""
    specific_force: Array
    """Of the platform origin [m/s^2], shape (n, 3)."""
    wrench: Array
    """Force over torque about the platform origin of what carries it [N], [N m], shape (n, 6)."""
    static: bool
    """Whether the samples are poses at rest."""
    free_offset: bool
    """Whether the wrench has a constant offset that is not known."""
    alpha_noise: float
    """1-sigma of the noise left in alpha [rad/s^2]."""
    spacing: float
    """Of the knots of the filter [s]; 0: not filtered."""
    position_sigma: float
    """1-sigma of the place that the acceleration was measured at [m]."""
    notes: tuple[str, ...] = ()
    """What a reader should know about how they were made."""

    def __len__(self) -> int:
        return len(self.time)


def prepare(
    experiment: Experiment, run: Run, *, acceleration: Acceleration | None = None, straight: bool = False
) -> Samples:
    """Samples of one run.

    Args:
        experiment: With robot and instruments.
        run: One of its runs.
        acceleration: Where to take the acceleration from; None: the IMU where there is one.
        straight: Whether to take the cables as massless and straight, as the paper does.

    Raises:
        InputError: A quantity that is needed is missing, the streams do not overlap, or nothing moves.
    """
    sources = choose_sources(experiment, run, acceleration)
    robot = experiment.robot.with_straight_cables() if straight else experiment.robot
    task = RunReader(experiment, robot, run, sources)
    return _static(task) if run.static else _moving(task)


def _static(task: RunReader) -> Samples:
    sources, streams = task.sources, task.run.streams
    raw = {source: streams[source[0]].values[source[1]] for source in sources.used()}
    forces = streams[sources.force].values
    rows = np.all([np.isfinite(v.reshape(len(v), -1)).all(axis=1) for v in [*raw.values(), *forces.values()]], axis=0)
    if not rows.any():
        raise InputError(f"{task.where}: expected at least one complete pose, found none; fill the empty cells")
    still = np.zeros((int(rows.sum()), 3))
    gravity = task.robot.gravity
    rotation = position = None
    if sources.rotation:
        rotation = task.solve("rotation", sources.rotation, raw[sources.rotation][rows])
        # At rest the specific force is gravity alone, and the attitude knows it without an accelerometer's bias.
        specific_force = specific_force_of(rotation, still, gravity)
    else:
        assert sources.specific_force is not None
        specific_force = task.solve(
            "specific_force", sources.specific_force, raw[sources.specific_force][rows], omega=still, alpha=still
        )
    if sources.position and rotation is not None:
        position = task.solve("position", sources.position, raw[sources.position][rows], rotation=rotation)
    return Samples(
        run=task.run.name,
        time=streams[sources.force].time[rows],
        omega=still,
        alpha=still,
        specific_force=specific_force,
        wrench=task.wrench({k: v[rows] for k, v in forces.items()}, position, rotation),
        static=True,
        free_offset=task.free_offset,
        alpha_noise=0.0,
        spacing=0.0,
        position_sigma=0.0,
    )


def _moving(task: RunReader) -> Samples:
    run, sources = task.run, task.sources
    everything = [*sources.used(), *((sources.force, quantity) for quantity in run.streams[sources.force].values)]
    raw = {source: _samples(task, source) for source in everything}
    start, end = run.window or (-np.inf, np.inf)
    start = max(start, *(float(s.time[0]) for s in raw.values()))
    end = min(end, *(float(s.time[-1]) for s in raw.values()))
    if end <= start:
        raise InputError(f"{task.where}: expected streams that overlap in time, found none; correct 'sync' or 'window'")
    differentiated = [sources.omega or sources.rotation]
    if sources.specific_force is None:
        differentiated.append(sources.position)
    spacing = _spacing([raw[s] for s in differentiated if s], list(raw.values()), start, end)
    times = task.experiment.common_time(run, sources.force)
    parts, gaps = [], -1
    for part_start, part_end in segments([s.time for s in raw.values()], start, end, spacing):
        gaps += 1
        for a, b, first, last in pieces(part_start, part_end, spacing):
            inside = times[(times >= first) & (times < last)]
            state = SmoothPart(task, raw, a, b, spacing).state(inside) if len(inside) else None
            if state is not None:
                parts.append(state)
    found = sum(len(p["time"]) for p in parts)
    if found < _FEWEST_SAMPLES:
        raise InputError(
            f"{task.where}: expected at least {_FEWEST_SAMPLES} force samples where all streams have data, found {found} in "
            f"{end - start:.2f} s; record longer, or widen 'window'"
        )
    joined = {key: np.concatenate([p[key] for p in parts]) for key in parts[0]}
    alpha_noise = float(np.sqrt(np.mean(joined["alpha_noise"] ** 2)))
    _check_motion(task.where, joined, alpha_noise)
    notes = _gyro_notes(run.name, joined["omega"], joined.pop("omega_of_attitude"))
    if sources.position and task.experiment.instruments[sources.position[0]].kind == "command":
        notes.append(f"run '{run.name}': the position is the commanded one, for want of a measured one")
    if gaps > 0:
        notes.append(f"run '{run.name}': {gaps} gap{'s' if gaps > 1 else ''} in the streams left out")
    return Samples(
        run=run.name,
        time=joined["time"],
        omega=joined["omega"],
        alpha=joined["alpha"],
        specific_force=joined["specific_force"],
        wrench=joined["wrench"],
        static=False,
        free_offset=task.free_offset,
        alpha_noise=alpha_noise,
        spacing=spacing,
        position_sigma=task.position_sigma,
        notes=tuple(notes),
    )


def _gyro_notes(run: str, omega: Array, omega_of_attitude: Array) -> list[str]:
    """Say where gyro and attitude contradict each other: a wrong axis, sign or unit passes all other checks."""
    notes = []
    for axis, name in enumerate("xyz"):
        own, other = omega[:, axis], omega_of_attitude[:, axis]
        own, other = own - own.mean(), other - other.mean()
        if (
            np.sqrt(np.mean(other**2)) > _LEAST_COMPARED
            and abs(factor := float(own @ other / (other @ other)) - 1) > _LARGEST_FACTOR
        ):
            notes.append(
                f"run '{run}': about {name} the gyro turns {factor + 1:.2g} times as fast as the orientation; check axes, signs and units"
            )
    return notes


def _samples(task: RunReader, source: Source) -> Samples1D:
    """A quantity with its complete samples on the common clock; rotations already of the platform, as quaternions."""
    name, quantity = source
    stream = task.run.streams[name]
    values = stream.values[quantity]
    valid = np.isfinite(values.reshape(len(values), -1)).all(axis=1)
    time, values = task.experiment.common_time(task.run, name)[valid], values[valid]
    if len(time) < 2:
        raise InputError(
            f"{stream.source}: expected at least 2 complete samples of {quantity.replace('_', ' ')}, found {len(time)}; fill the empty cells"
        )
    if values.ndim == 3:
        values = _quaternions(task.solve("rotation", source, values))
    elif quantity == "angular_velocity":
        values = task.solve("omega", source, values)
    return Samples1D(time, values)


def _quaternions(rotations: Array) -> Array:
    """Quaternions (w, x, y, z) without jumps of sign, shape (n, 4)."""
    quaternions = Rotation.from_matrix(rotations).as_quat(scalar_first=True)
    flips = np.where(np.sum(quaternions[1:] * quaternions[:-1], axis=1) < 0, -1.0, 1.0)
    return np.asarray(quaternions * np.concatenate([[1.0], np.cumprod(flips)])[:, None])


def _spacing(judged: list[Samples1D], used: list[Samples1D], start: float, end: float) -> float:
    """Knot spacing from the data: at least two samples of the slowest stream, at most what the motion bears."""
    steps = [np.diff(s.time[(s.time >= start) & (s.time <= end)]) for s in used]
    finest = 2.0 * max((float(np.median(step)) for step in steps if len(step)), default=_WIDEST_SPACING)
    widest = max(finest, min(_WIDEST_SPACING, (end - start) / 8))
    candidates = np.geomspace(finest, widest, 1 + int(np.ceil(2 * np.log2(widest / finest))))
    return choose_spacing(judged, [float(c) for c in candidates], start, min(end, start + _JUDGED))


def _check_motion(where: str, state: Mapping[str, Array], alpha_noise: float) -> None:
    """Refuse a recording of a platform at rest: its place is among the static runs."""
    turning = float(np.sqrt(np.mean(np.sum((state["alpha"] - state["alpha"].mean(axis=0)) ** 2, axis=1))))
    moving = float(
        np.sqrt(np.mean(np.sum((state["specific_force"] - state["specific_force"].mean(axis=0)) ** 2, axis=1)))
    )
    if turning < max(3 * alpha_noise, _LEAST_TURNING) and moving < _LEAST_MOVING:
        raise InputError(
            f"{where}: expected a motion, found a platform (nearly) at rest: {turning:.2g} rad/s^2 and {moving:.2g} m/s^2 rms; "
            "record a motion, or list it under 'static: true'"
        )
