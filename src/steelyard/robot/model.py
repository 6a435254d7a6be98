"""The description of a robot as an immutable value."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from steelyard.arrays import Array, readonly
from steelyard.display import printable
from steelyard.errors import WrongValueError
from steelyard.inertia import Inertia

_FARTHEST = 1e5
"""Largest coordinate [m]: beyond it, as in grids of surveyors, a milliradian is a hundred metres,
and nothing is left of a rotation that is known."""
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

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if value is not None and not (np.ndim(value) == 0 and np.isreal(value) and value >= 0):
                raise WrongValueError(
                    f"cable: '{name}': expected a number at least 0, found {value!r}; correct it"
                )


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

    def __post_init__(self) -> None:
        """Boxes as tuples, whatever sequence they came as."""
        for name, value in vars(self).copy().items():
            if value is None:
                continue
            if name not in ("position", "rpy"):
                if not float(readonly(value, (), f"limits: '{name}'")) > 0:
                    raise WrongValueError(
                        f"limits: '{name}': expected a number above 0, found {value}; correct it"
                    )
                continue
            low, high = readonly(value, (2, 3), f"limits: '{name}'")
            if not (low < high).all():
                raise WrongValueError(
                    f"limits: '{name}': expected the lowest corner first, then the highest, found"
                    f" {low.tolist()} and {high.tolist()}; correct it"
                )
            object.__setattr__(self, name, (tuple(low.tolist()), tuple(high.tolist())))


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
        anchors = _points(self.anchors, "anchors")
        m = len(anchors)
        radius = np.zeros(m) if np.size(self.pulley_radius) == 0 else self.pulley_radius
        if np.ndim(radius) == 0:
            # Alike at all cables.
            radius = np.broadcast_to(np.asarray(radius, dtype=np.float64), (m,))
        axis = np.tile([0.0, 0.0, 1.0], (m, 1))
        if np.size(self.pulley_axis):
            axis = _directions(self.pulley_axis, m)
        for name, value, shape in (
            ("anchors", anchors, (m, 3)),
            ("attachments", _points(self.attachments, "attachments"), (m, 3)),
            ("gravity", self.gravity, (3,)),
            ("pulley_radius", radius, (m,)),
            ("pulley_axis", axis, (m, 3)),
        ):
            object.__setattr__(self, name, readonly(value, shape, name))
        if self.covariance is not None:
            own = readonly(self.covariance, (6 * m, 6 * m), "covariance")
            object.__setattr__(self, "covariance", own)

        self._check()

    def _check(self) -> None:
        """Refuse what no robot has.

        Raises:
            WrongValueError: Tension limits, radii or properties of the cables are none.
        """
        limits = np.asarray(self.tension_limits, dtype=np.float64)
        if limits.shape != (2,) or not 0 <= limits[0] < limits[1]:
            raise WrongValueError(
                "tension_limits: expected the lowest and the highest tension [N], found"
                f" {self.tension_limits}; correct them"
            )
        for name, points in (("anchors", self.anchors), ("attachments", self.attachments)):
            far = too_far(points)
            if far:
                raise WrongValueError(f"{name}: {far}")
        if (self.pulley_radius < 0).any():
            raise WrongValueError(
                f"pulley_radius: expected radii of 0 or more [m], found"
                f" {float(self.pulley_radius.min()):g}; correct it"
            )
        for name, value, kind in (
            ("cable", self.cable, CableProperties),
            ("limits", self.limits, Limits),
            ("platform", self.platform, Inertia),
        ):
            if not isinstance(value, kind) and (value is not None or name != "platform"):
                raise WrongValueError(
                    f"{name}: expected steelyard.{kind.__name__}(…), found {type(value).__name__};"
                    " correct it"
                )

    @property
    def m(self) -> int:
        """Number of cables."""
        return len(self.anchors)

    @property
    def holds_any_pose(self) -> bool:
        """Whether its cables are enough to hold a platform in any pose: on fewer than six it
        swings.
        """
        return self.m >= DIRECTIONS

    @property
    def up(self) -> Array:
        """Unit vector against gravity, world frame, shape (3,)."""
        return -self.gravity / np.linalg.norm(self.gravity)

    def below_anchors(self, depth: float) -> Array:
        """A place amid the anchors, below the highest of them, world frame [m], shape (3,).

        Args:
            depth: How far below, in parts of the width that the anchors span.
        """
        heights = self.anchors @ self.up
        across = self.anchors - heights[:, None] * self.up
        middle = across.mean(axis=0)
        # Of a square this is its side, whichever way it is turned.
        width = np.sqrt(2 * np.mean(np.sum((across - middle) ** 2, axis=1)))
        return np.asarray(middle + (heights.max() - depth * width) * self.up)

    @property
    def size(self) -> float:
        """Radius of the platform as its attachments show it [m]: about their middle, of a single
        place about the origin; 1 m where they show none.
        """
        if not self.m:
            return 1.0
        off_centre = self.attachments - self.attachments.mean(0)
        radius = float(np.sqrt(np.mean(np.sum(off_centre**2, axis=1))))
        return radius or float(np.linalg.norm(self.attachments[0])) or 1.0

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


def too_far(points: ArrayLike) -> str:
    """What is wrong with coordinates that are too large to tell a rotation with; empty: nothing.

    Args:
        points: Any number of coordinates [m].
    """
    farthest = float(np.abs(np.asarray(points, dtype=np.float64)).max(initial=0.0))
    if farthest <= _FARTHEST:
        return ""
    return (
        f"expected coordinates of at most {_FARTHEST:g} m, found {farthest:.7g}; subtract the same"
        " place from all anchors and from all that instruments read in that frame"
    )


def _points(values: ArrayLike, name: str) -> Array:
    """Points, also where there are none, shape (m, 3)."""
    return np.zeros((0, 3)) if np.size(values) == 0 else readonly(values, (None, 3), name)


def _directions(values: ArrayLike, m: int) -> Array:
    """Unit vectors, one for all cables or one each, shape (m, 3).

    Raises:
        WrongValueError: One has no length.
    """
    given = readonly(np.atleast_2d(np.asarray(values)), (None, 3), "pulley_axis")
    length = np.linalg.norm(given, axis=1, keepdims=True)
    if not length.all():
        raise WrongValueError(
            "pulley_axis: expected directions, found a vector of length 0; correct it"
        )
    return np.tile(given / length, (m, 1)) if len(given) == 1 else given / length


@lru_cache(maxsize=32)
def _with_straight_cables(robot: Robot) -> Robot:
    # One and the same value every time: what has been built for it is found again.
    return replace(robot, cable=replace(robot.cable, linear_density=None))
