"""What peers on `platform.csv` share: one zero-phase low-pass, the angular acceleration, the change to
the ten about the centre of gravity."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from recording import Array, Platform
from scipy.signal import butter, filtfilt

CUT_OFF = 5.0
"""[Hz]: above the commands, below most of the natural frequencies of the platforms."""
MARGIN = 0.5
"""Left out at both ends, where the filter sees one side alone [s]."""


@dataclass(frozen=True, eq=False)
class Filtered:
    """All streams filtered alike, at twice the cut-off, where neighbours are almost independent."""

    motion: Platform
    alpha: Array
    """Angular acceleration in the platform [rad/s^2], shape (n, 3)."""


def filtered(data: Platform, cut_off: float = CUT_OFF) -> Filtered:
    """The low-passed recording with its angular acceleration."""
    b, a = butter(4, cut_off, fs=1 / data.step)
    smooth = {
        key: filtfilt(b, a, value, axis=0)
        for key, value in vars(data).items()
        if key in ("position", "quaternion", "omega", "specific_force", "wrench")
    }
    alpha = np.gradient(smooth["omega"], data.step, axis=0)
    inside = np.flatnonzero((data.t > data.t[0] + MARGIN) & (data.t < data.t[-1] - MARGIN))
    kept = inside[:: max(1, round(1 / (2 * cut_off * data.step)))]
    thinned = {key: value[kept] for key, value in smooth.items()}
    return Filtered(replace(data, t=data.t[kept], **thinned), alpha[kept])


def pinocchio_regressor(omega: Array, alpha: Array, specific_force: Array) -> Array:
    """Pinocchio's regressor, rows force then torque, for mass, first moment and Jxx Jxy Jyy Jxz Jyz Jzz
    about the origin; shape (n, 6, 10)."""
    import pinocchio as pin

    # Gravity acts as an acceleration; Pinocchio's is the spatial one, hence the product with v = 0.
    return np.array(
        [
            pin.bodyRegressor(
                pin.Motion(np.zeros(3), omega[i]), pin.Motion(specific_force[i], alpha[i])
            )
            for i in range(len(omega))
        ]
    )


def about_center_of_gravity(parameters: Array) -> Array:
    """Pinocchio's ten as mass, centre of gravity and Jxx Jyy Jzz Jyz Jxz Jxy about it."""
    m, c = parameters[0], parameters[1:4] / parameters[0]
    xx, xy, yy, xz, yz, zz = parameters[4:10]
    origin = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    J = origin - m * (c @ c * np.eye(3) - np.outer(c, c))
    return np.array([m, *c, J[0, 0], J[1, 1], J[2, 2], J[1, 2], J[0, 2], J[0, 1]])


def with_covariance(parameters: Array, covariance: Array) -> tuple[Array, Array]:
    """:func:`about_center_of_gravity` with its covariance, by central differences."""
    steps = 1e-4 * np.maximum(np.sqrt(np.diag(covariance)), 1e-9)
    jacobian = np.column_stack(
        [
            (about_center_of_gravity(parameters + e) - about_center_of_gravity(parameters - e))
            / (2 * h)
            for h, e in zip(steps, np.diag(steps), strict=True)
        ]
    )
    return about_center_of_gravity(parameters), jacobian @ covariance @ jacobian.T


def weighted_rows(recording: Filtered, *, offset: bool = True) -> tuple[Array, Array]:
    """Regressor and wrench in 1-sigma of each axis, as residuals of a first fit tell them, shapes
    (n, 6, k) and (n, 6).

    Args:
        recording: Filtered.
        offset: Whether six columns more have a constant wrench, the bias of a force sensor.
    """
    motion = recording.motion
    Y = pinocchio_regressor(motion.omega, recording.alpha, motion.specific_force)
    if offset:
        Y = np.concatenate([Y, np.tile(np.eye(6), (len(Y), 1, 1))], axis=2)
    sigma = np.ones(6)
    for _turn in range(3):
        A, b = Y / sigma[:, None], motion.wrench / sigma
        found = np.linalg.lstsq(A.reshape(-1, Y.shape[2]), b.ravel(), rcond=None)[0]
        sigma = (motion.wrench - Y @ found).std(axis=0)
    return Y / sigma[:, None], motion.wrench / sigma
