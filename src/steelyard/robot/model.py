"""The description of a robot as an immutable value."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np

from steelyard.arrays import Array, readonly
from steelyard.display import printable
from steelyard.inertia import Inertia

DIRECTIONS = 6
"""Of a platform: coordinates of its pose, components of a wrench; with as many taut cables of
constant length it cannot move."""


@dataclass(frozen=True)
class CableProperties:
    """What all cables of a robot are made of. None: without this effect."""

    diameter: float | None = None
    """[m]; for pictures only."""
    axial_stiffness: float | None = None
    """EA [N]; None: the cable does not stretch."""
    linear_density: float | None = None
    """[kg/m]; None: the cable is straight."""
    damping_ratio: float = 0.02
    """Of each cable as a spring with a quarter of the platform's mass; for simulation only."""


@dataclass(frozen=True)
class Limits:
    """What a motion of the platform must keep to. None: no limit."""

    position: tuple[tuple[float, float, float], tuple[float, float, float]] | None = None
    """Lowest and highest position of the platform origin [m]."""
    rpy: tuple[tuple[float, float, float], tuple[float, float, float]] | None = None
    """Lowest and highest roll, pitch, yaw [rad]."""
    speed: float | None = None
    """[m/s]"""
    acceleration: float | None = None
    """[m/s^2]"""
    angular_speed: float | None = None
    """[rad/s]"""
    angular_acceleration: float | None = None
    """[rad/s^2]"""
    cable_speed: float | None = None
    """At which winches feed a cable [m/s]."""


@dataclass(frozen=True, eq=False)
class Robot:
    """A platform on m cables; without cables it is a body on a wrench sensor."""

    name: str
    anchors: Array
    """Where the cables leave the frame or enter their rollers, world frame [m], shape (m, 3)."""
    attachments: Array
    """Where they are fixed to the platform, platform frame [m], shape (m, 3)."""
    gravity: Array = field(default_factory=lambda: np.array([0.0, 0.0, -9.81]))
    """World frame [m/s^2], shape (3,)."""
    pulley_radius: Array = field(default_factory=lambda: np.zeros(0))
    """[m], shape (m,); 0 is a cable that leaves from a point."""
    pulley_axis: Array = field(default_factory=lambda: np.zeros((0, 3)))
    """Direction of travel of the cable where it enters the roller, unit vectors in the world frame,
    shape (m, 3)."""
    cable: CableProperties = CableProperties()
    tension_limits: tuple[float, float] = (0.0, np.inf)
    """Lowest and highest allowed tension [N]."""
    limits: Limits = Limits()
    platform: Inertia | None = None
    """Nominal body."""
    covariance: Array | None = None
    """Of anchors, then attachments, three coordinates a cable, as a calibration has left it [m^2],
    shape (6 m, 6 m); None: the experiment says how uncertain they are."""

    def __post_init__(self) -> None:
        """Bring all arrays into their shapes, axes to unit length."""
        anchors = readonly(np.reshape(self.anchors, (-1, 3)), (None, 3), "anchors")
        m = len(anchors)
        no_pulleys = np.size(self.pulley_radius) == 0
        radius = np.zeros(m) if no_pulleys else self.pulley_radius
        axis = np.tile([0.0, 0.0, 1.0], (m, 1)) if no_pulleys else np.asarray(self.pulley_axis)
        axis = axis / np.linalg.norm(axis, axis=1, keepdims=True) if m else np.zeros((0, 3))
        for name, value, shape in (
            ("anchors", anchors, (m, 3)),
            ("attachments", np.reshape(self.attachments, (-1, 3)), (m, 3)),
            ("gravity", self.gravity, (3,)),
            ("pulley_radius", radius, (m,)),
            ("pulley_axis", axis, (m, 3)),
        ):
            object.__setattr__(self, name, readonly(value, shape, name))
        if self.covariance is not None:
            own = readonly(self.covariance, (6 * m, 6 * m), "covariance")
            object.__setattr__(self, "covariance", own)

    @property
    def m(self) -> int:
        """Number of cables."""
        return len(self.anchors)

    @property
    def up(self) -> Array:
        """Unit vector against gravity, world frame, shape (3,)."""
        return -self.gravity / np.linalg.norm(self.gravity)

    @property
    def size(self) -> float:
        """Radius of the platform as its attachments show it [m]; 1 m without cables."""
        if not self.m:
            return 1.0
        off_centre = self.attachments - self.attachments.mean(0)
        return float(np.sqrt(np.mean(np.sum(off_centre**2, axis=1))))

    def __repr__(self) -> str:
        body = (
            "no nominal platform"
            if self.platform is None
            else f"nominal platform {self.platform.mass:.6g} kg"
        )
        return (
            f"Robot '{printable(self.name)}': {self.m or 'no'} cable{'' if self.m == 1 else 's'},"
            f" {body}"
        )

    def with_straight_cables(self) -> Robot:
        """The same robot with massless cables, hence straight, as the paper assumes them."""
        return _with_straight_cables(self) if self.cable.linear_density else self


@lru_cache(maxsize=32)
def _with_straight_cables(robot: Robot) -> Robot:
    # One and the same value every time: what has been built for it is found again.
    return replace(robot, cable=replace(robot.cable, linear_density=None))
