"""Noise of readings under dead weights, as stated or as residuals show it, and rows that contradict
all others.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError
from steelyard.estimates.quantiles import chi2_tail, normal_tail, student_tail
from steelyard.experiment.observations import DeadWeights
from steelyard.identification.weighing.cell_problem import CellProblem, Solved
from steelyard.identification.weighing.tables import WrongWeight

_LEVELS, _SAME = 100, 1e-3
"""Most changes of a noise that is not stated, and the last one as a part."""
_FIRST, _LEAST = 1e-3, 1e-6
"""A noise that is not stated to begin with, and at least, over the largest reading."""
_FREEDOM = 3.0
"""Degrees of freedom that are left where a noise can be told: its mean square has no finite mean
from two downward."""
_WRONG, _CHANCE = 5.0, 1e-4
"""Residual of a row about all others, in 1-sigma, and probability of it among all rows, from which
on the row is wrong."""
_MOST_WRONG = 0.15
"""Part of the rows that may be left out as wrong: with more it is no row, but what is said of
all."""
_LARGER = 1e-3
"""Probability of a scatter below which the noise is not as stated."""


class Levelled(NamedTuple):
    """The solution with the noise that it was found with."""

    solved: Solved
    levels: list[float]
    """1-sigma of a reading of each table [N]."""
    freedom: list[float]
    """Degrees of freedom that are left to each."""


def first_noise(weights: DeadWeights) -> float:
    """1-sigma of its readings to begin with [N]."""
    return weights.description.noise or _FIRST * _largest(weights)


def _largest(weights: DeadWeights) -> float:
    return float(np.nanmax(np.abs(weights.reading), initial=1e-9))


def _with_levels(
    problem: CellProblem, use: Sequence[NDArray[np.bool_]], levels: Sequence[float]
) -> Levelled:
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
    return Levelled(found, levels, freedom)


def _enough(weights: DeadWeights) -> int:
    """Rows that tell gain and offset of every cell, and the noise."""
    return 2 * len(np.unique(weights.cable)) + int(_FREEDOM) + 1


def without_wrong(
    problem: CellProblem, levels: Sequence[float]
) -> tuple[list[NDArray[np.bool_]], Levelled]:
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
    problem: CellProblem, found: Levelled, use: Sequence[NDArray[np.bool_]]
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


def wrong_rows(
    problem: CellProblem, found: Solved, table: int, use: NDArray[np.bool_]
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


def scatter(weights: DeadWeights, found: Solved, use: NDArray[np.bool_], table: int) -> float:
    """Mean square of residuals over that of a stated noise; 1 within chance, and where it is not
    stated.
    """
    stated = weights.description.noise
    freedom = float(use.sum() - found.leverage[table].sum())
    if not stated or freedom < 1:
        return 1.0
    square = float(np.sum((found.residual[table][use] / stated) ** 2))
    return square / freedom if chi2_tail(square, freedom) < _LARGER else 1.0
