"""The state of the platform, of which instruments read parts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

import casadi as ca
import numpy as np

from steelyard import rotations
from steelyard.arrays import Array
from steelyard.batch import Batched
from steelyard.dynamics import specific_force_in_platform


@dataclass(frozen=True)
class State:
    """Everything about the platform at one instant, as symbols, or over n samples, as arrays.

    Symbols have the shapes below, arrays a leading axis of samples.
    """

    position: Any
    """Of the platform origin, world frame [m], shape (3,)."""
    rotation: Any
    """R_world_platform, shape (3, 3)."""
    velocity: Any
    """Of the platform origin, world frame [m/s], shape (3,)."""
    omega: Any
    """Angular velocity of the platform in the world, platform frame [rad/s], shape (3,)."""
    specific_force: Any
    """R^T (a_P - g): acceleration of the platform origin minus gravity, platform frame [m/s^2],
    shape (3,)."""
    alpha: Any
    """Derivative of omega [rad/s^2], shape (3,)."""
    tension: Any
    """Of the cables at the platform [N], shape (m,)."""
    wrench: Any
    """Force over torque about the platform origin of all that carries the body, platform frame [N],
    [N m], shape (6,)."""
    gravity: Any
    """World frame [m/s^2], shape (3,)."""
    rolling: Any = None
    """How far the friction of the rollers has built up, from -1 (cables hauled in) to 1 (paid out),
    shape (m,); None: as their present rate has it."""
    anchors: Any = None
    """Where the cables are fixed in the world [m], shape (3, m); None: as the robot file has it."""
    attachments: Any = None
    """The same in the platform frame."""
    stretching: Any = None
    """Part of the tension that stretches the cables [N], shape (m,), the rest of it being their
    damping; None: all of it."""


def symbols(m: int, *, remembered: bool = False) -> State:
    """A state of CasADi symbols for a robot of m cables.

    Args:
        m: Number of cables.
        remembered: Whether what the rollers remember of the motion is given.
    """
    return State(
        position=ca.SX.sym("position", 3),
        rotation=ca.SX.sym("rotation", 3, 3),
        velocity=ca.SX.sym("velocity", 3),
        omega=ca.SX.sym("omega", 3),
        specific_force=ca.SX.sym("specific_force", 3),
        alpha=ca.SX.sym("alpha", 3),
        tension=ca.SX.sym("tension", m),
        wrench=ca.SX.sym("wrench", 6),
        gravity=ca.SX.sym("gravity", 3),
        rolling=ca.SX.sym("rolling", m) if remembered else None,
    )


def state_of_pose(pose: Any, rate: Any, acceleration: Any, gravity: Any) -> State:
    """State of a platform whose pose is position [m] over quaternion (w, x, y, z), symbolically;
    without forces.

    The quaternion may have any length but zero and any rate of it: no state depends on that.

    Args:
        pose: Shape (7,).
        rate: Its time derivative, shape (7,).
        acceleration: The second one, shape (7,).
        gravity: World frame [m/s^2], shape (3,).
    """
    q, dq = pose[3:], rate[3:]
    R = rotations.from_quaternion(q) / ca.dot(q, q)
    omega = rotations.quaternion_omega(q, dq)
    return State(
        position=pose[:3],
        rotation=R,
        velocity=rate[:3],
        omega=omega,
        alpha=ca.jtimes(omega, ca.vertcat(pose, rate), ca.vertcat(rate, acceleration)),
        specific_force=specific_force_in_platform(R, acceleration[:3], gravity),
        tension=None,
        wrench=None,
        gravity=gravity,
    )


@cache
def _pose_motion() -> Batched:
    """:func:`motion_of_poses` at one instant."""
    q, dq, ddq = (ca.SX.sym(name, 6) for name in ("pose", "rate", "acceleration"))
    gravity = ca.SX.sym("gravity", 3)
    rpy = q[3:6]
    R = rotations.from_rpy(rpy)
    omega = R.T @ rotations.rate_matrix(rpy) @ dq[3:6]
    # In body axes the derivative of omega's coordinates is the angular acceleration itself, Eq.
    # (4b).
    alpha = ca.jtimes(omega, ca.vertcat(q, dq), ca.vertcat(dq, ddq))
    return Batched(
        "pose_motion",
        {"pose": q, "rate": dq, "acceleration": ddq, "gravity": gravity},
        {
            "rotation": R,
            "omega": omega,
            "alpha": alpha,
            "specific_force": specific_force_in_platform(R, ddq[:3], gravity),
        },
    )


def motion_of_poses(
    pose: Array, rate: Array, acceleration: Array, gravity: Array
) -> Mapping[str, Array]:
    """Motion in body axes of poses given as x, y, z [m], roll, pitch, yaw [rad] and their time
    derivatives.

    Eq. (3), (4a) and (4b) of [Tempel2017]_, the last as the exact derivative of the (corrected) one
    before it.

    Args:
        pose: Shape (n, 6).
        rate: Shape (n, 6).
        acceleration: Shape (n, 6).
        gravity: World frame [m/s^2], shape (3,).

    Returns:
        ``position``, ``rotation``, ``velocity``, ``omega``, ``alpha``, ``specific_force`` as in
        :class:`State`.
    """
    values = _pose_motion()(pose=pose, rate=rate, acceleration=acceleration, gravity=gravity)
    shape = (len(values["omega"]), 6)
    return {
        "position": np.ascontiguousarray(np.broadcast_to(pose, shape)[:, :3]),
        "velocity": np.ascontiguousarray(np.broadcast_to(rate, shape)[:, :3]),
        **values,
    }


@cache
def _quaternion_motion() -> Batched:
    q, dq, ddq = (ca.SX.sym(name, 4) for name in ("quaternion", "rate", "acceleration"))
    omega = rotations.quaternion_omega(q, dq)
    return Batched(
        "quaternion_motion",
        {"quaternion": q, "rate": dq, "acceleration": ddq},
        {"omega": omega, "alpha": ca.jtimes(omega, ca.vertcat(q, dq), ca.vertcat(dq, ddq))},
    )


def motion_of_quaternions(
    quaternion: Array, rate: Array, acceleration: Array
) -> Mapping[str, Array]:
    """Angular velocity and acceleration in body axes of quaternions (w, x, y, z) and their time
    derivatives.

    Args:
        quaternion: Of any length but zero, shape (n, 4).
        rate: Shape (n, 4).
        acceleration: Shape (n, 4).

    Returns:
        ``omega`` [rad/s] and ``alpha`` [rad/s^2], shape (n, 3).
    """
    return _quaternion_motion()(quaternion=quaternion, rate=rate, acceleration=acceleration)


@cache
def _specific_force() -> Batched:
    """:func:`specific_force_of` at one instant."""
    R = ca.SX.sym("rotation", 3, 3)
    acceleration, gravity = ca.SX.sym("acceleration", 3), ca.SX.sym("gravity", 3)
    value = specific_force_in_platform(R, acceleration, gravity)
    return Batched(
        "specific_force",
        {"rotation": R, "acceleration": acceleration, "gravity": gravity},
        {"value": value},
    )


def specific_force_of(rotation: Array, acceleration: Array, gravity: Array) -> Array:
    """Specific force of the platform origin in the platform frame [m/s^2], shape (n, 3).

    Args:
        rotation: R_world_platform, shape (n, 3, 3).
        acceleration: Of the platform origin, world frame [m/s^2], shape (n, 3) or (3,).
        gravity: World frame [m/s^2], shape (3,).
    """
    return _specific_force()(rotation=rotation, acceleration=acceleration, gravity=gravity)["value"]
