"""What the streams of two clocks share: readings of one as a linear function of what the other
tells at the same instant.

Each relation is exact physics up to constants that nobody needs to know beforehand (mounting,
units, signs, axes, biases, lever arms): they are coefficients of a regression. Only one thing must
not be among them, a shift in time. Under reversal of time positions, rotations, accelerations and
forces stay as they are and velocities turn their sign; as long as readings of one parity are
explained by functions of the same parity, no combination of coefficients can do what a shift does,
to first order.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

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


@dataclass(frozen=True, eq=False)
class Relation:
    """Readings of one clock, explained by another."""

    name: str
    samples: Signal
    """What is to be explained, at its own times."""
    beside: Callable[[Array], Array]
    """What the first clock itself knows, shape (n, b), at its own times."""
    explain: Callable[[Array], Array]
    """What the other clock tells, shape (n, p), at its own times."""
    exact: bool
    """Whether the physics is linear; else the geometry of the cables changes and leaves something
    over."""


def relations(of: ClockSignals, by: ClockSignals) -> Iterator[Relation]:
    """All that the readings of one clock share with another one.

    Args:
        of: Whose readings are explained.
        by: What explains them.
    """
    if of.has(ROTATION) and by.has(ROTATION):
        yield Relation("rotation", _matrices(of), _nothing, lambda t: _flat(by.turning(t)[0]), True)
    if of.has(RATE) and by.has(ROTATION):
        yield Relation(
            "gyro and rotation", of.samples(RATE), _nothing, lambda t: by.turning(t)[1], True
        )
    elif of.has(RATE) and by.has(RATE):
        yield Relation("gyros", of.samples(RATE), _nothing, lambda t: by.at(RATE, t), True)
    if of.has(POSITION) and by.has(POSITION):
        # Targets differ by lever arms, which turn with the platform.
        with_by = by.has(ROTATION)
        beside = (
            (lambda t: _flat(of.turning(t)[0])) if of.has(ROTATION) and not with_by else _nothing
        )
        yield Relation(
            "position", of.samples(POSITION), beside, lambda t: _placed(by, t, turned=with_by), True
        )
    if of.has(SPECIFIC_FORCE):
        yield from _accelerometer(of, by)
    if of.has(FORCE):
        yield from _carried(of, by, of.samples(FORCE), "force")
    if of.has(LENGTH) and by.has(POSITION):
        yield Relation(
            "cable length",
            of.samples(LENGTH),
            _nothing,
            lambda t: _with_squares(_placed(by, t, turned=by.has(ROTATION))),
            False,
        )
    if of.has(POSE) and by.has(POSITION, ROTATION):
        # Place alone explains some shift or other: attitude moves the reading as much.
        yield Relation(
            "pose", of.samples(POSE), _nothing, lambda t: _placed(by, t, turned=True), True
        )


def _nothing(time: Array) -> Array:
    return np.zeros((len(time), 0))


def _flat(matrices: Array) -> Array:
    return matrices.reshape(len(matrices), -1)


def _matrices(of: ClockSignals) -> Signal:
    raw = of.samples(ROTATION)
    return Signal(raw.time, _products_of_quaternion(raw.values))


def _products_of_quaternion(q: Array) -> Array:
    """Nine elements of the rotation matrices are linear in the ten products of their quaternions;
    those in their place, shape (n, 10).
    """
    i, j = np.triu_indices(4)
    return np.asarray(q[:, i] * q[:, j])


def _placed(by: ClockSignals, time: Array, *, turned: bool) -> Array:
    position = by.at(POSITION, time)
    return np.hstack([position, _flat(by.turning(time)[0])]) if turned else position


def _accelerometer(of: ClockSignals, by: ClockSignals) -> Iterator[Relation]:
    if by.has(POSITION, ROTATION):
        yield Relation(
            "acceleration", of.samples(SPECIFIC_FORCE), _nothing, lambda t: _motion(by, t), True
        )
    elif by.has(POSITION) and of.has(ROTATION):
        # In the axes of the world, where the other clock knows the acceleration; biases and lever
        # arms turn with the platform.
        raw = of.samples(SPECIFIC_FORCE)
        R = of.turning(raw.time)[0]
        world = Signal(raw.time, np.einsum("nij,nj->ni", R, raw.values))
        yield Relation(
            "acceleration", world, lambda t: _levers(of, t), lambda t: by.at(POSITION, t, 2), True
        )
    elif by.has(POSITION):
        # Without any attitude the platform must hardly turn.
        turned = (lambda t: _turned_by_rate(of, t)) if of.has(RATE) else _nothing
        yield Relation(
            "acceleration",
            of.samples(SPECIFIC_FORCE),
            turned,
            lambda t: by.at(POSITION, t, 2),
            False,
        )
    elif by.has(ROTATION):
        yield Relation(
            "direction of gravity",
            of.samples(SPECIFIC_FORCE),
            _nothing,
            lambda t: _turning(by, t),
            False,
        )
    elif by.has(SPECIFIC_FORCE):
        yield Relation(
            "accelerometers",
            of.samples(SPECIFIC_FORCE),
            _nothing,
            lambda t: by.at(SPECIFIC_FORCE, t),
            False,
        )


def _carried(of: ClockSignals, by: ClockSignals, samples: Signal, name: str) -> Iterator[Relation]:
    """Forces carry the platform: they follow its specific force and its turning, and where it
    is.
    """
    if by.has(SPECIFIC_FORCE) or by.has(POSITION) or by.has(ROTATION):
        beside = (
            (lambda t: _turning(of, t)) if of.has(ROTATION) and not by.has(ROTATION) else _nothing
        )
        yield Relation(name, samples, beside, lambda t: _everything(by, t), False)


def _everything(by: ClockSignals, time: Array) -> Array:
    """All even functions of the motion that a clock tells."""
    found = []
    if by.has(POSITION, ROTATION):
        found += [_motion(by, time), by.at(POSITION, time)]
    elif by.has(POSITION):
        found += [by.at(POSITION, time, 2), by.at(POSITION, time)]
    elif by.has(ROTATION):
        found.append(_turning(by, time))
    if by.has(SPECIFIC_FORCE):
        force_samples = by.at(SPECIFIC_FORCE, time)
        found.append(force_samples)
        if by.has(ROTATION):
            found.append(np.einsum("nij,nj->ni", by.turning(time)[0], force_samples))
    if by.has(RATE) and not by.has(ROTATION):
        found.append(_turned_by_rate(by, time))
    return np.hstack(found)


def _motion(by: ClockSignals, time: Array) -> Array:
    """Specific force of any point in the turning frame, and its parts, shape (n, 21)."""
    R = by.turning(time)[0]
    inside = np.einsum("nji,nj->ni", R, by.at(POSITION, time, 2))
    return np.hstack([inside, _turning(by, time)])


def _turning(by: ClockSignals, time: Array) -> Array:
    """Axes of the world in the turning frame, angular acceleration and the centripetal products,
    shape (n, 18).
    """
    R, omega, alpha = by.turning(time)
    return np.hstack([_flat(R), alpha, _squares(omega)])


def _turned_by_rate(by: ClockSignals, time: Array) -> Array:
    """Angle since the beginning, angular acceleration and the centripetal products, shape (n,
    12).
    """
    raw = by.samples(RATE)
    steps = np.diff(raw.time, prepend=raw.time[0])[:, None]
    angle = np.cumsum(raw.values * steps, axis=0)
    turned = np.column_stack([np.interp(time, raw.time, angle[:, i]) for i in range(3)])
    return np.hstack([turned, by.at(RATE, time, 1), _squares(by.at(RATE, time))])


def _levers(of: ClockSignals, time: Array) -> Array:
    """How biases and lever arms appear in the axes of the world, shape (n, 18): R, and its second
    derivative.
    """
    R, omega, alpha = of.turning(time)
    W = _cross(omega)
    return np.hstack([_flat(R), _flat(R @ (_cross(alpha) + W @ W))])


def _cross(v: Array) -> Array:
    zero = np.zeros(len(v))
    x, y, z = v.T
    return np.asarray(np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1)).reshape(-1, 3, 3)


def _squares(v: Array) -> Array:
    i, j = np.triu_indices(v.shape[1])
    return np.asarray(v[:, i] * v[:, j])


def _with_squares(v: Array) -> Array:
    centred = v - np.nanmean(v, axis=0)
    return np.hstack([centred, _squares(centred)])
