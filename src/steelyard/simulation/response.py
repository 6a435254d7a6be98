"""What a platform does on a command: the state over time, however it was found."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from steelyard.arrays import Array
from steelyard.dynamics import platform_wrench
from steelyard.inertia import Inertia
from steelyard.motion.state import State, motion_of_poses
from steelyard.motion.trajectory import Trajectory
from steelyard.robot.model import Robot

Progress = Callable[[float], None]
"""Is given the fraction done."""


class Response(Protocol):
    """What the platform really did."""

    @property
    def duration(self) -> float:
        """Length in time [s]."""

    def at(self, times: Array) -> State:
        """State at times in [0, duration] [s], arrays over the n times."""


@dataclass(frozen=True, eq=False)
class ExactMotion:
    """A platform that follows its command exactly, such as a body on the wrench sensor of a robot
    arm.
    """

    robot: Robot
    body: Inertia
    trajectory: Trajectory

    @property
    def duration(self) -> float:
        """Length in time [s]."""
        return self.trajectory.duration

    def at(self, times: Array) -> State:
        """See :class:`Response`."""
        pose, rate, acceleration = (self.trajectory.derivative(times, order) for order in range(3))
        motion = motion_of_poses(pose, rate, acceleration, self.robot.gravity)
        wrench = platform_wrench(
            self.body.parameters, motion["specific_force"], motion["omega"], motion["alpha"]
        )
        return State(**motion, tension=None, wrench=wrench, gravity=self.robot.gravity)
