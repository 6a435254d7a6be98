"""What force instruments measure, as a wrench on the platform, beside one account of its motion."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from scipy.spatial.transform import Rotation

from steelyard.arrays import Array
from steelyard.dynamics import specific_force_at
from steelyard.errors import InfeasibleError
from steelyard.identification.model.sources import Source
from steelyard.inspection.agreements.excerpt import Excerpt
from steelyard.inspection.agreements.frames import (
    AttitudeMotion,
    OriginMotion,
    angular_velocity,
    attitude_motion,
    lever_of,
    origin_motion,
    place_sigma,
    point_of,
    specific_force_of_origin,
)
from steelyard.inspection.agreements.motion import sigma_of, specific_force
from steelyard.instruments.equations import solve_for
from steelyard.robot.kinematics import cables_at
from steelyard.robot.model import Robot

_SMALL = 1e-6
"""Step of differences [rad], [m]."""


@dataclass(frozen=True, eq=False)
class MeasuredWrench:
    """A wrench of the cables, or of a sensor, beside a motion."""

    wrench: Array
    """On the platform about its origin, shape (n, 6)."""
    columns: Array
    """Its derivative by the constants of the sensors, then by those of the pose, shape (n, 6,
    c)."""
    sigma: Array
    """1-sigma of these, shape (c,)."""
    noise: tuple[float, float]
    """1-sigma left in force [N] and torque [N m]."""
    structure: Array | None
    """Structure matrix, shape (n, 6, m)."""
    of_pose: int = 0
    """How many of the constants are errors of the pose: the last ones."""


@dataclass(frozen=True, eq=False)
class PlatformMotion:
    """One account of how the platform moves."""

    turned: AttitudeMotion | None
    where: OriginMotion | None
    force: Array
    """Specific force of the platform origin [m/s^2], shape (n, 3)."""
    omega: Array
    alpha: Array
    noise: tuple[float, float]
    """1-sigma left in specific force [m/s^2] and angular acceleration [rad/s^2]."""
    sources: Mapping[str, Source] = field(default_factory=dict)
    """Quantity -> whose readings say so."""


def platform_motion(excerpt: Excerpt, sources: tuple[Source, ...]) -> PlatformMotion | None:
    """What some sources say of the motion; None where they do not say enough."""
    first = {quantity: (name, quantity) for name, quantity in reversed(sources)}
    turned = attitude_motion(excerpt, first["orientation"]) if "orientation" in first else None
    where = None
    if turned is not None and "position" in first:
        where = origin_motion(excerpt, first["position"], turned)
    turning = _turning(excerpt, first.get("angular_velocity"), turned)
    if turning is None:
        return None
    omega, alpha, jitter = turning
    of_force, place = first.get("specific_force"), None
    if of_force is not None:
        force, noise = _by_accelerometer(excerpt, of_force, turned, omega, alpha, jitter)
        place = of_force
    elif turned is not None:
        force = specific_force(excerpt, turned, where)
        noise = float(np.hypot(9.81 * turned.noise[0], 0.0 if where is None else where.noise[2]))
        place = None if where is None else first["position"]
    else:
        return None
    if place is not None:
        noise = float(np.hypot(noise, _by_place(excerpt, place[0], omega, alpha)))
    return PlatformMotion(turned, where, force, omega, alpha, (noise, jitter), first)


def _turning(
    excerpt: Excerpt, of_gyro: Source | None, turned: AttitudeMotion | None
) -> tuple[Array, Array, float] | None:
    """Angular velocity and acceleration, shape (n, 3), and the noise of the latter: by a gyro where
    there is one.
    """
    if of_gyro is not None:
        read = angular_velocity(excerpt, of_gyro)
        return read.value, read.rate, read.noise[1]
    if turned is not None:
        return turned.omega, turned.alpha, turned.noise[2]
    if excerpt.static:
        still = np.zeros((len(excerpt.time), 3))
        return still, still, 0.0
    return None


def _by_place(excerpt: Excerpt, name: str, omega: Array, alpha: Array) -> float:
    """Root mean square of what it changes in the acceleration of the origin that nobody knows well
    where an instrument sits [m/s^2].
    """
    _, by_point = specific_force_at(np.zeros_like(omega), omega, alpha, np.zeros(3))
    changes = by_point * place_sigma(excerpt.instruments[name], excerpt.robot)
    return float(np.sqrt(np.mean(np.sum(changes**2, axis=2))))


def _by_accelerometer(
    excerpt: Excerpt,
    of_force: Source,
    turned: AttitudeMotion | None,
    omega: Array,
    alpha: Array,
    jitter: float,
) -> tuple[Array, float]:
    """Specific force of the origin [m/s^2], shape (n, 3), and its noise."""
    rotation = np.broadcast_to(np.eye(3), (len(omega), 3, 3)) if turned is None else turned.rotation
    force = specific_force_of_origin(excerpt, of_force, rotation, omega, alpha)
    lever = lever_of(excerpt.instruments[of_force[0]], excerpt.robot)
    # Bias and small misalignment are its own, and are allowed for elsewhere.
    own, error = excerpt.observations[of_force].noise[0], excerpt.settings.balance.accelerometer
    noise = float(np.sqrt(own**2 + (lever * jitter) ** 2 + error**2))
    return force, noise


def of_cables(excerpt: Excerpt, source: Source, motion: PlatformMotion) -> MeasuredWrench | None:
    """The wrench of all cables; None where they cannot be straight."""
    turned, where = motion.turned, motion.where
    if turned is None or where is None:
        return None
    robot = excerpt.robot.with_straight_cables()
    read, instrument = excerpt.observations[source], excerpt.instruments[source[0]]
    try:
        W = _structures(robot, where, turned)
    except InfeasibleError:
        return None
    tension = solve_for(
        "tension",
        instrument,
        excerpt.experiment.robot.with_straight_cables(),
        {source[1]: read.value},
        {
            "position": where.position,
            "rotation": turned.rotation,
            "velocity": where.velocity,
            "omega": turned.omega,
        },
    )
    (stated,) = (term.deviation for term in instrument.terms(robot.m) if term.key == "offset")
    settings = excerpt.settings.balance
    usual = settings.sensor_offset * float(np.median(np.abs(read.value)))
    sigma = np.full(robot.m, usual)
    if stated is not None:
        sigma = np.maximum(stated, settings.least_offset * usual)
    spread = np.sqrt(np.sum(W**2, axis=2).reshape(len(W), 2, 3).mean(axis=(0, 2)))
    noise = (read.noise[0] * float(spread[0]), read.noise[0] * float(spread[1]))
    by_pose = np.einsum("nkmp,nm->nkp", _structure_changes(robot, where, turned), tension)
    return MeasuredWrench(
        np.einsum("nkm,nm->nk", W, tension),
        np.concatenate([W, by_pose], axis=2),
        np.concatenate([sigma, _pose_sigma(excerpt, motion.sources)]),
        noise,
        W,
        of_pose=by_pose.shape[2],
    )


@lru_cache(maxsize=32)
def _structures(robot: Robot, where: OriginMotion, turned: AttitudeMotion) -> Array:
    # Of straight cables: what sag does to the directions is less than what is allowed for.
    return cables_at(robot, where.position, turned.rotation, np.full(robot.m, 100.0)).structure


@lru_cache(maxsize=32)
def _structure_changes(robot: Robot, where: OriginMotion, turned: AttitudeMotion) -> Array:
    """How the structure matrix changes with small constant errors of attitude and place, shape
    (n, 6, m, 6): those of an instrument that is mounted a little otherwise than stated.

    A body that is turned with its instrument is as good a body: wrenches are in the axes before
    the turn.
    """
    still = _structures(robot, where, turned)
    even = np.full(robot.m, 100.0)
    changes = []
    for theta in _SMALL * np.eye(3):
        turn = Rotation.from_rotvec(theta).as_matrix()
        W = cables_at(robot, where.position, turned.rotation @ turn, even).structure
        back = np.concatenate([turn @ W[:, :3], turn @ W[:, 3:]], axis=1)
        changes.append((back - still) / _SMALL)
    for step in _SMALL * np.eye(3):
        W = cables_at(robot, where.position + step, turned.rotation, even).structure
        changes.append((W - still) / _SMALL)
    return np.stack(changes, axis=3)


def _pose_sigma(excerpt: Excerpt, sources: Mapping[str, Source]) -> Array:
    """1-sigma of constant errors of attitude [rad] and place [m], shape (6,)."""
    settings = excerpt.settings
    attitude, place = sources["orientation"][0], sources["position"][0]
    turned = np.hypot(
        sigma_of(excerpt, attitude, "misalignment", settings.least_sigma["rad"]),
        sigma_of(excerpt, attitude, "reference", settings.least_reference),
    )
    placed = sigma_of(excerpt, place, "target", settings.least_sigma["m"])
    if excerpt.instruments[place].commanded:
        placed = np.hypot(placed, settings.command_place)
    return np.concatenate([turned, placed])


def of_sensor(excerpt: Excerpt, of_force: Source, of_torque: Source) -> MeasuredWrench:
    """The wrench of a six-axis sensor."""
    name, robot = of_force[0], excerpt.experiment.robot
    instrument = excerpt.instruments[name]
    force, torque = excerpt.observations[of_force], excerpt.observations[of_torque]

    def wrench_of(forces: Array, torques: Array) -> Array:
        readings = {of_force[1]: forces, of_torque[1]: torques}
        return solve_for("wrench", instrument, robot, readings, {})

    wrench = wrench_of(force.value, torque.value)
    alone = wrench_of(np.zeros_like(force.value), torque.value)
    terms = {term.key: term for term in instrument.terms(robot.m)}
    sigma = []
    for key, axes in (("offset.force", wrench[:, :3]), ("offset.torque", alone[:, 3:])):
        stated = terms[key].deviation
        sigma.append(np.full(3, float(np.abs(axes).max())) if stated is None else stated)
    lever = float(np.linalg.norm(point_of(excerpt, name)))
    return MeasuredWrench(
        wrench,
        # Offsets of the sensor's axes are as many constants in those of the platform.
        np.broadcast_to(np.eye(6), (len(wrench), 6, 6)),
        np.maximum(np.concatenate(sigma), 1e-9),
        (force.noise[0], float(np.hypot(torque.noise[0], lever * force.noise[0]))),
        None,
    )
