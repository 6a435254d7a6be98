"""How what moves against the platform pulls at it: an oscillator, or a load on a string; and what
the balance of forces along a stretch makes of that, for each kind of thing that is looked for, and
score tests of it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np
from scipy.linalg.lapack import dtbtrs

from steelyard.arrays import Array
from steelyard.dynamics import AT_A_POINT, EVERY_ELEMENT, bending_regressor
from steelyard.estimates.quantiles import chi2_tail
from steelyard.identification.verdict.force_stretch import (
    INDEPENDENT,
    STEP,
    ForceStretch,
    beside,
    innovations,
    orthonormal,
)
from steelyard.robot.model import DIRECTIONS

_PULLED = np.stack(
    [
        np.eye(DIRECTIONS)[:, :3],
        *(np.vstack([np.zeros((3, 3)), np.cross(axis, np.eye(3)).T]) for axis in np.eye(3)),
    ],
    axis=1,
)
"""Wrenches that a pull makes, of a kilogramme and of a kilogramme a metre away along each axis, as
linear functions of it, platform frame, shape (6, 4, 3)."""


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
    """How the whitened balance follows each component of a pull, shape (n, 6, c) each: of a
    kilogramme and of a kilogramme a metre away; empty of what bends."""

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
        if self.kind.is_stiff:
            for each in frequencies:
                yield self.whitened(self.bent(float(each), AT_A_POINT))
            return
        for pull in self._pulls(frequencies):
            white, *others = (
                own * p[:, None, None] for own, p in zip(self.by_pull, pull.T, strict=True)
            )
            for each in others:
                white += each
            yield innovations(white, self.stretch.use, self.stretch.kept)

    def whitened(self, wrenches: Array) -> Array:
        """Columns of the balance as the residual is, shape (6 n - 6, c), from wrenches (n, 6,
        c).
        """
        return innovations(self.white @ wrenches, self.stretch.use, self.stretch.kept)

    def bent(self, frequency: float, elements: Sequence[int] = EVERY_ELEMENT) -> Array:
        """Wrench that the cables exert where a part follows the motion behind springs, by elements
        of its matrix, shape (n, 6, k), see :func:`.bending_regressor`.

        Args:
            frequency: [Hz]; infinite: it follows at once, as what bends far above the motion does.
            elements: Which are asked for.
        """
        stretch = self.stretch
        stiff = np.isinf(frequency)
        follows = stretch.felt if stiff else -self._behind(stretch.felt, 2 * np.pi * frequency)
        rate = np.gradient(follows, STEP, axis=0)
        orders = (follows, rate, np.gradient(rate, STEP, axis=0))
        felt = np.stack([stretch.at_samples(own) for own in orders])
        return bending_regressor(felt, stretch.omega, elements)

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
        """The same of what vibrates at a frequency whatever the motion is, as a wrench on the
        platform, shape (6 n - 6, 12): it goes on from where it was in the beginning, which nobody
        knows.

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
    """Pull of a kilogramme on a spring, ``omega^2 x`` of ``x'' + 2 damping omega x' + omega^2 x =
    -driven`` from rest, by the trapezoidal rule, shape (t, 3).

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
    """Pull of a kilogramme on a string, beyond that of one that is fixed, world frame [N], shape
    (f, t, 3): of a spherical pendulum at any angle, from where it hangs at first, by the method of
    Runge and Kutta.

    A string tells nothing but its direction: ``r'' = g - a + T r - 2 damping omega r'``, where T
    keeps its length ``|g| / omega^2`` [Goldstein2002]_ (chapter 2.4, a constraint with its
    multiplier).

    Args:
        acceleration: Of the point where it hangs, world frame, at equal steps [m/s^2], shape (t,
            3).
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


class ScoreTest(NamedTuple):
    """A pull that follows the acceleration, in all stretches."""

    fall: float
    """Decrease of the cost, chi-square where there is none."""
    pull: Array
    """Its size, shape (c,): mass, and mass times place; of what bends elements of its matrix."""


@dataclass(frozen=True, eq=False)
class Bent:
    """What bends in all stretches, as far as it does so at once.

    Searches for parts that nothing is known of have nine numbers at every frequency. Here is one:
    how much more than at once the same matrix answers there.
    """

    asked: Sequence[AskedStretch]
    at_once: Sequence[Array]
    """Wrench by the elements of the matrix, shape (n, 6, 21) each."""
    columns: Sequence[Array]
    """The same as the residual is, shape (6 n - 6, 21) each."""
    free: Sequence[Array]
    """What the body leaves of them, of the same shape."""
    estimated: Array
    """Elements of the matrix that the estimate has, shape (21,)."""
    further: Array
    """What the residual asks for beyond them, shape (21,)."""
    chance: float
    """Probability of that."""

    @classmethod
    def of(cls, asked: Sequence[AskedStretch], estimated: Array) -> Bent:
        """As the residual has it beyond what is estimated already."""
        at_once = [each.bent(np.inf) for each in asked]
        columns = [each.whitened(own) for each, own in zip(asked, at_once, strict=True)]
        free = [beside(each.stretch.base, own) for each, own in zip(asked, columns, strict=True)]
        normal, right = normal_equations(asked, free)
        further = solution(normal, right)
        chance = float(chi2_tail(float(right @ further), len(right)))
        return cls(asked, at_once, columns, free, estimated, further, chance)

    @cached_property
    def _bases(self) -> list[Array]:
        """Orthonormal columns of what the body leaves: only few recordings are asked further."""
        return [orthonormal(own) for own in self.free]

    def more(self, frequency: float) -> list[Array]:
        """What it answers more on springs of a frequency [Hz], in every stretch, shape (6 n - 6,
        1).
        """
        matrix = self.estimated + self.further
        return [
            each.whitened(((each.bent(frequency) - own) @ matrix)[:, :, None])
            for each, own in zip(self.asked, self.at_once, strict=True)
        ]

    def tested(self, frequency: float) -> ScoreTest:
        """How surely it does, as a share of that: less than at once is no answer of a part. What
        merely goes on vibrating there tells nothing.
        """
        found = []
        for each, base, rows in zip(self.asked, self._bases, self.more(frequency), strict=True):
            free = each.by_itself(frequency, each.damping)
            for own in (each.stretch.base, base):
                free, rows = beside(own, free), beside(own, rows)
            found.append(beside(orthonormal(free), rows))
        normal, right = normal_equations(self.asked, found)
        share = solution(normal, right)
        return ScoreTest(float(right @ share) if share[0] > 0 else 0.0, share)


def normal_equations(asked: Sequence[AskedStretch], own: Sequence[Array]) -> tuple[Array, Array]:
    """Normal equations of columns in all stretches, shapes (c, c) and (c,)."""
    normal = np.sum([one.T @ one for one in own], axis=0)
    over = [one.T @ each.stretch.over for each, one in zip(asked, own, strict=True)]
    return np.asarray(normal), np.sum(over, axis=0)


def solution(normal: Array, right: Array) -> Array:
    """Solution of normal equations as far as they are independent, shape (c,)."""
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    size, direction = np.linalg.eigh(normal / np.outer(scale, scale))
    told = np.abs(size) > INDEPENDENT * np.abs(size).max()
    along = direction[:, told].T @ (right / scale) / size[told]
    return np.asarray(direction[:, told] @ along / scale)
