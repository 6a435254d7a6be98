"""What the streams of two clocks share: readings of one as a linear function of the other's.

Each relation is exact physics up to constants that nobody needs to know beforehand (mounting,
units, signs, axes, biases, lever arms): they are coefficients of a regression. Only one thing must
not be among them, a shift in time. Under reversal of time positions, rotations, accelerations and
forces stay as they are and velocities turn their sign; as long as readings of one parity are
regressed on functions of the same parity, no combination of coefficients can do what a shift does,
to first order.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from steelyard.arrays import Array
from steelyard.clocks.clock_signals import (
    FORCE,
    LENGTH,
    POSE,
    POSITION,
    RATE,
    ROTATION,
    SPECIFIC_FORCE,
    ClockSignals,
    Signal,
)
from steelyard.rotations import cross_matrices

Regressors = Callable[[Array], Array]
"""Regressors at times of a clock [s], shape (n,): shape (n, p)."""


@dataclass(frozen=True, eq=False)
class Relation:
    """Readings of one clock as a linear function of another's."""

    name: str
    response: Signal
    """Readings of the first clock."""
    own: Regressors
    """Regressors that the first clock has itself, at its own times."""
    other: Regressors
    """Regressors of the other clock, at its own times."""
    linear: bool
    """Whether the physics is linear; else the geometry of the cables changes and leaves
    residuals."""


def relations(of: ClockSignals, by: ClockSignals) -> Iterator[Relation]:
    """All that the readings of one clock share with another one.

    Args:
        of: Whose readings are the responses.
        by: Whose readings are the regressors.
    """
    if of.has(ROTATION) and by.has(ROTATION):
        raw = of.samples(ROTATION)
        # Elements of rotation matrices are linear in the products of their quaternions.
        products = Signal(raw.time, _products(raw.values))
        yield Relation("rotation", products, _none, partial(_rotation, by), True)
    if of.has(RATE) and by.has(ROTATION):
        rate = of.samples(RATE)
        yield Relation("gyro and rotation", rate, _none, lambda t: by.turning(t)[1], True)
    elif of.has(RATE) and by.has(RATE):
        yield Relation("gyros", of.samples(RATE), _none, partial(by.at, RATE), True)
    if of.has(POSITION) and by.has(POSITION):
        # Targets differ by lever arms, which turn with the platform.
        own = partial(_rotation, of) if of.has(ROTATION) and not by.has(ROTATION) else _none
        yield Relation("position", of.samples(POSITION), own, partial(_position, by), True)
    if of.has(SPECIFIC_FORCE):
        yield from _of_accelerometer(of, by)
    if of.has(FORCE) and (by.has(SPECIFIC_FORCE) or by.has(POSITION) or by.has(ROTATION)):
        # Forces follow the specific force of the platform, its rotation and its position.
        turns = of.has(ROTATION) and not by.has(ROTATION)
        own = partial(_rotation_terms, of) if turns else _none
        yield Relation("force", of.samples(FORCE), own, partial(_motion_terms, by), False)
    if of.has(LENGTH) and by.has(POSITION):
        squares = partial(_position_and_squares, by)
        yield Relation("cable length", of.samples(LENGTH), _none, squares, False)
    if of.has(POSE) and by.has(POSITION, ROTATION):
        # Position alone would fit at some shift or other: rotation moves the reading as much.
        yield Relation("pose", of.samples(POSE), _none, partial(_position, by), True)


def _of_accelerometer(of: ClockSignals, by: ClockSignals) -> Iterator[Relation]:
    """The relation of an accelerometer to the motion that the other clock knows, by what is there
    to turn it into the axes of the accelerometer.
    """
    raw = of.samples(SPECIFIC_FORCE)
    acceleration = partial(by.at, POSITION, order=2)
    if by.has(POSITION, ROTATION):
        yield Relation("acceleration", raw, _none, partial(_specific_force_terms, by), True)
    elif by.has(POSITION) and of.has(ROTATION):
        # In the axes of the world, where the other clock knows the acceleration; biases and lever
        # arms turn with the platform.
        R = of.turning(raw.time)[0]
        world = Signal(raw.time, np.einsum("nij,nj->ni", R, raw.values))
        yield Relation("acceleration", world, partial(_lever_terms, of), acceleration, True)
    elif by.has(POSITION):
        # Without any attitude the platform must hardly turn.
        own = partial(_gyro_terms, of) if of.has(RATE) else _none
        yield Relation("acceleration", raw, own, acceleration, False)
    elif by.has(ROTATION):
        yield Relation("direction of gravity", raw, _none, partial(_rotation_terms, by), False)
    elif by.has(SPECIFIC_FORCE):
        other = partial(by.at, SPECIFIC_FORCE)
        yield Relation("accelerometers", raw, _none, other, False)


# Regressors


def _none(time: Array) -> Array:
    return np.zeros((len(time), 0))


def _rotation(by: ClockSignals, time: Array) -> Array:
    """Elements of the rotation matrix, shape (n, 9)."""
    return _flat(by.turning(time)[0])


def _position(by: ClockSignals, time: Array) -> Array:
    """Position, and the rotation for lever arms where it is known, shape (n, 3) or (n, 12)."""
    position = by.at(POSITION, time)
    return np.hstack([position, _rotation(by, time)]) if by.has(ROTATION) else position


def _position_and_squares(by: ClockSignals, time: Array) -> Array:
    """The same with products of its deviations, shape (n, p + p (p + 1) / 2)."""
    position = _position(by, time)
    centred = position - np.nanmean(position, axis=0)
    return np.hstack([centred, _products(centred)])


def _motion_terms(by: ClockSignals, time: Array) -> Array:
    """All even functions of the motion that a clock knows."""
    found = []
    if by.has(POSITION, ROTATION):
        found += [_specific_force_terms(by, time), by.at(POSITION, time)]
    elif by.has(POSITION):
        found += [by.at(POSITION, time, 2), by.at(POSITION, time)]
    elif by.has(ROTATION):
        found.append(_rotation_terms(by, time))
    if by.has(SPECIFIC_FORCE):
        specific_force = by.at(SPECIFIC_FORCE, time)
        found.append(specific_force)
        if by.has(ROTATION):
            found.append(np.einsum("nij,nj->ni", by.turning(time)[0], specific_force))
    if by.has(RATE) and not by.has(ROTATION):
        found.append(_gyro_terms(by, time))
    return np.hstack(found)


def _specific_force_terms(by: ClockSignals, time: Array) -> Array:
    """Specific force of any point in the turning frame, and its parts, shape (n, 21)."""
    R = by.turning(time)[0]
    inside = np.einsum("nji,nj->ni", R, by.at(POSITION, time, 2))
    return np.hstack([inside, _rotation_terms(by, time)])


def _rotation_terms(by: ClockSignals, time: Array) -> Array:
    """Axes of the world in the turning frame, angular acceleration and the centripetal products,
    shape (n, 18).
    """
    R, omega, alpha = by.turning(time)
    return np.hstack([_flat(R), alpha, _products(omega)])


def _gyro_terms(by: ClockSignals, time: Array) -> Array:
    """Angle since the beginning, angular acceleration and the centripetal products, shape (n,
    12).
    """
    raw = by.samples(RATE)
    steps = np.diff(raw.time, prepend=raw.time[0])[:, None]
    angle = np.cumsum(raw.values * steps, axis=0)
    turned = np.column_stack([np.interp(time, raw.time, angle[:, i]) for i in range(3)])
    return np.hstack([turned, by.at(RATE, time, 1), _products(by.at(RATE, time))])


def _lever_terms(of: ClockSignals, time: Array) -> Array:
    """How biases and lever arms appear in the axes of the world, shape (n, 18): R, and its second
    derivative.
    """
    R, omega, alpha = of.turning(time)
    W = cross_matrices(omega)
    return np.hstack([_flat(R), _flat(R @ (cross_matrices(alpha) + W @ W))])


def _flat(matrices: Array) -> Array:
    return matrices.reshape(len(matrices), -1)


def _products(v: Array) -> Array:
    """Products of all pairs of components, squares among them, shape (n, k (k + 1) / 2)."""
    i, j = np.triu_indices(v.shape[1])
    return np.asarray(v[:, i] * v[:, j])
