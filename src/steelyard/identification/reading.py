"""One run as its instruments saw it, turned into parts of the platform's state by their own measurement equations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from steelyard.arrays import Array
from steelyard.experiment.model import Experiment, Run
from steelyard.identification.smoothing import Samples1D, Smoothed, fit
from steelyard.identification.sources import Source, Sources
from steelyard.instruments.equations import solve_for
from steelyard.motion.state import motion_of_quaternions, specific_force_of
from steelyard.robot.kinematics import cables_at
from steelyard.robot.model import Robot


@dataclass(frozen=True, eq=False)
class RunReader:
    """One run and how to read it."""

    experiment: Experiment
    robot: Robot
    run: Run
    sources: Sources

    @property
    def where(self) -> str:
        """File and run, for messages."""
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
        # Sensors at the winch need the pose; those at the platform do without.
        pose = {"position": position, "rotation": rotation}
        tension = solve_for("tension", instrument, self.robot, readings, pose)
        structure = cables_at(self.robot, position, rotation, tension).structure
        wrench: Array = np.einsum("nkm,nm->nk", structure, tension)
        return wrench

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


@dataclass(frozen=True, eq=False)
class SmoothPart:
    """The streams of one run over an interval without gaps, smooth and turned into parts of the platform's state one by one."""

    reader: RunReader
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
        rotation = self.reader.sources.rotation
        return self.smooth(self.within(rotation)) if rotation else None

    @cached_property
    def gyro(self) -> Smoothed | None:
        """Angular velocity; None where it has to come from the attitude."""
        omega = self.reader.sources.omega
        return self.smooth(self.within(omega)) if omega and omega != self.reader.sources.rotation else None

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

    def alpha_noise(self, t: Array) -> float:
        """1-sigma of the noise left in the angular acceleration [rad/s^2]."""
        if self.gyro is not None:
            return self.gyro.noise(t, 1)
        assert self.attitude is not None
        # A quaternion turns half as fast as the rotation vector.
        return 2 * self.attitude.noise(t, 2)

    @cached_property
    def position(self) -> Smoothed | None:
        """Of the platform origin: what is tracked may be another point, whose lever turns with the platform."""
        source = self.reader.sources.position
        if source is None:
            return None
        tracked = self.within(source)
        origin = self.reader.solve("position", source, tracked.values, **self.rotation(tracked.time))
        return self.smooth(Samples1D(tracked.time, origin))

    def specific_force(self, t: Array) -> Array:
        """Of the platform origin, from the accelerometer or from the tracker."""
        source, gravity = self.reader.sources.specific_force, self.reader.robot.gravity
        if source is not None:
            felt = self.within(source)
            given = {**self.turning(felt.time), **self.rotation(felt.time), "gravity": gravity}
            at_origin = self.reader.solve("specific_force", source, felt.values, **given)
            return self.smooth(Samples1D(felt.time, at_origin)).at(t)
        assert self.position is not None  # choose_sources() has made sure
        return specific_force_of(self.rotation(t)["rotation"], self.position.at(t, 2), gravity)

    def wrench(self, t: Array) -> Array:
        """On the platform."""
        force = self.reader.sources.force
        readings = {q: self.smooth(self.within((name, q))).at(t) for name, q in self.raw if name == force}
        position = None if self.position is None else self.position.at(t)
        return self.reader.wrench(readings, position, self.rotation(t).get("rotation"))

    def state(self, t: Array) -> dict[str, Array] | None:
        """All of it at times; None where the samples do not determine it."""
        try:
            return {
                "time": t,
                **self.turning(t),
                "omega_of_attitude": self.omega_of_attitude(t),
                "specific_force": self.specific_force(t),
                "wrench": self.wrench(t),
                "alpha_noise": np.full(len(t), self.alpha_noise(t)),
            }
        except _UndeterminedError:
            return None


class _UndeterminedError(Exception):
    """A stream has too few samples in a part for its spline."""
