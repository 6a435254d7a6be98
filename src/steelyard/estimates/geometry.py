"""The geometry of a robot as a fit has corrected it beside the body."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from steelyard.arrays import Array
from steelyard.estimates.per_mass import PER_MASS_PARAMETERS
from steelyard.robot.model import Robot

_AXES = ("x", "y", "z")


@dataclass(frozen=True, eq=False)
class FoundGeometry:
    """Anchors and attachments that go with a body: what is not known of the one is not known of the
    other, so that predictions need both.
    """

    nominal: Array
    """Anchors and then attachments of the robot file [m], shape (2, m, 3)."""
    points: Array
    """The same as they were found [m], shape (2, m, 3)."""
    covariance: Array
    """Of the nine of :data:`.PER_MASS_PARAMETERS` and of these, shape (9 + 6 m, 9 + 6 m)."""

    def about(self, point: Array) -> FoundGeometry:
        """The same in a platform frame whose origin is at a point of the present one.

        Args:
            point: In the platform frame [m], shape (3,).
        """
        shift = np.array([np.zeros(3), point])[:, None]
        return replace(self, nominal=self.nominal - shift, points=self.points - shift)

    def names(self) -> tuple[str, ...]:
        """Of rows and columns of the covariance."""
        m = self.points.shape[1]
        coordinates = (
            f"{what}.{i + 1}.{axis}"
            for what in ("anchor", "attachment")
            for i in range(m)
            for axis in _AXES
        )
        return (*PER_MASS_PARAMETERS, *coordinates)

    def to_dict(self) -> dict[str, Any]:
        """Plain values."""
        anchors, attachments = self.points.tolist()
        return {
            "nominal": dict(zip(("anchors", "attachments"), self.nominal.tolist(), strict=True)),
            "anchors": anchors,
            "attachments": attachments,
            "covariance": {"parameters": list(self.names()), "matrix": self.covariance.tolist()},
        }

    def is_of(self, robot: Robot) -> bool:
        """Whether it was found for this robot: a correction says nothing about another."""
        own = np.array([robot.anchors, robot.attachments])
        return own.shape == self.nominal.shape and bool(np.allclose(own, self.nominal, atol=1e-9))

    def of(self, robot: Robot) -> Robot:
        """The robot with the points as they were found."""
        return replace(robot, anchors=self.points[0], attachments=self.points[1])
