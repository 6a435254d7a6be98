"""Camera systems and six-axis trackers: position and orientation together."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import casadi as ca

from steelyard.batch import Symbol
from steelyard.files.file_model import FileModel
from steelyard.instruments.base import (
    ORIENTATION_FORMS,
    Calibration,
    FrameForm,
    Instrument,
    Mounting,
    Prior,
    Quantity,
    Term,
    Vector,
    mounting_rotation,
    sigma,
)
from steelyard.instruments.noise import Noise, Sigma, reacquired, white_part, with_colored_part
from steelyard.instruments.position import FrameCalibration, frame_terms, tracker_frame
from steelyard.motion.state import State
from steelyard.robot.model import Robot


class PoseNoise(FileModel):
    """1-sigma per sample and axis [m], [rad]."""

    position: Noise | None = None
    """[m]"""
    rotation: Noise | None = None
    """[rad]"""


class PoseCalibration(Calibration):
    """Systematic errors, 1-sigma."""

    misalignment: Prior = sigma(0.05)
    """Small rotation of the tracked frame in the platform [rad]."""
    target: Prior = sigma(0.005)
    """Place of the tracked frame in the platform [m]."""
    frame: FrameCalibration = FrameCalibration()
    reacquired: Sigma | None = None
    """Constant shift after each loss of the target [m]; None: not stated."""


class Pose(Instrument):
    """Position and orientation of a frame on the platform in the tracker frame."""

    kind: Literal["pose"]
    position: Vector = (0.0, 0.0, 0.0)
    """Origin of the tracked frame in the platform frame [m]."""
    rpy_deg: Vector = (0.0, 0.0, 0.0)
    """Tracked frame to platform frame [deg]."""
    frame: FrameForm = FrameForm()
    noise: PoseNoise = PoseNoise()
    calibration: PoseCalibration = PoseCalibration()

    @property
    def mounting(self) -> Mounting:
        """See :class:`Instrument`."""
        return Mounting(self.rpy_deg, self.position, frame=self.frame)

    def quantities(self, m: int) -> tuple[Quantity, ...]:
        """See :class:`Instrument`."""
        n = self.noise
        return (
            Quantity(
                "position",
                (("x", "y", "z"),),
                "m",
                white_part(n.position),
                determines=("position",),
                disturbed=with_colored_part(n.position, reacquired(self.calibration.reacquired)),
            ),
            Quantity(
                "orientation",
                ORIENTATION_FORMS,
                "rad",
                white_part(n.rotation),
                rotation=True,
                determines=("rotation",),
                disturbed=with_colored_part(n.rotation),
            ),
        )

    def terms(self, m: int) -> tuple[Term, ...]:
        """See :class:`Instrument`."""
        c = self.calibration
        return (
            Term("misalignment", 3, "rad", c.misalignment),
            Term("target", 3, "m", c.target),
            *frame_terms(c.frame),
        )

    def predict(
        self, state: State, calibration: Mapping[str, Symbol], robot: Robot
    ) -> dict[str, Symbol]:
        """The tracked frame in the tracker frame."""
        c = calibration
        origin, R_world_tracker = tracker_frame(self.frame, c)
        target = state.position + state.rotation @ (ca.DM(self.position) + c["target"])
        R = mounting_rotation(self.rpy_deg, c["misalignment"])
        return {
            "position": R_world_tracker.T @ (target - origin),
            "orientation": R_world_tracker.T @ state.rotation @ R,
        }
