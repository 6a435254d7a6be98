"""Units that logs come in, and their factors to SI.

Inside steelyard everything is SI and radians; these factors are used by readers only.
"""

from __future__ import annotations

import math

STANDARD_GRAVITY = 9.80665
"""The g of accelerometers that read in g, exact by definition [m/s^2]."""

_POUND_FORCE = 0.45359237 * STANDARD_GRAVITY

FACTORS: dict[str, dict[str, float]] = {
    "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0},
    "N": {"N": 1.0, "daN": 10.0, "kN": 1e3, "mN": 1e-3, "kgf": STANDARD_GRAVITY, "lbf": _POUND_FORCE},
    "N m": {"N m": 1.0, "Nm": 1.0, "N mm": 1e-3, "Nmm": 1e-3, "kN m": 1e3, "kNm": 1e3},
    "m": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": 0.0254, "ft": 0.3048},
    "rad": {"rad": 1.0, "deg": math.pi / 180, "mrad": 1e-3},
    "rad/s": {"rad/s": 1.0, "deg/s": math.pi / 180, "mrad/s": 1e-3, "rpm": math.pi / 30},
    "m/s^2": {"m/s^2": 1.0, "m/s2": 1.0, "g": STANDARD_GRAVITY, "mg": STANDARD_GRAVITY * 1e-3},
    "1": {"1": 1.0},
}
"""SI unit -> accepted unit -> factor: value in SI = factor x value as read."""
