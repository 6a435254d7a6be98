"""Inertial measurement units: gyro, accelerometer and, if it has one, an attitude of its own."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import casadi as ca

from steelyard import rotations
from steelyard.batch import Symbol
from steelyard.dynamics import point_specific_force
from steelyard.files.file_model import FileModel
from steelyard.instruments.base import (
    ORIENTATION_FORMS,
    Calibration,
    Choice,
    Instrument,
    Mounting,
    Prior,
    Quantity,
    Term,
    Vector,
    exact,
    mounting_rotation,
    sigma,
)
from steelyard.instruments.noise import (
    AttitudeFilter,
    Noise,
    Sigma,
    drift,
    of_orientation,
    white_part,
    with_colored_part,
)
from steelyard.motion.state import State
from steelyard.robot.model import Robot

_POOR_SCALE = 0.02
"""1-sigma of the scale of cheap sensors, as their data sheets state it."""


class ImuNoise(FileModel):
    """1-sigma per sample and axis [rad/s], [m/s^2], [rad]."""

    angular_velocity: Noise | None = None
    """[rad/s]"""
    specific_force: Noise | None = None
    """[m/s^2]"""
    orientation: Noise | None = None
    """[rad]"""


class ImuCalibration(Calibration):
    """Systematic errors, 1-sigma."""

    gyro_bias: Prior = sigma(0.02)
    """Added to each axis [rad/s]."""
    accelerometer_bias: Prior = sigma(0.5)
    """Added to each axis [m/s^2]."""
    position: Prior = sigma(0.005)
    """Its place in the platform [m]."""
    misalignment: Prior = sigma(0.05)
    """Small rotation of the instrument in the platform [rad]."""
    reference: Prior = sigma(0.02)
    """Small rotation of its reference frame against the world [rad]."""
    gyro_scale: Prior = exact()
    """Relative error of each axis; not stated: none, unless the readings ask for one."""
    accelerometer_scale: Prior = exact()
    """The same."""
    gyro_drift: Sigma | None = None
    """Random walk of the bias [rad/s/sqrt(s)]; None: not stated."""
    accelerometer_drift: Sigma | None = None
    """The same [m/s^2/sqrt(s)]."""
    filter: AttitudeFilter | None = None
    """Time constant of a filter by which its orientation follows the accelerometer [s]; None: not
    stated."""
    heading: Sigma | None = None
    """Random walk of the heading of its orientation [rad/sqrt(s)]; None: not stated."""


class Imu(Instrument):
    """Angular velocity, specific force and orientation of the IMU; any of the three may be
    absent.
    """

    kind: Literal["imu"]
    position: Vector = (0.0, 0.0, 0.0)
    """Origin of the instrument frame in the platform frame [m]."""
    rpy_deg: Vector = (0.0, 0.0, 0.0)
    """Instrument frame to platform frame [deg]."""
    noise: ImuNoise = ImuNoise()
    calibration: ImuCalibration = ImuCalibration()
    gravity: Literal["included", "removed"] = "included"
    """``removed`` where the device took gravity out of its reading."""

    @property
    def mounting(self) -> Mounting:
        """See :class:`Instrument`."""
        return Mounting(self.rpy_deg, self.position)

    @property
    def choices(self) -> tuple[Choice, ...]:
        """See :class:`Instrument`."""
        other, what = "removed", "has gravity taken out"
        if self.gravity == "removed":
            other, what = "included", "still contains gravity"
        return (
            Choice("gravity", other, ("specific_force",), "gravity in the accelerometer", what),
        )

    def quantities(self, m: int) -> tuple[Quantity, ...]:
        """See :class:`Instrument`."""
        n, c = self.noise, self.calibration
        return (
            Quantity(
                "angular_velocity",
                (("wx", "wy", "wz"),),
                "rad/s",
                white_part(n.angular_velocity),
                required=False,
                determines=("rotation",),
                disturbed=with_colored_part(n.angular_velocity, drift(c.gyro_drift)),
            ),
            Quantity(
                "specific_force",
                (("ax", "ay", "az"),),
                "m/s^2",
                white_part(n.specific_force),
                required=False,
                determines=("position",),
                disturbed=with_colored_part(n.specific_force, drift(c.accelerometer_drift)),
            ),
            Quantity(
                "orientation",
                ORIENTATION_FORMS,
                "rad",
                white_part(n.orientation),
                rotation=True,
                required=False,
                determines=("rotation",),
                disturbed=of_orientation(n.orientation, c.filter, c.heading),
            ),
        )

    def terms(self, m: int) -> tuple[Term, ...]:
        """See :class:`Instrument`."""
        c = self.calibration
        return (
            Term("gyro_bias", 3, "rad/s", c.gyro_bias),
            Term("accelerometer_bias", 3, "m/s^2", c.accelerometer_bias),
            Term("position", 3, "m", c.position),
            Term("misalignment", 3, "rad", c.misalignment),
            Term("reference", 3, "rad", c.reference),
            Term("gyro_scale", 3, "1", c.gyro_scale, suspected=self._suspected("gyro_scale")),
            Term(
                "accelerometer_scale",
                3,
                "1",
                c.accelerometer_scale,
                suspected=self._suspected("accelerometer_scale"),
            ),
        )

    def _suspected(self, key: str) -> float | None:
        """1-sigma of a scale that is not as good as usual; None where one is stated."""
        return None if key in self.calibration.model_fields_set else _POOR_SCALE

    def predict(
        self, state: State, calibration: Mapping[str, Symbol], robot: Robot
    ) -> dict[str, Symbol]:
        """Rates and specific force where the IMU sits, in its own axes, and its orientation against
        its own reference.
        """
        c = calibration
        R = mounting_rotation(self.rpy_deg, c["misalignment"])
        place = ca.DM(self.position) + c["position"]
        force = point_specific_force(state.specific_force, state.omega, state.alpha, place)
        if self.gravity == "removed":
            force = force + state.rotation.T @ state.gravity
        return {
            "angular_velocity": (1 + c["gyro_scale"]) * (R.T @ state.omega) + c["gyro_bias"],
            "specific_force": (1 + c["accelerometer_scale"]) * (R.T @ force)
            + c["accelerometer_bias"],
            "orientation": rotations.exp(c["reference"]).T @ state.rotation @ R,
        }
