"""How a body swings on cables of constant length after a push: its motion, and what the cables pull
meanwhile.

The equations of motion of the platform beside the second derivative of every length, which
vanishes: both are linear in accelerations and tensions [Goldstein2002]_.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from steelyard import rotations
from steelyard.arrays import Array
from steelyard.dynamics import newton_euler
from steelyard.inertia import Inertia
from steelyard.motion.trajectory import Sampled
from steelyard.natural_frequencies.equilibrium import rigid_cables
from steelyard.natural_frequencies.modes import NaturalModes
from steelyard.robot.kinematics import shapes, structure_columns
from steelyard.robot.model import DIRECTIONS, Robot

_TOLERANCE = 1e-9
"""Of the integrator, relative and in metres, radians and their rates."""
_SAMPLES_PER_SECOND = 100.0
"""Instants through which the motion is laid as a quintic spline [Hz]: swings have some hertz."""


@dataclass(frozen=True, eq=False)
class FreeSwing:
    """A motion on cables of constant length."""

    trajectory: Sampled
    tension: Array
    """At the platform, at instants from the beginning to the end [N], shape (n, cables); below zero
    where a cable would have to push."""


def free_swing(found: NaturalModes, rate: Array, duration: float) -> FreeSwing:
    """A swing that begins where the body rests.

    Args:
        found: Body, cables and place of rest. Cables that are slack there do nothing.
        rate: Of the pose in the beginning: velocity of the platform origin [m/s] and angular
            velocity [rad/s], both along the axes of the world, shape (6,).
        duration: [s]
    """
    taut = found.rest.taut
    robot = hung_on(rigid_cables(found.cables), taut)
    equations = _equations(robot, found.body)
    rotation = found.rest.place.rotation
    start = np.concatenate(
        [
            found.rest.place.position,
            Rotation.from_matrix(rotation).as_quat(scalar_first=True),
            rate[:3],
            rotation.T @ rate[3:],
        ]
    )

    size = DIRECTIONS + robot.m

    def solved(x: Array) -> tuple[Array, Array]:
        """Rate of the state and tensions."""
        values = np.asarray(equations(x)).ravel()
        found = np.linalg.solve(
            values[: size * size].reshape(size, size).T, values[size * size : size * (size + 1)]
        )
        turning = values[size * (size + 1) :]
        return np.concatenate([x[7:10], turning, found[:DIRECTIONS]]), found[DIRECTIONS:]

    n = max(2, int(np.ceil(duration * _SAMPLES_PER_SECOND)) + 1)
    times = np.linspace(0.0, duration, n)
    solution = solve_ivp(
        lambda _, x: solved(x)[0],
        (0.0, duration),
        start,
        "DOP853",
        t_eval=times,
        rtol=_TOLERANCE,
        atol=_TOLERANCE,
    )
    states = solution.y.T
    rpy = Rotation.from_quat(states[:, 3:7], scalar_first=True).as_euler("ZYX")[:, ::-1]
    poses = np.hstack([states[:, :3], np.unwrap(rpy, axis=0)])
    tension = np.array([solved(each)[1] for each in states])
    return FreeSwing(Sampled.through(times, poses), tension)


def hung_on(robot: Robot, cables: NDArray[np.intp]) -> Robot:
    """The same robot with some of its cables alone.

    Args:
        robot: With all.
        cables: Numbers of those that stay, from 0, shape (k,).
    """
    own = cables
    covariance = robot.covariance
    if covariance is not None:
        points = np.concatenate([own, robot.m + own])
        coordinates = (3 * points[:, None] + np.arange(3)).ravel()
        covariance = covariance[np.ix_(coordinates, coordinates)]
    return replace(
        robot,
        anchors=robot.anchors[own],
        attachments=robot.attachments[own],
        pulley_radius=robot.pulley_radius[own],
        pulley_axis=robot.pulley_axis[own],
        covariance=covariance,
    )


def _equations(robot: Robot, body: Inertia) -> Any:
    """Of a state (position, quaternion, velocity along the axes of the world, angular velocity
    along those of the platform) to one vector: the matrix, column by column, and the right side of
    the equations for velocity's and angular velocity's rates and the tensions, and the rate of the
    quaternion.
    """
    x, unknown = ca.SX.sym("x", 13), ca.SX.sym("unknown", DIRECTIONS + robot.m)
    q = x[3:7] / ca.norm_2(x[3:7])
    R, omega = rotations.from_quaternion(q), x[10:13]
    acceleration, alpha = unknown[:3], unknown[3:6]
    specific_force = R.T @ (acceleration - ca.DM(robot.gravity))
    change, step = ca.SX.sym("change", DIRECTIONS), ca.SX.sym("step")
    cables = shapes(robot, x[:3] + change[:3], R @ rotations.exp(change[3:]), ca.DM.ones(robot.m))
    lengths = ca.vertcat(*[each.length for each in cables])
    wrench = ca.SX.zeros(DIRECTIONS)
    for i, (each, b) in enumerate(zip(cables, robot.attachments, strict=True)):
        direction = ca.substitute(each.direction, change, ca.SX.zeros(DIRECTIONS))
        wrench += structure_columns(R, ca.DM(b), direction) * unknown[DIRECTIONS + i]
    # Along a motion of constant rates a pose changes by step times these.
    rates = ca.vertcat(x[7:10], omega)
    along = ca.substitute(lengths, change, step * rates)
    curvature = ca.substitute(ca.jacobian(ca.jacobian(along, step), step), step, 0)
    by_pose = ca.substitute(ca.jacobian(lengths, change), change, ca.SX.zeros(DIRECTIONS))
    missing = ca.vertcat(
        newton_euler(ca.DM(body.parameters), specific_force, omega, alpha) - wrench,
        by_pose @ unknown[:DIRECTIONS] + curvature,
    )
    matrix = ca.jacobian(missing, unknown)
    rest = ca.substitute(missing, unknown, ca.SX.zeros(unknown.numel()))
    turning = rotations.quaternion_rate(q, omega)
    return ca.Function("free_swing", [x], [ca.densify(ca.vertcat(ca.vec(matrix), -rest, turning))])
