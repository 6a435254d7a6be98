"""Where the mass of a body lies: regions that its second moments must fit into [Wensing2018]_."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from steelyard.arrays import Array, readonly
from steelyard.errors import WrongValueError


@dataclass(frozen=True, eq=False)
class Box:
    """A box along the platform axes, in which all mass lies."""

    lower: Array
    """Corner in the platform frame [m], shape (3,)."""
    upper: Array
    """Corner in the platform frame [m], shape (3,)."""
    name: str = "box"

    def __post_init__(self) -> None:
        object.__setattr__(self, "lower", readonly(self.lower, (3,), "lower"))
        object.__setattr__(self, "upper", readonly(self.upper, (3,), "upper"))
        if not (self.lower < self.upper).all():
            raise WrongValueError(
                f"{self.name}: expected lower < upper, found {self.lower.tolist()},"
                f" {self.upper.tolist()}"
            )

    def about(self, point: Array) -> Box:
        """The same in a platform frame whose origin is at a point of the present one [m], shape
        (3,).
        """
        return replace(self, lower=self.lower - point, upper=self.upper - point)

    @property
    def conditions(self) -> dict[str, Array]:
        """Name -> Q of (x - lower)(upper - x) >= 0 as [r; 1]^T Q [r; 1], shape (4, 4) each."""
        found = {}
        for i, (low, high) in enumerate(zip(self.lower, self.upper, strict=True)):
            Q = np.zeros((4, 4))
            Q[i, i] = -1.0
            Q[i, 3] = Q[3, i] = (low + high) / 2
            Q[3, 3] = -low * high
            found[f"{self.name}, {'xyz'[i]}"] = Q
        return found


@dataclass(frozen=True, eq=False)
class Ellipsoid:
    """An ellipsoid in which all mass lies."""

    center: Array
    """In the platform frame [m], shape (3,)."""
    semi_axes: Array
    """Half of its diameters [m], shape (3,)."""
    R_platform_ellipsoid: Array | None = None
    """Columns are its axes in the platform frame, shape (3, 3); None: along the platform axes."""
    name: str = "ellipsoid"

    def __post_init__(self) -> None:
        R = np.eye(3) if self.R_platform_ellipsoid is None else self.R_platform_ellipsoid
        object.__setattr__(self, "center", readonly(self.center, (3,), "center"))
        object.__setattr__(self, "semi_axes", readonly(self.semi_axes, (3,), "semi_axes"))
        object.__setattr__(
            self, "R_platform_ellipsoid", readonly(R, (3, 3), "R_platform_ellipsoid")
        )
        if not (self.semi_axes > 0).all():
            raise WrongValueError(
                f"{self.name}: expected positive semi-axes, found {self.semi_axes.tolist()}"
            )
        R = np.asarray(self.R_platform_ellipsoid)
        if not np.allclose(R @ R.T, np.eye(3), atol=1e-9):
            raise WrongValueError(f"{self.name}: expected a rotation, found {R.tolist()}")

    def about(self, point: Array) -> Ellipsoid:
        """The same in a platform frame whose origin is at a point of the present one [m], shape
        (3,).
        """
        return replace(self, center=self.center - point)

    @property
    def conditions(self) -> dict[str, Array]:
        """Name -> Q of 1 - (r - c)^T E (r - c) >= 0 as [r; 1]^T Q [r; 1], shape (4, 4)."""
        R, c = np.asarray(self.R_platform_ellipsoid), self.center[:, None]
        E = R @ np.diag(self.semi_axes**-2) @ R.T
        return {self.name: np.block([[-E, E @ c], [c.T @ E, 1 - c.T @ E @ c]])}


Region = Box | Ellipsoid
