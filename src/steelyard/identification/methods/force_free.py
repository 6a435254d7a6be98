"""Centre of gravity and inertia per mass by regression on what cables cannot carry: a platform on
fewer than six locked cables swings, and the wrenches that move it are across all that the cables
could pull with.

The motion is filtered and differentiated first, and taken as exact: noise of the motion is in the
regressor, errors of the geometry are in nothing. It is the baseline that maximum likelihood is held
against.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from steelyard.arrays import Array
from steelyard.dynamics import platform_regressor
from steelyard.errors import InputError
from steelyard.estimates.estimate import (
    Estimate,
    judge,
    plausible_radius,
    plausible_sizes,
    unassessed,
)
from steelyard.experiment.model import Experiment
from steelyard.experiment.unread import is_unread
from steelyard.identification.methods.from_posterior.unweighed import up_to_mass
from steelyard.identification.methods.linear import block_sums, covariance_of, solve
from steelyard.identification.methods.settings import TWO_STEP, TwoStepSettings
from steelyard.identification.samples.preparation import Samples, prepare
from steelyard.identification.solve.posterior import Posterior, Progress
from steelyard.inertia import Inertia, body_jacobian

_BLOCK = 1.0
"""Stretches that are taken as independent of each other [s]: about a swing."""


@dataclass(frozen=True)
class ForceFree:
    """Regression on the wrenches that no cable can take up."""

    settings: TwoStepSettings = TWO_STEP
    """Thresholds of filter and fit."""

    name: ClassVar[str] = "force-free"
    fit: ClassVar[None] = None
    is_baseline: ClassVar[bool] = True

    def lack(self, experiment: Experiment) -> str:
        """What the method needs and the experiment has not, in words; empty where all is there."""
        if is_unread(experiment) and experiment.robot.m:
            return ""
        return (
            "it is for runs with locked winches and no forces, found runs with forces; use another"
            " method"
        )

    def drawn(self, posterior: Posterior) -> Estimate:
        """It draws from samples, not from a posterior."""
        return self(posterior.experiment)

    def __call__(self, experiment: Experiment, progress: Progress = None) -> Estimate:
        """Estimate.

        Raises:
            InputError: A run lacks what the method needs, or it has forces.
        """
        lack = self.lack(experiment)
        if lack:
            raise InputError(f"{self.name}: {lack}")
        mass, _ = experiment.known["mass"]
        size = plausible_radius(experiment.robot)
        regressors, targets, blocks = [], [], []
        for i, run in enumerate(experiment.runs):
            if progress:
                progress(f"{self.name}: {run.name}", i / len(experiment.runs))
            samples = prepare(experiment, run, straight=True, settings=self.settings.preparation)
            rows = _across(samples, size)
            regressors.append(rows[:, :, 1:])
            targets.append(-mass * rows[:, :, 0])
            step = float(np.median(np.diff(samples.time))) if len(samples) > 1 else _BLOCK
            blocks.append(max(1, round(_BLOCK / step)))
        scale = mass * np.array([*[size] * 3, *[size**2] * 6])
        found = solve(
            np.concatenate(regressors), np.concatenate(targets), scale, np.zeros(9), self.settings
        )
        parts = np.split(found.influence, np.cumsum([len(r) for r in regressors])[:-1])
        sums = np.concatenate([block_sums(p, b) for p, b in zip(parts, blocks, strict=True)])
        return self._estimate(experiment, found.value, covariance_of(sums), found.unknown)

    def _estimate(
        self, experiment: Experiment, value: Array, covariance: Array, unknown: Array
    ) -> Estimate:
        """Of first moment and inertia about the origin.

        Args:
            experiment: That they were made from.
            value: For the mass that is known or assumed, shape (9,).
            covariance: Theirs, shape (9, 9).
            unknown: Directions that the data do not tell, shape (9, k).
        """
        (mass, sigma), size = experiment.known["mass"], plausible_radius(experiment.robot)
        linear = np.concatenate([[mass], value])
        spread = np.zeros((10, 10))
        spread[1:, 1:] = covariance
        # All are multiples of the mass.
        spread += np.outer(linear, linear) * (sigma / mass) ** 2
        J = body_jacobian(linear)
        own = Inertia.from_parameters(linear).body_parameters
        whole = J @ spread @ J.T
        sizes = plausible_sizes(mass, size)
        known = np.sqrt(np.maximum(np.diag(whole), 0.0)) < sizes / 2
        if unknown.size:
            lost = np.abs(J[:, 1:] @ unknown).max(axis=1) > 1e-6 * sizes
            known &= ~lost
        body = np.where(known, own, np.nan)
        whole = np.where(np.outer(known, known), (whole + whole.T) / 2, np.nan)
        estimate = Estimate(
            method=self.name,
            value=body,
            covariance=whole,
            verdict=unassessed(judge(body)),
        )
        return up_to_mass(experiment, estimate)


def _across(samples: Samples, size: float) -> Array:
    """Regressor of the body across what the cables can carry, shape (n, 6 - m, 10).

    Args:
        samples: Of a run.
        size: Torques over it are comparable with forces [m].
    """
    assert samples.structure is not None
    scale = np.array([1.0] * 3 + [1 / size] * 3)
    m = samples.structure.shape[2]
    Y = platform_regressor(samples.specific_force, samples.omega, samples.alpha)
    Q, _ = np.linalg.qr(scale[:, None] * samples.structure, mode="complete")
    return np.asarray(np.einsum("nij,nip->njp", Q[:, :, m:], scale[:, None] * Y))
