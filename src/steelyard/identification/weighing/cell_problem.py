"""Readings under dead weights and what is known of the sensors beforehand, as one least-squares
problem.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.experiment.model import Experiment
from steelyard.experiment.observations import DeadWeights
from steelyard.instruments.weight import SCALE, cells_under_weights

Place = tuple[str, str, str | None]
"""Owner, key and run of a calibration parameter."""
_TURNS, _ARRIVED = 50, 1e-6
"""Most steps, and the last one in 1-sigma."""
_FAR_OFF = 5.0
"""Move of a gain or offset, in what its 1-sigma beforehand allows, that nobody would have stated
so."""


class Solved(NamedTuple):
    """The least-squares solution."""

    value: Array
    """Shape (k,)."""
    covariance: Array
    """Shape (k, k)."""
    residual: tuple[Array, ...]
    """Measured less predicted of each table [N], shape (n,)."""
    leverage: tuple[Array, ...]
    """Part of each reading that explains itself, shape (n,)."""


@dataclass(frozen=True, eq=False)
class CellProblem:
    """All tables and all that is known beforehand."""

    experiment: Experiment
    gravity: Place
    places: tuple[Place, ...]
    sizes: tuple[int, ...]
    mean: Array
    """Shape (k,)."""
    deviation: Array
    """1-sigma, shape (k,)."""

    @classmethod
    def of(
        cls, experiment: Experiment, gravity: Place, prior: Mapping[Place, tuple[Array, Array]]
    ) -> CellProblem:
        """Of the tables of an experiment, each set of weights with a scale of its own."""
        whole = dict(prior)
        for each in experiment.weights:
            for term in each.description.terms(experiment.robot.m):
                deviation = term.deviation
                assert deviation is not None  # a set of weights has no errors from the data
                whole[each.instrument, term.key, None] = term.mean, deviation
        return cls(
            experiment,
            gravity,
            tuple(whole),
            tuple(len(mean) for mean, _ in whole.values()),
            np.concatenate([mean for mean, _ in whole.values()]),
            np.concatenate([deviation for _, deviation in whole.values()]),
        )

    def place(self, place: Place) -> slice:
        """Where a parameter stands; one that is the same in all runs by its name alone."""
        own = place if place in self.places else (*place[:2], None)
        i = self.places.index(own)
        start = sum(self.sizes[:i])
        return slice(start, start + self.sizes[i])

    def told(self, value: Array) -> list[Place]:
        """Parameters that a reading depends on and that are not exact."""
        slopes = [self.predicted(each, value)[1] for each in self.experiment.weights]
        moves = np.abs(np.concatenate(slopes)).sum(axis=0) * self.deviation > 0
        return [place for place in self.places if moves[self.place(place)].any()]

    def predicted(self, weights: DeadWeights, value: Array) -> tuple[Array, Array]:
        """Readings of a table [N], shape (n,), and their derivatives, shape (n, k)."""
        robot = self.experiment.robot
        cells = self.experiment.instruments[weights.of]
        own = [self.place((weights.of, t.key, weights.run)) for t in cells.terms(robot.m)]
        columns = np.concatenate([np.arange(each.start, each.stop) for each in own])
        g = value[self.place(self.gravity)]
        scale = self.place((weights.instrument, SCALE, None))
        size, factor = float(np.linalg.norm(g)), float(value[scale][0])
        rows, cell = np.arange(len(weights)), weights.cable - 1
        pull = np.zeros((len(weights), robot.m))
        pull[rows, cell] = factor * weights.mass * size
        read = cells_under_weights(cells, robot)(pull=pull, errors=value[columns])
        by_pull = read["by_pull"][rows, cell, cell]
        slopes = np.zeros((len(weights), len(value)))
        slopes[:, columns] = read["by_errors"][rows, cell]
        slopes[:, scale] += (by_pull * weights.mass * size)[:, None]
        along = by_pull * factor * weights.mass
        slopes[:, self.place(self.gravity)] += along[:, None] * g / size
        return read["reading"][rows, cell], slopes

    def solved(
        self, use: Sequence[NDArray[np.bool_]], levels: Sequence[float], start: Array
    ) -> Solved:
        """By Gauss and Newton, in units of the 1-sigma beforehand.

        Args:
            use: Rows of each table, shape (n,).
            levels: 1-sigma of their readings [N].
            start: Where to begin, shape (k,).
        """
        value, free = start.copy(), self.deviation > 0
        for _ in range(_TURNS):
            parts = [self.predicted(each, value) for each in self.experiment.weights]
            off = [
                each.reading - seen
                for each, (seen, _) in zip(self.experiment.weights, parts, strict=True)
            ]
            white = [
                slopes[own][:, free] * self.deviation[free] / level
                for (_, slopes), own, level in zip(parts, use, levels, strict=True)
            ]
            A = np.concatenate(white)
            e = np.concatenate([o[u] / s for o, u, s in zip(off, use, levels, strict=True)])
            covariance = np.linalg.inv(np.eye(int(free.sum())) + A.T @ A)
            pull = ((self.mean - value) / np.where(free, self.deviation, 1.0))[free]
            step = covariance @ (A.T @ e + pull)
            if float(np.abs(step).max(initial=0.0)) < _ARRIVED:
                break
            value[free] += self.deviation[free] * step
        whole = np.zeros((len(value), len(value)))
        sigma = self.deviation[free]
        whole[np.ix_(free, free)] = sigma[:, None] * (covariance + covariance.T) / 2 * sigma
        own = [np.einsum("ni,ij,nj->n", each, covariance, each) for each in white]
        return Solved(value, whole, tuple(off), tuple(own))

    def moved(self, found: Solved, weights: DeadWeights) -> Iterator[str]:
        """Parameters of a table's cells that came out far from what was stated of them, the
        farthest first.
        """
        far = []
        for term in self.experiment.instruments[weights.of].terms(self.experiment.robot.m):
            own = self.place((weights.of, term.key, weights.run))
            told = self.deviation[own] ** 2 - np.diag(found.covariance)[own]
            off = found.value[own] - self.mean[own]
            for i in np.flatnonzero(off**2 > _FAR_OFF**2 * np.maximum(told, 1e-300)):
                unit = "" if term.unit == "1" else f" {term.unit}"
                where = f" of cable {i + 1}" if term.size > 1 else ""
                said = (
                    f"{weights.of}.{term.key}{where} is {found.value[own][i]:.4g}{unit}, stated as"
                    f" {self.mean[own][i]:.4g} ± {self.deviation[own][i]:.2g}{unit}"
                )
                far.append((float(off[i] ** 2 / told[i]), said))
        yield from (said for _, said in sorted(far, reverse=True))
