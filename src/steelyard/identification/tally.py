"""Residuals counted by what they are readings of; what stands far counts no more than noise may
reach.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache

import numpy as np

from steelyard.arrays import Array
from steelyard.estimates.quantiles import chi2_quantile, chi2_tail, poisson_tail
from steelyard.identification.model.sources import Source

_FAR = 1e-4
"""Probability of a number that counts no more than noise may reach [Huber1964]_."""
_SURELY = 1e-3
"""Probability below which what stands far is not the end of the noise."""


@dataclass
class Tally:
    """Sums over the residuals of rows, by what they are readings of."""

    square: dict[Source, float] = field(default_factory=dict)
    """Of whitened residuals, without those that stand far, which tell no noise."""
    count: dict[Source, float] = field(default_factory=dict)
    """Numbers in it."""
    far: dict[Source, int] = field(default_factory=dict)
    """Numbers that stand far."""
    rarest: dict[Source, float] = field(default_factory=dict)
    """Probability with which noise alone takes one number as far as the farthest."""
    held: dict[Source, tuple[float, float]] = field(default_factory=dict)
    """The same sum with those that stand far, which count as at the limit [Huber1964]_, and how
    many numbers it is of: noise of long tails."""
    cost: float = 0.0
    """Of all numbers, those that stand far counted as Huber does."""

    def include(self, other: Tally) -> None:
        """Add what another has counted."""
        for own, further in (
            (self.square, other.square),
            (self.count, other.count),
            (self.far, other.far),
        ):
            for label, value in further.items():
                own[label] = own.get(label, 0) + value  # type: ignore[assignment]
        for label, probability in other.rarest.items():
            self.see(label, probability)
        for label, (square, numbers) in other.held.items():
            whole, count = self.held.get(label, (0.0, 0.0))
            self.held[label] = (whole + square, count + numbers)
        self.cost += other.cost

    def see(self, label: Source, probability: float) -> None:
        """Keep the smallest probability of a number of some readings."""
        self.rarest[label] = min(self.rarest.get(label, 1.0), probability)

    def is_beyond_noise(self, label: Source) -> bool:
        """Whether more numbers stand far than noise alone would have put there, or one farther."""
        numbers, far = self.count.get(label, 0.0), self.far.get(label, 0)
        if not far:
            return False
        return (
            self.rarest.get(label, 0.0) * (numbers + far) < _SURELY
            or float(poisson_tail(far, _FAR * (numbers + far))) < _SURELY
        )

    def add(self, label: Source, size: Array, weight: Array, each: int) -> None:
        """Count residuals.

        Args:
            label: What they are of.
            size: Length of each, in its 1-sigma.
            weight: Huber's.
            each: Numbers in each.
        """
        # Where most are large, none is the exception.
        usual = median(size) / _usual(each) if size.size else 1.0
        near = (weight > 0) & (size <= limit(each) * max(1.0, usual))
        self.square[label] = self.square.get(label, 0.0) + float(np.sum(size[near] ** 2))
        self.count[label] = self.count.get(label, 0.0) + each * int(np.sum(near))
        self.far[label] = self.far.get(label, 0) + int(np.sum(~near & (weight > 0)))
        farthest = float(np.max(size, where=weight > 0, initial=0.0)) / max(1.0, usual)
        self.see(label, float(chi2_tail(farthest**2, each)))
        whole, numbers = self.held.get(label, (0.0, 0.0))
        self.held[label] = (
            whole + float(np.sum((size * weight) ** 2)),
            numbers + each * int(np.sum(weight > 0)),
        )
        # Of weights c / size: 2 c size - c^2 beyond c.
        self.cost += float(np.sum(size**2 * weight * (2 - weight)))


def median(values: Array) -> float:
    """Of all numbers, of which there must be one; of few it is found sooner than by NumPy's, which
    is made for many axes.
    """
    flat = values.ravel()
    middle = (flat.size - 1) // 2, flat.size // 2
    parted = np.partition(flat, middle)
    return float((parted[middle[0]] + parted[middle[1]]) / 2)


@cache
def _usual(k: int) -> float:
    """Median length of a whitened residual of k numbers."""
    return float(np.sqrt(chi2_quantile(0.5, k)))


@cache
def limit(k: int) -> float:
    """Length of a whitened residual of k numbers beyond which it stands far."""
    return float(np.sqrt(chi2_quantile(1 - _FAR, k)))


def robust_weight(size: Array, k: int) -> Array:
    """Huber's weights of whitened residuals of k numbers each."""
    return np.asarray(np.minimum(1.0, limit(k) / np.maximum(size, 1e-300)))
