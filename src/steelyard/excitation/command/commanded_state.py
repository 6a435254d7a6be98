"""State of the platform, structure matrix and tensions at one instant of a commanded motion, as
expressions.

Composed of the one statement of kinematics, dynamics and cables; nothing is stated anew.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import casadi as ca

from steelyard import rotations
from steelyard.arrays import Array
from steelyard.batch import Symbol
from steelyard.dynamics import newton_euler
from steelyard.excitation.command.motion_spline import COORDINATES
from steelyard.identification.model.balance.equations import taut_structure
from steelyard.identification.model.segment import POSE
from steelyard.motion.state import State, state_of_pose
from steelyard.robot.model import Robot

COMMAND = 3 * COORDINATES
"""Numbers of a command at one instant: the pose, its rate and its acceleration."""
COMMAND_WITH_JERK = 4 * COORDINATES
"""The same with the third time derivative."""
_ORDERS = 4
"""A pose and its first three time derivatives."""


def motion_of(command: Symbol) -> tuple[Symbol, Symbol, Symbol, Symbol]:
    """Position over quaternion of a commanded pose, and its first three time derivatives, shape
    (7,) each.

    Args:
        command: Pose and its first three time derivatives, shape (24,).
    """
    orders = [command[COORDINATES * k : COORDINATES * (k + 1)] for k in range(_ORDERS)]
    symbols = [ca.SX.sym(f"d{k}", COORDINATES) for k in range(_ORDERS)]
    pose = ca.vertcat(symbols[0][:3], rotations.quaternion_of_rpy(symbols[0][3:]))
    series = [pose]
    for _ in range(_ORDERS - 1):
        # d/dt by the chain rule: every derivative's rate is the next one.
        rate = ca.jtimes(series[-1], ca.vertcat(*symbols[:-1]), ca.vertcat(*symbols[1:]))
        series.append(rate)
    found = ca.substitute(series, symbols, orders)
    return found[0], found[1], found[2], found[3]


def state_at(motion: Sequence[Symbol], gravity: Array) -> State:
    """State, without forces, of a pose and its derivatives, which may be expressions."""
    symbols = [ca.SX.sym(name, POSE) for name in ("pose", "rate", "acceleration")]
    general = state_of_pose(symbols[0], symbols[1], symbols[2], ca.DM(gravity))
    names = ("position", "rotation", "velocity", "omega", "alpha", "specific_force")
    fields = [ca.SX(getattr(general, name)) for name in names]
    found = ca.substitute(fields, symbols, list(motion[:3]))
    return replace(general, **dict(zip(names, found, strict=True)))


def commanded_state(command: Symbol, gravity: Array) -> State:
    """State, without forces, of a command of pose, rate and acceleration, shape (18,)."""
    no_jerk = ca.SX.zeros(COMMAND_WITH_JERK - COMMAND)
    return state_at(motion_of(ca.vertcat(command, no_jerk)), gravity)


def structure_at(
    robot: Robot, state: State, geometry: Mapping[str, Symbol] | None = None
) -> Symbol:
    """Structure matrix of straight cables in a state, shape (6, m).

    Args:
        robot: With cables.
        state: Position and rotation of it.
        geometry: ``anchors`` and ``attachments``, three numbers a cable; None: those of the robot
            file.
    """
    taut = taut_structure(robot.with_straight_cables())
    fixed = geometry or {
        "anchors": ca.DM(robot.anchors.ravel()),
        "attachments": ca.DM(robot.attachments.ravel()),
    }
    return taut.at(position=state.position, rotation=state.rotation, **fixed)["structure"]


def static_wrench(ten: Symbol, state: State, gravity: Array) -> Symbol:
    """Wrench that holds a body at rest in the attitude of a state, in P [N], [N m], shape (6,).

    Args:
        ten: Its linear parameters, shape (10,).
        state: Rotation of it.
        gravity: World frame [m/s^2], shape (3,).
    """
    return newton_euler(ten, -state.rotation.T @ ca.DM(gravity), ca.SX.zeros(3), ca.SX.zeros(3))


def tension_of(robot: Robot, structure: Symbol, wrench: Symbol, level: Symbol | float) -> Symbol:
    """Tensions of a wrench nearest to a level, in closed form [Pott2009]_, shape (m,)."""
    even = ca.DM.ones(robot.m) * level
    return even + structure.T @ ca.solve(structure @ structure.T, wrench - structure @ even)
