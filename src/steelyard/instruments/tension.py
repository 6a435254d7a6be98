"""Force sensors in the cables."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import casadi as ca

from steelyard.batch import Symbol
from steelyard.instruments.base import Calibration, Instrument, Prior, Quantity, Sigma, Term, sigma
from steelyard.motion.state import State
from steelyard.robot.kinematics import shapes
from steelyard.robot.model import Robot


class TensionCalibration(Calibration):
    """Systematic errors, 1-sigma."""

    offset: Prior = Prior.model_construct(value=None, sigma=None, per="experiment")
    gain: Prior = sigma(0.01)
    common_gain: Prior = sigma(0.005)


class Tension(Instrument):
    """One force sensor per cable, in the order of the robot file, positive pulling."""

    kind: Literal["tension"]
    noise: Sigma | None = None
    calibration: TensionCalibration = TensionCalibration()
    end: Literal["platform", "winch"] = "platform"
    """At which end of the cable the sensors sit."""

    def quantities(self, m: int) -> tuple[Quantity, ...]:
        """See :class:`Instrument`."""
        return (Quantity("tension", (tuple(f"f{i + 1}" for i in range(m)),), "N", self.noise),)

    def terms(self, m: int) -> tuple[Term, ...]:
        """See :class:`Instrument`."""
        c = self.calibration
        return (
            Term("offset", m, "N", c.offset),
            Term("gain", m, "1", c.gain, nominal=1.0),
            Term("common_gain", 1, "1", c.common_gain, nominal=1.0),
        )

    def predict(self, state: State, calibration: Mapping[str, Symbol], robot: Robot) -> dict[str, Symbol]:
        """Gain times tension plus offset; at the winch with the weight that hangs between."""
        tension = state.tension
        if self.end == "winch":
            cables = shapes(robot, state.position, state.rotation, tension)
            tension = ca.vertcat(*[c.winch_tension for c in cables])
        c = calibration
        return {"tension": c["common_gain"] * c["gain"] * tension + c["offset"]}
