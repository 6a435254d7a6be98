"""A motion to begin with: a spline through poses that samples show, or through another motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from steelyard.arrays import Array
from steelyard.identification.model.motion_segment import Segment
from steelyard.identification.model.segment import motion_at
from steelyard.identification.samples.prepared import Samples
from steelyard.rotations import quaternions_of
from steelyard.smoothing import DEGREE, Samples1D, fit


def started(
    time: Array, pose: Array, grid: Array, start: float, end: float, spacing: float
) -> Array | None:
    """Coefficients of a spline through poses; None where they do not determine one.

    Args:
        time: [s], shape (n,).
        pose: Position and quaternion without jumps of sign, shape (n, 7).
        grid: Knots [s].
        start: Of the knots [s].
        end: Of the knots [s].
        spacing: Of the knots [s].
    """
    if len(time) <= 1:
        return None
    # Samples do not reach the ends, and may be few: the nearest pose stands in there.
    fine = np.linspace(start, end, 3 * (len(grid) - DEGREE))
    filled = np.column_stack([np.interp(fine, time, column) for column in pose.T])
    fitted = fit(Samples1D(fine, filled), start, end, spacing)
    return None if fitted is None else np.asarray(fitted.spline.c[:, :7])


def poses_of(samples: Samples, up: Array) -> Array:
    """Position and quaternion that samples show, the latter without jumps of sign, shape (n, 7).

    Args:
        samples: Of a run.
        up: Unit vector against gravity, world frame, shape (3,).
    """
    n = len(samples)
    position = np.zeros((n, 3)) if samples.position is None else samples.position
    rotation = _tilt(samples, up).as_matrix() if samples.rotation is None else samples.rotation
    return np.hstack([position, quaternions_of(rotation)])


def _tilt(samples: Samples, up: Array) -> Rotation:
    """Attitude of a body of which only its own feelings are known: gravity says where up is, the
    gyro how it has turned.
    """
    turned = [Rotation.identity()]
    if not samples.static:
        for omega, step in zip(samples.omega[:-1], np.diff(samples.time), strict=True):
            turned.append(turned[-1] * Rotation.from_rotvec(omega * step))
    else:
        turned *= len(samples)
    found = []
    for rotation, force_samples in zip(turned, samples.specific_force, strict=True):
        feels = rotation.apply(force_samples)
        axis = np.cross(feels, up)
        angle = np.arctan2(np.linalg.norm(axis), feels @ up)
        found.append(
            Rotation.from_rotvec(axis / max(float(np.linalg.norm(axis)), 1e-12) * angle) * rotation
        )
    return Rotation.concatenate(found)


def resampled(segment: Segment, onto: Segment) -> Segment:
    """A segment on other knots with the motion of this one."""
    start, end = float(onto.knots[0]), float(onto.knots[-1])
    spacing = onto.spacing
    times = np.linspace(
        max(start, float(segment.knots[0])), min(end, float(segment.knots[-1])), 4 * len(onto.knots)
    )
    pose, *_ = motion_at(segment.basis(times), segment.coefficients)
    coefficients = started(times, pose, onto.knots, start, end, spacing)
    return onto if coefficients is None else replace(onto, coefficients=coefficients)
