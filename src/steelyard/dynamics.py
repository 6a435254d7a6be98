r"""Newton-Euler equations of the platform and their regressor.

With the specific force :math:`s = R^T (a_P - g)` and :math:`h = m c`, all in the platform frame
about its origin, the cables (or whatever carries the body) exert

.. math:: f = m s + \dot\omega \times h + \omega \times (\omega \times h), \qquad
          n = J_P \dot\omega + \omega \times J_P \omega + h \times s .

This is Eq. (1) of [Tempel2017]_ with gravity on the left and the sign of its lower block corrected
(J_P = J_C - m [c]x [c]x), as Eq. (7) has it. It is linear in the ten parameters.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from steelyard.arrays import Array
from steelyard.batch import Batched, Symbol
from steelyard.errors import WrongValueError
from steelyard.inertia import TEN
from steelyard.rotations import cross_matrices

_SYMMETRIC = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
FLEXIBILITY = (
    *_SYMMETRIC,
    *((i, 3 + j) for i in range(3) for j in range(3)),
    *((3 + i, 3 + j) for i, j in _SYMMETRIC),
)
"""Rows and columns of the elements of a matrix of residual flexibility, in their order."""
EVERY_ELEMENT = tuple(range(len(FLEXIBILITY)))
"""All of them."""
AT_A_POINT = tuple(
    column
    for column, (i, j) in enumerate(FLEXIBILITY)
    if i < 3 and (i == j or (j >= 3 and j - 3 != i))
)
"""Elements by which a part at one point shows: how it follows forces along each axis, and turns by
them."""


def newton_euler(
    parameters: Symbol, specific_force: Symbol, omega: Symbol, alpha: Symbol
) -> Symbol:
    """Wrench that moves the body, about the platform origin, in the platform frame.

    Args:
        parameters: The ten of :data:`steelyard.inertia.LINEAR_PARAMETERS`, shape (10,).
        specific_force: Acceleration of the origin minus gravity, in P [m/s^2], shape (3,).
        omega: Angular velocity in P [rad/s], shape (3,).
        alpha: Its derivative [rad/s^2], shape (3,).

    Returns:
        Force [N] over torque [N m], shape (6,).
    """
    p = parameters
    m, h = p[0], p[1:4]
    J = ca.vertcat(
        ca.horzcat(p[4], p[9], p[8]),
        ca.horzcat(p[9], p[5], p[7]),
        ca.horzcat(p[8], p[7], p[6]),
    )
    s = specific_force
    force = m * s + ca.cross(alpha, h) + ca.cross(omega, ca.cross(omega, h))
    torque = J @ alpha + ca.cross(omega, J @ omega) + ca.cross(h, s)
    return ca.vertcat(force, torque)


def specific_force_in_platform(rotation: Symbol, acceleration: Symbol, gravity: Symbol) -> Symbol:
    """What an ideal accelerometer at the platform origin reads: R^T (a_P - g) [m/s^2], errata.md
    item 4 of Eq. (6).
    """
    return rotation.T @ (acceleration - gravity)


def point_specific_force(
    specific_force: Symbol, omega: Symbol, alpha: Symbol, point: Symbol
) -> Symbol:
    """Specific force of a point fixed to the platform, in P [m/s^2]: s + alpha x p + omega x (omega
    x p).
    """
    return specific_force + ca.cross(alpha, point) + ca.cross(omega, ca.cross(omega, point))


def point_velocity(rotation: Symbol, velocity: Symbol, omega: Symbol, point: Symbol) -> Symbol:
    """Velocity of a point fixed to the platform, in the world [m/s]: v + R (omega x p)."""
    return velocity + rotation @ ca.cross(omega, point)


@cache
def _batched_point() -> Batched:
    motion = {name: ca.SX.sym(name, 3) for name in ("specific_force", "omega", "alpha", "point")}
    force = point_specific_force(**motion)
    return Batched(
        "point", motion, {"force": force, "by_point": ca.jacobian(force, motion["point"])}
    )


def specific_force_at(
    specific_force: Array, omega: Array, alpha: Array, point: Array
) -> tuple[Array, Array]:
    """:func:`point_specific_force` over samples, and its derivative by the point.

    Args:
        specific_force: Of the platform origin, in P [m/s^2], shape (n, 3).
        omega: Shape (n, 3) [rad/s].
        alpha: Shape (n, 3) [rad/s^2].
        point: Platform frame [m], shape (3,).

    Returns:
        Specific force of the point [m/s^2], shape (n, 3), and derivative [1/s^2], shape (n, 3, 3).
    """
    found = _batched_point()(specific_force=specific_force, omega=omega, alpha=alpha, point=point)
    return found["force"], found["by_point"]


def bending_regressor(felt: Array, omega: Array, elements: Sequence[int] = EVERY_ELEMENT) -> Array:
    r"""Regressor of what the cables exert beyond a rigid body where parts of the platform bend, in
    P.

    A part on springs whose own frequencies :math:`\omega_k` lie above the motion stands off by
    :math:`q_k = -g_k^T (y - \ddot y / \omega_k^2) / \omega_k^2`, with the specific force and the
    angular acceleration :math:`y = (s, \dot\omega)` and what it feels of them, :math:`g_k`. All
    parts together are one matrix of residual flexibility [Craig2006]_,
    :math:`K = \sum_k g_k g_k^T / \omega_k^2`. With its first and last three rows,
    :math:`K_s` and :math:`K_{\dot\omega}`, the first moment is off by :math:`\eta = -K_s y`, and

    .. math:: f = \ddot\eta + 2 \omega \times \dot\eta + \dot\omega \times \eta
                  + \omega \times (\omega \times \eta), \qquad
              n = \eta \times s - K_{\dot\omega} \ddot y .

    Args:
        felt: Specific force of the platform origin [m/s^2] over angular acceleration [rad/s^2] and
            their first two derivatives by time, in P, shape (3, n, 6).
        omega: Angular velocity, in P [rad/s], shape (n, 3).
        elements: Which of the 21 elements of K are asked for.

    Returns:
        Shape (n, 6, k), by these elements of K, of which all are: xx, yy, zz, yz, xz, xy of its
        first block [kg s^2], all nine of the block beside that, row by row [kg m s^2], and six of
        its last one [kg m^2 s^2].
    """
    y, rate, change = np.ascontiguousarray(np.swapaxes(felt, 1, 2))
    turning = cross_matrices(omega)
    # How force and torque follow the first moment and its rate, samples last.
    by_moment, by_rate = np.zeros((6, 3, len(omega))), np.zeros((3, 3, len(omega)))
    by_moment[:3] = np.moveaxis(cross_matrices(felt[0, :, 3:]) + turning @ turning, 0, 2)
    by_moment[3:] = -np.moveaxis(cross_matrices(felt[0, :, :3]), 0, 2)
    by_rate[:] = np.moveaxis(2 * turning, 0, 2)
    found = np.zeros((len(elements), 6, len(omega)))
    for own, element in zip(found, elements, strict=True):
        row, column = FLEXIBILITY[element]
        for i, j in ((row, column), (column, row))[: 1 + (row != column)]:
            if i < 3:
                own -= by_moment[:, i] * y[j]
                own[:3] -= by_rate[:, i] * rate[j]
            own[i] -= change[j]
    return np.ascontiguousarray(np.moveaxis(found, 2, 0).swapaxes(1, 2))


@cache
def _batched() -> tuple[Batched, Batched]:
    p = ca.SX.sym("parameters", 10)
    motion = {name: ca.SX.sym(name, 3) for name in ("specific_force", "omega", "alpha")}
    wrench = newton_euler(p, *motion.values())
    regressor = ca.jacobian(wrench, p)
    return (
        Batched("newton_euler", {"parameters": p, **motion}, {"wrench": wrench}),
        Batched("regressor", motion, {"regressor": regressor}),
    )


def platform_wrench(
    parameters: ArrayLike, specific_force: ArrayLike, omega: ArrayLike, alpha: ArrayLike
) -> Array:
    """:func:`newton_euler` over samples.

    Args:
        parameters: Shape (10,) or (n, 10).
        specific_force: Shape (n, 3) [m/s^2].
        omega: Shape (n, 3) [rad/s].
        alpha: Shape (n, 3) [rad/s^2].

    Returns:
        Force over torque, in P about its origin [N], [N m], shape (n, 6).
    """
    batched, _ = _batched()
    values = _samples(
        {"parameters": parameters, "specific_force": specific_force, "omega": omega, "alpha": alpha}
    )
    return batched(**values)["wrench"]


def platform_regressor(specific_force: ArrayLike, omega: ArrayLike, alpha: ArrayLike) -> Array:
    r"""Regressor Y of the Newton-Euler equations, :math:`Y \phi` = wrench of the cables about the
    origin of P, in P.

    The exact derivative of :func:`newton_euler`; the joint form of Eq. (6) and (8) of
    [Tempel2017]_.

    Args:
        specific_force: Acceleration of the origin of P minus gravity, in P [m/s^2], shape (n, 3).
        omega: Angular velocity of P in the world, in P [rad/s], shape (n, 3).
        alpha: Its derivative [rad/s^2], shape (n, 3).

    Returns:
        Shape (n, 6, 10); columns in the order of :data:`steelyard.inertia.LINEAR_PARAMETERS`.
    """
    _, batched = _batched()
    values = _samples({"specific_force": specific_force, "omega": omega, "alpha": alpha})
    return batched(**values)["regressor"]


def _samples(vectors: Mapping[str, ArrayLike]) -> dict[str, Array]:
    """Vectors of all samples, shape (n, k), or one for all of them, shape (k,).

    Raises:
        WrongValueError: They are no numbers, or of other shapes.
    """
    found, n = {}, None
    for name, given in vectors.items():
        try:
            array = np.asarray(given, dtype=np.float64)
        except (TypeError, ValueError):
            raise WrongValueError(f"{name}: expected numbers, found others; correct it") from None
        width = TEN if name == "parameters" else 3
        if array.ndim not in (1, 2) or array.shape[-1] != width:
            raise WrongValueError(
                f"{name}: expected shape (n, {width}) or ({width},), found {array.shape}; correct"
                " it"
            )
        if array.ndim == 2:
            n = len(array) if n is None else n
            if len(array) != n:
                raise WrongValueError(
                    f"{name}: expected {n} samples as in what comes before it, found {len(array)};"
                    " hand over equal numbers of them"
                )
        found[name] = array
    return found


def wrench_about(wrench: Array, point: Array) -> Array:
    """Wrenches about another point: n - c x f.

    Args:
        wrench: Force over torque about the origin [N], [N m], shape (6,), (n, 6) or (n, 6, k).
        point: c, in the frame of the wrenches [m], shape (3,).
    """
    axis = min(1, wrench.ndim - 1)
    force, torque = np.split(wrench, 2, axis=axis)
    lever = np.reshape(point, [3 if i == axis else 1 for i in range(wrench.ndim)])
    return np.concatenate([force, torque - np.cross(lever, force, axis=axis)], axis=axis)
