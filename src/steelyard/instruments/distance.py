"""Laser and ultrasonic sensors: the distance of a point of the platform from a plane."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import casadi as ca
import numpy as np
from pydantic import field_validator

from steelyard.arrays import Array
from steelyard.batch import Symbol
from steelyard.files.file_model import FileModel
from steelyard.instruments.base import (
    Calibration,
    Instrument,
    Mounting,
    Prior,
    Quantity,
    Term,
    Vector,
    sigma,
)
from steelyard.instruments.noise import Noise, white_part, with_colored_part
from steelyard.motion.state import State
from steelyard.robot.model import Robot


class PlaneForm(FileModel):
    """A plane of the world: all points x with n . x = offset, n the normal of length one."""

    normal: Vector
    """Points to the side on which distances are positive, world frame; its length does not
    matter."""
    offset: float
    """Distance of the plane from the origin of the world, along the normal [m]."""

    @field_validator("normal")
    @classmethod
    def _has_a_direction(cls, normal: Vector) -> Vector:
        if not any(normal):
            raise ValueError("expected a direction, found [0, 0, 0]; give the normal of the plane")
        return normal

    @property
    def unit_normal(self) -> Array:
        """The normal n of length one, world frame, shape (3,)."""
        normal = np.array(self.normal)
        return np.asarray(normal / np.linalg.norm(normal))


class DistanceCalibration(Calibration):
    """Systematic errors, 1-sigma."""

    offset: Prior = sigma(0.005)
    """Added to the reading [m]."""
    target: Prior = sigma(0.005)
    """Place of the point in the platform [m]."""


class Distance(Instrument):
    """Perpendicular distance of a point of the platform from a plane of the world, positive on the
    side to which the normal points.
    """

    kind: Literal["distance"]
    point: Vector = (0.0, 0.0, 0.0)
    """Point whose distance is read, platform frame [m]."""
    plane: PlaneForm
    noise: Noise | None = None
    """1-sigma per sample [m]."""
    calibration: DistanceCalibration = DistanceCalibration()

    @property
    def mounting(self) -> Mounting:
        """See :class:`Instrument`."""
        return Mounting(point=self.point, point_key="point")

    def quantities(self, m: int) -> tuple[Quantity, ...]:
        """See :class:`Instrument`."""
        return (
            Quantity(
                "distance",
                (("d",),),
                "m",
                white_part(self.noise),
                disturbed=with_colored_part(self.noise),
            ),
        )

    def terms(self, m: int) -> tuple[Term, ...]:
        """See :class:`Instrument`."""
        c = self.calibration
        return Term("offset", 1, "m", c.offset), Term("target", 3, "m", c.target)

    def predict(
        self, state: State, calibration: Mapping[str, Symbol], robot: Robot
    ) -> dict[str, Symbol]:
        r"""The point's coordinate along the normal, counted from the plane.

        :math:`d = n \cdot (p + R (b + \delta b)) - h + o` with the plane's unit normal n and
        offset h, the platform's position p and rotation R, the point b and its error, and the
        offset o of the reading.
        """
        target = ca.DM(self.point) + calibration["target"]  # in the platform
        point = state.position + state.rotation @ target  # in the world
        height = ca.dot(ca.DM(self.plane.unit_normal), point) - self.plane.offset
        return {"distance": height + calibration["offset"]}
