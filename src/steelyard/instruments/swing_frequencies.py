"""Natural frequencies of free swinging, by a stop-watch or from a spectrum: rows of a table,
without time.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, Literal

from steelyard.batch import Symbol
from steelyard.instruments.base import Instrument, Quantity, Term
from steelyard.instruments.noise import Sigma
from steelyard.motion.state import State
from steelyard.robot.model import Robot

MODES = 6
"""Of a rigid body."""
_POSE = ("x", "y", "z", "roll", "pitch", "yaw")


class SwingFrequencies(Instrument):
    """Natural frequencies with which a platform swings on cables of constant length: at a pose, or
    on cables of given unstrained lengths; ascending, as many as were seen.

    No state of a motion says what it reads: :func:`steelyard.frequencies` does.
    """

    tabular: ClassVar[bool] = True

    kind: Literal["frequencies"]
    noise: Sigma | None = None
    """1-sigma of each [Hz]; None: a hundredth of the frequency."""

    def quantities(self, m: int) -> tuple[Quantity, ...]:
        """See :class:`Instrument`."""
        lengths = tuple(f"l{i + 1}" for i in range(m))
        forms = tuple(tuple(f"f{i + 1}" for i in range(k)) for k in range(MODES, 0, -1))
        return (
            Quantity("position", (_POSE[:3],), "m", None, required=False),
            Quantity("angles", (_POSE[3:],), "rad", None, required=False),
            *([Quantity("lengths", (lengths,), "m", None, required=False)] if m else []),
            Quantity("frequencies", forms, "Hz", self.noise),
        )

    def terms(self, m: int) -> tuple[Term, ...]:
        """See :class:`Instrument`."""
        return ()

    def predict(
        self, state: State, calibration: Mapping[str, Symbol], robot: Robot
    ) -> dict[str, Symbol]:
        """Nothing: see the class."""
        return {}
