"""What no cable tells of the balance is given in units that follow what is estimated.

In newtons of a fixed size it would shrink with a body, with readings or with attachments that
shrink, and the likelihood would rise for nothing. So the mass is its unit where no cable has a
sensor; with sensors in fewer than six cables the readings are that of what no cable carries, and of
its torque the distance of the attachments from their middle too. The balance follows the unit: by
minus the rest for each part that the unit grows.
"""

from __future__ import annotations

import numpy as np

from steelyard.arrays import Array
from steelyard.inertia import TEN


def in_units(derivative: Array, rest: Array, by_unit: Array) -> Array:
    """Derivative of the balance, the rest in units that follow too, shape (n, 6, c).

    Args:
        derivative: With the rest in units of a fixed size, shape (n, 6, c).
        rest: What is given in these units [N], [N m], shape (n, 6).
        by_unit: Change of the unit, in parts of it, by what is estimated, shape (c,) or (n, c).
    """
    return np.asarray(derivative - rest[:, :, None] * by_unit[..., None, :])


def by_mass(parameters: Array) -> Array:
    """How the mass follows the body, in parts of it [1/kg], shape (10,).

    Args:
        parameters: The ten of :data:`steelyard.inertia.LINEAR_PARAMETERS`, shape (10,).
    """
    return np.asarray(np.eye(1, TEN)[0] / parameters[0])


def by_readings(at: Array, at_one_more: Array) -> Array:
    """How readings grow with their systematic errors, in parts of them and as their mean, shape (n,
    c).

    Args:
        at: Their derivatives where tensions or wrench are, shape (n, k, c).
        at_one_more: The same with a unit more of each reading, shape (n, k, c).
    """
    return np.asarray(np.mean(at_one_more - at, axis=1))


def by_attachments(attachments: Array) -> Array:
    """How the distance of the attachments from their middle follows them, in parts of it [1/m],
    shape (3 m,).

    Args:
        attachments: On the platform [m], shape (m, 3).
    """
    arms = attachments - attachments.mean(axis=0)
    square = float(np.sum(arms**2))
    return np.asarray((arms / square if square else arms).ravel())
