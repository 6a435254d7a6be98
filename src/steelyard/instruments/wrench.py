"""A six-axis force-torque sensor that carries the body."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, Literal

import casadi as ca

from steelyard.batch import Symbol
from steelyard.files.file_model import FileModel
from steelyard.instruments.base import (
    Choice,
    ForceCalibration,
    Instrument,
    Mounting,
    Prior,
    Quantity,
    Term,
    Vector,
    exact,
    mounting_rotation,
)
from steelyard.instruments.noise import Noise, drift, white_part, with_colored_part
from steelyard.motion.state import State
from steelyard.robot.model import Robot

_FROM_DATA = Prior.model_construct(value=None, sigma=None, per="experiment")


class WrenchNoise(FileModel):
    """1-sigma per sample [N], [N m]."""

    force: Noise | None = None
    """[N]"""
    torque: Noise | None = None
    """[N m]"""


class WrenchOffset(FileModel):
    """Added to each axis [N], [N m]."""

    force: Prior = _FROM_DATA
    """[N]; default: the largest reading."""
    torque: Prior = _FROM_DATA
    """[N m]; default: the largest reading."""


class WrenchCalibration(ForceCalibration):
    """Systematic errors, 1-sigma."""

    offset: WrenchOffset = WrenchOffset()
    """Added to each axis."""
    position: Prior = exact()
    """Its place in the platform [m]."""
    misalignment: Prior = exact()
    """Small rotation of the instrument in the platform [rad]."""


class Wrench(Instrument):
    """Force and torque on the body, in the sensor's own frame about its own origin."""

    measured_force: ClassVar[Literal["wrench"]] = "wrench"

    kind: Literal["wrench"]
    position: Vector = (0.0, 0.0, 0.0)
    """Origin of the sensor in the platform frame [m]."""
    rpy_deg: Vector = (0.0, 0.0, 0.0)
    """Sensor frame to platform frame [deg]."""
    noise: WrenchNoise = WrenchNoise()
    calibration: WrenchCalibration = WrenchCalibration()
    acts_on: Literal["body", "sensor"] = "body"
    """Whose load the reading is: ``sensor`` turns the sign."""

    @property
    def mounting(self) -> Mounting:
        """See :class:`Instrument`."""
        return Mounting(self.rpy_deg, self.position)

    @property
    def choices(self) -> tuple[Choice, ...]:
        """See :class:`Instrument`."""
        other = "body" if self.acts_on == "sensor" else "sensor"
        what = f"is the load on the {other}"
        return (Choice("acts_on", other, ("force", "torque"), "sign of the wrench", what),)

    def quantities(self, m: int) -> tuple[Quantity, ...]:
        """See :class:`Instrument`."""
        n, walk = self.noise, drift(self.calibration.drift)
        return (
            Quantity(
                "force",
                (("fx", "fy", "fz"),),
                "N",
                white_part(n.force),
                disturbed=with_colored_part(n.force, walk),
            ),
            Quantity(
                "torque",
                (("tx", "ty", "tz"),),
                "N m",
                white_part(n.torque),
                disturbed=with_colored_part(n.torque, walk),
            ),
        )

    def terms(self, m: int) -> tuple[Term, ...]:
        """See :class:`Instrument`."""
        c = self.calibration
        return (
            Term("offset.force", 3, "N", c.offset.force),
            Term("offset.torque", 3, "N m", c.offset.torque),
            Term("position", 3, "m", c.position),
            Term("misalignment", 3, "rad", c.misalignment),
            c.filter_term,
        )

    def predict(
        self, state: State, calibration: Mapping[str, Symbol], robot: Robot
    ) -> dict[str, Symbol]:
        """The carrying wrench, moved to the sensor's origin and turned into its frame."""
        c = calibration
        R = mounting_rotation(self.rpy_deg, c["misalignment"])
        place = ca.DM(self.position) + c["position"]
        force, torque = state.wrench[:3], state.wrench[3:]
        sign = 1 if self.acts_on == "body" else -1
        return {
            "force": sign * (R.T @ force) + c["offset.force"],
            "torque": sign * (R.T @ (torque - ca.cross(place, force))) + c["offset.torque"],
        }
