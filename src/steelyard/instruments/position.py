"""Laser trackers and the like: the position of one target."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import casadi as ca

from steelyard.batch import Symbol
from steelyard.files.file_model import FileModel
from steelyard.instruments.base import (
    Calibration,
    FrameForm,
    Instrument,
    Mounting,
    Prior,
    Quantity,
    TargetLimits,
    Term,
    Vector,
    mounting_rotation,
    sigma,
)
from steelyard.instruments.noise import Noise, Sigma, reacquired, white_part, with_colored_part
from steelyard.motion.state import State
from steelyard.robot.model import Robot


class FrameCalibration(FileModel):
    """Error of the stated tracker frame, 1-sigma [m], [rad]."""

    position: Prior = sigma(0.002)
    """[m]"""
    rotation: Prior = sigma(0.0005)
    """[rad]"""


class PositionCalibration(Calibration):
    """Systematic errors, 1-sigma."""

    target: Prior = sigma(0.005)
    """Place of the target in the platform [m]."""
    frame: FrameCalibration = FrameCalibration()
    reacquired: Sigma | None = None
    """Constant shift after each loss of the target [m]; None: not stated."""


class Position(Instrument):
    """Position of a target on the platform in the tracker frame."""

    kind: Literal["position"]
    target: Vector = (0.0, 0.0, 0.0)
    """Tracked point in the platform frame [m]."""
    frame: FrameForm = FrameForm()
    noise: Noise | None = None
    """1-sigma per sample and axis [m]."""
    calibration: PositionCalibration = PositionCalibration()
    limits: TargetLimits = TargetLimits()

    @property
    def target_limits(self) -> TargetLimits:
        """See :class:`Instrument`."""
        return self.limits

    @property
    def mounting(self) -> Mounting:
        """See :class:`Instrument`."""
        return Mounting(point=self.target, point_key="target", frame=self.frame)

    def quantities(self, m: int) -> tuple[Quantity, ...]:
        """See :class:`Instrument`."""
        return (
            Quantity(
                "position",
                (("x", "y", "z"),),
                "m",
                white_part(self.noise),
                determines=("position",),
                disturbed=with_colored_part(self.noise, reacquired(self.calibration.reacquired)),
            ),
        )

    def terms(self, m: int) -> tuple[Term, ...]:
        """See :class:`Instrument`."""
        return (
            Term("target", 3, "m", self.calibration.target),
            *frame_terms(self.calibration.frame),
        )

    def predict(
        self, state: State, calibration: Mapping[str, Symbol], robot: Robot
    ) -> dict[str, Symbol]:
        """The target in the tracker frame."""
        origin, R = tracker_frame(self.frame, calibration)
        target = state.position + state.rotation @ (ca.DM(self.target) + calibration["target"])
        return {"position": R.T @ (target - origin)}


def frame_terms(frame: FrameCalibration) -> tuple[Term, Term]:
    """Systematic errors of a tracker frame."""
    return Term("frame.position", 3, "m", frame.position), Term(
        "frame.rotation", 3, "rad", frame.rotation
    )


def tracker_frame(frame: FrameForm, calibration: Mapping[str, Symbol]) -> tuple[Symbol, Symbol]:
    """Origin of the tracker in the world [m] and R_world_tracker = R(rpy) Exp(error)."""
    R = mounting_rotation(frame.rpy_deg, calibration["frame.rotation"])
    return ca.DM(frame.position) + calibration["frame.position"], R
