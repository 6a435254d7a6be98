"""What the instruments of an excerpt say of the platform, if they are as described: their own
measurement equations, solved for the motion.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy.spatial.transform import Rotation

from steelyard.arrays import Array
from steelyard.identification.model.sources import Source
from steelyard.inspection.agreements.excerpt import Excerpt, Observation
from steelyard.instruments import Instrument
from steelyard.instruments.equations import solve_for
from steelyard.robot.model import Robot

_REMEMBERED = 32
"""Attitudes and places: descriptions that are tried have most of them in common."""


@dataclass(frozen=True, eq=False)
class AttitudeMotion:
    """Attitude of the platform and how it changes, n instants."""

    rotation: Array
    """R_world_platform, shape (n, 3, 3)."""
    rate: Array
    """Its derivative [1/s]."""
    bend: Array
    """The second one [1/s^2]."""
    omega: Array
    """Angular velocity, platform frame [rad/s], shape (n, 3)."""
    alpha: Array
    """Its derivative [rad/s^2], shape (n, 3)."""
    noise: tuple[float, float, float]
    """1-sigma of angle [rad], angular velocity and acceleration."""


@dataclass(frozen=True, eq=False)
class OriginMotion:
    """The platform origin in the world, n instants."""

    position: Array
    """[m], shape (n, 3)."""
    velocity: Array
    acceleration: Array
    noise: tuple[float, float, float]


def mounting(excerpt: Excerpt, name: str) -> Array:
    """R_platform_instrument, shape (3, 3)."""
    return excerpt.instruments[name].mounting.rotation


def rpy_deg_of(matrix: Array) -> list[float]:
    """Roll, pitch, yaw [deg] of a rotation matrix, as experiment files have them."""
    # At a pitch of 90 degrees roll and yaw are one: any will do.
    angles = Rotation.from_matrix(matrix).as_euler("ZYX", degrees=True, suppress_warnings=True)
    whole = np.round(angles[::-1], 3) + 0.0
    return [180.0 if angle == -180.0 else angle for angle in whole.tolist()]


def _axis_of(matrices: Array) -> Array:
    """Axis of the antisymmetric part of matrices, shape (n, 3)."""
    m = matrices
    columns = [m[:, 2, 1] - m[:, 1, 2], m[:, 0, 2] - m[:, 2, 0], m[:, 1, 0] - m[:, 0, 1]]
    return np.stack(columns, axis=1) / 2


def point_of(excerpt: Excerpt, name: str) -> Array:
    """Where on the platform an instrument looks [m], shape (3,)."""
    return np.array(excerpt.instruments[name].mounting.point or (0.0, 0.0, 0.0), dtype=np.float64)


def place_sigma(instrument: Instrument, robot: Robot) -> Array:
    """1-sigma with which it is stated where an instrument sits [m], shape (3,); zero where it is
    said nowhere.
    """
    key = instrument.mounting.point_key
    for term in instrument.terms(robot.m):
        if term.key == key and term.deviation is not None:
            return term.deviation
    return np.zeros(3)


def lever_of(instrument: Instrument, robot: Robot) -> float:
    """How far from the origin of the platform an instrument may well sit [m]."""
    point = np.array(instrument.mounting.point or (0.0, 0.0, 0.0), dtype=np.float64)
    return float(np.linalg.norm(np.concatenate([point, place_sigma(instrument, robot)])))


def tracker_frame(excerpt: Excerpt, name: str) -> tuple[Array, Array]:
    """Origin of the frame that readings stand in, in the world [m], and R_world_tracker."""
    frame = excerpt.instruments[name].mounting.frame
    if frame is None:
        return np.zeros(3), np.eye(3)
    return np.array(frame.position, dtype=np.float64), frame.rotation


@dataclass(frozen=True)
class _Solver:
    """The measurement equation of one quantity, solved for a part of the state that it is linear
    in.
    """

    unknown: str
    instrument: Instrument
    quantity: str
    robot: Robot

    @classmethod
    def of(cls, unknown: str, excerpt: Excerpt, source: Source) -> _Solver:
        # No motion depends on what may be amended in the robot; so fewer equations are made.
        return cls(unknown, excerpt.instruments[source[0]], source[1], excerpt.experiment.robot)

    def value(self, reading: Array, **given: Array) -> Array:
        """The unknown for readings over n samples."""
        readings = {self.quantity: reading}
        return solve_for(self.unknown, self.instrument, self.robot, readings, given)

    def change(self, rate: Array, **given: Array) -> Array:
        """Its time derivative for rates of the readings and of what is given: the same without
        its constant part.
        """
        shapes = tuple((key, each.shape[1:]) for key, each in given.items())
        return self.value(rate, **given) - _constant_part(self, rate.shape[1:], shapes)


@lru_cache(maxsize=_REMEMBERED)
def _constant_part(
    solver: _Solver, shape: tuple[int, ...], given: tuple[tuple[str, tuple[int, ...]], ...]
) -> Array:
    """The unknown for readings, and all that is given, of zero; their shapes without samples."""
    return solver.value(np.zeros((1, *shape)), **{key: np.zeros((1, *own)) for key, own in given})


def attitude_motion(excerpt: Excerpt, source: Source) -> AttitudeMotion:
    """Attitude that an orientation shows."""
    return _attitude_motion(excerpt.observations[source], _Solver.of("rotation", excerpt, source))


@lru_cache(maxsize=_REMEMBERED)
def _attitude_motion(read: Observation, solver: _Solver) -> AttitudeMotion:
    R = _nearest(solver.value(read.value))
    rate, bend = solver.change(read.rate), solver.change(read.bend)
    back = R.swapaxes(1, 2)
    # Nine numbers share what three angles scatter by.
    angle, speed, acceleration = (each * np.sqrt(1.5) for each in read.noise)
    noise = (angle, speed, acceleration)
    return AttitudeMotion(R, rate, bend, _axis_of(back @ rate), _axis_of(back @ bend), noise)


def _nearest(matrices: Array) -> Array:
    """Rotations nearest to smoothed matrices."""
    U, _, V = np.linalg.svd(matrices)
    D = np.ones(U.shape[:2])
    D[:, 2] = np.linalg.det(U @ V)
    return np.asarray((U * D[:, None, :]) @ V)


def origin_motion(excerpt: Excerpt, source: Source, turned: AttitudeMotion) -> OriginMotion:
    """Where the platform origin is, if a position is that of its target."""
    solver = _Solver.of("position", excerpt, source)
    return _origin_motion(excerpt.observations[source], turned, solver)


@lru_cache(maxsize=_REMEMBERED)
def _origin_motion(read: Observation, turned: AttitudeMotion, solver: _Solver) -> OriginMotion:
    lever = lever_of(solver.instrument, solver.robot)
    noise = np.hypot(read.noise, lever * np.array(turned.noise))
    return OriginMotion(
        solver.value(read.value, rotation=turned.rotation),
        solver.change(read.rate, rotation=turned.rate),
        solver.change(read.bend, rotation=turned.bend),
        (float(noise[0]), float(noise[1]), float(noise[2])),
    )


def angular_velocity(excerpt: Excerpt, source: Source) -> Observation:
    """Angular velocity in the platform frame [rad/s]."""
    return _angular_velocity(excerpt.observations[source], _Solver.of("omega", excerpt, source))


@lru_cache(maxsize=_REMEMBERED)
def _angular_velocity(read: Observation, solver: _Solver) -> Observation:
    return replace(read, value=solver.value(read.value), rate=solver.change(read.rate))


def specific_force_there(excerpt: Excerpt, source: Source, turned: AttitudeMotion) -> Observation:
    """Specific force of the point where an accelerometer sits, platform frame [m/s^2]."""
    solver = _Solver.of("specific_force", excerpt, source)
    gravity = tuple(excerpt.robot.gravity.tolist())
    return _specific_force_there(excerpt.observations[source], solver, turned, gravity)


@lru_cache(maxsize=_REMEMBERED)
def _specific_force_there(
    read: Observation, solver: _Solver, turned: AttitudeMotion, gravity: tuple[float, ...]
) -> Observation:
    """See :func:`specific_force_there`, for a gravity in the world [m/s^2]."""
    # Of an instrument that does not turn, that of the origin is that of any point.
    still = np.zeros_like(read.value)
    given = {"omega": still, "alpha": still}
    value = solver.value(read.value, rotation=turned.rotation, gravity=np.array(gravity), **given)
    # Gravity turns slowly: it has no rate worth looking at.
    level = np.zeros_like(turned.rotation)
    rate = solver.change(read.rate, rotation=level, gravity=still, **given)
    return replace(read, value=value, rate=rate)


def specific_force_of_origin(
    excerpt: Excerpt, source: Source, rotation: Array, omega: Array, alpha: Array
) -> Array:
    """Specific force of the platform origin by an accelerometer, platform frame [m/s^2], shape
    (n, 3).
    """
    return _Solver.of("specific_force", excerpt, source).value(
        excerpt.observations[source].value,
        rotation=rotation,
        omega=omega,
        alpha=alpha,
        gravity=excerpt.robot.gravity,
    )


def attitude_source(excerpt: Excerpt) -> Source | None:
    """The orientation to go by: a measured one where there is one."""
    return next(iter(excerpt.quantity("orientation")), None)
