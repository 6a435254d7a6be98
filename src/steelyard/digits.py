"""Numbers as people read them: names and units of the ten parameters, and the digits that an
uncertainty leaves.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

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


def number(value: float | None, deviation: float | None = None, *, sign: bool = False) -> str:
    """A number with the digits that its uncertainty leaves: two of the 1-sigma; a dash where there
    is none.
    """
    if value is None:
        return "-"
    scale = deviation if deviation else abs(value) * 1e-3
    digits = (
        int(np.clip(1 - np.floor(np.log10(scale)), 0, 6)) if scale and np.isfinite(scale) else 3
    )
    text = f"{value:+.{digits}f}" if sign else f"{value:.{digits}f}"
    return text if deviation is None else f"{text} ± {deviation:.{digits}f}"


def ten_numbers(values: ArrayLike, deviations: ArrayLike, *, sign: bool = False) -> list[str]:
    """Ten body parameters with their 1-sigma, in the units of :data:`LABELS`.

    Args:
        values: SI, NaN where there is none, shape (10,).
        deviations: 1-sigma, likewise.
        sign: Whether to write a plus.
    """
    pairs = zip(np.asarray(values).tolist(), np.asarray(deviations).tolist(), LABELS, strict=True)
    return [
        number(
            value * factor if np.isfinite(value) else None,
            deviation * factor if np.isfinite(deviation) else None,
            sign=sign,
        )
        for value, deviation, (_, _, factor) in pairs
    ]
