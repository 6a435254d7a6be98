"""Cables that carry the platform and whose tensions nobody reads, and winches that are locked: what
stands in for sensors that are not there.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar, Literal

import casadi as ca

from steelyard.batch import Symbol
from steelyard.instruments.base import Instrument, Prior, Quantity, Term, sigma
from steelyard.instruments.length import ROLLER, ROLLER_AXIS, STRETCH, Length
from steelyard.motion.state import State
from steelyard.robot.model import Robot

CHANGE = "change_of_length"
"""What locked winches read: nothing."""
PER_CABLE = frozenset({"tension", "length", CHANGE})
"""Quantities with a number for each cable."""
COMPLIANCE = "compliance"
"""Key of 1 / EA of the cables of locked winches."""
_SOFTEST = 1e-4
"""1-sigma of that [1/N]: thin ropes of polyamide. What a robot file says of it is where to begin:
it is the softness of what the winch is fixed to, too, and goes with the mass where one is
assumed."""
_ANY_LENGTH = 100.0
"""1-sigma of the length of a cable [m]: it is told by the motion alone."""


class UnreadCables(Instrument):
    """Stands in for force sensors where there are none: that the platform hangs on its cables, and
    how hard each pulls, is all that acts on it. No file names it.
    """

    measured_force: ClassVar[Literal["tension"]] = "tension"
    per_cable: ClassVar[bool] = True

    kind: Literal["unread cables"] = "unread cables"
    cables: int
    """Their number m."""

    @property
    def unread(self) -> frozenset[str]:
        """See :class:`Instrument`."""
        return frozenset(f"f{i + 1}" for i in range(self.cables))

    def quantities(self, m: int) -> tuple[Quantity, ...]:
        """See :class:`Instrument`."""
        return (Quantity("tension", (tuple(f"f{i + 1}" for i in range(m)),), "N", None),)

    def terms(self, m: int) -> tuple[Term, ...]:
        """See :class:`Instrument`."""
        return ()

    def predict(
        self, state: State, calibration: Mapping[str, Symbol], robot: Robot
    ) -> dict[str, Symbol]:
        """The tensions at the platform."""
        return {"tension": state.tension}


class ConstantLengths(Instrument):
    """Stands in for encoders of locked winches: the unstrained length of every cable is the same
    all along a run. No file names it; see ``uncertainty: {length_noise: …}``.

    How far cables stretch is told by the motion. Taken as known it would not be safe: a stretch of
    half a millimetre that nobody has stated makes the inertia per mass wrong by 4 %.
    """

    per_cable: ClassVar[bool] = True

    kind: Literal["constant lengths"] = "constant lengths"
    cables: int
    """Their number m."""
    noise: float
    """1-sigma by which lengths are off a constant at each instant [m]."""
    axial_stiffness: float | None = None
    """EA of the robot file [N]; None: it does not say."""

    @property
    def unread(self) -> frozenset[str]:
        """See :class:`Instrument`."""
        return frozenset(f"l{i + 1}" for i in range(self.cables))

    @property
    def tells_stretch(self) -> bool:
        """See :class:`Instrument`."""
        return True

    def quantities(self, m: int) -> tuple[Quantity, ...]:
        """See :class:`Instrument`."""
        columns = tuple(f"l{i + 1}" for i in range(m))
        return (Quantity(CHANGE, (columns,), "m", self.noise, determines=("position", "rotation")),)

    def terms(self, m: int) -> tuple[Term, ...]:
        """See :class:`Instrument`."""
        length = Prior.model_validate({"sigma": _ANY_LENGTH, "per": "run"})
        softness = 1 / self.axial_stiffness if self.axial_stiffness else 0.0
        return (
            Term("length", m, "m", length),
            Term(COMPLIANCE, 1, "1/N", sigma(_SOFTEST), nominal=softness, positive=True),
        )

    def predict(
        self, state: State, calibration: Mapping[str, Symbol], robot: Robot
    ) -> dict[str, Symbol]:
        """By how much unstrained lengths differ from the constant ones, as a length is
        predicted.
        """
        stretching = replace(robot, cable=replace(robot.cable, axial_stiffness=1.0))
        own = {
            "gain": 1.0,
            "offset": -calibration["length"],
            STRETCH: calibration[COMPLIANCE],
            ROLLER: calibration["length"] * 0.0,
            ROLLER_AXIS: ca.SX.zeros(2 * robot.m),
        }
        read = Length(kind="length").predict(state, own, stretching)
        return {CHANGE: read["length"]}
