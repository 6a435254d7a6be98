"""Natural frequencies and mode shapes of a body that hangs on the cables of a robot, with the
uncertainty that its estimate leaves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from steelyard.arrays import Array
from steelyard.errors import InputError
from steelyard.estimates.estimate import Estimate
from steelyard.estimates.geometry import FoundGeometry
from steelyard.inertia import BODY_PARAMETERS, TEN, Inertia
from steelyard.natural_frequencies.hanging_body import Place
from steelyard.natural_frequencies.modes import NaturalModes, by_points, natural, sensitivity
from steelyard.robot.file import read_robot
from steelyard.robot.model import DIRECTIONS, Robot

FORMAT = "steelyard-frequencies/1"


@dataclass(frozen=True, eq=False)
class Mode:
    """A natural mode."""

    frequency: float
    """[Hz]"""
    standard_deviation: float | None
    """1-sigma from the covariance of the body [Hz]; None: it has none."""
    shape: Array
    """Twist of the platform: velocity of its origin, then angular velocity [rad], along the axes of
    the world, of unit length with the platform's size as that of an angle, shape (6,)."""


@dataclass(frozen=True, eq=False)
class Frequencies:
    """A body at rest on cables, and how it swings about that."""

    robot: str
    place: Place
    lengths: Array
    """Unstrained lengths of the cables [m], shape (m,)."""
    tension: Array
    """At the platform, at rest [N], NaN where the mass is not known, shape (m,)."""
    modes: tuple[Mode, ...]
    """In ascending order of their frequencies."""
    elastic: bool
    """Whether the cables stretch and sag."""

    @property
    def pose(self) -> Array:
        """x, y, z [m], roll, pitch, yaw [rad], shape (6,)."""
        rpy = Rotation.from_matrix(self.place.rotation).as_euler("ZYX")[::-1]
        return np.concatenate([self.place.position, rpy])

    def to_dict(self) -> dict[str, Any]:
        """Plain values in the shape of the contract."""
        return {
            "format": FORMAT,
            "robot": self.robot,
            "elastic": self.elastic,
            "pose": self.pose.tolist(),
            "lengths": self.lengths.tolist(),
            "modes": [
                {
                    "frequency": each.frequency,
                    "standard_deviation": each.standard_deviation,
                    "shape": each.shape.tolist(),
                }
                for each in self.modes
            ],
            "tension": [float(v) if np.isfinite(v) else None for v in self.tension],
        }


def frequencies(
    robot: Robot | str | Path,
    body: Inertia | Estimate | None = None,
    *,
    pose: ArrayLike | None = None,
    lengths: Sequence[float] | None = None,
    elastic: bool = False,
) -> Frequencies:
    """Natural frequencies about the equilibrium on cables of constant length.

    Args:
        robot: With its cables; or the name of a bundled one, or the path of its file.
        body: That hangs on them, or an estimate of it; None: the nominal platform.
        pose: x, y, z [m], roll, pitch, yaw [rad]: the cables have the lengths of this pose; with
            fewer than six cables the body then comes to rest beside it, shape (6,).
        lengths: Of the cables in place of it, unstrained [m].
        elastic: Whether the cables stretch and sag as the robot file says; with six cables and more
            they do in any case.

    Raises:
        InputError: Neither pose nor lengths, or both; no equilibrium; a body that is not known well
            enough; no stiffness where it is needed.
    """
    robot = robot if isinstance(robot, Robot) else read_robot(robot)
    known, covariance, weighed = _body(robot, body)
    if elastic and not weighed:
        raise InputError(
            "expected an estimate with a mass, since cables stretch under it, found one without;"
            " leave --elastic out, or identify with 'known: {mass: …}'"
        )
    geometry = body.geometry if isinstance(body, Estimate) and not elastic else None
    if geometry is not None and robot.m < DIRECTIONS and geometry.is_of(robot):
        return _with_geometry(robot, known, geometry, pose, lengths, weighed=weighed)
    found = natural(robot, known, pose=pose, lengths=lengths, elastic=elastic)
    deviations: list[float | None] = [None] * len(found.frequencies)
    if covariance is not None:
        J = sensitivity(found)
        spread = np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", J, covariance, J), 0.0))
        deviations = [float(v) for v in spread]
    return _told(found, deviations, weighed=weighed)


def _told(found: NaturalModes, deviations: Sequence[float | None], *, weighed: bool) -> Frequencies:
    """What there is to tell of natural modes, with their 1-sigma."""
    modes = zip(found.frequencies, deviations, found.shapes, strict=True)
    tension = found.rest.tension
    return Frequencies(
        found.cables.name,
        found.rest.place,
        found.lengths,
        tension if weighed else np.full(len(tension), np.nan),
        tuple(Mode(float(f), sigma, shape) for f, sigma, shape in modes),
        found.elastic,
    )


def _with_geometry(
    robot: Robot,
    body: Inertia,
    geometry: FoundGeometry,
    pose: ArrayLike | None,
    lengths: ArrayLike | None,
    *,
    weighed: bool,
) -> Frequencies:
    """On the robot as it was found beside the body: errors of both go together."""
    found = natural(geometry.of(robot), body, pose=pose, lengths=lengths)
    per_mass = sensitivity(found)[:, 1:] * [1, 1, 1, *[body.mass] * 6]
    J = np.hstack([per_mass, by_points(found)])
    spread = np.einsum("ij,jk,ik->i", J, geometry.covariance, J)
    return _told(found, np.sqrt(np.maximum(spread, 0.0)).tolist(), weighed=weighed)


def _body(robot: Robot, body: Inertia | Estimate | None) -> tuple[Inertia, Array | None, bool]:
    """The body, the covariance of its ten parameters where there is one, shape (10, 10), and
    whether its mass is known; else it is one of a kilogram.
    """
    if body is None:
        if robot.platform is None:
            raise InputError(
                f"robot '{robot.name}': expected a nominal 'platform', found none; name an estimate"
            )
        return robot.platform, None, True
    if isinstance(body, Inertia):
        return body, None, True
    if body.body is not None:
        return _possible(body.body), body.covariance, True
    if body.per_mass is not None and np.isfinite(body.per_mass.value).all():
        value = body.per_mass.value
        covariance = np.zeros((TEN, TEN))
        covariance[1:, 1:] = body.per_mass.covariance
        return _possible(Inertia.from_body_parameters([1.0, *value])), covariance, False
    missing = [name for name, v in zip(BODY_PARAMETERS, body.value, strict=True) if np.isnan(v)]
    raise InputError(
        "expected an estimate of a whole body, or of its inertia per mass, found one without"
        f" {', '.join(missing)}; record a motion that tells them"
    )


def _possible(body: Inertia) -> Inertia:
    """The body, if it can exist."""
    if body.is_physical:
        return body
    raise InputError(
        "expected a body that can exist, found one that cannot; choose the method consistent or"
        " maximum-likelihood"
    )
