"""A package of somebody else: an instrument, a log reader, an export and a sink."""

from contextlib import contextmanager
from typing import ClassVar, Literal

import numpy as np

from steelyard.exports.formats import ExportFormat
from steelyard.instruments.base import Calibration, Instrument, Prior, Quantity, Term, sigma
from steelyard.logs.log import Log

ENTRY_POINTS = """\
[steelyard.instruments]
altimeter = hall_sensors:Altimeter
[steelyard.logs]
hall = hall_sensors:opened
[steelyard.exports]
hall = hall_sensors:FORMAT
[steelyard.sinks]
hall = hall_sensors:HallSink
"""


class AltimeterCalibration(Calibration):
    """Systematic errors, 1-sigma."""

    offset: Prior = sigma(0.01)
    """Added [m]."""


class Altimeter(Instrument):
    """Height of the platform origin."""

    kind: Literal["altimeter"]
    noise: float | None = None
    """1-sigma per sample [m]."""
    calibration: AltimeterCalibration = AltimeterCalibration()

    def quantities(self, m):
        return (Quantity("height", (("h",),), "m", self.noise),)

    def terms(self, m):
        return (Term("offset", 1, "m", self.calibration.offset),)

    def predict(self, state, calibration, robot):
        return {"height": state.position[2] + calibration["offset"]}


@contextmanager
def opened(path):
    """Lines of blanks between numbers, the names in the first one."""
    names = tuple(path.read_text().split("\n", 1)[0].split())
    rows = np.loadtxt(path, skiprows=1, ndmin=2)

    def load(wanted, part, count):
        use = slice(count)
        return {name: rows[use, names.index(name)] for name in wanted}

    yield Log(path, names, load)


FORMAT = ExportFormat(
    "hall", "mass alone", lambda exported: f"{exported.body.mass!r}\n", whole=True
)


class HallSink:
    """Keeps what it is sent."""

    sent: ClassVar[list] = []

    def __init__(self, url):
        self.url = url

    def send(self, text):
        self.sent.append((self.url, text))

    def close(self):
        pass
