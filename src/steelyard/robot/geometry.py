"""How the wrench of the cables follows from where they are fixed and where the platform is: for
errors of both.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca

from steelyard import rotations
from steelyard.arrays import Array
from steelyard.batch import Batched, Symbol
from steelyard.robot import cable
from steelyard.robot.kinematics import structure_columns
from steelyard.robot.model import Robot


@dataclass(frozen=True, eq=False)
class WrenchByGeometry:
    """Derivatives of the wrench of the cables over n samples, in P."""

    anchor: Array
    """By the coordinates of the anchors in the world [N/m], [N], shape (n, 6, 3 m)."""
    attachment: Array
    """By the coordinates of the attachments in the platform, same units, shape (n, 6, 3 m)."""
    pose: Array
    """By the position of the platform in the world, then by a rotation vector on the right of its
    rotation, shape (n, 6, 6)."""


def cable_wrench(
    robot: Robot,
    position: Symbol,
    rotation: Symbol,
    tension: Symbol,
    anchors: Symbol,
    attachments: Symbol,
) -> Symbol:
    """Wrench of the cables on the platform about its origin, in P [N], [N m], for any geometry,
    shape (6,).

    Args:
        robot: Everything about the cables but where they are fixed.
        position: Of the platform origin, world frame [m], shape (3,).
        rotation: R_world_platform, shape (3, 3).
        tension: At the platform [N], shape (m,).
        anchors: World frame [m], shape (3, m).
        attachments: Platform frame [m], shape (3, m).
    """
    wrench = ca.SX.zeros(6)
    for i in range(robot.m):
        spec = cable.spec(robot, i)._replace(anchor=anchors[:, i])
        shape = cable.by_tension(spec, position + rotation @ attachments[:, i], tension[i])
        wrench += structure_columns(rotation, attachments[:, i], shape.direction) * tension[i]
    return wrench


@lru_cache(maxsize=32)
def _batched(robot: Robot) -> Batched:
    """Derivatives of :func:`cable_wrench` about the geometry of the robot file."""
    position, rotation = ca.SX.sym("position", 3), ca.SX.sym("rotation", 3, 3)
    tension = ca.SX.sym("tension", robot.m)
    anchors, attachments = ca.SX.sym("anchors", 3, robot.m), ca.SX.sym("attachments", 3, robot.m)
    moved, turn = ca.SX.sym("moved", 3), ca.SX.sym("turn", 3)
    wrench = cable_wrench(
        robot, position + moved, rotation @ rotations.exp(turn), tension, anchors, attachments
    )
    derivatives = [
        ca.densify(ca.jacobian(wrench, ca.vec(by)))
        for by in (anchors, attachments, ca.vertcat(moved, turn))
    ]
    present = [ca.DM(robot.anchors).T, ca.DM(robot.attachments).T, ca.DM.zeros(3), ca.DM.zeros(3)]
    derivatives = ca.substitute(derivatives, [anchors, attachments, moved, turn], present)
    return Batched(
        "geometry",
        {"position": position, "rotation": rotation, "tension": tension},
        dict(zip(("anchor", "attachment", "pose"), derivatives, strict=True)),
    )


def wrench_by_geometry(
    robot: Robot, position: Array, rotation: Array, tension: Array
) -> WrenchByGeometry:
    """Derivatives of the wrench of the cables by the coordinates of anchors and attachments and by
    the pose.

    Cables are taken as straight here: how their sag changes with an error of millimetres is of no
    account.

    Args:
        robot: With m cables.
        position: Of the platform origin, world frame [m], shape (n, 3).
        rotation: R_world_platform, shape (n, 3, 3).
        tension: At the platform [N], shape (n, m).
    """
    values = _batched(robot.with_straight_cables())(
        position=position, rotation=rotation, tension=tension
    )
    return WrenchByGeometry(**values)
