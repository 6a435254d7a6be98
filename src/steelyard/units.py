"""Units that logs come in, and their factors to SI.

Inside steelyard everything is SI and radians; these factors are used by readers only.
"""

from __future__ import annotations

import math
import re

STANDARD_GRAVITY = 9.80665
"""The g of accelerometers that read in g, exact by definition [m/s^2]."""

_POUND_FORCE = 0.45359237 * STANDARD_GRAVITY
_INCH, _FOOT = 0.0254, 0.3048
_DEGREE = math.pi / 180

# fmt: off
FACTORS: dict[str, dict[str, float]] = {
    "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "100ns": 1e-7, "min": 60.0, "h": 3600.0},
    "N": {
        "N": 1.0, "daN": 10.0, "kN": 1e3, "mN": 1e-3, "cN": 1e-2,
        "kgf": STANDARD_GRAVITY, "kp": STANDARD_GRAVITY, "gf": STANDARD_GRAVITY * 1e-3,
        "lbf": _POUND_FORCE,
    },
    "N m": {
        "N m": 1.0, "Nm": 1.0, "N mm": 1e-3, "Nmm": 1e-3, "N cm": 1e-2, "Ncm": 1e-2,
        "mN m": 1e-3, "mNm": 1e-3, "kN m": 1e3, "kNm": 1e3, "kgf m": STANDARD_GRAVITY,
        "lbf ft": _POUND_FORCE * _FOOT, "lbf in": _POUND_FORCE * _INCH,
    },
    "m": {"m": 1.0, "dm": 0.1, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": _INCH, "ft": _FOOT},
    "rad": {
        "rad": 1.0, "deg": _DEGREE, "mrad": 1e-3, "gon": math.pi / 200, "arcmin": _DEGREE / 60,
        "rev": 2 * math.pi,
    },
    "rad/s": {
        "rad/s": 1.0, "deg/s": _DEGREE, "dps": _DEGREE, "mrad/s": 1e-3, "rpm": math.pi / 30,
        "rev/s": 2 * math.pi,
    },
    "m/s^2": {
        "m/s^2": 1.0, "m/s2": 1.0, "mm/s^2": 1e-3, "cm/s^2": 1e-2, "g": STANDARD_GRAVITY,
        "mg": STANDARD_GRAVITY * 1e-3, "ug": STANDARD_GRAVITY * 1e-6, "ft/s^2": _FOOT,
    },
    "kg": {"kg": 1.0, "g": 1e-3, "t": 1e3, "lb": 0.45359237},
    "Hz": {"Hz": 1.0, "mHz": 1e-3},
    "1": {"1": 1.0},
}
# fmt: on
"""SI unit -> accepted unit -> factor: value in SI = factor x value as read."""

MASS = "kg"
"""Units of masses stand as they are: without a quantity beside it, 'kg' is what displays of force
sensors show, and 'g' an acceleration."""
_CANONICAL = frozenset(
    unit for quantity, factors in FACTORS.items() if quantity != MASS for unit in factors
)

# fmt: off
_SIGNS = str.maketrans({
    "µ": "u", "μ": "u", "°": "deg", "º": "deg", "²": "^2", "⁻": "^-", "¹": "1",
    "·": " ", "⋅": " ", "∙": " ", "*": " ", "\u2212": "-",
})
# fmt: on
_SECOND = re.compile(r"(?<![A-Za-z])sec(ond)?s?(?![A-Za-z])", re.IGNORECASE)
_PER = re.compile(r" per | ?/ ?")
_PER_SECOND = re.compile(r"[ .]s(\^-\^?1|-1)$")
_PER_SECOND_SQUARED = re.compile(r"/s(2|/s)$|[ .]s(\^-\^?2|-2)$")
_SPELLINGS = {
    "s": "sekunden, sek",
    "ms": "msec, millisecond, milliseconds",
    "us": "usec, microseconds",
    "ns": "nsec, nanoseconds",
    "min": "minute, minutes",
    "h": "hour, hours",
    "N": "newton, newtons",
    "kN": "kilonewton, kilonewtons",
    "kgf": "kg",
    "lbf": "lb, lbs",
    "N m": "n-m, n.m, newton meters, newton metres, newton-meters",
    "N mm": "n-mm, n.mm",
    "lbf ft": "ft lbf, ft-lbf, lbf-ft, ft lb, ft-lb, lb ft, lb-ft",
    "lbf in": "in lbf, in-lbf, lbf-in, in lb, in-lb, lb in, lb-in",
    "m": "meter, meters, metre, metres",
    "mm": "millimeter, millimeters, millimetre, millimetres",
    "cm": "centimeter, centimeters, centimetre, centimetres",
    "in": "inch, inches",
    "ft": "foot, feet",
    "rad": "radian, radians, rad",
    "deg": "degree, degrees, deg",
    "deg/s": "degree/s, degrees/s, deg/s",
    "rad/s": "rad/s, radians/s",
    "rpm": "rpm, rev/min, u/min",
}
"""Unit -> spellings whose case does not matter. What has two meanings is not here: 'grad' (gon in
English, degree in German), 'mil', 'Hz'."""
_UNIT_OF_SPELLING = {
    spelling: unit for unit, text in _SPELLINGS.items() for spelling in text.split(", ")
}

_CASED = {"-": "1", "g0": "g", "gn": "g", "g_n": "g"}

_OTHERS = frozenset(
    [
        "V",
        "Volt",
        "Volts",
        "mV",
        "uV",
        "mV/V",
        "A",
        "Ampere",
        "mA",
        "K",
        "kHz",
        "1/s",
        "1/min",
        "degC",
        "degF",
        "%",
        "bar",
        "mbar",
        "Pa",
        "hPa",
        "kPa",
        "MPa",
        "W",
        "kW",
        "J",
        "T",
        "mT",
        "uT",
        "nT",
        "Gauss",
        "m/s",
        "mm/s",
        "km/h",
        "rad/s^2",
        "deg/s^2",
        "digit",
        "digits",
        "count",
        "counts",
        "LSB",
        "inc",
        "px",
        "dB",
        "MN",
        "N/m",
        "N/mm",
        "grad",
        "Grad",
        "mil",
    ]
)
"""Units that no column of ours may have: they show that a text is a unit."""


def canonical_unit(text: str) -> str | None:
    """A unit as :data:`FACTORS` spells it, however a log does ("°/s", "m/s²", "µs"); None: none of
    them, or not without doubt.
    """
    if text in _CANONICAL:
        return text
    spelled = _spelled(text)
    for found in (spelled, _CASED.get(spelled, ""), _UNIT_OF_SPELLING.get(spelled.lower(), "")):
        if found in _CANONICAL:
            return found
    return None


def is_unit(text: str) -> bool:
    """Whether a text is a unit, of whatever quantity."""
    return canonical_unit(text) is not None or _spelled(text) in _OTHERS


def _spelled(text: str) -> str:
    """A unit in ASCII with single blanks, quotients with a slash."""
    spelled = " ".join(text.replace("**", "^").translate(_SIGNS).split()).rstrip(".")
    spelled = _PER.sub("/", _SECOND.sub("s", spelled))
    return _PER_SECOND.sub("/s", _PER_SECOND_SQUARED.sub("/s^2", spelled))
