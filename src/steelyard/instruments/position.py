"""Laser trackers and the like: the position of one target."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal

import casadi as ca
import numpy as np
from pydantic import Field

from steelyard import rotations
from steelyard.batch import Symbol
from steelyard.instruments.base import (
    Calibration,
    Instrument,
    Prior,
    Quantity,
    Sigma,
    Term,
    Vector,
    sigma,
)
from steelyard.motion.state import State
from steelyard.robot.model import Robot
from steelyard.yaml_file import FileModel


class FrameForm(FileModel):
    """The tracker frame in the world frame."""

    position: Vector = (0.0, 0.0, 0.0)
    """[m]"""
    rpy_deg: Vector = (0.0, 0.0, 0.0)
    """[deg]"""


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


class TargetLimits(FileModel):
    """What the target may reach before the instrument loses it."""

    speed: Annotated[float, Field(gt=0)] | None = None
    """[m/s]"""
    acceleration: Annotated[float, Field(gt=0)] | None = None
    """[m/s^2]"""


class Position(Instrument):
    """Position of a target on the platform in the tracker frame."""

    kind: Literal["position"]
    target: Vector = (0.0, 0.0, 0.0)
    """Tracked point in the platform frame [m]."""
    frame: FrameForm = FrameForm()
    noise: Sigma | None = None
    """1-sigma per sample and axis [m]."""
    calibration: PositionCalibration = PositionCalibration()
    limits: TargetLimits = TargetLimits()

    def quantities(self, m: int) -> tuple[Quantity, ...]:
        """See :class:`Instrument`."""
        return (Quantity("position", (("x", "y", "z"),), "m", self.noise),)

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
    R = rotations.from_rpy(ca.DM(np.radians(frame.rpy_deg))) @ rotations.exp(
        calibration["frame.rotation"]
    )
    return ca.DM(frame.position) + calibration["frame.position"], R
