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
from steelyard.estimates.estimate import Estimate
from steelyard.identification.methods.consistent import Consistent
from steelyard.identification.methods.method import Fit, JointMotion, PosteriorMethod
from steelyard.identification.solve.posterior import Posterior


@dataclass(frozen=True)
class MaximumLikelihood(PosteriorMethod):
    """The joint estimator, over bodies that can exist."""

    regions: Sequence[Box | Ellipsoid] = ()
    """Where the mass lies: in all of them."""
    towards_nominal: bool = False
    """Whether to pull towards the nominal body, as far as that predicts the runs left out
    better."""

    name: ClassVar[str] = "maximum-likelihood"

    @property
    def fit(self) -> Fit:
        """What the estimate is drawn from."""
        return JointMotion(self.settings, self.verdict)

    def of(self, posterior: Posterior) -> Estimate:
        """Estimate from a posterior of :attr:`fit`; raises as :meth:`.Consistent.of` does."""
        own = Consistent(self.regions, self.towards_nominal, verdict=self.verdict)
        return own.of(posterior, self.name)
