"""The cables of a robot at a pose: directions, lengths and the structure matrix.

The structure matrix W is in the platform frame: W t is the wrench of the cables on the platform
about its origin, for tensions t at the platform end. Where cables have weight it depends on the
tensions, since they sag.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.arrays import Array
from steelyard.batch import Batched, Symbol
from steelyard.dynamics import point_velocity
from steelyard.errors import InfeasibleError
from steelyard.robot import cable, pulley
from steelyard.robot.model import Robot

_QUICK_STEPS = 1
"""What a taut cable needs; samples with a slack one are done again with all steps."""
_QUICK_TOLERANCE = 1e-10
"""Residual of a quick shape that is kept: no direction is then wrong by more."""
_SLACK_AT_ONCE = 65536
"""Samples that are done again at a time: bounds their memory."""


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
    """Column of W of one cable: force of a unit tension over its torque about the origin, in P, Eq.
    (5b), (11).
    """
    pull = rotation.T @ direction
    return ca.vertcat(pull, ca.cross(attachment, pull))


def shapes(
    robot: Robot,
    position: Symbol,
    rotation: Symbol,
    tension: Symbol,
    *,
    anchors: Symbol | None = None,
    attachments: Symbol | None = None,
    stretch: Symbol | None = None,
    rollers: Symbol | None = None,
    leaning: Symbol | None = None,
    steps: int = cable.STEPS,
) -> list[cable.CableShape]:
    """Shapes of all cables at a pose for tensions at the platform end, symbolically; steps as of
    :func:`cable.by_tension`. Where the cables are fixed, shapes (3, m), None: as the robot file has
    it. So are by which factor they stretch more, a number, by how much the radii of rollers are
    larger [m], shape (m,), and by how much their axes lean (:func:`.leaned`), shape (2 m,); cables
    that do not stretch and points without a roller stay as they are.
    """
    anchors = ca.DM(robot.anchors.T) if anchors is None else anchors
    attachments = ca.DM(robot.attachments.T) if attachments is None else attachments
    found = []
    for i in range(robot.m):
        spec = cable.spec(robot, i)._replace(anchor=anchors[:, i])
        if stretch is not None and robot.cable.axial_stiffness:
            spec = spec._replace(compliance=stretch * spec.compliance)
        if rollers is not None and spec.rolls:
            spec = spec._replace(radius=ca.SX(spec.radius + rollers[i]))
        if leaning is not None and spec.rolls:
            axis = pulley.leaned(robot.pulley_axis[i], leaning[2 * i], leaning[2 * i + 1])
            spec = spec._replace(axis=axis)
        point = position + rotation @ attachments[:, i]
        found.append(cable.by_tension(spec, point, tension[i], steps=steps))
    return found


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
    cables = shapes(robot, position, rotation, tension, anchors=anchors, attachments=attachments)
    for i, each in enumerate(cables):
        wrench += structure_columns(rotation, attachments[:, i], each.direction) * tension[i]
    return wrench


def paid_out(
    robot: Robot, position: Symbol, rotation: Symbol, velocity: Symbol, omega: Symbol
) -> Symbol:
    """Rates at which the cables between their rollers and the platform get longer, symbolically
    [m/s], shape (m,).

    Those of straight cables that do not stretch: where a cable moves in earnest, stretch and sag
    change its length by hundredths of that rate, and where it hardly moves, it is not known which
    way a roller resists.

    Args:
        robot: Its cables.
        position: Of the platform origin, world frame [m], shape (3,).
        rotation: R_world_platform, shape (3, 3).
        velocity: Of the platform origin, world frame [m/s], shape (3,).
        omega: Angular velocity, platform frame [rad/s], shape (3,).
    """
    straight = shapes(robot.with_straight_cables(), position, rotation, ca.SX.ones(robot.m))
    # A roller turns with its cable, and a cable that leaves it tangentially grows as its free end
    # moves away.
    rates = []
    for attachment, each in zip(robot.attachments, straight, strict=True):
        moved = point_velocity(rotation, velocity, omega, ca.DM(attachment))
        rates.append(-ca.dot(each.direction, moved))
    return ca.vertcat(*rates)


@lru_cache(maxsize=32)
def _batched(robot: Robot, steps: int) -> Batched:
    """The cables at a pose for tensions, see :class:`CableState`, with their residuals."""
    position, rotation = ca.SX.sym("position", 3), ca.SX.sym("rotation", 3, 3)
    tension = ca.SX.sym("tension", robot.m)
    all_cables = shapes(robot, position, rotation, tension, steps=steps)
    columns = [
        structure_columns(rotation, ca.DM(b), c.direction)
        for b, c in zip(robot.attachments, all_cables, strict=True)
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


def _of(chosen: NDArray[np.int_], value: ArrayLike, ndim: int) -> Array:
    """Chosen samples of an array; one value of the given dimension for all stays what it is."""
    value = np.asarray(value, dtype=np.float64)
    return value[chosen] if value.ndim > ndim else value


def cables_at(
    robot: Robot, position: ArrayLike, rotation: ArrayLike, tension: ArrayLike
) -> CableState:
    """Directions, lengths and structure matrix at poses.

    Args:
        robot: With m cables, at least one.
        position: Of the platform origin, world frame [m], shape (n, 3).
        rotation: R_world_platform, shape (n, 3, 3).
        tension: At the platform end [N], shape (n, m) or (m,); of influence only where cables have
            weight or stretch.

    Returns:
        State of the cables over the n samples.

    Raises:
        InfeasibleError: A cable is too slack for its equations to be solved.
    """
    tension = np.asarray(tension, dtype=np.float64)
    if robot.cable.linear_density:
        # A reading near zero carries no direction: nothing pulls less than a cable that just bears
        # its own weight across.
        reach = np.linalg.norm(robot.anchors - attachments_at(position, rotation, robot), axis=-1)
        tension = np.maximum(
            tension, robot.cable.linear_density * np.linalg.norm(robot.gravity) * reach
        )
    values = _batched(robot, _QUICK_STEPS)(position=position, rotation=rotation, tension=tension)
    if robot.cable.linear_density:
        slack = np.flatnonzero(~(values["residual"] < _QUICK_TOLERANCE).all(axis=-1))
        for start in range(0, len(slack), _SLACK_AT_ONCE):
            some = slack[start : start + _SLACK_AT_ONCE]
            again = _batched(robot, cable.STEPS)(
                position=_of(some, position, 1),
                rotation=_of(some, rotation, 2),
                tension=_of(some, tension, 1),
            )
            for key, value in again.items():
                values[key][some] = value
    residual = values.pop("residual")
    values["structure"] = values["structure"].reshape(-1, 6, robot.m)
    values["direction"] = values["direction"].reshape(-1, robot.m, 3)
    # A solution that is no number must not pass for one whose error is small.
    bad = ~((residual < cable.RESIDUAL_TOLERANCE) & np.isfinite(values["direction"]).all(axis=-1))
    if bad.any():
        sample, i = np.argwhere(bad)[0]
        raise InfeasibleError(
            f"cable {i + 1} of '{robot.name}': expected a cable that hangs between its anchor and"
            f" its attachment, found none at sample {sample}; check the pose, the anchors and the"
            " tension there",
            sample=int(sample),
        )
    return CableState(**values)
