"""The joint estimator as a stream: what is known at every instant, in bounded memory."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from steelyard.estimates.estimate import Estimate
from steelyard.experiment.equivalent.platform_frame import centred
from steelyard.experiment.model import Experiment
from steelyard.identification.methods.consistent import Consistent
from steelyard.identification.methods.method import Fit, PosteriorMethod
from steelyard.identification.recursive.settings import RECURSIVE, RecursiveSettings
from steelyard.identification.solve.conclusion import sound
from steelyard.identification.solve.posterior import Posterior, Progress
from steelyard.identification.solve.settings import FIT, FitSettings


@dataclass(frozen=True)
class AsItArrives:
    """A recording taken chunk by chunk; see :func:`.follow`."""

    settings: FitSettings = FIT
    own: RecursiveSettings = RECURSIVE

    def __call__(self, experiment: Experiment, progress: Progress = None) -> Posterior:
        """Posterior of an experiment; raises as :func:`.follow` does."""
        from steelyard.identification.recursive.concluding import posterior_of
        from steelyard.identification.recursive.follow import follow

        def tell(what: str, fraction: float) -> None:
            if progress is not None:
                progress(f"recursive: {what}", fraction)

        def posterior() -> Posterior:
            *_, last = follow(centred(experiment), tell, self.settings, self.own)
            return posterior_of(last)

        return sound(posterior)


@dataclass(frozen=True)
class Recursive(PosteriorMethod):
    """The joint estimator chunk by chunk, as it would be while the robot moves."""

    recursion: RecursiveSettings = RECURSIVE
    """How the recursion goes."""

    name: ClassVar[str] = "recursive"

    @property
    def fit(self) -> Fit:
        """What the estimate is drawn from."""
        return AsItArrives(self.settings, self.recursion)

    def lack(self, experiment: Experiment) -> str:
        """A run in motion, where there is none, and one force instrument for all of them."""
        moving = [run for run in experiment.runs if not run.static]
        if len({experiment.force_instrument(run) for run in moving}) > 1:
            return (
                "it needs one force instrument in all runs in motion, found several, or runs"
                " without forces beside others; use maximum-likelihood"
            )
        if moving:
            return ""
        return "it needs a run in motion, found poses at rest alone; use maximum-likelihood"

    def of(self, posterior: Posterior) -> Estimate:
        """Estimate from a posterior of :attr:`fit`; raises as :meth:`.Consistent.of` does."""
        return Consistent(verdict=self.verdict).of(posterior, self.name)
