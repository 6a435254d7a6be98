"""The pose that the controller asked for."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, Literal

from steelyard.batch import Symbol
from steelyard.instruments.base import Instrument, Quantity, Term
from steelyard.instruments.noise import white_part
from steelyard.instruments.pose import PoseNoise
from steelyard.motion.state import State
from steelyard.robot.model import Robot


class Command(Instrument):
    """Commanded platform pose in the world; a measurement only if it states a noise."""

    commanded: ClassVar[bool] = True

    kind: Literal["command"]
    noise: PoseNoise = PoseNoise()

    def quantities(self, m: int) -> tuple[Quantity, ...]:
        """See :class:`Instrument`."""
        return (
            Quantity(
                "position",
                (("x", "y", "z"),),
                "m",
                white_part(self.noise.position),
                determines=("position",),
            ),
            Quantity(
                "orientation",
                (("roll", "pitch", "yaw"),),
                "rad",
                white_part(self.noise.rotation),
                rotation=True,
                determines=("rotation",),
            ),
        )

    def terms(self, m: int) -> tuple[Term, ...]:
        """See :class:`Instrument`."""
        return ()

    @property
    def is_measurement(self) -> bool:
        """Whether it says how far the platform may be from the command."""
        return self.noise.position is not None or self.noise.rotation is not None

    def predict(
        self, state: State, calibration: Mapping[str, Symbol], robot: Robot
    ) -> dict[str, Symbol]:
        """The platform's pose."""
        return {"position": state.position, "orientation": state.rotation}
