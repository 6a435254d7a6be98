"""All ten parameters at once, weighted by what the noise of every sensor does to the balance of
wrenches.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from steelyard.estimates.estimate import Estimate
from steelyard.identification.methods.from_posterior.finished import finished
from steelyard.identification.methods.method import PosteriorMethod
from steelyard.identification.solve.posterior import Posterior


@dataclass(frozen=True)
class LeastSquares(PosteriorMethod):
    """Generalised least squares over the motion that its instruments give, with priors on every
    calibration parameter, corrected for noise in the regressor.
    """

    name: ClassVar[str] = "least-squares"

    def of(self, posterior: Posterior) -> Estimate:
        """Estimate from a posterior of :attr:`fit`."""
        return finished(posterior, self.name, settings=self.verdict)
