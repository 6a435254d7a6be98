"""Whether what nothing explains is a load that swings below the platform, or a liquid that sloshes.

A process beside the motion is independent of it. A load on a string follows the platform's
acceleration instead, with its own frequency, so that the process cannot stand for it: where it is as
strong as that, the body is wrong by it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from steelyard.arrays import Array
from steelyard.estimates.quantiles import fisher_tail
from steelyard.identification.model.balance import UNMODELLED_PARTS
from steelyard.identification.model.segment import motion_at
from steelyard.identification.solve.posterior import Posterior

_STEP = 0.02
"""Between instants [s]."""
_FREQUENCIES = np.geomspace(0.3, 3.0, 80)
"""Of loads on strings of three metres to some centimetres [Hz]."""
_DAMPING = 0.02
"""Ratio, of a load on a string or of a liquid."""
_EXPLAINED = 0.3
"""Part of the unmodelled force that the swing must be: the body takes some of it."""
_CHANCE = 1e-4
"""Probability that noise is as much like it, over all frequencies."""


@dataclass(frozen=True)
class Swinging:
    """A load that swings."""

    mass: float
    """[kg]"""
    frequency: float
    """[Hz]"""
    explained: float
    """Part of the unmodelled force that it is."""

    def __str__(self) -> str:
        return (
            f"something of about {self.mass:.2g} kg or more seems to swing at {self.frequency:.2g} Hz"
            " below the platform, which is no part of a rigid body; fix it, or take it off and add it"
            " afterwards"
        )


def swinging(found: Posterior) -> Swinging | None:
    """The load that the unmodelled force of an estimate is; None: it is none, or there is no such
    force.
    """
    force = next(iter(UNMODELLED_PARTS))
    best: Swinging | None = None
    for segment in found.fit.state.segments:
        processes = segment.processes_of(force)
        if not processes or segment.static:
            continue
        local = segment.basis(np.arange(*segment.span, _STEP))
        (own, _), *_ = processes
        # What the cables do beyond the body is what they withstand.
        pull = -segment.disturbance(own, local)
        pose, _, acceleration, _ = motion_at(local, segment.coefficients)
        rotation = Rotation.from_quat(pose[:, 3:], scalar_first=True).as_matrix()
        independent = pull.size * _STEP / max(2 * own.time, _STEP)
        each = likeliest_swing(
            pull, rotation, acceleration[:, :3], found.calibration.gravity, independent
        )
        if each is not None and (best is None or each.explained > best.explained):
            best = each
    return best


def likeliest_swing(
    pull: Array, rotation: Array, acceleration: Array, gravity: Array, independent: float
) -> Swinging | None:
    """The load whose pull a force is most like; None: noise is as much like one.

    Args:
        pull: Platform frame, every .02 s [N], shape (n, 3).
        rotation: R_world_platform, shape (n, 3, 3).
        acceleration: Of the platform, world frame [m/s^2], shape (n, 3).
        gravity: World frame [m/s^2], shape (3,).
        independent: Number of independent values that the force is worth.
    """
    from scipy.signal import bilinear, lfilter

    down = gravity / np.linalg.norm(gravity)
    across = np.linalg.svd(down[None])[2][1:]
    time = _STEP * np.arange(len(pull))
    axes = np.einsum("nji,kj->nki", rotation, across)
    whole = float(np.sum(pull**2))
    best: Swinging | None = None
    for frequency in _FREQUENCIES:
        omega = 2 * np.pi * frequency
        b, a = bilinear([-(omega**2)], [1.0, 2 * _DAMPING * omega, omega**2], 1 / _STEP)
        away = lfilter(b, a, acceleration @ across.T, axis=0)
        columns = [np.einsum("nk,nki->ni", away, axes)]
        decay = np.exp(-_DAMPING * omega * time)
        for wave in (np.cos(omega * time), np.sin(omega * time)):
            columns += [(decay * wave)[:, None] * axes[:, k] for k in range(2)]
        design = np.stack([each.ravel() for each in columns], axis=1)
        solved, *_ = np.linalg.lstsq(design, pull.ravel(), rcond=None)
        explained = 1 - float(np.sum((pull.ravel() - design @ solved) ** 2)) / max(whole, 1e-300)
        if solved[0] > 0 and (best is None or explained > best.explained):
            best = Swinging(float(solved[0]), float(frequency), explained)
    if best is None or best.explained < _EXPLAINED:
        return None
    count = 5
    left = max(independent - count, 1.0)
    ratio = best.explained / count / ((1 - best.explained) / left)
    chance = float(fisher_tail(ratio, count, left)) * len(_FREQUENCIES)
    return best if chance < _CHANCE else None
