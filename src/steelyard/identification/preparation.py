"""From raw streams to samples: one time base, the platform frame, everything filtered alike.

What the classical methods stand on. Readings are turned into parts of the platform's state by the measurement equations of the
instruments themselves, with systematic errors at the values known beforehand.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from steelyard.arrays import Array
from steelyard.errors import InputError
from steelyard.experiment.model import Experiment, Run
from steelyard.identification.smoothing import Samples1D, Smoothed, choose_spacing, fit, pieces, segments
from steelyard.identification.sources import Acceleration, Source, Sources, choose_sources
from steelyard.instruments.equations import solve_for
from steelyard.motion.state import motion_of_quaternions, specific_force_of
from steelyard.robot.kinematics import cables_at
from steelyard.robot.model import Robot

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
    omega_noise: float
    """1-sigma of the noise left in omega [rad/s]."""
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
    task = _Task(experiment, robot, run, sources)
    return _static(task) if run.static else _moving(task)


@dataclass(frozen=True, eq=False)
class _Task:
    """One run and how to read it."""

    experiment: Experiment
    robot: Robot
    run: Run
    sources: Sources

    @property
    def where(self) -> str:
        return f"{self.experiment.source or self.experiment.name}: run '{self.run.name}'"

    def solve(self, unknown: str, source: Source, readings: Array, **given: Array) -> Array:
        """Part of the platform's state behind the readings of one quantity."""
        instrument = self.experiment.instruments[source[0]]
        return solve_for(unknown, instrument, self.robot, {source[1]: readings}, given)

    def wrench(self, readings: Mapping[str, Array], position: Array | None, rotation: Array | None) -> Array:
        """Wrench on the platform behind the readings of the force instrument, shape (n, 6)."""
        instrument = self.experiment.instruments[self.sources.force]
        if instrument.kind == "wrench":
            return solve_for("wrench", instrument, self.robot, readings, {})
        assert position is not None  # choose_sources() has made sure
        assert rotation is not None
        given = {"position": position, "rotation": rotation} if self._at_winch else {}
        tension = solve_for("tension", instrument, self.robot, readings, given)
        structure = cables_at(self.robot, position, rotation, tension).structure
        wrench: Array = np.einsum("nkm,nm->nk", structure, tension)
        return wrench

    @property
    def _at_winch(self) -> bool:
        return getattr(self.experiment.instruments[self.sources.force], "end", "platform") == "winch"

    @property
    def free_offset(self) -> bool:
        """Whether the wrench has a constant offset that is not known."""
        instrument = self.experiment.instruments[self.sources.force]
        return instrument.kind == "wrench" and any(
            term.key.startswith("offset") and (term.deviation is None or bool(term.deviation.any()))
            for term in instrument.terms(self.robot.m)
        )

    @property
    def position_sigma(self) -> float:
        """1-sigma of the place on the platform whose acceleration is measured [m]."""
        source = self.sources.specific_force or self.sources.position
        if source is None:
            return 0.0
        terms = {term.key: term for term in self.experiment.instruments[source[0]].terms(self.robot.m)}
        place = terms.get("position") or terms.get("target")
        if place is None or place.deviation is None:
            return 0.0
        return float(np.sqrt(np.mean(place.deviation**2)))


def _static(task: _Task) -> Samples:
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
        omega_noise=0.0,
        spacing=0.0,
        position_sigma=0.0,
    )


def _moving(task: _Task) -> Samples:
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
            state = _Part(task, raw, a, b, spacing).state(inside) if len(inside) else None
            if state is not None:
                parts.append(state)
    found = sum(len(p["time"]) for p in parts)
    if found < _FEWEST_SAMPLES:
        raise InputError(
            f"{task.where}: expected at least {_FEWEST_SAMPLES} force samples where all streams have data, found {found} in "
            f"{end - start:.2f} s; record longer, or widen 'window'"
        )
    joined = {key: np.concatenate([p[key] for p in parts]) for key in parts[0]}
    noise = {key: float(np.sqrt(np.mean(joined.pop(key) ** 2))) for key in ("alpha_noise", "omega_noise")}
    _check_motion(task.where, joined, noise)
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
        alpha_noise=noise["alpha_noise"],
        omega_noise=noise["omega_noise"],
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


def _samples(task: _Task, source: Source) -> Samples1D:
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


@dataclass(frozen=True, eq=False)
class _Part:
    """The streams of one run over an interval without gaps, smooth and turned into parts of the platform's state one by one."""

    task: _Task
    raw: Mapping[Source, Samples1D]
    start: float
    end: float
    spacing: float

    def within(self, source: Source) -> Samples1D:
        """Samples in the interval."""
        samples = self.raw[source]
        inside = (samples.time >= self.start) & (samples.time <= self.end)
        return Samples1D(samples.time[inside], samples.values[inside])

    def smooth(self, samples: Samples1D) -> Smoothed:
        """Fit, or give the part up."""
        fitted = fit(samples, self.start, self.end, self.spacing)
        if fitted is None:
            raise _UndeterminedError
        return fitted

    @cached_property
    def attitude(self) -> Smoothed | None:
        """Quaternion."""
        rotation = self.task.sources.rotation
        return self.smooth(self.within(rotation)) if rotation else None

    @cached_property
    def gyro(self) -> Smoothed | None:
        """Angular velocity; None where it has to come from the attitude."""
        omega = self.task.sources.omega
        return self.smooth(self.within(omega)) if omega and omega != self.task.sources.rotation else None

    def rotation(self, t: Array) -> dict[str, Array]:
        """R_world_platform, where it is known."""
        if self.attitude is None:
            return {}
        return {"rotation": Rotation.from_quat(self.attitude.at(t), scalar_first=True).as_matrix()}

    def turning(self, t: Array) -> dict[str, Array]:
        """Angular velocity and acceleration."""
        if self.gyro is not None:
            return {"omega": self.gyro.at(t), "alpha": self.gyro.at(t, 1)}
        assert self.attitude is not None  # choose_sources() has made sure
        return dict(motion_of_quaternions(*(self.attitude.at(t, order) for order in range(3))))

    def omega_of_attitude(self, t: Array) -> Array:
        """Angular velocity as the attitude has it, to hold against the gyro; NaN where there are not both."""
        if self.attitude is None or self.gyro is None:
            return np.full((len(t), 3), np.nan)
        return motion_of_quaternions(*(self.attitude.at(t, order) for order in range(3)))["omega"]

    def turning_noise(self, t: Array) -> tuple[float, float]:
        """1-sigma of the noise left in angular velocity and acceleration."""
        if self.gyro is not None:
            return self.gyro.noise(t, 0), self.gyro.noise(t, 1)
        assert self.attitude is not None
        # A quaternion turns half as fast as the rotation vector.
        return 2 * self.attitude.noise(t, 1), 2 * self.attitude.noise(t, 2)

    @cached_property
    def position(self) -> Smoothed | None:
        """Of the platform origin: what is tracked may be another point, whose lever turns with the platform."""
        source = self.task.sources.position
        if source is None:
            return None
        tracked = self.within(source)
        origin = self.task.solve("position", source, tracked.values, **self.rotation(tracked.time))
        return self.smooth(Samples1D(tracked.time, origin))

    def specific_force(self, t: Array) -> Array:
        """Of the platform origin, from the accelerometer or from the tracker."""
        source, gravity = self.task.sources.specific_force, self.task.robot.gravity
        if source is not None:
            felt = self.within(source)
            given = {**self.turning(felt.time), **self.rotation(felt.time), "gravity": gravity}
            at_origin = self.task.solve("specific_force", source, felt.values, **given)
            return self.smooth(Samples1D(felt.time, at_origin)).at(t)
        assert self.position is not None  # choose_sources() has made sure
        return specific_force_of(self.rotation(t)["rotation"], self.position.at(t, 2), gravity)

    def wrench(self, t: Array) -> Array:
        """On the platform."""
        force = self.task.sources.force
        readings = {q: self.smooth(self.within((name, q))).at(t) for name, q in self.raw if name == force}
        position = None if self.position is None else self.position.at(t)
        return self.task.wrench(readings, position, self.rotation(t).get("rotation"))

    def state(self, t: Array) -> dict[str, Array] | None:
        """All of it at times; None where the samples do not determine it."""
        try:
            omega_noise, alpha_noise = self.turning_noise(t)
            return {
                "time": t,
                **self.turning(t),
                "omega_of_attitude": self.omega_of_attitude(t),
                "specific_force": self.specific_force(t),
                "wrench": self.wrench(t),
                "omega_noise": np.full(len(t), omega_noise),
                "alpha_noise": np.full(len(t), alpha_noise),
            }
        except _UndeterminedError:
            return None


class _UndeterminedError(Exception):
    """A stream has too few samples in a part for its spline."""


def _check_motion(where: str, state: Mapping[str, Array], noise: Mapping[str, float]) -> None:
    """Refuse a recording of a platform at rest: its place is among the static runs."""
    turning = float(np.sqrt(np.mean(np.sum((state["alpha"] - state["alpha"].mean(axis=0)) ** 2, axis=1))))
    moving = float(
        np.sqrt(np.mean(np.sum((state["specific_force"] - state["specific_force"].mean(axis=0)) ** 2, axis=1)))
    )
    if turning < max(3 * noise["alpha_noise"], _LEAST_TURNING) and moving < _LEAST_MOVING:
        raise InputError(
            f"{where}: expected a motion, found a platform (nearly) at rest: {turning:.2g} rad/s^2 and {moving:.2g} m/s^2 rms; "
            "record a motion, or list it under 'static: true'"
        )
