"""How much a command excites a platform on its elastic cables, as one number with its gradient.

The inertial wrench stretches the cables: the platform is off its command by that wrench over their
stiffness, which changes with the pose. The part of this deflection that lies in the band of the
natural frequencies, differentiated twice and enlarged by resonance, is the acceleration of the
vibration. The stiffness is known to a factor only, so the band begins well below the lowest natural
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
from steelyard.errors import InfeasibleError
from steelyard.excitation.command.commanded_state import (
    COMMAND,
    commanded_state,
    static_wrench,
    structure_at,
)
from steelyard.excitation.settings import DEFAULT, DesignSettings
from steelyard.motion.state import State
from steelyard.robot.model import Robot
from steelyard.simulation.forward_dynamics import CablePlatform


def cable_stiffness(robot: Robot, state: State) -> Symbol:
    """Wrench by which straight elastic cables resist a small displacement of the platform, in P
    [N/m], [N], [N m], shape (6, 6).

    What their tension adds is small beside it and left out.
    """
    assert robot.cable.axial_stiffness is not None
    structure = structure_at(robot, state)
    lengths = []
    for anchor, attachment in zip(robot.anchors, robot.attachments, strict=True):
        cable = ca.DM(anchor) - state.position - state.rotation @ ca.DM(attachment)
        lengths.append(ca.norm_2(cable))
    stiffness = ca.diag(robot.cable.axial_stiffness / ca.vertcat(*lengths))
    return structure @ stiffness @ structure.T


def inertial_wrench(robot: Robot, state: State) -> Symbol:
    """Wrench that accelerates the nominal platform, without what carries its weight, in P [N],
    [N m], shape (6,).
    """
    assert robot.platform is not None
    ten = ca.DM(robot.platform.parameters)
    moving = newton_euler(ten, state.specific_force, state.omega, state.alpha)
    return moving - static_wrench(ten, state, robot.gravity)


def dunkerley_sum(robot: Robot, state: State) -> Symbol:
    """Sum of the inverse squares of the six natural angular frequencies of the nominal platform on
    its cables [s^2]: the trace of stiffness^-1 times mass matrix, Dunkerley's bound of the lowest.
    """
    assert robot.platform is not None
    accelerations = ca.SX.sym("accelerations", 6)
    inertial = newton_euler(
        ca.DM(robot.platform.parameters), accelerations[:3], ca.SX.zeros(3), accelerations[3:]
    )
    mass_matrix = ca.jacobian(inertial, accelerations)
    return ca.trace(ca.solve(cable_stiffness(robot, state), mass_matrix))


@lru_cache(maxsize=8)
def _dunkerley_function(robot: Robot) -> Batched:
    command = ca.SX.sym("command", COMMAND)
    state = commanded_state(command, robot.gravity)
    return Batched("dunkerley", {"command": command}, {"value": dunkerley_sum(robot, state)})


def dunkerley_sum_at(robot: Robot, pose: Array) -> float:
    """:func:`dunkerley_sum` in a pose x, y, z [m], roll, pitch, yaw [rad]."""
    command = np.concatenate([pose, np.zeros(COMMAND - len(pose))])
    return float(_dunkerley_function(robot)(command=command)["value"].ravel()[0])


def natural_frequencies(robot: Robot, pose: Array, level: float) -> Array:
    """Of the platform on its elastic cables, ascending [Hz], shape (6,); empty where their
    stiffness is not known.
    """
    elastic = robot.holds_any_pose and robot.cable.axial_stiffness
    if not (elastic and robot.platform and robot.platform.is_physical):
        return np.zeros(0)
    try:
        return CablePlatform(robot, robot.platform).natural_frequencies(pose, level)
    except InfeasibleError:
        return np.zeros(0)


@dataclass(frozen=True, eq=False)
class CableVibration:
    """Of commands at n instants of equal steps."""

    robot: Robot
    """With a nominal platform and an axial stiffness."""
    times: Array
    """Middles of the steps [s], shape (n,)."""
    lowest_frequency: float
    """Lowest natural frequency [Hz]."""
    settings: DesignSettings = DEFAULT

    def value(self, commands: Array) -> tuple[float, Array]:
        """Mean square of the vibration in units of the allowed one, and its gradient by pose, rate
        and acceleration, shape (n, 18).

        Args:
            commands: Shape (n, 18).
        """
        deflection, gradient = self._functions
        vibration = self._filter @ deflection(command=commands)["value"]
        weight = 2 * self._filter.T @ vibration
        by_command = gradient(command=commands, weight=weight)["gradient"]
        return float(np.sum(vibration**2)), by_command

    @cached_property
    def _filter(self) -> Array:
        """Takes deflections to amplitudes of the accelerations at the f frequencies of the band,
        as parts of the allowed root mean square, shape (2 f, n).
        """
        chosen = self.settings
        step = self.times[1] - self.times[0]
        length = len(self.times) * step
        frequencies = np.arange(1, len(self.times) // 2) / length
        frequencies = frequencies[frequencies >= chosen.vibration_band * self.lowest_frequency]
        angle = 2 * np.pi * np.outer(frequencies, self.times)
        resonance = 1 / (2 * max(self.robot.cable.damping_ratio, chosen.least_damping))
        unit = np.sqrt(2) / len(self.times) * resonance / chosen.vibration_level
        scale = unit * (2 * np.pi * frequencies) ** 2
        return np.vstack([np.cos(angle) * scale[:, None], np.sin(angle) * scale[:, None]])

    @cached_property
    def _functions(self) -> tuple[Batched, Batched]:
        """Deflection of the platform over the limits on acceleration [s^2], and the gradient of
        weighted sums of it.
        """
        robot, limits = self.robot, self.robot.limits
        command = ca.SX.sym("command", COMMAND)
        state = commanded_state(command, robot.gravity)
        moved = ca.solve(cable_stiffness(robot, state), inertial_wrench(robot, state))
        linear = limits.acceleration or self.settings.reference_acceleration
        angular = limits.angular_acceleration or self.settings.reference_angular_acceleration
        value = ca.vertcat(
            state.rotation @ moved[:3] / linear, state.rotation @ moved[3:] / angular
        )
        value = ca.cse(ca.densify(value))
        weight = ca.SX.sym("weight", value.numel())
        gradient = ca.cse(ca.densify(ca.jtimes(value, command, weight, True)))
        return (
            Batched("deflection", {"command": command}, {"value": value}),
            Batched("gradient", {"command": command, "weight": weight}, {"gradient": gradient}),
        )
