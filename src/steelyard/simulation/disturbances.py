"""Errors of virtual sensors that go on for a while: coloured noise, drifts, an attitude that
follows the accelerometer.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from steelyard.arrays import Array
from steelyard.instruments.noise import Disturbance
from steelyard.simulation.response import Response


def disturbed(
    value: Array, stated: Disturbance, times: Array, motion: Response, rng: np.random.Generator
) -> Array:
    """Readings with one disturbance; rotations of shape (n, 3, 3) are turned by it.

    A target is never lost here, and what nobody says the size of is not drawn.

    Args:
        value: Noise-free readings.
        stated: The disturbance.
        times: Of the readings, evenly spaced [s], shape (n,).
        motion: Of the platform.
        rng: Of the draw.
    """
    step = float(np.median(np.diff(times)))
    width = 3 if value.ndim == 3 else value.shape[1]
    if stated.cause == "filter" and stated.time is not None:
        lean = Rotation.from_rotvec(_leaning(times, stated.time, motion))
        return np.asarray(lean.as_matrix() @ value)
    if stated.cause == "drift" and stated.level:
        steps = rng.normal(0.0, stated.level * np.sqrt(step), (len(times), width))
        error = np.cumsum(steps, axis=0)
        if stated.vertical:
            error[:, :2] = 0.0
            return np.asarray(Rotation.from_rotvec(error).as_matrix() @ value)
    elif stated.cause == "colored" and stated.level and stated.time is not None:
        error = markov(rng.normal(size=(len(times), width)), step / stated.time) * stated.level
    else:
        return value
    if value.ndim == 3:
        return np.asarray(value @ Rotation.from_rotvec(error).as_matrix())
    return value + error


def markov(white: Array, step: float) -> Array:
    """A stationary Gauss-Markov process of unit variance.

    Args:
        white: Standard normal numbers, shape (n, k).
        step: Between samples, in correlation times.
    """
    from scipy.signal import lfilter

    kept = np.exp(-step)
    drive = np.sqrt(1 - kept**2) * white
    drive[0] = white[0]
    return np.asarray(lfilter([1.0], [1.0, -kept], drive, axis=0))


def _leaning(times: Array, constant: float, motion: Response) -> Array:
    """Rotation vectors in the world by which an attitude is wrong that takes what the accelerometer
    reads for the vertical, with this time constant [s]; shape (n, 3).
    """
    from scipy.signal import lfilter

    state = motion.at(times)
    up = np.einsum("nij,nj->ni", state.rotation, state.specific_force)
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    off = np.cross(up, [0.0, 0.0, 1.0])
    kept = np.exp(-float(np.median(np.diff(times))) / constant)
    return np.asarray(lfilter([1 - kept], [1.0, -kept], off, axis=0))
