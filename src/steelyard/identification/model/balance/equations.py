"""The balance of wrenches as expressions: the wrench that moves the body and drags the cables, the
structure matrix, and derivatives of the balance by everything that it depends on.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import casadi as ca
import numpy as np

from steelyard.arrays import Array
from steelyard.batch import Batched, Symbol, jacobians
from steelyard.dynamics import newton_euler
from steelyard.identification.model.calibration_parameters import (
    AIR,
    ATTACHED,
    CalibrationValues,
)
from steelyard.inertia import TEN
from steelyard.motion.state import State, state_of_pose
from steelyard.robot.cable_inertia import cable_inertia_expression
from steelyard.robot.kinematics import cable_wrench, cables_at
from steelyard.robot.model import DIRECTIONS, Robot
from steelyard.robot.surroundings import (
    HOSE,
    air_wrench,
    attached_wrench,
    damping_wrench,
    hose_wrench,
    middle_of,
    swivel_wrench,
)

_MOTION = ("position", "rotation", "velocity", "omega", "alpha", "specific_force")
"""Fields of a state that the motion gives."""
_OF_MOTION = ("pose", "rate", "acceleration")
_PER_HOSE = sum(size for _, size in HOSE)


class _MovingBody(NamedTuple):
    """Symbols that the wrench of the moving body and cables depends on."""

    pose: Symbol
    rate: Symbol
    acceleration: Symbol
    gravity: Symbol
    parameters: Symbol
    weight: Symbol
    """Mass of which the platform feels the weight alone, at its origin, shape (1,)."""
    drag: Symbol
    attached: Symbol
    """Force, stiffness and their moments of a hose, shape (16,)."""
    air: Symbol
    """Drag and damping, each of moving and of turning, shape (4,)."""
    hoses: Symbol
    """Those that are stated, shape (9 h,)."""
    swivel: Symbol
    """Friction where cables turn about their anchors, shape (m,), or (0,): none."""

    @classmethod
    def new(cls, hoses: int, swivels: int) -> _MovingBody:
        sizes = {
            "pose": 7,
            "rate": 7,
            "acceleration": 7,
            "gravity": 3,
            "parameters": TEN,
            "weight": 1,
            "drag": 1,
            "attached": sum(size for _, size in ATTACHED),
            "air": sum(size for _, size in AIR),
            "hoses": hoses * _PER_HOSE,
            "swivel": swivels,
        }
        return cls(**{name: ca.SX.sym(name, size) for name, size in sizes.items()})

    @property
    def state(self) -> State:
        return state_of_pose(self.pose, self.rate, self.acceleration, self.gravity)

    def wrench(self, robot: Robot) -> Symbol:
        """What the cables must exert so that the body moves as it does."""
        state = self.state
        needed = newton_euler(self.parameters, state.specific_force, state.omega, state.alpha)
        needed -= ca.vertcat(state.rotation.T @ (self.weight * self.gravity), ca.SX.zeros(3))
        needed -= self.drag * _dragged(robot, state, self.gravity)
        for own in ca.vertsplit(self.hoses, _PER_HOSE) if self.hoses.numel() else ():
            needed -= hose_wrench(state.position, state.rotation, self.gravity, own)
        if not robot.m:
            return needed
        hose = ca.vertsplit(self.attached, np.cumsum([0, *(size for _, size in ATTACHED)]).tolist())
        needed -= attached_wrench(state.position, state.rotation, middle_of(robot), *hose)
        speeds = (state.rotation, state.velocity, state.omega)
        needed -= air_wrench(*speeds, self.air[0], self.air[1])
        return needed - damping_wrench(*speeds, self.air[2], self.air[3])

    def rubbing(self, robot: Robot) -> Symbol:
        """What friction where cables turn about their anchors does to the platform."""
        if not self.swivel.numel():
            return ca.SX.zeros(6)
        own = self.state
        return swivel_wrench(
            robot, own.position, own.rotation, own.velocity, own.omega, self.swivel
        )


class _Geometry(NamedTuple):
    """Where the cables are fixed, as symbols."""

    anchors: Symbol
    attachments: Symbol

    @classmethod
    def of(cls, robot: Robot) -> _Geometry:
        return cls(ca.SX.sym("anchors", 3, robot.m), ca.SX.sym("attachments", 3, robot.m))


@lru_cache(maxsize=16)
def motion_and_wrench(heavy: Robot, hoses: int = 0, swivels: int = 0) -> Batched:
    """Motion, and the wrench that moves the body, drags the cables and withstands hoses and air."""
    body = _MovingBody.new(hoses, swivels)
    state = body.state
    motion = {name: ca.densify(ca.SX(getattr(state, name))) for name in _MOTION}
    wrench = body.wrench(heavy) - body.rubbing(heavy)
    return Batched("moved", body._asdict(), {"wrench": wrench, **motion})


def _dragged(robot: Robot, state: State, gravity: Symbol) -> Symbol:
    """Wrench of the inertia of the cables, as an expression of the state."""
    if not robot.m or not robot.cable.linear_density:
        return ca.SX.zeros(6)
    return cable_inertia_expression(
        robot,
        state.position,
        state.rotation,
        state.specific_force,
        state.omega,
        state.alpha,
        gravity,
    )


@lru_cache(maxsize=16)
def taut_structure(robot: Robot) -> Batched:
    """Structure matrix of straight cables."""
    position, rotation = ca.SX.sym("position", 3), ca.SX.sym("rotation", 3, 3)
    tension = ca.SX.sym("tension", robot.m)
    fixed = _Geometry.of(robot)
    wrench = cable_wrench(robot, position, rotation, tension, *fixed)
    return _batched(
        "taut",
        {"position": position, "rotation": rotation},
        fixed,
        {"structure": ca.jacobian(wrench, tension)},
    )


@lru_cache(maxsize=32)
def derivatives_of_balance(
    heavy: Robot, hoses: int = 0, swivels: int = 0, asked: frozenset[str] | None = None
) -> Batched:
    """Of the wrench of the cables less what moves the body, by everything; sag is of no account for
    these, and how friction follows the pose.

    Args:
        heavy: The robot.
        hoses: That are stated.
        swivels: Of cables about their anchors.
        asked: Inputs by which there are derivatives beside the motion; None: all.
    """
    robot = heavy.with_straight_cables()
    body, fixed = _MovingBody.new(hoses, swivels), _Geometry.of(robot)
    tension = ca.SX.sym("tension", robot.m)
    state = body.state
    wrench = cable_wrench(robot, state.position, state.rotation, tension, *fixed)
    wrench -= body.wrench(heavy)
    by = body._asdict()
    if robot.m:
        by |= {"anchor": ca.vec(fixed.anchors), "attachment": ca.vec(fixed.attachments)}
    if asked is not None:
        by = {key: each for key, each in by.items() if key in _OF_MOTION or key in asked}
    outputs = {f"by_{key}": each for key, each in jacobians(wrench, by).items()}
    for key in {"rate", "swivel"} & by.keys():
        outputs[f"by_{key}"] += ca.jacobian(body.rubbing(robot), by[key])
    outputs = {name: ca.densify(each) for name, each in outputs.items()}
    if not robot.m:
        return Batched("derivatives", body._asdict(), outputs)
    return _batched("derivatives", {**body._asdict(), "tension": tension}, fixed, outputs)


def _batched(
    name: str, inputs: dict[str, Symbol], fixed: _Geometry, outputs: dict[str, Symbol]
) -> Batched:
    """A function of anchors and attachments that stand in one row each, cable by cable."""
    flat = {key: ca.SX.sym(key, fixed.anchors.numel()) for key in ("anchors", "attachments")}
    matrices = [ca.reshape(each, 3, -1) for each in flat.values()]
    replaced = ca.substitute(list(outputs.values()), [fixed.anchors, fixed.attachments], matrices)
    return Batched(
        name, {**inputs, **flat}, dict(zip(outputs, map(ca.densify, replaced), strict=True))
    )


def structure_matrices(
    robot: Robot, calibration: CalibrationValues, position: Array, rotation: Array, tension: Array
) -> Array:
    """Structure matrices; how an error of the geometry changes the sag is of no account, shape (n,
    6, m).
    """
    straight = robot.with_straight_cables()
    taut = taut_structure(straight)
    # Of one cable a column, which has no axis of its own.
    shape = (-1, DIRECTIONS, robot.m)
    structure = taut(position=position, rotation=rotation, **calibration.geometry)["structure"]
    structure = structure.reshape(shape)
    if not robot.cable.linear_density:
        return structure
    as_stated = {"anchors": robot.anchors.ravel(), "attachments": robot.attachments.ravel()}
    sagging = cables_at(robot, position, rotation, tension).structure
    stated = taut(position=position, rotation=rotation, **as_stated)["structure"].reshape(shape)
    return np.asarray(structure + sagging - stated)
