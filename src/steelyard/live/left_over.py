"""What forces show that neither the body nor known errors explain, at an instant."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from steelyard.arrays import Array
from steelyard.dynamics import wrench_about
from steelyard.identification.model.balance import balance_of
from steelyard.identification.recursive.following import Following


def left_over(following: Following) -> Array:
    """Mean wrench of the last chunk that the body does not explain, about the platform origin as it
    is stated, in platform axes [N], [N m], shape (6,); NaN where no force was read.

    Args:
        following: The motion and what is known.
    """
    window = following.window
    number, state = len(window.chunks) - 1, following.recursion.state
    if number < 0 or state.parameters is None or not len(window.chunks[number].forces.time):
        return np.full(6, np.nan)
    chunk = window.chunks[number]
    at = balance_of(
        following.experiment,
        replace(chunk.segment, coefficients=window.motion[window.place(number)]),
        chunk.forces,
        state.calibration,
        state.parameters,
        state.factors,
    )
    wrench = np.mean(at.left_over + at.by_wrench, axis=0)
    return wrench_about(wrench, following.experiment.origin)
