"""Cables that carry the platform and whose tensions nobody reads."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, Literal

from steelyard.batch import Symbol
from steelyard.instruments.base import Instrument, Quantity, Term
from steelyard.motion.state import State
from steelyard.robot.model import Robot


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
