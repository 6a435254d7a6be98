"""What an estimator knows after it has seen an experiment: the value that estimates, verdicts,
bounds, predictions and reports are drawn from.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.dynamics import platform_wrench
from steelyard.estimates.estimate import identifiable_parameters, plausible_radius, plausible_sizes
from steelyard.experiment.model import Experiment
from steelyard.identification.model.balance import Forces
from steelyard.identification.model.calibration_parameters import CalibrationValues
from steelyard.identification.model.fitted_motion import FittedMotion
from steelyard.identification.model.sources import Source
from steelyard.identification.samples.preparation import Samples
from steelyard.identification.solve.bound import Bound
from steelyard.identification.solve.fit_state import Fit
from steelyard.identification.solve.normal_equations import (
    Blocks,
    BorderEquations,
    BorderPrior,
    Solution,
    summed,
)
from steelyard.inertia import BODY_PARAMETERS, TEN, Inertia, body_jacobian
from steelyard.natural_frequencies.information import frequency_information

Progress = Callable[[str, float], None] | None
"""Is called with what is being done and the fraction that is done."""
EXACT = 1e-6
"""1-sigma of what is known exactly, as a part of its plausible size."""
_LARGEST = 3.0
"""1-sigma of the body before any reading, in parts of its plausible size: it moves what the data
tell to half of that size by less than .06 of a sigma."""


@dataclass(frozen=True, eq=False)
class Posterior:
    """An experiment after a fit."""

    experiment: Experiment
    fit: Fit
    """Where it ended: motion, calibration, noise."""
    force_samples: tuple[Forces, ...]
    """Of each segment of the fit, with what was left out."""
    samples: tuple[Samples, ...]
    """Of all runs, at the times of the force readings."""
    motion_ratios: Mapping[Source, float]
    """Residuals of each quantity of the motion instruments in units of its stated noise, root mean
    square; about 1 where the noise is as stated."""
    motion_converged: bool
    """Whether the motion instruments agree on a motion."""
    stated: bool
    """Whether the noise of the forces was stated."""
    equations: Mapping[str, BorderEquations]
    """Run -> normal equations."""
    prior: BorderPrior
    solution: Solution
    blocks: Blocks
    bound: Bound
    """What can be known at best, if all noise is as it was taken."""
    weights: Mapping[str, Array]
    """Run -> weight of each sample."""
    motion: tuple[FittedMotion, ...]
    """Of each stretch of the runs in motion."""
    contacts: Mapping[str, tuple[tuple[float, float], ...]]
    """Run -> stretches in which something touched the platform [s]."""
    spikes: Mapping[str, int]
    """Run -> force readings that stood alone."""
    held_out: frozenset[str] = frozenset()
    """Runs whose forces were not looked at."""
    notes: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()
    """Instruments that were left out, since the fit did not arrive with them."""

    @property
    def by_contradiction(self) -> list[str]:
        """Motion instruments, the one that departs most from the motion that all show first; none
        where there is only one.
        """
        names = motion_instruments(self.experiment)
        return sorted(names, key=lambda name: -self.departure(name)) if len(names) > 1 else []

    def departure(self, name: str) -> float:
        """By how much an instrument departs from that motion, in its noise."""
        ratios = self.motion_ratios.items()
        return max((ratio for (owner, _), ratio in ratios if owner == name), default=0.0)

    @property
    def calibration(self) -> CalibrationValues:
        """Values of the calibration parameters, as estimated."""
        return self.fit.state.calibration

    @property
    def parameters(self) -> Array:
        """The ten of :data:`steelyard.inertia.LINEAR_PARAMETERS`, shape (10,)."""
        return self.solution.value[:TEN]

    @property
    def deviations(self) -> Array:
        """1-sigma of all calibration parameters, shape (u,)."""
        return np.asarray(np.sqrt(np.maximum(np.diag(self.solution.covariance)[TEN:], 0.0)))

    @property
    def total(self) -> BorderEquations:
        """Normal equations of all runs."""
        return summed(list(self.equations.values()))

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
    def identifiable(self) -> NDArray[np.bool_]:
        """Which of the ten body parameters the data tell, shape (10,)."""
        return identifiable_parameters(float(self.parameters[0]), self.body_covariance, self.size)

    @property
    def told(self) -> NDArray[np.bool_]:
        """Those of them that are no assumption, shape (10,)."""
        assumed = np.arange(TEN) == 0
        return np.asarray(self.identifiable & ~(assumed & self.experiment.mass_assumed))

    @property
    def body_covariance(self) -> Array:
        """Of the ten of :data:`steelyard.inertia.BODY_PARAMETERS`, shape (10, 10)."""
        J = body_jacobian(self.parameters)
        return np.asarray(J @ self.solution.covariance[:TEN, :TEN] @ J.T)

    def unexplained(self, samples: Samples) -> Array:
        """Wrench that the body does not explain [N], [N m], shape (n, 6)."""
        moves = platform_wrench(
            self.parameters, samples.specific_force, samples.omega, samples.alpha
        )
        return np.asarray(samples.wrench - moves)


def motion_instruments(experiment: Experiment) -> list[str]:
    """Those that have recorded how the platform moves."""
    return [
        name
        for name, each in experiment.instruments.items()
        if (each.is_motion or each.is_cable_motion)
        and any(name in run.streams for run in experiment.runs)
    ]


def plausible(parameters: Array, size: float) -> Array:
    """Plausible size of the ten linear parameters, shape (10,)."""
    mass = max(abs(float(parameters[0])), 1e-9)
    return np.array([mass, *[mass * size] * 3, *[mass * size**2] * 6])


def prior_of(
    experiment: Experiment, calibration: CalibrationValues, parameters: Array, size: float
) -> BorderPrior:
    """What is known beforehand about the calibration parameters, and what the user knows about the
    body.

    Args:
        experiment: With what is known.
        calibration: Values from which the border's columns are counted.
        parameters: The ten about which what is known is linearised, shape (10,).
        size: Plausible radius of the body [m].
    """
    known = calibration.calibration_parameters
    k = TEN + len(known)
    free = known.deviation > 0
    weight = np.where(free, 1 / np.where(free, known.deviation, 1.0) ** 2, 0.0)
    precision = np.zeros((k, k))
    precision[TEN:, TEN:] = np.diag(weight)
    pull = np.concatenate([np.zeros(TEN), weight * (known.mean - calibration.values)])
    of_body, toward = known_body(experiment, parameters, size)
    precision[:TEN, :TEN] += of_body
    pull[:TEN] += toward
    return BorderPrior(precision, pull)


def known_body(experiment: Experiment, parameters: Array, size: float) -> tuple[Array, Array]:
    """Precision of what is known about the body beforehand, and its pull, shapes (10, 10) and
    (10,).

    That it is not much larger than its robot, what natural frequencies tell that somebody has seen, and
    what the user knows. Without the former an
    inertia that the data do not tell may grow until unseen vibrations explain all torques with it.
    """
    sizes = plausible(parameters, size)
    precision, pull = np.diag((_LARGEST * sizes) ** -2), np.zeros(TEN)
    seen = frequency_information(experiment, parameters, sizes)
    if seen is not None:
        of_seen, toward = seen.about()
        precision, pull = precision + of_seen, pull + toward
    if not experiment.known:
        return precision, pull
    body = Inertia.from_parameters(parameters).body_parameters
    J = body_jacobian(parameters)
    own = plausible_sizes(float(parameters[0]), size)
    for name, (value, sigma) in experiment.known.items():
        i = BODY_PARAMETERS.index(name)
        deviation = max(sigma, EXACT * own[i])
        row = J[i] / deviation
        precision += np.outer(row, row)
        pull += row * ((value - body[i]) / deviation + row @ parameters)
    return precision, pull
