"""Tables of readings under dead weights as they fit, and what they leave of the calibration
parameters.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from steelyard.arrays import Array
from steelyard.experiment.observations import DeadWeights
from steelyard.identification.weighing.cell_problem import Place


class WrongWeight(NamedTuple):
    """A reading that contradicts all others, and was left out."""

    where: str
    cable: int
    mass: float
    """As it is stated [kg]."""
    off: float
    """Measured less predicted by all others [N]."""
    would_be: float
    """Mass that would fit [kg]."""

    def __str__(self) -> str:
        return (
            f"{self.where}: {self.mass:g} kg on cable {self.cable} reads {self.off:+.3g} N off all"
            f" others and what is stated of the cell, as {self.would_be:.4g} kg would: left out;"
            " correct the weight, the cable or the reading, or leave the row out"
        )


@dataclass(frozen=True, eq=False)
class WeighedTable:
    """One table of readings under dead weights, and how it fits."""

    weights: DeadWeights
    noise: float
    """1-sigma of a reading that it was taken with [N]."""
    stated: float | None
    """The same as stated; None: it was estimated."""
    ratio: float
    """Mean square of the residuals over that of the stated noise; 1 where it is estimated."""
    known: float
    """1-sigma that is left of what its cells read under these weights, the worst of them [N]."""
    wrong: tuple[WrongWeight, ...]
    moved: tuple[str, ...]
    """Gains and offsets far from what is stated of them, in words, the farthest first."""

    @property
    def reasons(self) -> Iterator[str]:
        """Why not to rely on it."""
        of, name = self.weights.of, self.weights.instrument
        if self.stated is not None and self.noise > self.stated:
            yield (
                f"readings of {of} under dead weights scatter by {np.sqrt(self.ratio):.1f} times"
                f" the stated noise of {name}; check the weights, the zero of the cells and 'noise'"
            )
        if self.moved:
            more = f", and so are {len(self.moved) - 1} more" if len(self.moved) > 1 else ""
            yield (
                f"dead weights say that {self.moved[0]}{more}; check the weights and units, or"
                f" state a larger 1-sigma under 'calibration' of {of}"
            )

    def __str__(self) -> str:
        w = self.weights
        cables = ", ".join(map(str, np.unique(w.cable)))
        how = "as stated" if self.stated == self.noise else "estimated"
        return (
            f"run '{w.run}': {len(w)} readings of {w.of} under dead weights ({w.mass.min():g} to"
            f" {w.mass.max():g} kg on cable{'s' * (len(np.unique(w.cable)) > 1)} {cables}), noise"
            f" {self.noise:.2g} N, {how}; what these cells read is known to {self.known:.2g} N then"
        )


@dataclass(frozen=True, eq=False)
class WeighedCells:
    """What dead weights leave of the calibration parameters that they tell of."""

    places: tuple[Place, ...]
    """Of the parameters, one after the other."""
    sizes: tuple[int, ...]
    value: Array
    """Shape (k,)."""
    covariance: Array
    """Zero for exact ones, shape (k, k)."""
    tables: tuple[WeighedTable, ...]

    @property
    def each(self) -> Mapping[Place, tuple[Array, Array]]:
        """Value and 1-sigma of each parameter."""
        ends = np.cumsum(np.array(self.sizes, dtype=np.intp))[:-1]
        sigma = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        parts = zip(np.split(self.value, ends), np.split(sigma, ends), strict=True)
        return dict(zip(self.places, parts, strict=True))

    def of(self, places: Sequence[Place]) -> WeighedCells:
        """The same of some of the parameters, in this order."""
        starts = np.concatenate([[0], np.cumsum(self.sizes)])
        own = [self.places.index(place) for place in places]
        parts = [np.arange(starts[i], starts[i + 1]) for i in own]
        use = np.concatenate([np.zeros(0), *parts]).astype(np.intp)
        return replace(
            self,
            places=tuple(places),
            sizes=tuple(self.sizes[i] for i in own),
            value=self.value[use],
            covariance=self.covariance[np.ix_(use, use)],
        )

    @property
    def wrong(self) -> tuple[WrongWeight, ...]:
        """Rows that were left out."""
        return tuple(row for table in self.tables for row in table.wrong)

    @property
    def reasons(self) -> list[str]:
        """Why not to rely on them."""
        return [text for table in self.tables for text in table.reasons]
