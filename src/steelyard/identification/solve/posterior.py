"""What an estimator knows after it has seen an experiment: the value that estimates, verdicts,
bounds, predictions and reports are drawn from.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.dynamics import platform_wrench
from steelyard.estimates.estimate import identifiable_parameters, plausible_radius
from steelyard.experiment.model import Experiment, Load
from steelyard.identification.known_body import known_bodies
from steelyard.identification.model.balance import Forces
from steelyard.identification.model.calibration_parameters import CalibrationValues, Key, gather
from steelyard.identification.model.fitted_motion import FittedMotion
from steelyard.identification.model.sources import Source
from steelyard.identification.samples.prepared import Samples
from steelyard.identification.solve.border.normal_equations import (
    Blocks,
    BorderEquations,
    BorderPrior,
    FurtherLoad,
    Solution,
    summed,
)
from steelyard.identification.solve.bound import Bound, bound_of
from steelyard.identification.solve.fit_state import Fit
from steelyard.identification.solve.misfits.slack_cables import SlackCables
from steelyard.inertia import TEN, body_jacobian

T = TypeVar("T")
Progress = Callable[[str, float], None] | None
"""Is called with what is being done and the fraction that is done."""


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
    slack: tuple[SlackCables, ...] = ()
    """Cables that may hang slack for a while, of runs without forces that have such ones."""
    notes: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()
    """Instruments that were left out, since the fit did not arrive with them."""
    further_loads: tuple[FurtherLoad, ...] = ()
    """Those of the experiment but the first."""
    by_source: Mapping[Source, Array] = field(default_factory=dict)
    """Quantity -> part of the normal matrix that its readings bring, shape (k, k); the rest is what
    is known of how a motion goes."""
    load: Load | None = None
    """The one that it is seen from, see :meth:`of_load`; None: there is one body, or the first."""
    _kept: dict[str, tuple[object, Any]] = field(init=False, default_factory=dict)
    """See :meth:`once`."""

    def once(self, name: str, settings: object, make: Callable[[], T]) -> T:
        """What takes a while to find out and is asked for more than once.

        Args:
            name: What it is.
            settings: By which it is found out.
            make: Finds it out.
        """
        if name not in self._kept or self._kept[name][0] != settings:
            self._kept[name] = settings, make()
        return cast(T, self._kept[name][1])

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
    def asked_for(self) -> frozenset[Key]:
        """Errors that were taken as none until the readings asked for them."""

        def found() -> frozenset[Key]:
            known = self.calibration.calibration_parameters
            return frozenset(known.believed_since(gather(self.experiment)))

        return self.once("asked for", None, found)

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

    @property
    def joint_change(self) -> Array:
        """How the linear parameters of each load follow the border of the first load's posterior,
        shape (l, 10, k).
        """
        count = 1 + len(self.further_loads)
        found = np.zeros((count, TEN, len(self.solution.value)))
        found[:, :, :TEN] = np.eye(TEN)
        for own, load in zip(found[1:], self.further_loads, strict=True):
            own[:, load.columns] = np.eye(TEN)
        return found

    def number_of_load(self, run: str) -> int:
        """Of that which a run carried: 0 is the first."""
        own = self.experiment.load_of(run)
        return 0 if own is None else self._number(own)

    @property
    def load_number(self) -> int:
        """Of the load that it is seen from."""
        return 0 if self.load is None else self._number(self.load)

    def _number(self, load: Load) -> int:
        """Of a load, by its name."""
        return [each.name for each in self.experiment.loads].index(load.name)

    def parameters_in(self, run: str) -> Array:
        """The ten linear parameters of what a run carried, shape (10,)."""
        if self.carries(run):
            return self.parameters
        state = self.fit.state
        assert state.parameters is not None
        return state.calibration.body(state.parameters, run)

    def carries(self, run: str) -> bool:
        """Whether a run carried the load that it is seen from."""
        own = self.experiment.load_of(run)
        return own is None or own is (self.load or self.experiment.loads[0])

    @property
    def of_its_runs(self) -> Experiment:
        """The experiment of the runs that carried the load that it is seen from."""
        loads = self.experiment.loads
        return self.experiment.alone(self.load or loads[0]) if loads else self.experiment

    def of_load(self, load: Load) -> Posterior:
        """The same posterior with another load in place of the first: nothing is fitted again.

        Args:
            load: One of those of the experiment.
        """
        if load is self.experiment.loads[0]:
            return self
        further = self.further_loads[self.experiment.loads.index(load) - 1]
        k = len(self.solution.value)
        change = further.change(k, further.columns)
        # Right-hand sides are of the ten as they are and of all else from where it was linearised.
        there = np.zeros(k)
        there[:TEN] = further.value

        def moved(normal: Array, right: Array) -> tuple[Array, Array]:
            other = change.T @ normal @ change
            return other, change.T @ right + other @ there

        back = np.linalg.inv(change)
        s = self.solution
        value = there + back @ s.value
        held, held_pull = moved(s.held, s.held_pull)
        solution = replace(
            s,
            value=value,
            covariance=back @ s.covariance @ back.T,
            gain=back @ s.gain @ back.T,
            projection=back @ s.projection @ back.T,
            noise_part=back @ s.noise_part @ back.T,
            bias=back @ s.bias,
            held=held,
            held_pull=held_pull,
            wide=back @ s.wide,
            scores=change.T @ s.scores,
        )
        equations = {}
        for run, each in self.equations.items():
            noise = each.noise if self.experiment.load_of(run) is load else np.zeros((TEN, TEN))
            by_noise = None if each.by_noise is None else change.T @ each.by_noise @ change
            both = moved(each.normal, each.right)
            equations[run] = BorderEquations(*both, noise, each.freedom, by_noise)
        pairs = [moved(*each) for each in zip(self.blocks.normal, self.blocks.right, strict=True)]
        blocks = Blocks(
            np.array([normal for normal, _ in pairs]).reshape(-1, k, k),
            np.array([right for _, right in pairs]).reshape(-1, k),
            self.blocks.run,
            self.blocks.since,
        )
        known = self.experiment.of_load(load)
        return replace(
            self,
            experiment=known,
            equations=equations,
            prior=BorderPrior(*moved(self.prior.precision, self.prior.pull)),
            solution=solution,
            blocks=blocks,
            by_source={s: change.T @ each @ change for s, each in self.by_source.items()},
            bound=bound_of(solution),
            load=load,
        )

    def unexplained(self, samples: Samples) -> Array:
        """Wrench that the body does not explain [N], [N m], shape (n, 6)."""
        moves = platform_wrench(
            self.parameters_in(samples.run), samples.specific_force, samples.omega, samples.alpha
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
    precision = np.zeros((k, k))
    precision[TEN:, TEN:] = known.precision
    off = known.mean - calibration.values
    pull = np.concatenate([np.zeros(TEN), known.precision @ off])
    for each in known_bodies(experiment, calibration, parameters, size):
        own = each.columns(TEN + np.arange(len(known), dtype=np.intp))
        for rows in own:
            pull[rows] += each.gradient + each.precision @ parameters
            for columns in own:
                precision[np.ix_(rows, columns)] += each.precision
    return BorderPrior(precision, pull)
