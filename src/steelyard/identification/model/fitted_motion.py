"""The motion of a run as fitted, with its uncertainty: pose, velocity and acceleration at any
rate.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

import casadi as ca
import numpy as np
from scipy.spatial.transform import Rotation

from steelyard import rotations
from steelyard.arrays import Array, readonly
from steelyard.batch import Batched
from steelyard.display import printable
from steelyard.identification.model.motion_segment import Segment
from steelyard.identification.model.segment import POSE, covariance_of, motion_at, spread
from steelyard.motion.state import state_of_pose
from steelyard.tables import Tabular

FORMAT = "steelyard-motion/1"
"""Of a table of motions."""
QUANTITIES = (
    "position",
    "rotation",
    "velocity",
    "angular_velocity",
    "acceleration",
    "angular_acceleration",
)
"""Place of the platform origin and its derivatives in the world; rotations, angular velocity and
acceleration in the platform frame."""
_AXES = {
    "position": ("x", "y", "z"),
    "velocity": ("vx", "vy", "vz"),
    "angular_velocity": ("wx", "wy", "wz"),
    "acceleration": ("ax", "ay", "az"),
    "angular_acceleration": ("alpha_x", "alpha_y", "alpha_z"),
}
_ROTATION_SIGMAS = ("sigma_rx", "sigma_ry", "sigma_rz")
RATE = 100.0
"""At which it is written [Hz]."""
PLATFORM_ORIGIN = readonly(np.zeros(3), (3,), "origin")
"""In its own frame [m]."""
_AT_ONCE = 512
"""Instants whose covariance is held at once, which bounds the memory."""


@dataclass(frozen=True, eq=False)
class FittedMotion(Tabular):
    """Motion at n times."""

    run: str
    time: Array
    """By the reference clock of the motion [s], shape (n,)."""
    rotation: Array
    """Quaternion (w, x, y, z), shape (n, 4)."""
    values: Mapping[str, Array]
    """Quantity -> shape (n, 3); all of :data:`QUANTITIES` but ``rotation``."""
    sigma: Mapping[str, Array]
    """Quantity -> 1-sigma, shape (n, 3); of ``rotation`` of a rotation vector on its right."""

    def columns(self) -> dict[str, Array]:
        """Columns of a table."""
        found = {
            "t": self.time,
            **dict(zip(_AXES["position"], self.values["position"].T, strict=True)),
        }
        found |= dict(zip(("qw", "qx", "qy", "qz"), self.rotation.T, strict=True))
        for name in QUANTITIES[2:]:
            found |= dict(zip(_AXES[name], self.values[name].T, strict=True))
        for name in QUANTITIES:
            labels = (
                _ROTATION_SIGMAS
                if name == "rotation"
                else [f"sigma_{axis}" for axis in _AXES[name]]
            )
            found |= dict(zip(labels, self.sigma[name].T, strict=True))
        return found

    def __repr__(self) -> str:
        extent = f" from {self.time[0]:.2f} to {self.time[-1]:.2f} s" if len(self.time) else ""
        return f"FittedMotion of run '{printable(self.run)}': {len(self.time)} instants{extent}"


@cache
def _state() -> Batched:
    """Quantities of the motion of a point of the platform with their derivatives by pose, rate and
    acceleration, as expressions.
    """
    point = ca.SX.sym("point", 3)
    pose, rate, acceleration = (ca.SX.sym(name, POSE) for name in ("pose", "rate", "acceleration"))
    at = ca.SX.sym("at", POSE)
    state = state_of_pose(pose, rate, acceleration, ca.DM.zeros(3))
    present = state_of_pose(at, rate, acceleration, ca.DM.zeros(3)).rotation
    turned = rotations.log(present.T @ state.rotation)
    lever = state.rotation @ point
    spin, change = (state.rotation @ each for each in (state.omega, state.alpha))
    moves = ca.cross(spin, lever)
    place, velocity = pose[:3] + lever, rate[:3] + moves
    speeds_up = acceleration[:3] + ca.cross(change, lever) + ca.cross(spin, moves)
    outputs = ca.vertcat(place, turned, velocity, state.omega, speeds_up, state.alpha)
    derivatives = {
        f"by_{name}": ca.densify(ca.substitute(ca.jacobian(outputs, symbol), at, pose))
        for name, symbol in (("pose", pose), ("rate", rate), ("acceleration", acceleration))
    }
    return Batched(
        "state",
        {"pose": pose, "rate": rate, "acceleration": acceleration, "point": point},
        {
            "position": place,
            "velocity": velocity,
            "acceleration": speeds_up,
            "omega": state.omega,
            "alpha": state.alpha,
            **derivatives,
        },
    )


def fitted_motion(
    segment: Segment,
    inverse: Array,
    followed: Array,
    border: Array,
    times: Array | None = None,
    *,
    point: Array = PLATFORM_ORIGIN,
) -> FittedMotion:
    """Motion of a point of the platform along a segment.

    Args:
        segment: With its motion.
        inverse: Of the matrix of its coefficients, lower banded form, shape (42, N).
        followed: How these follow the border parameters, with the opposite sign, shape (N, b).
        border: Covariance of the border parameters, shape (b, b).
        times: Where to look [s]; None: at :data:`RATE` between the first and the last reading.
        point: In the platform frame [m], shape (3,).
    """
    if times is None:
        read = [reading.time for reading in segment.readings]
        start = max(min(float(t[0]) for t in read), float(segment.knots[0]))
        end = min(max(float(t[-1]) for t in read), float(segment.knots[-1]))
        times = np.arange(np.ceil(start * RATE), np.floor(end * RATE) + 1) / RATE
    values, vectors = np.linalg.eigh(border)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    parts = [
        _part(segment, inverse, followed, root, times[i : i + _AT_ONCE], point)
        for i in range(0, max(len(times), 1), _AT_ONCE)
    ]
    stacked = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    sigma = {name: stacked.pop(f"sigma_{name}") for name in QUANTITIES}
    return FittedMotion(segment.run, times, stacked.pop("rotation"), stacked, sigma)


def _part(
    segment: Segment, inverse: Array, followed: Array, root: Array, times: Array, point: Array
) -> dict[str, Array]:
    """The motion of a point at some times, with its 1-sigma."""
    local = segment.basis(times)
    pose, rate, acceleration, _ = motion_at(local, segment.coefficients)
    found = _state()(pose=pose, rate=rate, acceleration=acceleration, point=point)
    block = segment.block
    by_order = (found[f"by_{name}"] for name in ("pose", "rate", "acceleration"))
    rows = spread(local, *by_order, block=block)
    covariance = covariance_of(inverse, rows, local.first, block)
    variance = np.diagonal(covariance, axis1=1, axis2=2).copy()
    for first in np.unique(local.first):
        own = np.flatnonzero(local.first == first)
        by_border = rows[own] @ (followed[first * block : first * block + rows.shape[2]] @ root)
        variance[own] += np.sum(by_border**2, axis=2)
    sigma = np.sqrt(np.maximum(variance, 0.0))
    quaternion = Rotation.from_quat(pose[:, 3:], scalar_first=True).as_quat(
        scalar_first=True, canonical=False
    )
    return {
        "position": found["position"],
        "rotation": quaternion,
        "velocity": found["velocity"],
        "angular_velocity": found["omega"],
        "acceleration": found["acceleration"],
        "angular_acceleration": found["alpha"],
        **{f"sigma_{name}": sigma[:, 3 * i : 3 * i + 3] for i, name in enumerate(QUANTITIES)},
    }
