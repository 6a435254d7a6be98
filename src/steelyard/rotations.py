"""Rotations: in CasADi what the model needs with derivatives, in NumPy what samples need.

``R_a_b`` maps coordinates in frame b to coordinates in frame a. Tait-Bryan angles are (roll, pitch,
yaw) with ``R = Rz(yaw) Ry(pitch) Rx(roll)``, Eq. (3) of [Tempel2017]_; quaternions are (w, x, y,
z) in Hamilton's convention, q and -q are one rotation.

In CasADi every argument is one vector or matrix: rotation matrices have shape (3, 3), quaternions
(4,), all else (3,). In NumPy time is the first axis of each, n samples long. All other conversions
of recorded numbers use :class:`scipy.spatial.transform.Rotation`.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
from scipy.spatial.transform import Rotation

from steelyard.arrays import Array
from steelyard.batch import Symbol


def skew(v: Symbol) -> Symbol:
    """Matrix of the cross product, ``skew(v) w = v x w``, Eq. (2) of [Tempel2017]_."""
    return ca.skew(v)


def from_rpy(rpy: Symbol) -> Symbol:
    """Rotation matrix of Tait-Bryan angles (roll, pitch, yaw) [rad], Eq. (3) of [Tempel2017]_."""
    cr, cp, cy = ca.cos(rpy[0]), ca.cos(rpy[1]), ca.cos(rpy[2])
    sr, sp, sy = ca.sin(rpy[0]), ca.sin(rpy[1]), ca.sin(rpy[2])
    return ca.vertcat(
        ca.horzcat(cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
        ca.horzcat(sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
        ca.horzcat(-sp, cp * sr, cp * cr),
    )


def rate_matrix(rpy: Symbol) -> Symbol:
    """Matrix that takes rates of roll, pitch, yaw to the angular velocity in world axes, shape
    (3, 3).

    Eq. (4a) of [Tempel2017]_ with its third column corrected to [0, 0, 1].
    """
    cp, cy, sp, sy = ca.cos(rpy[1]), ca.cos(rpy[2]), ca.sin(rpy[1]), ca.sin(rpy[2])
    return ca.vertcat(
        ca.horzcat(cy * cp, -sy, 0),
        ca.horzcat(sy * cp, cy, 0),
        ca.horzcat(-sp, 0, 1),
    )


def from_quaternion(q: Symbol) -> Symbol:
    """Rotation matrix of a unit quaternion (w, x, y, z)."""
    w, v = q[0], q[1:4]
    return (w * w - ca.dot(v, v)) * ca.DM.eye(3) + 2 * v @ v.T + 2 * w * skew(v)


def quaternion_of_rpy(rpy: Symbol) -> Symbol:
    """Quaternion (w, x, y, z) of Tait-Bryan angles (roll, pitch, yaw) [rad], without jumps of
    sign.
    """
    cr, cp, cy = ca.cos(rpy[0] / 2), ca.cos(rpy[1] / 2), ca.cos(rpy[2] / 2)
    sr, sp, sy = ca.sin(rpy[0] / 2), ca.sin(rpy[1] / 2), ca.sin(rpy[2] / 2)
    return ca.vertcat(
        cy * cp * cr + sy * sp * sr,
        cy * cp * sr - sy * sp * cr,
        cy * sp * cr + sy * cp * sr,
        sy * cp * cr - cy * sp * sr,
    )


def quaternion_rate(q: Symbol, omega: Symbol) -> Symbol:
    """Time derivative of a quaternion (w, x, y, z) for an angular velocity in body axes [rad/s]:
    ``q (0, omega) / 2``, the inverse of :func:`quaternion_omega` at unit length.
    """
    w, v = q[0], q[1:4]
    return ca.vertcat(-ca.dot(v, omega), w * omega + ca.cross(v, omega)) / 2


def quaternion_omega(q: Symbol, dq: Symbol) -> Symbol:
    """Angular velocity in body axes [rad/s] of a quaternion (w, x, y, z) of any length, not zero,
    and its derivative: the vector of ``2 q^-1 dq``.
    """
    w, v, dw, dv = q[0], q[1:4], dq[0], dq[1:4]
    return 2 * (w * dv - dw * v - ca.cross(v, dv)) / ca.dot(q, q)


def exp(theta: Symbol) -> Symbol:
    """Rotation matrix of a rotation vector [rad] (Rodrigues), exact to rounding near zero and
    smooth there; the inverse of :func:`log`.
    """
    square = ca.dot(theta, theta)
    small = square < 1e-6
    # Both branches are evaluated: the exact one must stay finite, with finite derivatives, where it
    # is not taken.
    safe = ca.if_else(small, 1.0, square)
    angle = ca.sqrt(safe)
    sine = ca.if_else(small, 1 - square / 6 + square**2 / 120, ca.sin(angle) / angle)
    cosine = ca.if_else(small, 0.5 - square / 24 + square**2 / 720, (1 - ca.cos(angle)) / safe)
    matrix = skew(theta)
    return ca.DM.eye(3) + sine * matrix + cosine * matrix @ matrix


def log(rotation: Symbol) -> Symbol:
    """Rotation vector [rad] of a rotation matrix by an angle below pi, smooth at zero."""
    axial = (
        ca.vertcat(
            rotation[2, 1] - rotation[1, 2],
            rotation[0, 2] - rotation[2, 0],
            rotation[1, 0] - rotation[0, 1],
        )
        / 2
    )
    square = ca.dot(axial, axial)
    cosine = (ca.trace(rotation) - 1) / 2
    small = ca.logic_and(square < 1e-6, cosine > 0)
    sine = ca.sqrt(ca.if_else(small, 1.0, square))
    factor = ca.if_else(small, 1 + square / 6 + 3 * square**2 / 40, ca.atan2(sine, cosine) / sine)
    return factor * axial


def cross_matrices(vectors: Array) -> Array:
    """Matrices of the cross product with vectors, ``S(v) w = v x w``.

    Args:
        vectors: Shape (n, 3).

    Returns:
        Shape (n, 3, 3); :func:`skew` is the same in CasADi.
    """
    zero = np.zeros(len(vectors))
    x, y, z = vectors.T
    rows = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1)
    return np.asarray(rows).reshape(-1, 3, 3)


def quaternions_of(matrices: Array) -> Array:
    """Quaternions (w, x, y, z) of rotation matrices over time, without jumps of sign.

    Args:
        matrices: Shape (n, 3, 3).

    Returns:
        Shape (n, 4).
    """
    return sign_continuous(Rotation.from_matrix(matrices).as_quat(scalar_first=True))


def is_rotation(matrix: Array, tolerance: float) -> bool:
    """Whether a matrix is a rotation, neither stretched nor mirrored.

    Args:
        matrix: Finite, shape (3, 3).
        tolerance: Largest departure of an element of R^T R from those of the identity.
    """
    if np.abs(matrix).max() > 1 + tolerance:  # its square may be too large for a number
        return False
    departure = np.abs(matrix.T @ matrix - np.eye(3)).max()
    return bool(departure <= tolerance and np.linalg.det(matrix) > 0)


def sign_continuous(quaternions: Array) -> Array:
    """Quaternions over time without jumps of sign: of q and -q, each the one closer to the sample
    before; the first stays as it is.

    Args:
        quaternions: Of unit length, shape (n, 4).

    Returns:
        The same rotations, shape (n, 4).
    """
    jumps = np.sum(quaternions[1:] * quaternions[:-1], axis=1) < 0
    signs = np.cumprod(np.where(jumps, -1.0, 1.0))
    return np.asarray(quaternions * np.concatenate([[1.0], signs])[:, None])
