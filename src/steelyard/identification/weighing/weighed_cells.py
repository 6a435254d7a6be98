r"""What dead weights tell of force sensors: gains and offsets, with the gravity that pulled.

The readings of a table and what is known of the sensors beforehand are one small least-squares
problem, :math:`f = h(\text{gains}, \text{offsets}, m g)` with h the sensors' own measurement
equation. Its solution with its covariance takes the place of that knowledge, so that all methods,
the bound and the calibration start from it.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from steelyard.arrays import Array
from steelyard.experiment.model import Experiment
from steelyard.identification.weighing.cell_problem import CellProblem, Place
from steelyard.identification.weighing.noise_and_rows import (
    first_noise,
    scatter,
    without_wrong,
    wrong_rows,
)
from steelyard.identification.weighing.tables import WeighedCells, WeighedTable
from steelyard.instruments.weight import SCALE


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
    problem = CellProblem.of(experiment, gravity, prior)
    levels = [first_noise(each) for each in experiment.weights]
    use, (found, levels, freedom) = without_wrong(problem, levels)
    larger = [
        scatter(each, found, own, k)
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
                tuple(wrong_rows(problem, found, k, use[k])),
                tuple(problem.moved(found, each)),
            )
            for k, each in enumerate(experiment.weights)
        ),
    ).of([place for place in problem.told(found.value) if place[1] != SCALE])
