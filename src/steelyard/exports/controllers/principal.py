"""A body by its principal axes, as load data of industrial robots have it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from steelyard.arrays import Array
from steelyard.inertia import Inertia

MILLIMETRES = 1e3
"""In a metre."""


class Principal(NamedTuple):
    """Moments about the centre of gravity, and the axes that they are about."""

    moments: Array
    """Ascending [kg m^2], shape (3,)."""
    rotation: Rotation
    """R_platform_principal: columns of its matrix are the axes in the platform frame."""


def principal(body: Inertia) -> Principal:
    """Principal moments and right-handed axes of a body.

    A body that has its axes along those of the platform keeps them, in their order.
    """
    J = body.inertia
    if not (J - np.diag(np.diag(J))).any():
        return Principal(np.diag(J), Rotation.identity())
    moments, axes = np.linalg.eigh(J)
    if np.linalg.det(axes) < 0:
        axes[:, 0] *= -1
    return Principal(moments, Rotation.from_matrix(axes))
