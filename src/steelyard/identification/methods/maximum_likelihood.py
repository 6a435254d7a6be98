"""Everything at once, in continuous time: motion, body and every calibration parameter from the raw
readings of all instruments.

No resampling, no filter, no derivative of noise: the pose is a spline in time that all readings
look at, each at its own time by its own clock. Forces enter through the structure matrix, with the
internal tension free.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from steelyard.bodies.mass_region import Box, Ellipsoid
from steelyard.estimates.estimate import Estimate, no_estimate
from steelyard.experiment.model import Experiment
from steelyard.identification.methods.consistent import Consistent
from steelyard.identification.methods.method import JointMotion
from steelyard.identification.solve.beginning import NoBalanceError
from steelyard.identification.solve.posterior import Posterior, Progress
from steelyard.identification.solve.settings import FIT, FitSettings
from steelyard.identification.verdict.settings import VERDICT, VerdictSettings


@dataclass(frozen=True)
class MaximumLikelihood:
    """The joint estimator, over bodies that can exist."""

    regions: Sequence[Box | Ellipsoid] = ()
    """Where the mass lies: in all of them."""
    towards_nominal: bool = False
    """Whether to pull towards the nominal body, as far as that predicts the runs left out
    better."""

    settings: FitSettings = FIT
    """How to fit."""
    verdict: VerdictSettings = VERDICT
    """When to accept."""

    name: ClassVar[str] = "maximum-likelihood"
    is_baseline: ClassVar[bool] = False

    @property
    def fit(self) -> JointMotion:
        """What the estimate is drawn from."""
        return JointMotion(self.settings)

    def __call__(self, experiment: Experiment, progress: Progress = None) -> Estimate:
        """Estimate.

        Raises:
            InputError: A run lacks what the method needs, no body has its mass in the regions, or
                there is no nominal body to pull towards.
        """
        try:
            return self.of(self.fit(experiment, progress))
        except NoBalanceError as error:
            return no_estimate(self.name, str(error))

    def of(self, posterior: Posterior) -> Estimate:
        """Estimate from a posterior of :meth:`fit`; raises as a call does."""
        own = Consistent(self.regions, self.towards_nominal, self.settings, self.verdict)
        return own.of(posterior, self.name)
