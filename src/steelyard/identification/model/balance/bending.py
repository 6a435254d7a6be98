"""Parts of a platform that bend, as what they feel along a motion says."""

from __future__ import annotations

from functools import cache

import casadi as ca
import numpy as np

from steelyard.arrays import Array
from steelyard.batch import Batched
from steelyard.dynamics import bending_regressor
from steelyard.identification.model.calibration_parameters import CalibrationValues
from steelyard.identification.model.motion_segment import Segment
from steelyard.identification.model.segment import basis, motion_at
from steelyard.motion.state import state_of_pose

_STEP = 0.02
"""Between the instants of which second derivatives are differences [s]: at 3 Hz they are 1 % too
small, and at 25 Hz, where a motion has but noise, four tenths are left."""


def bending_along(segment: Segment, times: Array, calibration: CalibrationValues) -> Array:
    """Wrench that the cables exert beyond a rigid body, by what bends, shape (n, 6, 21); see
    :func:`steelyard.dynamics.bending_regressor`.

    How it follows the motion's coefficients is of no account: at the frequencies of the motion it
    is some parts in a thousand of the wrench.

    Args:
        segment: With its motion.
        times: Within the segment [s], of poses at rest their numbers, shape (n,).
        calibration: Present values of the systematic errors.
    """
    if segment.static:
        felt, omega = felt_at(segment, times, calibration)
        still = np.zeros_like(felt)
        return bending_regressor(np.stack([felt, still, still]), omega)
    felt, omega = felt_at(segment, times, calibration)
    before, after = (felt_at(segment, times + step, calibration)[0] for step in (-_STEP, _STEP))
    rate, change = (after - before) / (2 * _STEP), (before - 2 * felt + after) / _STEP**2
    return bending_regressor(np.stack([felt, rate, change]), omega)


def felt_at(segment: Segment, times: Array, calibration: CalibrationValues) -> tuple[Array, Array]:
    """Specific force of the platform origin [m/s^2] over angular acceleration [rad/s^2], shape (n,
    6), and angular velocity [rad/s], shape (n, 3), in P; arguments as of :func:`bending_along`.
    Beyond the ends of a segment, as its first and last pieces go on.
    """
    own = segment.basis(times) if segment.static else basis(segment.knots, times)
    pose, rate, acceleration, _ = motion_at(own, segment.coefficients)
    found = _felt()(pose=pose, rate=rate, acceleration=acceleration, gravity=calibration.gravity)
    return found["felt"], found["omega"]


@cache
def _felt() -> Batched:
    """See :func:`felt_at`."""
    pose, rate, acceleration = (ca.SX.sym(name, 7) for name in ("pose", "rate", "acceleration"))
    gravity = ca.SX.sym("gravity", 3)
    state = state_of_pose(pose, rate, acceleration, gravity)
    inputs = {"pose": pose, "rate": rate, "acceleration": acceleration, "gravity": gravity}
    felt = ca.vertcat(state.specific_force, state.alpha)
    return Batched("felt", inputs, {"felt": felt, "omega": state.omega})
