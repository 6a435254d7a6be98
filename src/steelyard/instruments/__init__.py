"""The kinds of instruments, one file each, and the table of them."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

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
]
"""Every kind, told apart by its key ``kind``."""
