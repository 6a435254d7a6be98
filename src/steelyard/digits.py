"""Numbers as people read them: names and units of the ten parameters, and the one rule by which
they are rounded: the digits that an uncertainty leaves, else three significant ones.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

LABELS = (
    ("mass", "kg", 1.0),
    ("centre of gravity x", "mm", 1e3),
    ("centre of gravity y", "mm", 1e3),
    ("centre of gravity z", "mm", 1e3),
    ("inertia xx", "kg m²", 1.0),
    ("inertia yy", "kg m²", 1.0),
    ("inertia zz", "kg m²", 1.0),
    ("inertia yz", "kg m²", 1.0),
    ("inertia xz", "kg m²", 1.0),
    ("inertia xy", "kg m²", 1.0),
)
"""Name, unit and factor from SI of the ten of :data:`steelyard.inertia.BODY_PARAMETERS`."""

SHORT_LABELS = ("mass", "cog x", "cog y", "cog z", "Jxx", "Jyy", "Jzz", "Jyz", "Jxz", "Jxy")
"""The names in a table, where eighty characters must hold several estimates side by side."""

_RELATIVE = 1e-3
"""Assumed 1-sigma of a number that stands without one, over its value: four to five digits."""
_DIGITS, _MOST_DIGITS = 3, 6
"""Behind the point: of a number without any scale, and at most."""
_LARGE, _SMALL = 1e7, 1e-4
"""From and below which a number has a power of ten: more zeros than these nobody counts."""
_LEAST_DEVIATION = 1e-5
"""A 1-sigma below has no two digits among those behind the point."""
_LEAST_TIME = 5e-7
"""[s]; what is shorter is the rounding of time stamps."""


def number(value: float | None, deviation: float | None = None, *, sign: bool = False) -> str:
    """A number with the digits that its uncertainty leaves: two of the 1-sigma; a dash where there
    is none.
    """
    if value is None or not np.isfinite(value):
        return "-"
    scale = deviation if deviation else abs(value) * _RELATIVE
    digits = _DIGITS
    if scale and np.isfinite(scale):
        scale = float(f"{scale:.1e}")  # 9.97 has the digits of 10
        digits = int(np.clip(1 - np.floor(np.log10(scale)), 0, _MOST_DIGITS))
    text = fixed(value, digits, sign=sign)
    return text if deviation is None else f"{text} ± {deviation:.{digits}f}"


def figures(value: float | None, digits: int = 3, *, sign: bool = False) -> str:
    """A number of so many significant digits; a dash where there is none. Powers of ten only where
    a number is too long otherwise.

    Args:
        value: The number.
        digits: At least so many; those before the point are all written.
        sign: Whether to write a plus.
    """
    if value is None or not np.isfinite(value):
        return "-"
    rounded = float(f"{value:.{digits}g}")
    size = abs(rounded)
    if size >= _LARGE or 0 < size < _SMALL:
        text = f"{rounded:.{digits}g}"
        return f"+{text}" if sign and rounded > 0 else text
    behind = 0 if size == 0 else max(digits - 1 - int(np.floor(np.log10(size))), 0)
    text = fixed(value if behind == 0 else rounded, behind, sign=sign)
    return text.rstrip("0").rstrip(".") if "." in text else text


def deviation(value: float | None) -> str:
    """A 1-sigma alone, as it stands behind its number; a dash where there is none."""
    if value is not None and 0 < value < _LEAST_DEVIATION:
        return figures(value, 2)
    return number(value, value).partition(" ± ")[0]


def alike(values: Sequence[float | None], digits: int = 3) -> list[str]:
    """Numbers of one kind beside each other, with as many digits behind the point as the largest
    one of so many significant digits has.
    """
    known = [abs(value) for value in values if value is not None and np.isfinite(value)]
    largest = max(known, default=0.0)
    if not _SMALL <= largest < _LARGE:
        return [figures(value, digits) for value in values]
    behind = max(digits - 1 - int(np.floor(np.log10(largest))), 0)
    return [
        "-" if value is None or not np.isfinite(value) else fixed(value, behind) for value in values
    ]


def between(low: float, high: float) -> str:
    """Two ends of a range, with as many digits behind the point as the larger one leaves."""
    largest = max(abs(low), abs(high))
    digits = 0
    if largest and np.isfinite(largest):
        digits = int(np.clip(_DIGITS - 1 - np.floor(np.log10(largest)), 0, _MOST_DIGITS))
    return f"{fixed(low, digits)} to {fixed(high, digits)}"


def milliseconds(seconds: float) -> str:
    """A short time in ms with two digits; what is shorter than any clock reads is said to be so."""
    if abs(seconds) < _LEAST_TIME:
        return "< 0.001"
    return figures(seconds * 1e3, 2)


def per_cent(share: float) -> str:
    """A share in whole per cent."""
    return f"{fixed(100 * share, 0)}%"


def fixed(value: float, digits: int, *, sign: bool = False) -> str:
    """A number with so many digits behind the point; what rounds to zero has no sign."""
    text = f"{value:.{digits}f}"
    if float(text) == 0:
        return text.lstrip("-")
    return f"+{text}" if sign and value > 0 else text


def ten_numbers(values: ArrayLike, deviations: ArrayLike, *, sign: bool = False) -> list[str]:
    """Ten body parameters with their 1-sigma, in the units of :data:`LABELS`.

    Args:
        values: SI, NaN where there is none, shape (10,).
        deviations: 1-sigma, likewise.
        sign: Whether to write a plus.
    """
    values = np.asarray(values, dtype=np.float64)
    deviations = np.asarray(deviations, dtype=np.float64)
    factors = np.array([factor for _, _, factor in LABELS])
    pairs = zip(_known(values * factors), _known(deviations * factors), strict=True)
    return [number(value, deviation, sign=sign) for value, deviation in pairs]


def _known(values: NDArray[np.float64]) -> list[float | None]:
    """Numbers of shape (n,), None for those that are not finite."""
    return [value if np.isfinite(value) else None for value in values.tolist()]
