"""Numbers as people read them: names and units of the ten parameters, and the digits that an
uncertainty leaves.
"""

from __future__ import annotations

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

_RELATIVE = 1e-3
"""Assumed 1-sigma of a number that stands without one, over its value: four to five digits."""
_DIGITS, _MOST_DIGITS = 3, 6
"""Behind the point: of a number without any scale, and at most."""


def number(value: float | None, deviation: float | None = None, *, sign: bool = False) -> str:
    """A number with the digits that its uncertainty leaves: two of the 1-sigma; a dash where there
    is none.
    """
    if value is None:
        return "-"
    scale = deviation if deviation else abs(value) * _RELATIVE
    digits = _DIGITS
    if scale and np.isfinite(scale):
        digits = int(np.clip(1 - np.floor(np.log10(scale)), 0, _MOST_DIGITS))
    text = f"{value:+.{digits}f}" if sign else f"{value:.{digits}f}"
    return text if deviation is None else f"{text} ± {deviation:.{digits}f}"


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
