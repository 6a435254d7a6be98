"""Samples of a run on one time base, filtered alike."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array


@dataclass(frozen=True, eq=False)
class Samples:
    """One run in the platform frame on one time base, n samples."""

    run: str
    time: Array
    """Common time [s]; of a static run the number of the pose; shape (n,)."""
    omega: Array
    """Angular velocity [rad/s], shape (n, 3)."""
    alpha: Array
    """Angular acceleration [rad/s^2], shape (n, 3)."""
    specific_force: Array
    """Of the platform origin [m/s^2], shape (n, 3)."""
    wrench: Array
    """Force over torque about the platform origin of what carries it [N], [N m], shape (n, 6)."""
    static: bool
    """Whether the samples are poses at rest."""
    free_offset: bool
    """Whether the wrench has a constant offset that is not known."""
    alpha_noise: float
    """1-sigma of the noise left in alpha [rad/s^2]."""
    spacing: float
    """Of the knots of the filter [s]; 0: not filtered."""
    position_sigma: float
    """1-sigma of the place that the acceleration was measured at [m]."""
    position: Array | None = None
    """Of the platform origin, world frame [m], shape (n, 3); None where nothing tells it."""
    rotation: Array | None = None
    """R_world_platform, shape (n, 3, 3); None where nothing tells it."""
    velocity: Array | None = None
    """Of the platform origin, world frame [m/s], shape (n, 3); None where the force sensors do not
    ask for it."""
    tension: Array | None = None
    """Of the cables at the platform [N], shape (n, m); None without cables."""
    structure: Array | None = None
    """Structure matrix, shape (n, 6, m); None without cables."""
    noise: Mapping[str, float] = field(default_factory=dict)
    """1-sigma of single readings of the force instrument about their spline."""
    notes: tuple[str, ...] = ()
    """What a reader should know about how they were made."""

    def __len__(self) -> int:
        return len(self.time)

    def part(self, rows: slice | NDArray[np.intp]) -> Samples:
        """Some of the samples."""
        motion = ("position", "rotation", "velocity", "omega", "alpha", "specific_force")
        arrays = ("time", *motion, "wrench", "tension", "structure")
        given: dict[str, Any] = {key: getattr(self, key) for key in arrays}
        changed: dict[str, Any] = {
            key: None if value is None else value[rows] for key, value in given.items()
        }
        return replace(self, **changed)
