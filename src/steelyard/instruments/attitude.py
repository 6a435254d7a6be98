"""Orientation of the platform from any source."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

from steelyard import rotations
from steelyard.batch import Symbol
from steelyard.instruments.base import (
    ORIENTATION_FORMS,
    Calibration,
    Instrument,
    Mounting,
    Prior,
    Quantity,
    Term,
    Vector,
    mounting_rotation,
    sigma,
)
from steelyard.instruments.noise import AttitudeFilter, Noise, Sigma, of_orientation, white_part
from steelyard.motion.state import State
from steelyard.robot.model import Robot


class AttitudeCalibration(Calibration):
    """Systematic errors, 1-sigma."""

    misalignment: Prior = sigma(0.05)
    """Small rotation of the instrument in the platform [rad]."""
    reference: Prior = sigma(0.02)
    """Small rotation of its reference frame against the world [rad]."""
    filter: AttitudeFilter | None = None
    """Time constant of a filter that follows the accelerometer [s]; None: not stated."""
    heading: Sigma | None = None
    """Random walk of the heading [rad/sqrt(s)]; None: not stated."""


class Attitude(Instrument):
    """Orientation of the platform, or of a frame fixed to it, in the world."""

    kind: Literal["attitude"]
    rpy_deg: Vector = (0.0, 0.0, 0.0)
    """Instrument frame to platform frame [deg]."""
    noise: Noise | None = None
    """1-sigma per sample and axis [rad]."""
    calibration: AttitudeCalibration = AttitudeCalibration()

    @property
    def mounting(self) -> Mounting:
        """See :class:`Instrument`."""
        return Mounting(self.rpy_deg)

    def quantities(self, m: int) -> tuple[Quantity, ...]:
        """See :class:`Instrument`."""
        c = self.calibration
        return (
            Quantity(
                "orientation",
                ORIENTATION_FORMS,
                "rad",
                white_part(self.noise),
                rotation=True,
                determines=("rotation",),
                disturbed=of_orientation(self.noise, c.filter, c.heading),
            ),
        )

    def terms(self, m: int) -> tuple[Term, ...]:
        """See :class:`Instrument`."""
        c = self.calibration
        return Term("misalignment", 3, "rad", c.misalignment), Term(
            "reference", 3, "rad", c.reference
        )

    def predict(
        self, state: State, calibration: Mapping[str, Symbol], robot: Robot
    ) -> dict[str, Symbol]:
        """Orientation of the frame against the instrument's reference."""
        R = mounting_rotation(self.rpy_deg, calibration["misalignment"])
        return {"orientation": rotations.exp(calibration["reference"]).T @ state.rotation @ R}
