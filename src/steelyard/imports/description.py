"""What the files of another program say of a robot, before anything is decided about it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

Vector = tuple[float, float, float]

Convention = Literal["matrix", "integral"]
"""Products of inertia as elements of the inertia matrix, or as +integral(x y dm), which is minus
them."""

Point = Literal["cog", "origin"]
"""About which point an inertia is: the centre of gravity or the origin of the platform frame."""


@dataclass(frozen=True)
class Cable:
    """One cable; None: the files do not say."""

    where: str
    """File, line and key, for messages."""
    anchor: Vector
    """World frame [m]; where there is a roller, the point at which the cable enters it."""
    attachment: Vector
    """Platform frame [m]."""
    radius: float = 0.0
    """Of the roller [m]; 0: the cable leaves from a point."""
    axis: Vector = (0.0, 0.0, 1.0)
    """Direction of travel of the cable where it enters the roller; the roller swivels about this
    line. World frame."""
    lowest_tension: float | None = None
    """[N]"""
    highest_tension: float | None = None
    """[N]"""
    diameter: float | None = None
    """[m]"""
    axial_stiffness: float | None = None
    """EA [N]"""


@dataclass(frozen=True)
class DescribedBody:
    """The nominal platform, with its inertia as it stands in the files."""

    where: str
    """File, line and key, for messages."""
    mass: float
    """[kg]"""
    center_of_gravity: Vector
    """Platform frame [m]."""
    moments: Vector
    """xx, yy, zz [kg m^2], platform axes."""
    products: Vector
    """yz, xz, xy [kg m^2], signs as in the files."""
    convention: Convention | None
    """What the products are; None: the format does not say."""
    reason: str
    """How that is known, or why it is not."""
    about: Point | None = "cog"
    """About which point the inertia is; None: the format does not say."""


@dataclass(frozen=True)
class Description:
    """A robot in SI units, as far as the files state it."""

    format: str
    """Name of the format."""
    files: tuple[Path, ...]
    cables: tuple[Cable, ...]
    name: str = ""
    """Empty: the files do not say, and theirs will do."""
    body: DescribedBody | None = None
    gravity: Vector | None = None
    """World frame [m/s^2]; None: the files do not say."""
    limits: Mapping[str, object] = field(default_factory=dict)
    """As in the robot file."""
    notes: tuple[str, ...] = ()
    """What was left out of the files, assumed or chosen."""
    alone: bool = False
    """Whether the format is one of a platform, without cables."""
