"""How much a command makes a platform ring on its elastic cables, as one number with its
derivative.

What moves the body bends the cables: the platform is off its command by that wrench over their
stiffness, which changes with the pose. The part of this deflection that lies in the band of the
natural frequencies, differentiated twice and enlarged by resonance, is the acceleration of the
ringing. The stiffness is known to a factor only, so the band begins well below the lowest natural
frequency.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import casadi as ca
import numpy as np

from steelyard.arrays import Array
from steelyard.batch import Batched, Symbol
from steelyard.dynamics import newton_euler
from steelyard.excitation.sight import AT, commanded_state, hanging_wrench, structure_at
from steelyard.motion.state import State
from steelyard.robot.model import Robot

BAND = 0.7
"""Where the band begins, in units of the lowest natural frequency."""
PER_INTERVAL = 10
"""Instants between two knots of a course at which its commands are taken."""
ALLOWED = 0.05
"""Root mean square of the ringing that a command may cause, in units of the limits on
acceleration."""
_LEAST_DAMPING = 0.005
_UNLIMITED = 3.0, 5.0
"""Units where there is no limit on acceleration and angular acceleration [m/s^2], [rad/s^2]."""


def stiffness_of(robot: Robot, state: State) -> Symbol:
    """Wrench by which straight elastic cables resist a small displacement of the platform, in P
    [N/m], [N], [N m], shape (6, 6).

    What their tension adds is of no account beside it.
    """
    assert robot.cable.axial_stiffness is not None
    structure = structure_at(robot, state)
    lengths = [
        ca.norm_2(ca.DM(a) - state.position - state.rotation @ ca.DM(b))
        for a, b in zip(robot.anchors, robot.attachments, strict=True)
    ]
    return structure @ ca.diag(robot.cable.axial_stiffness / ca.vertcat(*lengths)) @ structure.T


def moving_wrench(robot: Robot, state: State) -> Symbol:
    """Wrench that moves the nominal platform, without what holds it up, in P [N], [N m], shape
    (6,).
    """
    assert robot.platform is not None
    ten = ca.DM(robot.platform.parameters)
    moving = newton_euler(ten, state.specific_force, state.omega, state.alpha)
    return moving - hanging_wrench(ten, state, robot.gravity)


def softness_of(robot: Robot, state: State) -> Symbol:
    """How easily the nominal platform swings on its cables: sum of the inverse squares of its six
    natural angular frequencies [s^2].
    """
    assert robot.platform is not None
    accelerations = ca.SX.sym("accelerations", 6)
    inertial = newton_euler(
        ca.DM(robot.platform.parameters), accelerations[:3], ca.SX.zeros(3), accelerations[3:]
    )
    return ca.trace(ca.solve(stiffness_of(robot, state), ca.jacobian(inertial, accelerations)))


@lru_cache(maxsize=8)
def _softness(robot: Robot) -> Batched:
    command = ca.SX.sym("command", AT)
    state = commanded_state(command, robot.gravity)
    return Batched("softness", {"command": command}, {"value": softness_of(robot, state)})


def softness_at(robot: Robot, pose: Array) -> float:
    """:func:`softness_of` in a pose x, y, z [m], roll, pitch, yaw [rad]."""
    return float(
        _softness(robot)(command=np.concatenate([pose, np.zeros(AT - len(pose))]))["value"].ravel()[
            0
        ]
    )


@dataclass(frozen=True, eq=False)
class Ringing:
    """For commands at instants of equal steps."""

    robot: Robot
    """With a nominal platform and an axial stiffness."""
    times: Array
    """Middles of the steps [s], shape (n,)."""
    lowest: float
    """Natural frequency [Hz]."""

    def value(self, commands: Array) -> tuple[float, Array]:
        """Mean square of the ringing in units of the allowed one, and its derivative by pose, rate
        and acceleration, shape (n, 18).

        Args:
            commands: Shape (n, 18).
        """
        deflection = self._deflection(command=commands)["value"]
        ringing = self._band @ deflection
        weight = 2 * self._band.T @ ringing
        return float(np.sum(ringing**2)), self._slopes(command=commands, weight=weight)["slope"]

    @cached_property
    def _band(self) -> Array:
        """Amplitudes of the accelerations in the band, as parts of the root mean square, shape (2
        f, n).
        """
        step = self.times[1] - self.times[0]
        length = len(self.times) * step
        frequencies = np.arange(1, len(self.times) // 2) / length
        frequencies = frequencies[frequencies >= BAND * self.lowest]
        angle = 2 * np.pi * np.outer(frequencies, self.times)
        resonance = 1 / (2 * max(self.robot.cable.damping_ratio, _LEAST_DAMPING))
        scale = np.sqrt(2) / len(self.times) * resonance / ALLOWED * (2 * np.pi * frequencies) ** 2
        return np.vstack([np.cos(angle) * scale[:, None], np.sin(angle) * scale[:, None]])

    @cached_property
    def _deflection(self) -> Batched:
        return self._built[0]

    @cached_property
    def _slopes(self) -> Batched:
        return self._built[1]

    @cached_property
    def _built(self) -> tuple[Batched, Batched]:
        robot = self.robot
        command = ca.SX.sym("command", AT)
        state = commanded_state(command, robot.gravity)
        wrench, stiffness = moving_wrench(robot, state), stiffness_of(robot, state)
        moved = ca.solve(stiffness, wrench)
        limits = robot.limits
        linear, angular = (
            limits.acceleration or _UNLIMITED[0],
            limits.angular_acceleration or _UNLIMITED[1],
        )
        value = ca.vertcat(
            state.rotation @ moved[:3] / linear, state.rotation @ moved[3:] / angular
        )
        value = ca.cse(ca.densify(value))
        weight = ca.SX.sym("weight", value.numel())
        slope = ca.cse(ca.densify(ca.jtimes(value, command, weight, True)))
        return (
            Batched("deflection", {"command": command}, {"value": value}),
            Batched("slopes", {"command": command, "weight": weight}, {"slope": slope}),
        )
