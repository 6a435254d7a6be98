"""The identified body at rest on the cables of a robot: where, with which tensions, and what each
cable is as a spring.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import eigh
from scipy.spatial.transform import Rotation

from steelyard.arrays import Array, readonly
from steelyard.dynamics import platform_wrench
from steelyard.errors import InfeasibleError, InputError
from steelyard.excitation.limits.rest_poses import listed_numbers, workspace_grid
from steelyard.inertia import Inertia
from steelyard.natural_frequencies.modes import natural
from steelyard.robot import cable
from steelyard.robot.kinematics import attachments_at, cables_at
from steelyard.robot.model import Robot
from steelyard.robot.tension import distribute
from steelyard.rotations import cross_matrices
from steelyard.simulation.trajectories import workspace_of

LEAST_CABLES = 6
"""With fewer the body comes to rest beside a pose that is chosen."""
ASSUMED_STRAIN = 1e-3
"""Of the tightest cable at rest, where the robot file says no stiffness."""
_TIME_STEPS = (1e-3, 5e-4, 2e-4, 1e-4, 5e-5, 2e-5, 1e-5)
"""Round ones to choose from [s]."""
_PHASE_A_STEP = 0.1
"""Largest product of angular frequency and time step; Runge-Kutta of fourth order is stable up to
2.8 and keeps energy to 1e-6 a swing here."""


@dataclass(frozen=True, eq=False)
class Hanging:
    """A body at rest on m straight, massless, elastic cables."""

    robot: Robot
    """As in its file."""
    body: Inertia
    position: Array
    """Of the platform origin, world frame [m], shape (3,)."""
    rotation: Array
    """R_world_platform, shape (3, 3)."""
    tension: Array
    """[N], shape (m,)"""
    leave: Array
    """Where the cables leave their rollers, or the anchors without; world frame [m], shape (m,
    3)."""
    length: Array
    """Unstrained, from the anchor over the roller to the attachment [m], shape (m,)."""
    slack: Array
    """Straight distance from the point where it leaves its roller at which each cable of this
    length is slack [m], shape (m,)."""
    axial_stiffness: float
    """EA, that of the robot file or an assumed one [N]."""
    damping: Array
    """[N s/m], shape (m,)"""
    time_step: float
    """That resolves the swings on these cables [s]."""

    @property
    def stiffness(self) -> Array:
        """Of the cables as springs, EA over unstrained length [N/m], shape (m,)."""
        return self.axial_stiffness / self.length

    @property
    def quaternion(self) -> Array:
        """Of the platform in the world (w, x, y, z), shape (4,)."""
        rotation = Rotation.from_matrix(self.rotation)
        return np.asarray(rotation.as_quat(scalar_first=True, canonical=True))

    @property
    def sag(self) -> float:
        """How far the cables would hang through in their middle by their weight, the largest; 0
        without weight [m].
        """
        weight = (self.robot.cable.linear_density or 0.0) * np.linalg.norm(self.robot.gravity)
        line = self.leave - attachments_at(self.position, self.rotation, self.robot)
        chord = np.linalg.norm(line, axis=1)
        level = np.linalg.norm(line - np.outer(line @ self.robot.up, self.robot.up), axis=1)
        pull = np.maximum(self.tension, weight * chord + 1e-9)
        return float(np.max(weight * level * chord / (8 * pull)))

    @property
    def roll(self) -> float:
        """How far the points where cables leave their rollers move within the workspace, the most;
        0 without rollers [m].
        """
        if not self.robot.pulley_radius.any():
            return 0.0
        middle, reach = workspace_of(self.robot)
        signs = np.array(np.meshgrid(*[[-1, 1]] * 3)).reshape(3, -1).T
        corners = [
            _shapes(self.robot, middle[:3] + s * reach[:3], self.rotation, self.tension)[0]
            for s in signs
        ]
        return float(np.linalg.norm(np.array(corners) - self.leave, axis=2).max())


def hang(robot: Robot, body: Inertia, pose: ArrayLike | None = None) -> Hanging:
    """Hang a body on a robot's cables.

    Args:
        robot: Its cables are taken as straight and massless.
        body: That it carries, one that can exist.
        pose: x, y, z [m], roll, pitch, yaw [rad], shape (6,); None: level, as near to the middle of
            the workspace as the cables can hold it. With fewer than six cables they get the lengths
            of this pose, and the body comes to rest beside it.

    Raises:
        InputError: The robot has no cables, the body cannot exist, or the cables cannot hold
            it there.
    """
    if not robot.m:
        raise InputError(
            f"--robot: expected a robot with cables, found none on '{robot.name}'; export the"
            " platform alone, without a robot"
        )
    if not body.is_physical:
        raise InputError(
            "--robot: expected a body that can exist, found one that cannot, which MuJoCo refuses;"
            " choose the method consistent or maximum-likelihood, or export the platform alone"
        )
    if pose is not None and not np.isfinite(pose).all():
        raise InputError(
            f"--pose: expected six finite numbers, found {' '.join(map(str, np.ravel(pose)))};"
            " correct it"
        )
    if robot.m < LEAST_CABLES:
        return _swinging(robot, body, pose)
    poses = workspace_grid(robot) if pose is None else readonly(np.atleast_2d(pose), (1, 6), "pose")
    rotations = Rotation.from_euler("ZYX", poses[:, :2:-1]).as_matrix()
    straight = robot.with_straight_cables()
    structures = cables_at(straight, poses[:, :3], rotations, np.ones(robot.m)).structure
    specific_force = -np.einsum("nji,j->ni", rotations, robot.gravity)  # (n, 3), in P
    still = np.zeros_like(specific_force)
    wrenches = platform_wrench(body.parameters, specific_force, still, still)
    for place, rotation, structure, wrench in zip(
        poses, rotations, structures, wrenches, strict=True
    ):
        try:
            tension = distribute(structure[None], wrench[None], robot.tension_limits)[0]
        except InfeasibleError:
            continue
        # The last digits, which a solver with a tolerance leaves.
        tension = tension + np.linalg.pinv(structure) @ (wrench - structure @ tension)
        return _hanging(robot, body, place[:3], rotation, structure, tension)
    low, high = robot.tension_limits
    where, found, cure = "a pose within its limits", "none", "check the robot file"
    if pose is not None:
        where = f"that {listed_numbers(poses[0, :3])} m is a pose"
        found, cure = "that it is not", "choose another --pose"
    raise InputError(
        f"--robot: expected {where} in which the cables of '{robot.name}' can hold {body.mass:.4g}"
        f" kg with {low:g} to {high:g} N, found {found}; {cure}, or export the platform alone,"
        " without --robot"
    )


def _swinging(robot: Robot, body: Inertia, pose: ArrayLike | None) -> Hanging:
    """A body that comes to rest on fewer than six cables."""
    chosen = workspace_of(robot)[0] * [1, 1, 1, 0, 0, 0] if pose is None else np.asarray(pose)
    straight = robot.with_straight_cables()
    rest = natural(straight, body, pose=chosen).rest
    place, tension = rest.place, np.maximum(rest.tension, 0.0)
    structure = cables_at(straight, place.position[None], place.rotation[None], tension).structure
    return _hanging(robot, body, place.position, place.rotation, structure[0], tension)


def _hanging(
    robot: Robot, body: Inertia, position: Array, rotation: Array, structure: Array, tension: Array
) -> Hanging:
    """The body at rest with known tensions, and what each cable is as a spring.

    Args:
        robot: As in its file.
        body: At rest.
        position: Of the platform origin [m], shape (3,).
        rotation: R_world_platform, shape (3, 3).
        structure: Structure matrix there, shape (6, m).
        tension: [N], shape (m,).
    """
    axial_stiffness = robot.cable.axial_stiffness or float(tension.max()) / ASSUMED_STRAIN
    elastic = replace(robot, cable=replace(robot.cable, axial_stiffness=axial_stiffness))
    leave, length, on_roller = _shapes(elastic, position, rotation, tension)
    stiffness = axial_stiffness / length
    return Hanging(
        robot=robot,
        body=body,
        position=position,
        rotation=rotation,
        tension=tension,
        leave=leave,
        length=length,
        slack=length - on_roller,
        axial_stiffness=axial_stiffness,
        # As in the simulations of this package: each cable as a spring with a quarter of the mass.
        damping=2 * robot.cable.damping_ratio * np.sqrt(stiffness * body.mass / 4),
        time_step=_time_step(body, structure @ (stiffness[:, None] * structure.T)),
    )


def _shapes(
    robot: Robot, position: Array, rotation: Array, tension: Array
) -> tuple[Array, Array, Array]:
    """Leave points [m], shape (m, 3), unstrained lengths [m] and strained lengths on the rollers
    [m], shape (m,), of straight cables.
    """
    straight = robot.with_straight_cables()
    rows = []
    for i, point in enumerate(attachments_at(position, rotation, straight)):
        shape = cable.by_tension(cable.spec(straight, i), ca.DM(point), float(tension[i]))
        on_roller = float(robot.pulley_radius[i]) * shape.wrap
        rows.append(
            np.array(ca.evalf(ca.vertcat(shape.leave_point, shape.length, on_roller))).ravel()
        )
    found = np.array(rows)
    return found[:, :3], found[:, 3], found[:, 4]


def _time_step(body: Inertia, stiffness: Array) -> float:
    """A round time step that resolves the fastest swing [s].

    Args:
        body: That swings.
        stiffness: By displacements and rotations about the platform origin, in P, shape (6, 6).
    """
    h = cross_matrices(body.first_moment[None])[0]
    mass = np.block([[body.mass * np.eye(3), -h], [h, body.inertia_about_origin]])
    fastest = float(np.sqrt(eigh(stiffness, mass, eigvals_only=True).max()))
    return next((step for step in _TIME_STEPS if fastest * step <= _PHASE_A_STEP), _TIME_STEPS[-1])
