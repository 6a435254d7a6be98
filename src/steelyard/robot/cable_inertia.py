"""The inertia of the cables themselves: a platform that accelerates across its cables accelerates
them too.

A taut cable follows its end in a straight line, so that its own acceleration grows linearly from
nothing at the roller to that of the attachment. Of the inertia of such a load, mass per length
times length times acceleration over two, two thirds hang on the far end: a third of the cable's
mass moves with the platform, across the cable. Along the cable the tension at the platform is
measured.
"""

from __future__ import annotations

from functools import lru_cache

import casadi as ca

from steelyard.arrays import Array
from steelyard.batch import Batched, Symbol
from steelyard.dynamics import point_specific_force
from steelyard.robot import cable
from steelyard.robot.model import Robot


def cable_inertia_expression(
    robot: Robot,
    position: Symbol,
    rotation: Symbol,
    specific_force: Symbol,
    omega: Symbol,
    alpha: Symbol,
    gravity: Symbol,
) -> Symbol:
    """Wrench of the cables on the platform that comes from their own inertia, about its origin, in
    P [N], [N m], shape (6,).

    Args:
        robot: With cables that have weight.
        position: Of the platform origin, world frame [m], shape (3,).
        rotation: R_world_platform, shape (3, 3).
        specific_force: Of the platform origin, in P [m/s^2], shape (3,).
        omega: Angular velocity, in P [rad/s], shape (3,).
        alpha: Its derivative [rad/s^2], shape (3,).
        gravity: World frame [m/s^2], shape (3,).
    """
    wrench = ca.SX.zeros(6)
    straight = robot.with_straight_cables()
    for i in range(robot.m):
        attachment = ca.DM(robot.attachments[i])
        shape = cable.by_tension(
            cable.spec(straight, i), position + rotation @ attachment, ca.SX(1.0)
        )
        along = rotation.T @ shape.direction
        specific = point_specific_force(specific_force, omega, alpha, attachment)
        # Gravity makes the cable sag, which its shape knows; here is what is left, the
        # acceleration.
        acceleration = specific + rotation.T @ gravity
        across = acceleration - along * ca.dot(along, acceleration)
        mass = (robot.cable.linear_density or 0.0) * shape.length
        force = -mass / 3 * across
        wrench += ca.vertcat(force, ca.cross(attachment, force))
    return wrench


@lru_cache(maxsize=32)
def _batched(robot: Robot) -> Batched:
    state = {
        "position": ca.SX.sym("position", 3),
        "rotation": ca.SX.sym("rotation", 3, 3),
        **{name: ca.SX.sym(name, 3) for name in ("specific_force", "omega", "alpha", "gravity")},
    }
    return Batched(
        "cable_inertia", state, {"wrench": cable_inertia_expression(robot, *state.values())}
    )


def cable_inertia_wrench(
    robot: Robot,
    *,
    position: Array,
    rotation: Array,
    specific_force: Array,
    omega: Array,
    alpha: Array,
    gravity: Array,
) -> Array:
    """:func:`cable_inertia_expression` over samples, arrays with samples on axis 0; shape (n,
    6).
    """
    return _batched(robot)(
        position=position,
        rotation=rotation,
        specific_force=specific_force,
        omega=omega,
        alpha=alpha,
        gravity=gravity,
    )["wrench"]
