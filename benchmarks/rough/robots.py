"""Robots of drawn recordings, with three to twelve cables; a seed draws body, place and pace."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .further import FURTHER
from .shared import public

_GRAVITY = public.GRAVITY


@dataclass(frozen=True, eq=False)
class RoughRobot:
    """A robot of the public benchmark's form, and what its files state beside."""

    plain: public.PublicRobot
    geometry: float = 0.002
    """1-sigma of every coordinate of anchors and attachments [m]."""
    encoder: float = 0.0005
    """Noise of the lengths [m]."""

    @property
    def size(self) -> float:
        """Of the platform [m]."""
        return float(np.ptp(self.plain.attachments, axis=0).max())

    @property
    def weight(self) -> float:
        """[N]"""
        return _GRAVITY * self.plain.mass

    @property
    def pull(self) -> float:
        """What a cable pulls about the middle of the motion [N]."""
        return self.plain.tension


THREE = replace(
    public.FOUR_CABLES,
    name="three",
    words="6 kg suspended on three cables in a hall of 3 m",
    anchors=np.array([[2.0, 0.0, 3.0], [-1.0, 1.732, 3.0], [-1.0, -1.732, 3.0]]),
    attachments=np.array([[0.2, 0.0, 0.1], [-0.1, 0.1732, 0.1], [-0.1, -0.1732, 0.1]]),
    mass=6.1,
    center_of_gravity=np.array([0.004, -0.011, 0.02]),
    inertia=np.diag([0.09, 0.1, 0.13]),
    center=np.array([0.0, 0.0, 1.2]),
    reach=np.array([0.2, 0.18, 0.15, 0.0, 0.0, 0.0]),
    tension=30.0,
)
FOUR = replace(public.FOUR_CABLES, name="four")
FIVE = replace(
    public.FOUR_CABLES,
    name="five",
    words="25 kg suspended on five cables in a hall of 6 m",
    anchors=np.array([[3, 2.5, 4], [3, -2.5, 4], [-3, 2.5, 4], [-3, -2.5, 4], [-3.2, 0, 4.0]]),
    attachments=np.array(
        [
            [0.3, 0.25, 0.3],
            [0.3, -0.25, 0.3],
            [-0.3, 0.25, 0.3],
            [-0.3, -0.25, 0.3],
            [-0.3, 0, -0.1],
        ]
    ),
    axial_stiffness=1e5,
    mass=25.0,
    center_of_gravity=np.array([0.02, 0.01, 0.03]),
    inertia=np.diag([1.3, 1.5, 2.1]),
    center=np.array([0.0, 0.0, 1.5]),
    reach=np.array([0.12, 0.1, 0.1, 0.0, 0.0, 0.0]),
    tension=85.0,
)
_CORNERS = np.arange(3) * 2 * np.pi / 3
_UP = np.repeat(np.column_stack([3 * np.cos(_CORNERS), 3 * np.sin(_CORNERS), np.full(3, 4)]), 2, 0)
_LOW = np.column_stack(
    [0.4 * np.cos(_CORNERS + np.pi / 3), 0.4 * np.sin(_CORNERS + np.pi / 3), np.zeros(3)]
)
SIX = replace(
    public.COGIRO,
    name="six",
    words="40 kg suspended on six cables, two from each corner of a triangle, in a hall of 6 m",
    anchors=_UP + np.array([[0.0, 0.05, 0.0], [0.0, -0.05, 0.0]] * 3),
    attachments=_LOW[[2, 0, 0, 1, 1, 2]],
    axial_stiffness=2e5,
    mass=40.0,
    center_of_gravity=np.array([0.02, -0.015, -0.05]),
    inertia=np.diag([3.6, 3.2, 4.1]),
    center=np.array([0.0, 0.0, 1.3]),
    reach=np.array([0.15, 0.15, 0.15, 0.08, 0.08, 0.1]),
    tension=100.0,
    imu=np.array([0.03, 0.02, 0.1]),
    target=np.array([0.1, -0.12, 0.3]),
)
TIGHT = replace(
    public.EIGHT_TIGHT,
    name="tight",
    words="8 kg held by eight cables from above and below in a frame of 4 m; some go slack",
    tension=80.0,
    reach=np.array([0.18, 0.12, 0.1, 0.06, 0.06, 0.06]),
    frequency=0.6,
)
_INNER = np.array([[-3.5, -3.0, 5.6], [-3.5, 3.0, 5.6], [3.5, 3.0, 5.6], [3.5, -3.0, 5.6]])
_SPREAD = np.array([[-0.5, -0.4, 0.9], [-0.5, 0.45, 0.1], [0.5, 0.4, 0.9], [0.5, -0.45, 0.1]])
TWELVE = replace(
    public.COGIRO,
    name="twelve",
    words="320 kg suspended on twelve cables in a hall of 15 m",
    anchors=np.concatenate([public.COGIRO.anchors, _INNER]),
    attachments=np.concatenate([public.COGIRO.attachments, _SPREAD]),
    mass=320.0,
    center_of_gravity=np.array([0.02, 0.03, 0.2]),
    inertia=np.diag([140.0, 150.0, 90.0]),
    tension=600.0,
)

ROBOTS = {
    "cogiro": RoughRobot(public.COGIRO),
    "three": RoughRobot(THREE),
    "four": RoughRobot(FOUR),
    "five": RoughRobot(FIVE),
    "six": RoughRobot(SIX),
    "tight": RoughRobot(TIGHT),
    "desk": RoughRobot(public.DESK, geometry=0.0003, encoder=0.0001),
    "twelve": RoughRobot(TWELVE),
    **{name: RoughRobot(each) for name, each in FURTHER.items()},
    "mini": RoughRobot(FURTHER["mini"], geometry=0.0003, encoder=0.0001),
}


def drawn(robot: RoughRobot, rng: np.random.Generator) -> RoughRobot:
    """The robot with another body that can exist, elsewhere and at another pace."""
    plain, size = robot.plain, robot.size
    scale = rng.uniform(0.85, 1.15)
    # Of a body: half the trace less the moments are second moments, which are positive.
    moments = np.trace(plain.inertia) / 2 * np.eye(3) - plain.inertia
    stretch = np.diag(rng.uniform(0.9, 1.1, 3))
    turned = public.rotation_of(rng.normal(0, 0.06, 3))
    moments = scale * turned @ stretch @ moments @ stretch @ turned.T
    body = replace(
        plain,
        mass=scale * plain.mass,
        center_of_gravity=plain.center_of_gravity + rng.normal(0, 0.03 * size, 3),
        inertia=np.trace(moments) * np.eye(3) - moments,
        tension=scale * plain.tension,
        center=plain.center + rng.uniform(-0.5, 0.5, 3) * plain.reach[:3],
        reach=plain.reach * rng.uniform(0.8, 1.1, 6),
        frequency=plain.frequency * rng.uniform(0.85, 1.1),
    )
    return replace(robot, plain=body)
