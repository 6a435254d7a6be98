"""An experiment, balanced: the value that estimates, verdicts, bounds and predictions are drawn
from.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.dynamics import platform_wrench
from steelyard.estimates.estimate import plausible_radius, told_by
from steelyard.experiment.model import Experiment, Run
from steelyard.identification.model.calibration_parameters import Calibration
from steelyard.identification.model.preparation import Samples
from steelyard.identification.solve.kinematic_fit import KinematicFit
from steelyard.identification.solve.normal_equations import (
    TEN,
    Blocks,
    Prior,
    Solution,
    Sums,
)
from steelyard.inertia import body_jacobian

Progress = Callable[[str, float], None] | None
Instruments = Callable[[Experiment, Run, Samples, Calibration], Samples | None]


@dataclass(frozen=True, eq=False)
class Study:
    """An experiment, balanced: everything that estimate, verdict and prediction are drawn from."""

    experiment: Experiment
    calibration: Calibration
    """After estimation."""
    kinematics: KinematicFit
    samples: tuple[Samples, ...]
    """Of all runs, with these systematic errors."""
    sigma: Mapping[str, Array]
    """Run -> 1-sigma of single force readings as used."""
    stated: bool
    """Whether the noise of the forces was stated."""
    sums: Mapping[str, Sums]
    """Run -> normal equations."""
    prior: Prior
    solution: Solution
    blocks: Blocks
    parameters: Array
    """The ten of :data:`steelyard.inertia.LINEAR_PARAMETERS`, shape (10,)."""
    weights: Mapping[str, Array]
    """Run -> weight of each sample."""
    residuals: Mapping[str, Array]
    """Run -> whitened residual of each sample, shape (n, 6)."""
    settled: bool
    """Whether the last round changed little."""
    held_out: frozenset[str] = frozenset()
    """Runs whose forces were not looked at."""
    part: Study | None = None
    """The part of a long recording that has told the errors of the motion instruments; None: all of
    it."""
    notes: tuple[str, ...] = ()

    @property
    def total(self) -> Sums:
        """Normal equations of all runs whose forces were looked at."""
        return sum_up([each for name, each in self.sums.items() if name not in self.held_out])

    def left_over(self, samples: Samples) -> Array:
        """Wrench that the body does not explain [N], [N m], shape (n, 6)."""
        moves = platform_wrench(
            self.parameters, samples.specific_force, samples.omega, samples.alpha
        )
        return np.asarray(samples.wrench - moves)

    @property
    def noise_factor(self) -> float:
        """By how much the variance of the residual exceeds that of the noise; 1 where it does
        not.
        """
        return max([1.0, *self.solution.inflation.values()])

    @property
    def size(self) -> float:
        """Plausible radius of the body [m]."""
        return plausible_radius(self.experiment.robot)

    @property
    def told(self) -> NDArray[np.bool_]:
        """Which of the ten body parameters the data tell, shape (10,)."""
        return told_by(float(self.parameters[0]), self.body_covariance, self.size)

    @property
    def body_covariance(self) -> Array:
        """Of the ten of :data:`steelyard.inertia.BODY_PARAMETERS`, shape (10, 10)."""
        J = body_jacobian(self.parameters)
        return np.asarray(J @ self.solution.covariance[:TEN, :TEN] @ J.T)


def plausible(parameters: Array, size: float) -> Array:
    """Plausible size of the ten linear parameters, shape (10,)."""
    mass = max(abs(float(parameters[0])), 1e-9)
    return np.array([mass, *[mass * size] * 3, *[mass * size**2] * 6])


def sum_up(sums: Sequence[Sums]) -> Sums:
    """Normal equations of several runs."""
    first, *others = sums
    for other in others:
        first = first + other
    return first
