"""Reads a recording of the public benchmark; NumPy alone."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Platform:
    """The friendlier version: one exact clock, exact mounting, the wrench by exact geometry."""

    t: Array
    """[s], shape (n,)."""
    position: Array
    """Of the platform's origin in the world [m], shape (n, 3)."""
    quaternion: Array
    """(w, x, y, z), platform -> world, shape (n, 4)."""
    omega: Array
    """In the platform [rad/s], shape (n, 3)."""
    specific_force: Array
    """Of the origin, in the platform [m/s^2], shape (n, 3)."""
    wrench: Array
    """Of the cables about the origin, in the platform: force [N], torque [N m]; shape (n, 6)."""

    @property
    def step(self) -> float:
        """Between samples [s]."""
        return float(np.median(np.diff(self.t)))


def columns(path: Path) -> dict[str, Array]:
    """Name -> values of a CSV file."""
    with path.open(encoding="utf-8") as file:
        header = file.readline().strip().split(",")
        values = np.loadtxt(file, delimiter=",", ndmin=2)
    return dict(zip(header, values.T, strict=True))


def read_description(folder: Path) -> dict[str, Any]:
    """What a method may know."""
    return json.loads((folder / "description.json").read_text("utf-8"))


def read_platform(folder: Path) -> Platform:
    """The friendlier version of a recording."""
    found: Mapping[str, Array] = columns(folder / "platform.csv")
    group = lambda names: np.column_stack([found[name] for name in names.split()])  # noqa: E731
    return Platform(
        t=found["t"],
        position=group("x y z"),
        quaternion=group("qw qx qy qz"),
        omega=group("wx wy wz"),
        specific_force=group("ax ay az"),
        wrench=group("fx fy fz tx ty tz"),
    )
