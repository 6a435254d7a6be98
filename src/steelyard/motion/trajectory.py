"""Commanded motions as functions of time, with their derivatives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline

from steelyard.arrays import Array, readonly


class Trajectory(Protocol):
    """Pose over time; at rest before its start and after its end."""

    @property
    def duration(self) -> float:
        """Length in time [s]."""

    def derivative(self, t: Array, order: int) -> Array:
        """Derivative of x, y, z [m], roll, pitch, yaw [rad] by time.

        Args:
            t: Times [s], shape (n,).
            order: 0 is the pose itself.

        Returns:
            Shape (n, 6).
        """


@dataclass(frozen=True)
class MultisineShape:
    """How a multisine is composed, beside its frequencies and amplitudes."""

    most_sines: int = 40
    """Of an axis, spread over the band: more make a longer sum, not a richer motion."""
    fade_share: float = 1 / 8
    """Part of the duration in which it is faded in, and out."""
    least_fade: float = 2.0
    """Time of that at least, in a motion that is long enough [s]: the period of half a hertz."""
    points_per_harmonic: int = 24
    """Of the spline through it: twelve per half wave of the fastest sine."""
    least_points: int = 200
    """Of the spline through it."""


MULTISINE_SHAPE = MultisineShape()
"""What is used where nothing is given."""

# 35 u^4 - 84 u^5 + 70 u^6 - 20 u^7: velocity, acceleration and jerk vanish at both ends, so that
# elastic cables stay quiet.
REST_TO_REST = np.polynomial.Polynomial([0, 0, 0, 0, 35, -84, 70, -20])


@dataclass(frozen=True)
class RestToRest:
    """One straight move in all six coordinates, with a pause before and after it."""

    start: Array
    """Pose x, y, z [m], roll, pitch, yaw [rad], shape (6,)."""
    end: Array
    """Pose at the end, shape (6,)."""
    move: float
    """Time of the move itself [s]."""
    pause: float = 0.0
    """Rest before and after it [s]."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "start", readonly(self.start, (6,), "start"))
        object.__setattr__(self, "end", readonly(self.end, (6,), "end"))

    @property
    def duration(self) -> float:
        """Length in time [s]."""
        return self.move + 2 * self.pause

    def derivative(self, t: Array, order: int) -> Array:
        """See :class:`Trajectory`."""
        u = np.clip((np.asarray(t) - self.pause) / self.move, 0.0, 1.0)
        shape = REST_TO_REST.deriv(order)(u) if order else REST_TO_REST(u)
        offset = self.start if order == 0 else 0.0
        moving = 1.0 if order == 0 else ((u > 0) & (u < 1))
        return offset + (shape * moving / self.move**order)[:, None] * (self.end - self.start)

    def reversed(self) -> RestToRest:
        """The same move back."""
        return RestToRest(self.end, self.start, self.move, self.pause)


@dataclass(frozen=True)
class Repeated:
    """A move there and back, again and again."""

    move: RestToRest
    times: int
    """Moves in all."""

    @property
    def duration(self) -> float:
        """Length in time [s]."""
        return self.move.duration * self.times

    def derivative(self, t: Array, order: int) -> Array:
        """See :class:`Trajectory`."""
        t = np.asarray(t)
        number = np.clip(np.floor(t / self.move.duration), 0, self.times - 1).astype(int)
        since = t - number * self.move.duration
        there = self.move.derivative(since, order)
        back = self.move.reversed().derivative(since, order)
        return np.where((number % 2 == 0)[:, None], there, back)


@dataclass(frozen=True)
class Sampled:
    """A trajectory through given poses: a quintic spline, whose fourth derivative is still
    continuous.
    """

    spline: BSpline
    duration: float
    """[s]"""

    @classmethod
    def through(cls, time: Array, poses: Array, *, at_rest: bool = False) -> Sampled:
        """Through poses at increasing times, from and to rest where that is said.

        Args:
            time: From 0 on [s], shape (n,).
            poses: Shape (n, 6).
            at_rest: Whether velocity and acceleration vanish at both ends; needs six poses at
                least.
        """
        if at_rest:
            still = [(1, np.zeros(6)), (2, np.zeros(6))]
            spline = make_interp_spline(time, poses, k=5, bc_type=(still, still))
            return cls(spline, float(time[-1]))
        degree = min(5, len(time) - 1)
        degree -= 1 - degree % 2
        return cls(make_interp_spline(time, poses, k=degree), float(time[-1]))

    def derivative(self, t: Array, order: int) -> Array:
        """See :class:`Trajectory`."""
        t = np.asarray(t)
        inside = np.clip(t, 0.0, self.duration)
        # Some releases of SciPy read beyond their memory for derivatives above the degree.
        values = np.zeros((len(t), 6))
        if order <= self.spline.k:
            values = np.asarray(self.spline(inside, nu=order))
        if order:
            values[inside != t] = 0.0
        return values


def multisine(
    center: Sequence[float],
    amplitude: Sequence[float],
    duration: float,
    harmonics: int,
    seed: int = 1,
    shape: MultisineShape = MULTISINE_SHAPE,
) -> Sampled:
    """A smooth motion of all six axes that begins and ends at rest at its centre.

    Every axis is a sum of sines of random phase whose frequencies are multiples of 1 / duration,
    faded in and out over an eighth of the duration, but no faster than in two seconds.

    Args:
        center: Pose x, y, z [m], roll, pitch, yaw [rad].
        amplitude: Largest excursion of each axis, same units.
        duration: [s]
        harmonics: Highest multiple of 1 / duration.
        seed: Of the phases.
        shape: Number of sines and fading.
    """
    rng = np.random.default_rng(seed)
    points = max(shape.least_points, shape.points_per_harmonic * harmonics)
    t = np.linspace(0.0, duration, points + 1)
    # A short motion needs most of its time to begin and end softly.
    fade_time = min(duration / 2, max(duration * shape.fade_share, shape.least_fade))
    u = np.clip(np.minimum(t, duration - t) / fade_time, 0.0, 1.0)
    fade = REST_TO_REST(u)
    k = np.unique(np.linspace(1, harmonics, min(harmonics, shape.most_sines)).round())
    poses = np.empty((len(t), 6))
    for axis in range(6):
        weights = rng.uniform(0.5, 1.0, len(k))
        phases = rng.uniform(0.0, 2 * np.pi, len(k))
        signal = fade * (np.sin(2 * np.pi * np.outer(t, k) / duration + phases) @ weights)
        poses[:, axis] = center[axis] + amplitude[axis] * signal / np.abs(signal).max()
    return Sampled.through(t, poses, at_rest=True)
