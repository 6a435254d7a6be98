r"""What dead weights tell of force sensors: gains and offsets, with the gravity that pulled.

The readings of a table and what is known of the sensors beforehand are one small least-squares
problem, :math:`f = h(\text{gains}, \text{offsets}, m g)` with h the sensors' own measurement
equation. Its solution with its covariance takes the place of that knowledge, so that all methods,
the bound and the calibration start from it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.errors import InputError
from steelyard.estimates.quantiles import chi2_tail, normal_tail, student_tail
from steelyard.experiment.model import Experiment
from steelyard.experiment.observations import DeadWeights
from steelyard.instruments.weight import SCALE, cells_under_weights

Place = tuple[str, str, str | None]
"""Owner, key and run of a calibration parameter."""
_TURNS, _ARRIVED = 50, 1e-6
"""Most steps, and the last one in 1-sigma."""
_LEVELS, _SAME = 100, 1e-3
"""The same of a noise that is not stated, and its last change as a part."""
_FIRST, _LEAST = 1e-3, 1e-6
"""A noise that is not stated to begin with, and at least, over the largest reading."""
_FREEDOM = 3.0
"""Degrees of freedom that are left where a noise can be told: its mean square has no finite mean
from two downward."""
_WRONG, _CHANCE = 5.0, 1e-4
"""Residual of a row about all others, in 1-sigma, and probability of it among all rows, from which
on the row is wrong."""
_MOST_WRONG = 0.15
"""Part of the rows that may be left out as wrong: with more it is no row, but what is said of all."""
_LARGER = 1e-3
"""Probability of a scatter below which the noise is not as stated."""
_FAR_OFF = 5.0
"""Move of a gain or offset, in what its 1-sigma beforehand allows, that nobody would have stated so."""


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
                f"dead weights say that {self.moved[0]}{more}; check the weights and units, or state a"
                f" larger 1-sigma under 'calibration' of {of}"
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


def weighed_cells(
    experiment: Experiment, gravity: Place, prior: Mapping[Place, tuple[Array, Array]]
) -> WeighedCells:
    """What dead weights tell of force sensors, beside what is known of them.

    Args:
        experiment: With at least one table of dead weights.
        gravity: Which parameter the gravity is.
        prior: Parameter -> value and 1-sigma known beforehand: gravity, and all terms of the force
            instruments that tables are about; those that are per run also in the run of a table.

    Raises:
        InputError: The noise of a table is not stated, and its rows are too few to show it.
    """
    problem = _CellProblem.of(experiment, gravity, prior)
    levels = [_first_noise(each) for each in experiment.weights]
    use, (found, levels, freedom) = _without_wrong(problem, levels)
    larger = [
        _scatter(each, found, own, k)
        for k, (each, own) in enumerate(zip(experiment.weights, use, strict=True))
    ]
    # What is estimated from few rows may be more than it seems.
    factors = [
        1.0 if each.description.noise and ratio == 1 else ratio * left / max(left - 2, 1.0)
        for each, ratio, left in zip(experiment.weights, larger, freedom, strict=True)
    ]
    if max(factors) > 1:
        levels = [s * float(np.sqrt(f)) for s, f in zip(levels, factors, strict=True)]
        found = problem.solved(use, levels, found.value)
    return WeighedCells(
        problem.places,
        problem.sizes,
        found.value,
        found.covariance,
        tuple(
            WeighedTable(
                each,
                levels[k],
                each.description.noise or None,
                larger[k],
                levels[k] * float(np.sqrt(found.leverage[k].max())),
                tuple(_wrong_rows(problem, found, k, use[k])),
                tuple(problem.moved(found, each)),
            )
            for k, each in enumerate(experiment.weights)
        ),
    ).of([place for place in problem.told(found.value) if place[1] != SCALE])


class _Solved(NamedTuple):
    """The least-squares solution."""

    value: Array
    """Shape (k,)."""
    covariance: Array
    """Shape (k, k)."""
    residual: tuple[Array, ...]
    """Measured less predicted of each table [N], shape (n,)."""
    leverage: tuple[Array, ...]
    """Part of each reading that explains itself, shape (n,)."""


class _Levelled(NamedTuple):
    """The solution with the noise that it was found with."""

    solved: _Solved
    levels: list[float]
    """1-sigma of a reading of each table [N]."""
    freedom: list[float]
    """Degrees of freedom that are left to each."""


@dataclass(frozen=True, eq=False)
class _CellProblem:
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
    ) -> _CellProblem:
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
    ) -> _Solved:
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
        return _Solved(value, whole, tuple(off), tuple(own))

    def moved(self, found: _Solved, weights: DeadWeights) -> Iterator[str]:
        """Parameters of a table's cells that came out far from what was stated of them, the farthest
        first.
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


def _first_noise(weights: DeadWeights) -> float:
    """1-sigma of its readings to begin with [N]."""
    return weights.description.noise or _FIRST * _largest(weights)


def _largest(weights: DeadWeights) -> float:
    return float(np.nanmax(np.abs(weights.reading), initial=1e-9))


def _with_levels(
    problem: _CellProblem, use: Sequence[NDArray[np.bool_]], levels: Sequence[float]
) -> _Levelled:
    """Solution with noise as stated, or as the residuals show it, what the unknowns have taken of
    these off it [MacKay1992]_.

    Raises:
        InputError: Too few are left to tell a noise that is not stated.
    """
    tables, levels = problem.experiment.weights, list(levels)
    found = problem.solved(use, levels, problem.mean)
    for _ in range(_LEVELS):
        before = list(levels)
        freedom = [
            float(own.sum() - spent.sum()) for own, spent in zip(use, found.leverage, strict=True)
        ]
        for k, each in enumerate(tables):
            if each.description.noise:
                continue
            if freedom[k] < _FREEDOM:
                raise InputError(
                    f"run '{each.run}': '{each.instrument}': expected 'noise' of the readings, or"
                    f" more rows to tell it (some {_enough(each)}), found {int(use[k].sum())} rows;"
                    " state it, or hang more weights"
                )
            square = float(found.residual[k][use[k]] @ found.residual[k][use[k]]) / freedom[k]
            levels[k] = max(float(np.sqrt(square)), _LEAST * _largest(each))
        if levels == before:
            break
        found = problem.solved(use, levels, found.value)
        if np.allclose(levels, before, rtol=_SAME, atol=0.0):
            break
    return _Levelled(found, levels, freedom)


def _enough(weights: DeadWeights) -> int:
    """Rows that tell gain and offset of every cell, and the noise."""
    return 2 * len(np.unique(weights.cable)) + int(_FREEDOM) + 1


def _without_wrong(
    problem: _CellProblem, levels: Sequence[float]
) -> tuple[list[NDArray[np.bool_]], _Levelled]:
    """Rows of each table that do not contradict all others, shape (n,), and the solution by them;
    where many do, it is no row, but what is said of all.
    """
    tables = problem.experiment.weights
    use = [np.isfinite(each.reading) for each in tables]
    whole = [each.copy() for each in use]
    first = found = _with_levels(problem, use, levels)
    while (worst := _worst(problem, found, use)) is not None:
        table, row = worst
        use[table][row] = False
        left_out = int((whole[table] & ~use[table]).sum())
        if left_out > max(1, int(_MOST_WRONG * len(tables[table]))):
            return whole, first
        found = _with_levels(problem, use, found.levels)
    return use, found


def _worst(
    problem: _CellProblem, found: _Levelled, use: Sequence[NDArray[np.bool_]]
) -> tuple[int, int] | None:
    """Table and row that stand farthest from all others, as they would not by chance; None: none
    does.
    """
    worst: tuple[int, int] | None = None
    least = _CHANCE / sum(int(own.sum()) for own in use)
    for k, weights in enumerate(problem.experiment.weights):
        stated = weights.description.noise or 0.0
        residual, rows = found.solved.residual[k][use[k]], np.flatnonzero(use[k])
        square = residual**2 / np.maximum(1 - found.solved.leverage[k], 1e-9)
        # As all other rows scatter, where that is more than was stated.
        others = max(found.freedom[k] - 1, 0.5)
        rest = np.sqrt(np.maximum(float(residual @ residual) - square, 0.0) / others)
        noise = np.maximum(rest, max(stated, _LEAST * _largest(weights)))
        z = np.sqrt(square) / noise
        chance = 2 * np.where(noise > stated, student_tail(z, others), normal_tail(z))
        i = int(np.argmin(np.where(z > _WRONG, chance, 1.0)))
        if z[i] > _WRONG and chance[i] < least:
            least, worst = float(chance[i]), (k, int(rows[i]))
    return worst


def _wrong_rows(
    problem: _CellProblem, found: _Solved, table: int, use: NDArray[np.bool_]
) -> Iterator[WrongWeight]:
    """Rows of a table that were left out, against the solution by all others."""
    weights, own = problem.experiment.weights[table], problem.place(problem.gravity)
    _, slopes = problem.predicted(weights, found.value)
    for row in np.flatnonzero(~use & np.isfinite(weights.reading)):
        mass, off = float(weights.mass[row]), float(found.residual[table][row])
        # Newtons of a kilogram: as this row has them, or without a weight as gravity has.
        pulled = float(slopes[row, own] @ found.value[own])
        each = pulled / mass if mass else float(np.linalg.norm(found.value[own]))
        cable = int(weights.cable[row])
        yield WrongWeight(weights.where(int(row)), cable, mass, off, mass + off / each)


def _scatter(weights: DeadWeights, found: _Solved, use: NDArray[np.bool_], table: int) -> float:
    """Mean square of residuals over that of a stated noise; 1 within chance, and where it is not
    stated.
    """
    stated = weights.description.noise
    freedom = float(use.sum() - found.leverage[table].sum())
    if not stated or freedom < 1:
        return 1.0
    square = float(np.sum((found.residual[table][use] / stated) ** 2))
    return square / freedom if chi2_tail(square, freedom) < _LARGER else 1.0
