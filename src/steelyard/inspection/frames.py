"""What the instruments of an excerpt say of the platform, if they are as described."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.spatial.transform import Rotation

from steelyard.arrays import Array
from steelyard.identification.model.sources import Source
from steelyard.inspection.excerpt import Excerpt, Observation

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
    return matrix_of(getattr(excerpt.instruments[name], "rpy_deg", (0.0, 0.0, 0.0)))


@lru_cache(maxsize=256)
def matrix_of(rpy_deg: tuple[float, float, float]) -> Array:
    """Rotation matrix of roll, pitch, yaw [deg], as experiment files have them; read-only."""
    matrix = np.asarray(Rotation.from_euler("ZYX", rpy_deg[::-1], degrees=True).as_matrix())
    matrix.setflags(write=False)
    return matrix


def rpy_deg_of(matrix: Array) -> list[float]:
    """Roll, pitch, yaw [deg] of a rotation matrix, as experiment files have them."""
    with np.errstate(all="ignore"):
        # At a pitch of 90 degrees roll and yaw are one: any will do.
        angles = _angles(matrix)
    return [float(round(each, 3)) + 0.0 for each in angles]


def _angles(R: Array) -> tuple[float, float, float]:
    pitch = float(np.degrees(np.arcsin(np.clip(-R[2, 0], -1, 1))))
    if abs(R[2, 0]) > 1 - 1e-9:
        return 0.0, pitch, float(np.degrees(np.arctan2(-R[0, 1], R[1, 1])))
    return (
        float(np.degrees(np.arctan2(R[2, 1], R[2, 2]))),
        pitch,
        float(np.degrees(np.arctan2(R[1, 0], R[0, 0]))),
    )


def vector_of(matrices: Array) -> Array:
    """Axis of the antisymmetric part of matrices, shape (n, 3)."""
    m = matrices
    return (
        np.stack(
            [m[:, 2, 1] - m[:, 1, 2], m[:, 0, 2] - m[:, 2, 0], m[:, 1, 0] - m[:, 0, 1]], axis=1
        )
        / 2
    )


def tracker_frame(excerpt: Excerpt, name: str) -> tuple[Array, Array]:
    """Origin of the tracker in the world [m] and R_world_tracker."""
    frame = getattr(excerpt.instruments[name], "frame", None)
    if frame is None:
        return np.zeros(3), np.eye(3)
    return np.array(frame.position, dtype=np.float64), matrix_of(frame.rpy_deg)


def turning(excerpt: Excerpt, source: Source) -> AttitudeMotion:
    """Attitude that an orientation shows."""
    name = source[0]
    frame, mounted = tracker_frame(excerpt, name)[1], mounting(excerpt, name)
    return _turning(excerpt.observations[source], frame.tobytes(), mounted.tobytes())


@lru_cache(maxsize=_REMEMBERED)
def _turning(read: Observation, frame: bytes, mounted: bytes) -> AttitudeMotion:
    seen = read.between(_matrix(frame), _matrix(mounted).T)
    R, rate, bend = _nearest(seen.value), seen.rate, seen.bend
    back = R.swapaxes(1, 2)
    # Nine numbers share what three angles scatter by.
    angle, speed, acceleration = (each * np.sqrt(1.5) for each in seen.noise)
    return AttitudeMotion(
        R, rate, bend, vector_of(back @ rate), vector_of(back @ bend), (angle, speed, acceleration)
    )


def _matrix(content: bytes) -> Array:
    return np.frombuffer(content).reshape(3, 3)


def _nearest(matrices: Array) -> Array:
    """Rotations nearest to smoothed matrices."""
    U, _, V = np.linalg.svd(matrices)
    D = np.ones(U.shape[:2])
    D[:, 2] = np.linalg.det(U @ V)
    return np.asarray((U * D[:, None, :]) @ V)


def lever_of(excerpt: Excerpt, name: str) -> Array:
    """Where on the platform an instrument looks [m], shape (3,)."""
    instrument = excerpt.instruments[name]
    return np.array(
        getattr(instrument, "target", None) or getattr(instrument, "position", (0.0, 0.0, 0.0)),
        dtype=np.float64,
    )


def place(excerpt: Excerpt, source: Source, turned: AttitudeMotion) -> OriginMotion:
    """Where the platform origin is, if a position is that of its target."""
    name = source[0]
    origin, R = tracker_frame(excerpt, name)
    lever = lever_of(excerpt, name)
    return _place(
        excerpt.observations[source], turned, R.tobytes(), origin.tobytes(), lever.tobytes()
    )


@lru_cache(maxsize=_REMEMBERED)
def _place(
    read: Observation, turned: AttitudeMotion, frame: bytes, origin: bytes, where: bytes
) -> OriginMotion:
    seen, lever = read.mapped(_matrix(frame)), np.frombuffer(where)
    size = float(np.linalg.norm(lever))
    by_place, by_angle = np.array(seen.noise), size * np.array(turned.noise)
    noise = np.hypot(by_place, by_angle)
    return OriginMotion(
        seen.value + np.frombuffer(origin) - turned.rotation @ lever,
        seen.rate - turned.rate @ lever,
        seen.bend - turned.bend @ lever,
        (float(noise[0]), float(noise[1]), float(noise[2])),
    )


def moved(force: Array, turned_omega: Array, alpha: Array, lever: Array) -> Array:
    """Specific force at a lever away from a point whose specific force is given [m/s^2], shape (n,
    3).
    """
    return np.asarray(
        force + np.cross(alpha, lever) + np.cross(turned_omega, np.cross(turned_omega, lever))
    )


def gyro(excerpt: Excerpt, source: Source) -> Observation:
    """Angular velocity in the platform frame [rad/s]."""
    return excerpt.observations[source].mapped(mounting(excerpt, source[0]))


def accelerometer(excerpt: Excerpt, source: Source, rotation: Array) -> Observation:
    """Specific force where the instrument sits, platform frame [m/s^2]."""
    seen = excerpt.observations[source].mapped(mounting(excerpt, source[0]))
    if getattr(excerpt.instruments[source[0]], "gravity", "included") == "removed":
        return seen.plus(-rotation.swapaxes(1, 2) @ excerpt.robot.gravity)
    return seen


def attitude_source(excerpt: Excerpt) -> Source | None:
    """Who tells the attitude: a measured one where there is one."""
    sources = excerpt.quantity("orientation")
    return min(sources, key=lambda s: excerpt.instruments[s[0]].kind == "command", default=None)
