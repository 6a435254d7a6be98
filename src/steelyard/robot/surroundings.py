"""What pulls at a platform beside its cables: hoses and umbilicals, and the air."""

from __future__ import annotations

import casadi as ca
import numpy as np

from steelyard.arrays import Array
from steelyard.batch import Symbol
from steelyard.robot.model import Robot

_AIR = 1.2
"""Density [kg/m^3]."""
_TAUT = 0.01
"""Length within which a hose becomes taut, so that its pull follows smoothly [m]."""
_STICKING = 5e-3
"""Speed below which bearings and knots that turn to and fro give way, rather than slip [m/s]."""
HOSE = (("at", 3), ("to", 3), ("force", 1), ("stiffness", 1), ("free", 1))
"""What :func:`hose_wrench` takes of a hose, and how many numbers."""
_SLOWEST = 1e-3
"""Speed below which drag is no longer quadratic, so that its derivative is smooth [m/s],
[rad/s]."""


def middle_of(robot: Robot) -> Array:
    """A place amid those that a platform reaches: below the middle of its anchors, world frame [m],
    shape (3,).
    """
    middle = robot.anchors.mean(axis=0)
    distance = np.linalg.norm(robot.anchors - middle, axis=1).mean()
    return np.asarray(middle - 0.5 * distance * robot.up)


def hose_wrench(position: Symbol, rotation: Symbol, gravity: Symbol, hose: Symbol) -> Symbol:
    """Wrench on the platform about its origin of a hose that is described, in P [N], [N m], shape
    (6,): a part of its weight, and a pull towards where it comes from when it is longer than it is
    free.

    Args:
        position: Of the platform origin, world frame [m], shape (3,).
        rotation: R_world_platform, shape (3, 3).
        gravity: World frame [m/s^2], shape (3,).
        hose: See :data:`HOSE`: where it is fixed to the platform, in P [m], and where it comes
            from, world frame [m], weight [N], stiffness [N/m], free length [m]; shape (9,).
    """
    at, to, weight, stiffness, free = ca.vertsplit(hose, [0, 3, 6, 7, 8, 9])
    along = to - position - rotation @ at
    length = ca.sqrt(ca.sumsqr(along) + _TAUT**2)
    beyond = length - free
    pull = stiffness * (beyond + ca.sqrt(beyond**2 + _TAUT**2)) / 2
    force = rotation.T @ (pull * along / length + weight * gravity / ca.norm_2(gravity))
    return ca.vertcat(force, ca.cross(at, force))


def attached_wrench(
    position: Symbol,
    rotation: Symbol,
    middle: Array,
    force: Symbol,
    stiffness: Symbol,
    moments: Symbol,
    stiffness_moment: Symbol,
) -> Symbol:
    """Wrench on the platform about its origin of a hose that pulls at one of its points, in P [N],
    [N m], shape (6,).

    It is linear in what is not known: products of the force with the point b, platform frame, stand
    for b, since force and point are hard to tell apart. The turning of b moves the hose's end by so
    little that its stiffness does not count.

    Args:
        position: Of the platform origin, world frame [m], shape (3,).
        rotation: R_world_platform, shape (3, 3).
        middle: Where it pulls with ``force``, world frame [m], shape (3,).
        force: World frame [N], shape (3,).
        stiffness: By how much less it pulls the further the platform is from there [N/m].
        moments: b times the components of the force, one after the other [N m], shape (9,).
        stiffness_moment: b times the stiffness [N], shape (3,).
    """
    away = rotation.T @ (position - ca.DM(middle))
    torque = -ca.cross(stiffness_moment, away)
    for axis in range(3):
        own = moments[3 * axis : 3 * axis + 3]
        torque += ca.cross(own, rotation[axis, :].T)
    return ca.vertcat(rotation.T @ force - stiffness * away, torque)


def air_wrench(
    rotation: Symbol, velocity: Symbol, omega: Symbol, area: Symbol, turning: Symbol
) -> Symbol:
    """Wrench of still air on the platform about its origin, in P [N], [N m], shape (6,); see
    :func:`damping_wrench` for what grows with the rate itself.

    Args:
        rotation: R_world_platform, shape (3, 3).
        velocity: Of the platform origin, world frame [m/s], shape (3,).
        omega: Angular velocity, platform frame [rad/s], shape (3,).
        area: Drag coefficient times area [m^2].
        turning: The same of turning [m^5].
    """
    ahead = rotation.T @ velocity
    speed = ca.sqrt(ca.sumsqr(ahead) + _SLOWEST**2)
    spin = ca.sqrt(ca.sumsqr(omega) + _SLOWEST**2)
    return -0.5 * _AIR * ca.vertcat(area * speed * ahead, turning * spin * omega)


def damping_wrench(
    rotation: Symbol, velocity: Symbol, omega: Symbol, moving: Symbol, turning: Symbol
) -> Symbol:
    """Wrench on a platform that swings, of cables, rollers and slow air, which decays its swings
    alike whatever their size; in P [N], [N m], shape (6,).

    Args:
        rotation: R_world_platform, shape (3, 3).
        velocity: Of the platform origin, world frame [m/s], shape (3,).
        omega: Angular velocity, platform frame [rad/s], shape (3,).
        moving: Force over velocity [N s/m].
        turning: Torque over angular velocity [N m s].
    """
    return -ca.vertcat(moving * (rotation.T @ velocity), turning * omega)


def swivel_wrench(
    robot: Robot,
    position: Symbol,
    rotation: Symbol,
    velocity: Symbol,
    omega: Symbol,
    friction: Symbol,
) -> Symbol:
    """Wrench on a platform that swings, of dry friction where its cables turn about their anchors:
    in the bearings of rollers that swivel, in knots and strands that bend; in P [N], [N m], shape
    (6,).

    A torque that does not depend on how fast a cable turns pulls across it at its attachment,
    against the motion there.

    Args:
        robot: With m cables, taken as straight.
        position: Of the platform origin, world frame [m], shape (3,).
        rotation: R_world_platform, shape (3, 3).
        velocity: Of the platform origin, world frame [m/s], shape (3,).
        omega: Angular velocity, platform frame [rad/s], shape (3,).
        friction: Torque at each anchor [N m], shape (m,).
    """
    wrench = ca.SX.zeros(6)
    for i in range(robot.m):
        attachment = ca.DM(robot.attachments[i])
        along = rotation.T @ (ca.DM(robot.anchors[i]) - position) - attachment
        length = ca.norm_2(along)
        moving = rotation.T @ velocity + ca.cross(omega, attachment)
        across = moving - along * ca.dot(along, moving) / length**2
        speed = ca.sqrt(ca.sumsqr(across) + _STICKING**2)
        force = -friction[i] / length * across / speed
        wrench += ca.vertcat(force, ca.cross(attachment, force))
    return wrench
