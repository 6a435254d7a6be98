"""The kinds of instruments, one file each, and the table of them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import Field, ValidatorFunctionWrapHandler, WrapValidator

from steelyard.instruments.attitude import Attitude as Attitude
from steelyard.instruments.base import Instrument as Instrument
from steelyard.instruments.base import Quantity as Quantity
from steelyard.instruments.base import Term as Term
from steelyard.instruments.command import Command as Command
from steelyard.instruments.distance import Distance as Distance
from steelyard.instruments.imu import Imu as Imu
from steelyard.instruments.length import Length as Length
from steelyard.instruments.pose import Pose as Pose
from steelyard.instruments.position import Position as Position
from steelyard.instruments.swing_frequencies import SwingFrequencies as SwingFrequencies
from steelyard.instruments.tension import Tension as Tension
from steelyard.instruments.weight import Weight as Weight
from steelyard.instruments.wrench import Wrench as Wrench
from steelyard.plugins.provided import provided

KINDS = frozenset(
    [
        *("tension", "wrench", "imu", "attitude", "position", "pose", "length", "distance"),
        *("command", "frequencies", "weight"),
    ]
)
"""Those of this package."""


def _of_kind(value: Any, by_table: ValidatorFunctionWrapHandler) -> Any:
    """An instrument of a kind of the table, or of one that another package provides."""
    if isinstance(value, Instrument):
        return value
    kind = value.get("kind") if isinstance(value, Mapping) else None
    if isinstance(kind, str) and kind not in KINDS:
        found = provided("instruments", kind)
        if found is not None:
            if not (isinstance(found, type) and issubclass(found, Instrument)):
                raise ValueError(
                    f"expected that kind '{kind}' of another package is an instrument, found"
                    f" {found!r}; correct that package"
                )
            return found.model_validate(value)
    return by_table(value)


AnyInstrument = Annotated[
    Tension
    | Wrench
    | Imu
    | Attitude
    | Position
    | Pose
    | Length
    | Distance
    | Command
    | SwingFrequencies
    | Weight,
    Field(discriminator="kind"),
    WrapValidator(_of_kind),
]
"""Every kind, told apart by its key ``kind``; kinds of other packages too."""
