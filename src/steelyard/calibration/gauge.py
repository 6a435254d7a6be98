"""Gauge freedom: whether anything ties the frames in which anchors and attachments are told.

A frame that no reading ties may be moved at will without any reading changing. What can be told
then is the shape; its uncertainty is that about the frame in which the points are nearest to those
drawn (inner constraints, an S-transformation [Baarda1973]_).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array

_TIED = 0.5
"""1-sigma of a motion of a frame, over that beforehand, below which readings tie it."""
_AXES = ("x", "y", "z")


@dataclass(frozen=True, eq=False)
class Gauge:
    """A frame, and how points are told in it."""

    frame: str
    untied: tuple[str, ...]
    """Motions of the frame that nothing ties: ``x``, …, ``rotation about z``."""
    covariance: Array
    """Of the points about the frame in which they are nearest to those drawn, or that a datum has
    defined, shape (3 n, 3 n)."""
    defined: str | None = None
    """What a datum says that the frame is, in words; None: there is none."""

    def __str__(self) -> str:
        if self.defined is not None:
            return f"the {self.frame} is {self.defined}; 1-sigma are about it"
        if not self.untied:
            return f"the {self.frame} is tied by the readings"
        return (
            f"nothing ties the {self.frame} ({', '.join(self.untied)}): it is that in which the"
            " points are nearest to those of the robot file, and 1-sigma are about it"
        )


def rigid_motions(points: Array) -> Array:
    """How points move with their frame: along x, y, z, then about these, shape (3 n, 6).

    Args:
        points: Shape (n, 3).
    """
    centred = points - points.mean(axis=0)
    moved = np.zeros((len(points), 3, 6))
    moved[:, :, :3] = np.eye(3)
    for i, axis in enumerate(np.eye(3)):
        moved[:, :, 3 + i] = np.cross(axis, centred)
    return moved.reshape(-1, 6)


def gauge_of(frame: str, points: Array, covariance: Array, deviation: Array) -> Gauge:
    """Which motions of a frame the readings leave, and the covariance without them.

    Args:
        frame: Its name, in words.
        points: As drawn, shape (n, 3).
        covariance: Of what was found, shape (3 n, 3 n).
        deviation: 1-sigma of every coordinate beforehand, shape (3 n,).
    """
    free = deviation > 0
    directions = rigid_motions(points)
    size = np.linalg.norm(directions, axis=0)
    # Points on a line do not turn about it.
    names = [*_AXES, *(f"rotation about {axis}" for axis in _AXES)]
    use = [i for i in range(6) if size[i] > 1e-9 and free.all()]
    if not use:
        return Gauge(frame, (), covariance)
    basis = directions[:, use]
    along = np.linalg.pinv(basis)
    now = np.sqrt(np.diag(along @ covariance @ along.T))
    before = np.sqrt(np.diag((along * deviation**2) @ along.T))
    loose = now > _TIED * before
    if not loose.any():
        return Gauge(frame, (), covariance)
    moved = basis[:, loose]
    across = np.eye(len(covariance)) - moved @ np.linalg.pinv(moved)
    untied = tuple(names[use[i]] for i in np.flatnonzero(loose))
    return Gauge(frame, untied, across @ covariance @ across.T)
