"""How names and units are shown to people."""

from __future__ import annotations

import hashlib
import math
from typing import NamedTuple

from steelyard.report.evidence.values import EstimatedBody, Number


class Unit(NamedTuple):
    """In which a quantity is shown."""

    name: str
    factor: float
    """From SI."""


_ANGLE = math.degrees(1.0)
_NAMES = {"m/s^2": "m/s²", "kg m^2": "kg m²", "N m": "N m", "1": "-"}


def shown_unit(unit: str, quantity: str = "") -> Unit:
    """Angles in degrees, places of targets in mm where they are errors of a mounting; all else as
    it is.
    """
    if unit == "rad":
        return Unit("°", _ANGLE)
    if unit in {"rad/s", "rad/s^2"}:
        return Unit("°/s" if unit == "rad/s" else "°/s²", _ANGLE)
    if unit == "m" and quantity == "error":
        return Unit("mm", 1e3)
    if unit == "s" and quantity == "error":
        return Unit("ms", 1e3)
    return Unit(_NAMES.get(unit, unit), 1.0)


def scaled(value: Number, factor: float) -> Number:
    """A number in another unit."""
    return None if value is None else value * factor


def deviations_of(body: EstimatedBody) -> list[Number]:
    """1-sigma of the ten."""
    return [
        None if row[i] is None else max(row[i] or 0.0, 0.0) ** 0.5
        for i, row in enumerate(body.covariance)
    ]


def words(name: str) -> str:
    """A name of the contract as people would write it."""
    return name.replace("_", " ")


def slug(*parts: str) -> str:
    """A name for links and elements: short, safe, and unlike that of other parts."""
    text = "-".join(
        "".join(c if c.isascii() and c.isalnum() else "-" for c in part.lower())[:24]
        for part in parts
    )
    return f"{text}-{hashlib.sha256(chr(0).join(parts).encode(errors='replace')).hexdigest()[:6]}"


def line_colour(i: int) -> str:
    """The i-th of the colours that the page has for lines, again and again."""
    return f"var(--line-{i % 8 + 1})"
