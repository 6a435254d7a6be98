"""How what moves against the platform pulls at it: an oscillator, or a load on a string; and what the
balance of forces along a stretch makes of that, for each kind of thing that is looked for.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from scipy.linalg.lapack import dtbtrs

from steelyard.arrays import Array
from steelyard.dynamics import AT_A_POINT, bending_regressor
from steelyard.identification.verdict.force_stretch import STEP, ForceStretch, innovations
from steelyard.robot.model import DIRECTIONS

_PULLED = np.stack(
    [
        np.eye(DIRECTIONS)[:, :3],
        *(np.vstack([np.zeros((3, 3)), np.cross(axis, np.eye(3)).T]) for axis in np.eye(3)),
    ],
    axis=1,
)
"""Wrenches that a pull makes, of a kilogramme and of a kilogramme a metre away along each axis, as linear
functions of it, platform frame, shape (6, 4, 3)."""


class Kind(NamedTuple):
    """What moves against the platform."""

    name: Literal["swings", "bends"]
    lowest: float
    highest: float
    """Frequencies that are looked for [Hz]."""
    damping: tuple[float, ...]
    """Ratios, the widest line last."""
    at_any_angle: bool = False
    """Whether it swings as far as it does, in place of small swings."""

    @property
    def is_stiff(self) -> bool:
        """Whether platforms on their cables vibrate at such frequencies themselves."""
        return self.name == "bends"


KINDS = (
    # On strings of some metres to some centimetres, or a liquid: level, in the world.
    Kind("swings", 0.25, 3.2, (0.005, 0.02)),
    # The same, so far that it takes longer, pulls downwards twice in a period, and has no line.
    Kind("swings", 0.25, 3.2, (0.005, 0.02), at_any_angle=True),
    # On something elastic, along the axes of the platform, whose weight it feels too.
    Kind("bends", 1.5, 14.0, (0.01, 0.03)),
)
"""All that are looked for."""


@dataclass(frozen=True, eq=False)
class AskedStretch:
    """A stretch that is asked for one kind: what does not depend on the frequency is there once."""

    stretch: ForceStretch
    kind: Kind
    damping: float
    """Ratio."""
    whole: float
    """Mass of platform and load [kg]."""
    white: Array
    """The whitener in units of the scatter, shape (n, 6, 6)."""
    by_pull: tuple[Array, ...]
    """How the whitened balance follows each component of a pull, shape (n, 6, c) each: of a kilogramme
    and of a kilogramme a metre away; empty of what bends."""

    @classmethod
    def of(cls, stretch: ForceStretch, kind: Kind, whole: float) -> AskedStretch:
        """Of one kind."""
        white = stretch.whitener / stretch.scatter
        if kind.name == "bends":
            return cls(stretch, kind, kind.damping[-1], whole, white, ())
        by_pull = tuple(white @ each for each in np.moveaxis(_PULLED, 2, 0))
        return cls(stretch, kind, kind.damping[-1], whole, white, by_pull)

    def rows(self, frequencies: Array) -> Iterator[Array]:
        """Columns of the balance as the residual is, one after the other, shape (6 n - 6, c) each.

        Args:
            frequencies: At which it moves [Hz], shape (f,).
        """
        stretch = self.stretch
        if self.kind.name == "bends":
            for bent in self._bent(frequencies):
                yield innovations(self.white @ bent, stretch.use, stretch.kept)
            return
        for pull in self._pulls(frequencies):
            white, *others = (
                own * p[:, None, None] for own, p in zip(self.by_pull, pull.T, strict=True)
            )
            for each in others:
                white += each
            yield innovations(white, stretch.use, stretch.kept)

    def _bent(self, frequencies: Array) -> Iterator[Array]:
        """Wrench that the cables exert where a part follows the motion behind springs, at each frequency,
        by the elements of its matrix, shape (n, 6, c) each.
        """
        stretch = self.stretch
        for each in 2 * np.pi * frequencies:
            follows = -self._behind(stretch.felt, each)
            rate = np.gradient(follows, STEP, axis=0)
            orders = (follows, rate, np.gradient(rate, STEP, axis=0))
            felt = np.stack([stretch.at_samples(own) for own in orders])
            yield bending_regressor(felt, stretch.omega)[:, :, AT_A_POINT]

    def _behind(self, driven: Array, omega: float) -> Array:
        """Pull of a kilogramme on a spring that begins as it would hang at rest."""
        return np.asarray(oscillator(driven - driven[0], omega, self.damping, STEP) - driven[0])

    def _pulls(self, frequencies: Array) -> Iterator[Array]:
        """Of a kilogramme, platform frame [N], shape (n, 3) each."""
        stretch, omega = self.stretch, 2 * np.pi * frequencies
        if self.kind.at_any_angle:
            # All of them at once: their steps in time are what takes long.
            pulls = pendulums(stretch.acceleration, stretch.gravity, omega, self.damping, STEP)
            for pull in pulls:
                yield self._in_platform(pull)
            return
        level = stretch.level
        for each in omega:
            yield self._in_platform(self._behind(level, each))

    def _in_platform(self, pull: Array) -> Array:
        """At the samples and in the platform frame, from the instants and in the world frame."""
        found = np.einsum("nji,nj->ni", self.stretch.rotation, self.stretch.at_samples(pull))
        return np.asarray(found)

    def by_itself(self, frequency: float, damping: float) -> Array:
        """The same of what vibrates at a frequency whatever the motion is, as a wrench on the platform,
        shape (6 n - 6, 12): it goes on from where it was in the beginning, which nobody knows.

        Args:
            frequency: [Hz]
            damping: Ratio; 0: something keeps it up, as the mains do.
        """
        stretch, omega = self.stretch, 2 * np.pi * frequency
        since = stretch.time - stretch.time[0]
        waves = np.exp(-damping * omega * since) * (np.cos(omega * since), np.sin(omega * since))
        white = np.concatenate([self.white * own[:, None, None] for own in waves], axis=2)
        return innovations(white, stretch.use, stretch.kept)


def oscillator(driven: Array, omega: float, damping: float, step: float) -> Array:
    """Pull of a kilogramme on a spring, ``omega^2 x`` of ``x'' + 2 damping omega x' + omega^2 x = -driven`` from
    rest, by the trapezoidal rule, shape (t, 3).

    Args:
        driven: Acceleration at equal steps [m/s^2], shape (t, 3).
        omega: Of the spring [rad/s].
        damping: Ratio.
        step: [s]
    """
    half = omega * step / 2
    first, middle, last = (
        1 + 2 * damping * half + half**2,
        2 * (half**2 - 1),
        1 - 2 * damping * half + half**2,
    )
    band = np.empty((3, len(driven)))
    band[0], band[1], band[2] = first, middle, last
    right = driven.copy()
    right[1:] += 2 * driven[:-1]
    right[2:] += driven[:-2]
    found, _ = dtbtrs(band, -(half**2) * right, uplo="L")
    return np.asarray(found)


def pendulums(
    acceleration: Array, gravity: Array, omega: Array, damping: float, step: float
) -> Array:
    """Pull of a kilogramme on a string, beyond that of one that is fixed, world frame [N], shape (f, t,
    3): of a spherical pendulum at any angle, from where it hangs at first, by the method of Runge and
    Kutta.

    A string tells nothing but its direction: ``r'' = g - a + T r - 2 damping omega r'``, where T keeps its
    length ``|g| / omega^2`` [Goldstein2002]_ (chapter 2.4, a constraint with its multiplier).

    Args:
        acceleration: Of the point where it hangs, world frame, at equal steps [m/s^2], shape (t, 3).
        gravity: World frame [m/s^2], shape (3,).
        omega: Of small swings, one for each length [rad/s], shape (f,).
        damping: Ratio of small swings.
        step: [s]
    """
    felt = gravity - acceleration
    square = (np.linalg.norm(gravity) / omega**2) ** 2
    drag = (2 * damping * omega)[:, None]

    def tension(place: Array, speed: Array, at: Array) -> Array:
        return np.asarray(-(np.sum(speed**2, axis=1) + place @ at) / square)[:, None]

    def rate(place: Array, speed: Array, at: Array) -> Array:
        return np.asarray(at + tension(place, speed, at) * place - drag * speed)

    place = np.sqrt(square)[:, None] * felt[0] / np.linalg.norm(felt[0])
    speed = np.zeros_like(place)
    found = np.empty((len(omega), *felt.shape))
    for i, here in enumerate(felt):
        found[:, i] = -tension(place, speed, here) * place - here
        if i + 1 == len(felt):
            break
        there = felt[i + 1]
        middle = (here + there) / 2
        first = rate(place, speed, here)
        half = place + step / 2 * speed, speed + step / 2 * first
        second = rate(*half, middle)
        other = place + step / 2 * half[1], speed + step / 2 * second
        third = rate(*other, middle)
        last = rate(place + step * other[1], speed + step * third, there)
        place = place + step * speed + step**2 / 6 * (first + second + third)
        speed = speed + step / 6 * (first + 2 * second + 2 * third + last)
        # It neither grows nor turns along itself by the errors of the steps.
        place *= np.sqrt(square / np.sum(place**2, axis=1))[:, None]
        speed -= place * (np.sum(place * speed, axis=1) / square)[:, None]
    return found
