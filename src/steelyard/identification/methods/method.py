"""What a method of estimation is: an experiment in, an estimate out, settings as fields.

Most methods fit first and estimate then: a :data:`Fit` takes the experiment to a posterior, which
several methods may share, and each draws its own estimate from it.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import ClassVar, Protocol

from steelyard.estimates.estimate import Estimate, no_estimate
from steelyard.experiment.equivalent.platform_frame import centred, near
from steelyard.experiment.model import Experiment
from steelyard.identification.methods.fall_back import fit_that_arrives
from steelyard.identification.methods.loads import drawn
from steelyard.identification.solve.beginning.begin import NoBalanceError
from steelyard.identification.solve.between_fits.finer_knots import follows
from steelyard.identification.solve.held_motion import fit_with_held_motion
from steelyard.identification.solve.posterior import Posterior, Progress
from steelyard.identification.solve.settings import FIT, FitSettings
from steelyard.identification.verdict.resonance import resonance
from steelyard.identification.verdict.settings import VERDICT, VerdictSettings

Fit = Callable[[Experiment, Progress], Posterior]
"""From an experiment to what estimates are drawn from; equal ones give the same. It is told in the
platform frame of :func:`.centred` or of :func:`.near`."""


class Method(Protocol):
    """A method with its settings."""

    @property
    def name(self) -> str:
        """By which it is chosen, and under which its estimate is kept."""

    @property
    def fit(self) -> Fit | None:
        """What its estimate is drawn from; methods with the same one share it; None: the method
        stands alone.
        """

    @property
    def is_baseline(self) -> bool:
        """Whether it stands beside better ones, so that it need not succeed."""

    def lack(self, experiment: Experiment) -> str:
        """What the method needs and the experiment has not, in words, where that takes no fit to
        see; empty where all is there.
        """

    def __call__(self, experiment: Experiment, progress: Progress = None) -> Estimate:
        """Estimate the ten parameters; without numbers, and with a reason, where that fails."""

    def drawn(self, posterior: Posterior) -> Estimate:
        """Estimate from a posterior of its :attr:`fit`, with those of all loads where there are
        several.
        """


@dataclass(frozen=True, kw_only=True)
class PosteriorMethod(ABC):
    """A method whose estimate is drawn from a posterior.

    A method of its own has a :attr:`name` and says in :meth:`of` how it estimates; where the
    motion is not to be held, it has another :attr:`fit`, where it needs more than forces and
    motion, a :meth:`lack`.
    """

    settings: FitSettings = FIT
    """How to fit."""
    verdict: VerdictSettings = VERDICT
    """When to accept."""

    name: ClassVar[str]
    is_baseline: ClassVar[bool] = False

    @property
    def fit(self) -> Fit:
        """What the estimate is drawn from; methods with an equal one share its posterior."""
        return HeldMotion(self.settings)

    def lack(self, experiment: Experiment) -> str:
        """See :meth:`.Method.lack`."""
        return ""

    def __call__(self, experiment: Experiment, progress: Progress = None) -> Estimate:
        """Estimate; without numbers where there is no posterior.

        Raises:
            InputError: A run lacks what the method needs, or see :meth:`of`.
        """
        lack = self.lack(experiment)
        if lack:
            return no_estimate(self.name, lack)
        try:
            return self.drawn(self.fit(experiment, progress))
        except NoBalanceError as error:
            return no_estimate(self.name, str(error))

    @abstractmethod
    def of(self, posterior: Posterior) -> Estimate:
        """Estimate from a posterior of :attr:`fit`, in its platform frame."""

    def drawn(self, posterior: Posterior) -> Estimate:
        """The same in the platform frame as it was stated, with the estimates of all loads where
        there are several.
        """
        return drawn(self.of, posterior)


def by_processes(method: Method, jobs: int) -> Method:
    """The same method, with so many processes at the windows of a long recording where it has
    such.
    """
    if not isinstance(method, PosteriorMethod):
        return method
    return replace(method, settings=replace(method.settings, jobs=jobs))


@dataclass(frozen=True)
class JointMotion:
    """Motion, body and calibration at once; see :func:`.fit_that_arrives`.

    Where a part seems to move against the platform faster than the knots follow, it may be the
    platform as a whole, on its cables: the motion is followed as closely as that asks for, and
    where nothing seems to move then, that is what counts.
    """

    settings: FitSettings = FIT
    verdict: VerdictSettings = field(default=VERDICT, hash=False)

    def __call__(self, experiment: Experiment, progress: Progress = None) -> Posterior:
        """Posterior of an experiment; raises as :func:`.fit_that_arrives` does."""
        experiment = centred(experiment)
        found = fit_that_arrives(experiment, progress, settings=self.settings)
        moving = resonance(found, self.verdict)
        if moving is None or moving.name != "bends" or moving.frequency is None:
            return found
        if follows(found.fit.state, moving.frequency):
            return found
        closer = fit_that_arrives(
            experiment, progress, settings=self.settings, vibrating=moving.frequency
        )
        still = resonance(closer, self.verdict)
        return closer if closer.fit.converged and still is None else found


@dataclass(frozen=True)
class HeldMotion:
    """Body and calibration over a motion that is held; see :func:`.fit_with_held_motion`."""

    settings: FitSettings = FIT

    def __call__(self, experiment: Experiment, progress: Progress = None) -> Posterior:
        """Posterior of an experiment; raises as :func:`.fit_with_held_motion` does."""
        return fit_with_held_motion(near(experiment), progress, settings=self.settings)
