"""Cable lengths from the winches' encoders."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, Literal

import casadi as ca

from steelyard.batch import Symbol
from steelyard.instruments.base import Calibration, Instrument, Prior, Quantity, Term, exact, sigma
from steelyard.instruments.noise import Noise, white_part, with_colored_part
from steelyard.motion.state import State
from steelyard.robot.kinematics import shapes
from steelyard.robot.model import Robot

STRETCH = "stretch"
"""Key of the factor on the stretch of the cables."""
ROLLER = "roller"
"""Key of what is added to the radii of the rollers."""
ROLLER_AXIS = "roller_axis"
"""Key of by how much the axes are turned about which the rollers swivel."""
CABLE_DAMPING = "damping"
"""Key of the time by which the stretch of the cables lags behind their tension."""
DAMPED = 0.02
"""1-sigma of that time [s], taken where it is not stated: a tenth of critical damping of a platform
that swings with 1.6 Hz on its ropes, or losses of fibre ropes of a twentieth of what they store, at
.4 Hz."""


class LengthCalibration(Calibration):
    """Systematic errors, 1-sigma."""

    offset: Prior = sigma(1.0)
    """Added to each cable [m]."""
    gain: Prior = exact()
    """Factor on each cable: the circumference of its drum; default: exact."""
    stretch: Prior = exact()
    """Factor on the stretch of all cables: 1 / EA over that of the robot file; not stated: 0.1
    where tensions are read and the robot file has an axial stiffness, else exact."""
    damping: Prior = exact()
    """Two times by which the stretch of the cables lags behind their tension [s], a damping over a
    stiffness each: of a stretch that changes as the tension does, and of one that is fed, which a
    damper between winch and platform feels and a rope that is damped in itself does not. The
    stretch is that of ``T - a T' - b T l'/l``. Not stated: 0.02 where the stretch is not exact, in
    motion."""
    roller: Prior = exact()
    """By how much the radius of each roller is larger than in the robot file [m]; default:
    exact."""
    roller_axis: Prior = exact()
    """By how much the ``axis`` about which each roller swivels leans from that of the robot file,
    along two directions square to it, cable after cable [rad]; default: exact."""


class Length(Instrument):
    """Unstrained length of every cable from anchor over the roller to attachment, up to a
    constant.
    """

    per_cable: ClassVar[bool] = True
    may_rest: ClassVar[bool] = True

    kind: Literal["length"]
    noise: Noise | None = None
    """1-sigma per sample [m]."""
    calibration: LengthCalibration = LengthCalibration()

    def quantities(self, m: int) -> tuple[Quantity, ...]:
        """See :class:`Instrument`."""
        columns = tuple(f"l{i + 1}" for i in range(m))
        return (
            Quantity(
                "length",
                (columns,),
                "m",
                white_part(self.noise),
                determines=("position", "rotation"),
                disturbed=with_colored_part(self.noise),
            ),
        )

    def terms(self, m: int) -> tuple[Term, ...]:
        """See :class:`Instrument`."""
        c = self.calibration
        return (
            Term("offset", m, "m", c.offset),
            Term("gain", m, "1", c.gain, nominal=1.0),
            Term(STRETCH, 1, "1", c.stretch, nominal=1.0, positive=True),
            Term(ROLLER, m, "m", c.roller),
            Term(ROLLER_AXIS, 2 * m, "rad", c.roller_axis),
            self._damping,
        )

    @property
    def _damping(self) -> Term:
        """It acts on the tension at the time of a reading, not on the reading."""
        stated = CABLE_DAMPING in self.calibration.model_fields_set
        suspected = None if stated else DAMPED
        return Term(
            CABLE_DAMPING, 2, "s", self.calibration.damping, suspected=suspected, positive=True
        )

    def predict(
        self, state: State, calibration: Mapping[str, Symbol], robot: Robot
    ) -> dict[str, Symbol]:
        """Unstrained lengths at the state's pose and tensions."""
        cables = shapes(
            robot,
            state.position,
            state.rotation,
            state.tension,
            anchors=state.anchors,
            attachments=state.attachments,
            stretch=calibration[STRETCH],
            rollers=calibration[ROLLER],
            leaning=calibration[ROLLER_AXIS],
        )
        unstrained = ca.vertcat(*[c.length for c in cables])
        return {"length": calibration["gain"] * unstrained + calibration["offset"]}
