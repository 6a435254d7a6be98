"""A body on cables of constant length: what acts on it about a pose, and how that changes with the
pose and the tensions.

Small changes of the pose are a displacement of the platform origin along the axes of the world and
a rotation vector in the platform frame.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np
from scipy.spatial.transform import Rotation

from steelyard import rotations
from steelyard.arrays import Array
from steelyard.batch import Batched
from steelyard.inertia import Inertia
from steelyard.robot.kinematics import shapes
from steelyard.robot.model import Robot
from steelyard.rotations import cross_matrices


@dataclass(frozen=True, eq=False)
class Place:
    """A pose of the platform."""

    position: Array
    """Of the platform origin, world frame [m], shape (3,)."""
    rotation: Array
    """R_world_platform, shape (3, 3)."""

    def moved(self, change: Array) -> Place:
        """By a small change, shape (6,)."""
        turned = Rotation.from_rotvec(change[3:]).as_matrix()
        return Place(self.position + change[:3], self.rotation @ turned)


@dataclass(frozen=True, eq=False)
class HangingForces:
    """What acts on a body at a pose, and the lengths of its cables."""

    force: Array
    """Along the changes of the pose: of weight and cables [N], [N m], shape (6,)."""
    by_pose: Array
    """Its derivative by them at constant tensions, shape (6, 6)."""
    by_tension: Array
    """Shape (6, m)."""
    length: Array
    """Unstrained [m], shape (m,)."""
    length_by_pose: Array
    """Shape (m, 6)."""
    length_by_tension: Array
    """Shape (m, m); zero where cables neither stretch nor sag."""
    potential: float
    """Of the weight [J]."""
    potential_by_pose: Array
    """Shape (6,)."""


def forces(
    robot: Robot, body: Inertia, place: Place, tension: Array, change: Array
) -> HangingForces:
    """About a pose.

    Args:
        robot: Its cables.
        body: That hangs on them.
        place: The pose.
        tension: At the platform [N], shape (m,).
        change: Small, of the pose, shape (6,).
    """
    found = _function(_Alike(_fixed(robot), robot))(
        anchors=robot.anchors.ravel(),
        attachments=robot.attachments.ravel(),
        position=place.position,
        rotation=place.rotation,
        change=change,
        tension=tension,
        mass=[body.mass],
        center=body.center_of_gravity,
    )
    own = {name: value[0] for name, value in found.items()}
    own["by_tension"] = own["by_tension"].reshape(-1, robot.m)
    own["length_by_tension"] = own["length_by_tension"].reshape(-1, robot.m)
    return HangingForces(**{**own, "potential": float(own["potential"][0])})


def mass_matrix(body: Inertia, rotation: Array) -> Array:
    """Of the kinetic energy by the rates of the changes of the pose, shape (6, 6)."""
    h = cross_matrices(body.first_moment[None])[0]
    mixed = -rotation @ h
    return np.block([[body.mass * np.eye(3), mixed], [mixed.T, body.inertia_about_origin]])


@dataclass(frozen=True)
class _Alike:
    """A robot among all that differ only in where their cables are fixed."""

    fixed: tuple[Any, ...]
    robot: Robot = field(compare=False)


def _fixed(robot: Robot) -> tuple[Any, ...]:
    """All of a robot that acts on a hanging body, but where its cables are fixed."""
    arrays = (robot.gravity, robot.pulley_radius, robot.pulley_axis)
    return robot.m, robot.cable, *(each.tobytes() for each in arrays)


@lru_cache(maxsize=16)
def _function(alike: _Alike) -> Batched:
    """Of anchors, attachments, pose, its change, tensions, mass and centre of gravity to the parts
    of :class:`HangingForces`.
    """
    robot = alike.robot
    # Flat, since a matrix of one column, of a single cable, is a column to those who evaluate.
    flat = ca.SX.sym("a", 3 * robot.m), ca.SX.sym("b", 3 * robot.m)
    anchors, attachments = (ca.reshape(each, 3, robot.m) for each in flat)
    position, base, change = ca.SX.sym("p", 3), ca.SX.sym("R", 3, 3), ca.SX.sym("x", 6)
    tension, mass, center = ca.SX.sym("T", robot.m), ca.SX.sym("m"), ca.SX.sym("c", 3)
    place = position + change[:3]
    rotation = base @ rotations.exp(change[3:])
    gravity = ca.DM(robot.gravity)
    potential = -mass * ca.dot(gravity, place + rotation @ center)
    cables = shapes(robot, place, rotation, tension, anchors=anchors, attachments=attachments)
    force = mass * gravity
    torque = mass * ca.cross(center, rotation.T @ gravity)
    for i, each in enumerate(cables):
        pull = each.direction * tension[i]
        force += pull
        torque += ca.cross(attachments[:, i], rotation.T @ pull)
    total = ca.vertcat(force, torque)
    length = ca.vertcat(*[each.length for each in cables])
    return Batched(
        "hanging_body",
        {
            "anchors": flat[0],
            "attachments": flat[1],
            "position": position,
            "rotation": base,
            "change": change,
            "tension": tension,
            "mass": mass,
            "center": center,
        },
        {
            "force": total,
            "by_pose": ca.jacobian(total, change),
            "by_tension": ca.jacobian(total, tension),
            "length": length,
            "length_by_pose": ca.jacobian(length, change),
            "length_by_tension": ca.jacobian(length, tension),
            "potential": potential,
            "potential_by_pose": ca.gradient(potential, change),
        },
    )
