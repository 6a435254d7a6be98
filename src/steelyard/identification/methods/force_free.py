"""Centre of gravity and inertia per mass by regression on what cables cannot carry: a platform on
fewer than six locked cables swings, and the wrenches that move it are across all that the cables
could pull with.

The motion is filtered and differentiated first, and taken as exact: noise of the motion is in the
regressor, errors of the geometry are in nothing. Moments at which a cable may hang slack are left
out. It is the baseline that maximum likelihood is held against.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from steelyard.errors import InputError
from steelyard.estimates.estimate import (
    Estimate,
    judge,
    plausible_radius,
    plausible_sizes,
    unassessed,
)
from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run
from steelyard.experiment.unread import is_unread
from steelyard.identification.methods.from_posterior.unweighed import up_to_mass
from steelyard.identification.methods.settings import TWO_STEP, TwoStepSettings
from steelyard.identification.methods.swing_regression import SwingRegression, swing_regression
from steelyard.identification.solve.misfits.slack_cables import SlackCables
from steelyard.identification.solve.posterior import Posterior, Progress
from steelyard.inertia import Inertia, body_jacobian


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

        def begun(run: Run, part: float) -> None:
            if progress:
                progress(f"{self.name}: {run.name}", part)

        found = swing_regression(experiment, begun, self.settings)
        estimate = self._estimate(experiment, found)
        return replace(estimate, notes=(*_left_out(found.slack), *estimate.notes))

    def _estimate(self, experiment: Experiment, found: SwingRegression) -> Estimate:
        """The body.

        Args:
            experiment: That it was made from.
            found: First moment and inertia about the origin.
        """
        (mass, sigma), size = experiment.known["mass"], plausible_radius(experiment.robot)
        linear = np.concatenate([[mass], found.value])
        spread = np.zeros((10, 10))
        spread[1:, 1:] = found.covariance
        # All are multiples of the mass.
        spread += np.outer(linear, linear) * (sigma / mass) ** 2
        J = body_jacobian(linear)
        own = Inertia.from_parameters(linear).body_parameters
        whole = J @ spread @ J.T
        sizes = plausible_sizes(mass, size)
        known = np.sqrt(np.maximum(np.diag(whole), 0.0)) < sizes / 2
        if found.unknown.size:
            lost = np.abs(J[:, 1:] @ found.unknown).max(axis=1) > 1e-6 * sizes
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


def _left_out(slack: Sequence[SlackCables]) -> Iterator[str]:
    """One sentence on all runs, for maximum likelihood says it of each."""
    parts = [f"{100 * each.left_out:.0f} % of run '{each.run}'" for each in slack]
    if parts:
        yield f"left out, since a cable pulls next to nothing or hangs slack: {', '.join(parts)}"
