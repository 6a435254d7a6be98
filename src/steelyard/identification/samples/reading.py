"""A part of a run, smooth: the platform's state at any instant of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from steelyard.arrays import Array
from steelyard.identification.model.sources import Source
from steelyard.identification.samples.run_reader import RunReader
from steelyard.motion.state import motion_of_quaternions, specific_force_of
from steelyard.smoothing import Samples1D, Smoothed, fit

_SMALL_STEP = 1e-4
"""In time, over which the velocity of a lever is found [s]."""
_EDGE = 1e-4
"""Samples so close outside an interval still belong to it [s]: a clock that is moved a little must
not lose one."""


@dataclass(frozen=True, eq=False)
class SmoothPart:
    """The streams of one run over an interval without gaps, smooth and turned into parts of the
    platform's state one by one.
    """

    reader: RunReader
    raw: Mapping[Source, Samples1D]
    start: float
    end: float
    spacing: float
    robust: bool = False
    """Whether to leave out numbers that stand far from the others of their channel."""

    def within(self, source: Source) -> Samples1D:
        """Samples in the interval."""
        samples = self.raw[source]
        inside = (samples.time >= self.start - _EDGE) & (samples.time <= self.end + _EDGE)
        return Samples1D(
            np.clip(samples.time[inside], self.start, self.end), samples.values[inside]
        )

    def smooth(self, samples: Samples1D) -> Smoothed:
        """Fit, or give the part up."""
        fitted = fit(samples, self.start, self.end, self.spacing, robust=self.robust)
        if fitted is None:
            raise UndeterminedError
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
        return (
            self.smooth(self.within(omega))
            if omega and omega != self.reader.sources.rotation
            else None
        )

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
        """Angular velocity as the attitude has it, to hold against the gyro; NaN where there are
        not both.
        """
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
        """Of the platform origin: what is tracked may be another point, whose lever turns with the
        platform.
        """
        source = self.reader.sources.position
        if source is None:
            return None
        tracked = self.within(source)
        rotation = self.rotation(tracked.time)
        if source[1] == "length":
            (force_samples,) = (smoothed.at(tracked.time) for smoothed in self.forces.values())
            origin = self.reader.hung_at(
                source, tracked.values, rotation["rotation"], force_samples
            )
        else:
            origin = self.reader.solve("position", source, tracked.values, **rotation)
        return self.smooth(Samples1D(tracked.time, origin))

    @cached_property
    def force_samples(self) -> Smoothed | None:
        """Specific force of the platform origin by the accelerometer; None where it has to come
        from the tracker.
        """
        source = self.reader.sources.specific_force
        if source is None:
            return None
        samples = self.within(source)
        given = {
            **self.turning(samples.time),
            **self.rotation(samples.time),
            "gravity": self.reader.gravity,
        }
        return self.smooth(
            Samples1D(
                samples.time, self.reader.solve("specific_force", source, samples.values, **given)
            )
        )

    def specific_force(self, t: Array) -> Array:
        """Of the platform origin, from the accelerometer or from the tracker."""
        if self.force_samples is not None:
            return self.force_samples.at(t)
        assert self.position is not None  # choose_sources() has made sure
        return specific_force_of(
            self.rotation(t)["rotation"], self.position.at(t, 2), self.reader.gravity
        )

    @cached_property
    def forces(self) -> dict[str, Smoothed]:
        """Readings of the force instrument."""
        return {
            q: self.smooth(self.within((name, q)))
            for name, q in self.raw
            if name == self.reader.sources.force
        }

    @cached_property
    def tension(self) -> Smoothed:
        """At the platform, of sensors behind rollers, reading by reading: a roller turns its
        friction around before a filter follows.
        """
        read = self.within((self.reader.sources.force, "tension"))
        return self.smooth(
            Samples1D(
                read.time,
                self.reader.force_samples({"tension": read.values}, self.moving(read.time)),
            )
        )

    def pose(self, t: Array) -> dict[str, Array]:
        """Position and rotation, where they are known."""
        return {
            **({} if self.position is None else {"position": self.position.at(t)}),
            **self.rotation(t),
        }

    def moving(self, t: Array) -> dict[str, Array]:
        """Pose, velocity and angular velocity."""
        omega = self.turning(t)["omega"]
        return {**self.pose(t), "velocity": self.velocity(t, omega), "omega": omega}

    @cached_property
    def tracked(self) -> Smoothed:
        """What is read of the place, as it was read: without what the attitude's noise does at the
        lever of a tracked point.
        """
        assert self.reader.sources.position is not None  # choose_sources() has made sure
        return self.smooth(self.within(self.reader.sources.position))

    def velocity(self, t: Array, omega: Array) -> Array:
        """Of the platform origin, from how the tracked point moves and how the platform turns
        [m/s], shape (n, 3).
        """
        source = self.reader.sources.position
        assert source is not None  # choose_sources() has made sure
        assert self.position is not None
        if source[1] == "length":
            return self.position.at(t, 1)
        rotation = Rotation.from_matrix(self.rotation(t)["rotation"])
        place, rate = self.tracked.at(t), self.tracked.at(t, 1)
        before, after = (
            self.reader.solve(
                "position",
                source,
                place + step * rate,
                rotation=(rotation * Rotation.from_rotvec(step * omega)).as_matrix(),
            )
            for step in (-_SMALL_STEP, _SMALL_STEP)
        )
        return np.asarray((after - before) / (2 * _SMALL_STEP))

    def carried(self, t: Array) -> dict[str, Array]:
        """What carries the platform."""
        if self.reader.behind_rollers:
            motion = self.moving(t)
            force_samples = self.tension.at(t)
            return {
                **motion,
                **self.reader.carried(force_samples, motion["position"], motion["rotation"]),
            }
        readings = {q: smoothed.at(t) for q, smoothed in self.forces.items()}
        pose = self.pose(t)
        force_samples = self.reader.force_samples(readings, pose)
        return {
            **pose,
            **self.reader.carried(force_samples, pose.get("position"), pose.get("rotation")),
        }

    def motion(self, t: Array) -> dict[str, Array]:
        """How the platform moves."""
        return {
            **self.turning(t),
            "omega_of_attitude": self.omega_of_attitude(t),
            "specific_force": self.specific_force(t),
        }

    def noise(self, t: Array) -> dict[str, float]:
        """1-sigma of the noise left in ``alpha``, and of single force readings about their
        spline.
        """
        forces = {"tension": self.tension} if self.reader.behind_rollers else self.forces
        return {
            "alpha": self.alpha_noise(t),
            **{quantity: smoothed.sigma for quantity, smoothed in forces.items()},
        }

    def state(self, t: Array) -> tuple[dict[str, Array], dict[str, float]] | None:
        """All of it at times, and its noise; None where the samples do not determine it."""
        try:
            return {"time": t, **self.motion(t), **self.carried(t)}, self.noise(t)
        except UndeterminedError:
            return None


class UndeterminedError(Exception):
    """A stream has too few samples in a part for its spline."""
