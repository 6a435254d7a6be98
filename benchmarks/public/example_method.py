"""An example of a method for the public benchmark: mass and centre of gravity from a platform that is
taken to be at rest all the time. `python benchmarks/public/run.py benchmarks/public/example_method.py`.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from recording import read_platform

NAME = "example: weighing at rest (NumPy)"
DATA = "platform"  # or "full": the raw streams, each on its own clock


def estimate(folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """The ten, NaN for what is not given, and their covariance or None.

    A dictionary with `value`, `covariance` and `accepted` will do as well.
    """
    data = read_platform(folder)
    # f = m s and tau = c x f; the ten are m, c and six of the inertia, which rest does not tell.
    s, f, tau = data.specific_force, data.wrench[:, :3], data.wrench[:, 3:]
    mass = np.sum(s * f) / np.sum(s * s)
    cross = np.array([[[0, z, -y], [-z, 0, x], [y, -x, 0]] for x, y, z in f])
    center = np.linalg.lstsq(cross.reshape(-1, 3), tau.ravel(), rcond=None)[0]
    value = np.full(10, np.nan)
    value[:4] = mass, *center
    covariance = np.full((10, 10), np.nan)
    scatter = (f - mass * s).var() / np.sum(s * s)
    torque = (tau.ravel() - cross.reshape(-1, 3) @ center).var()
    covariance[:4, :4] = 0.0
    covariance[0, 0] = scatter
    covariance[1:4, 1:4] = torque * np.linalg.inv(np.einsum("nji,njk->ik", cross, cross))
    return value, covariance
