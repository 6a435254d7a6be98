"""All ten parameters at once, weighted by what the noise of every sensor does to the balance of
wrenches.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from steelyard.estimates.estimate import Estimate, no_estimate
from steelyard.experiment.model import Experiment
from steelyard.identification.methods.finished import finished
from steelyard.identification.methods.method import HeldMotion
from steelyard.identification.solve.beginning import NoBalanceError
from steelyard.identification.solve.posterior import Posterior, Progress
from steelyard.identification.solve.settings import FIT, FitSettings
from steelyard.identification.verdict.settings import VERDICT, VerdictSettings


@dataclass(frozen=True)
class LeastSquares:
    """Generalised least squares over the motion that its instruments give, with priors on every
    calibration parameter, corrected for noise in the regressor.
    """

    settings: FitSettings = FIT
    """How to fit."""
    verdict: VerdictSettings = VERDICT
    """When to accept."""

    name: ClassVar[str] = "least-squares"
    is_baseline: ClassVar[bool] = False

    @property
    def fit(self) -> HeldMotion:
        """What the estimate is drawn from."""
        return HeldMotion(self.settings)

    def __call__(self, experiment: Experiment, progress: Progress = None) -> Estimate:
        """Estimate.

        Raises:
            InputError: A run lacks what the method needs.
        """
        try:
            return self.of(self.fit(experiment, progress))
        except NoBalanceError as error:
            return no_estimate(self.name, str(error))

    def of(self, posterior: Posterior) -> Estimate:
        """Estimate from a posterior of :meth:`fit`."""
        return finished(posterior, self.name, settings=self.verdict)
