"""The cables of a robot at a pose: directions, lengths and the structure matrix.

The structure matrix W is in the platform frame: W t is the wrench of the cables on the platform about its origin, for tensions t
at the platform end. Where cables have weight it depends on the tensions, since they sag.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from steelyard.arrays import Array
from steelyard.batch import Batched, Symbol
from steelyard.errors import InfeasibleError
from steelyard.robot import cable
from steelyard.robot.model import Robot


@dataclass(frozen=True)
class CableState:
    """Cables over n samples; see :class:`steelyard.robot.cable.CableShape`."""

    direction: Array
    """World frame, from the platform to the anchor, shape (n, m, 3)."""
    structure: Array
    """Structure matrix W in the platform frame, shape (n, 6, m)."""
    length: Array
    """Unstrained, from the anchor over the roller to the attachment [m], shape (n, m)."""
    winch_tension: Array
    """[N], shape (n, m)."""


def structure_columns(rotation: Symbol, attachment: Symbol, direction: Symbol) -> Symbol:
    """Column of W of one cable: force of a unit tension over its torque about the origin, in P, Eq. (5b), (11)."""
    pull = rotation.T @ direction
    return ca.vertcat(pull, ca.cross(attachment, pull))


def shapes(robot: Robot, position: Symbol, rotation: Symbol, tension: Symbol) -> list[cable.CableShape]:
    """Shapes of all cables at a pose for tensions at the platform end, symbolically."""
    return [
        cable.by_tension(cable.spec(robot, i), position + rotation @ ca.DM(robot.attachments[i]), tension[i])
        for i in range(robot.m)
    ]


@lru_cache(maxsize=32)
def _batched(robot: Robot) -> Batched:
    position, rotation = ca.SX.sym("position", 3), ca.SX.sym("rotation", 3, 3)
    tension = ca.SX.sym("tension", robot.m)
    all_cables = shapes(robot, position, rotation, tension)
    columns = [
        structure_columns(rotation, ca.DM(b), c.direction) for b, c in zip(robot.attachments, all_cables, strict=True)
    ]
    return Batched(
        "cables",
        {"position": position, "rotation": rotation, "tension": tension},
        {
            "direction": ca.horzcat(*[c.direction for c in all_cables]).T,
            "structure": ca.horzcat(*columns),
            "length": ca.vertcat(*[c.length for c in all_cables]),
            "winch_tension": ca.vertcat(*[c.winch_tension for c in all_cables]),
            "residual": ca.vertcat(*[c.residual for c in all_cables]),
        },
    )


def attachments_at(position: ArrayLike, rotation: ArrayLike, robot: Robot) -> Array:
    """Attachments in the world frame [m], shape (n, m, 3)."""
    turned = np.asarray(rotation, dtype=np.float64) @ robot.attachments.T
    return np.asarray(position, dtype=np.float64)[..., None, :] + np.swapaxes(turned, -1, -2)


def cables_at(robot: Robot, position: ArrayLike, rotation: ArrayLike, tension: ArrayLike) -> CableState:
    """Directions, lengths and structure matrix at poses.

    Args:
        robot: With m cables, at least one.
        position: Of the platform origin, world frame [m], shape (n, 3).
        rotation: R_world_platform, shape (n, 3, 3).
        tension: At the platform end [N], shape (n, m) or (m,); of influence only where cables have weight or stretch.

    Returns:
        State of the cables over the n samples.

    Raises:
        InfeasibleError: A cable is too slack for its equations to be solved.
    """
    tension = np.asarray(tension, dtype=np.float64)
    if robot.cable.linear_density:
        # A reading near zero carries no direction: nothing pulls less than a cable that just bears its own weight across.
        reach = np.linalg.norm(robot.anchors - attachments_at(position, rotation, robot), axis=-1)
        tension = np.maximum(tension, robot.cable.linear_density * np.linalg.norm(robot.gravity) * reach)
    values = _batched(robot)(position=position, rotation=rotation, tension=tension)
    residual = values.pop("residual")
    values["structure"] = values["structure"].reshape(-1, 6, robot.m)
    values["direction"] = values["direction"].reshape(-1, robot.m, 3)
    # A solution that is no number must not pass for one whose error is small.
    bad = ~((residual < cable.RESIDUAL_TOLERANCE) & np.isfinite(values["direction"]).all(axis=-1))
    if bad.any():
        sample, i = np.argwhere(bad)[0]
        raise InfeasibleError(
            f"cable {i + 1} of '{robot.name}': expected a cable that hangs between its anchor and its attachment, found none at sample "
            f"{sample}; check the pose, the anchors and the tension there",
            sample=int(sample),
        )
    return CableState(**values)
