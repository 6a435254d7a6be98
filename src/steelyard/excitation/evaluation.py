"""Evaluation of motions: how well the body will be known from them, and which limits of the robot
they use.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array
from steelyard.estimates.estimate import Estimate
from steelyard.excitation.information.linearisation_point import (
    LinearisationPoint,
    prior_information,
)
from steelyard.excitation.information.noise_free_recording import fit_noise_free
from steelyard.excitation.information.optimality_criterion import Target
from steelyard.excitation.information.predicted_information import (
    InformationTerms,
    PredictedInformation,
)
from steelyard.excitation.limits.cable_vibration import natural_frequencies
from steelyard.excitation.limits.motion_constraints import Margin
from steelyard.excitation.limits.verification import Verified, times_of, verify
from steelyard.excitation.settings import DEFAULT, DesignSettings
from steelyard.experiment.model import Experiment
from steelyard.identification.methods.maximum_likelihood import MaximumLikelihood
from steelyard.identification.solve.bound import known_information
from steelyard.identification.solve.posterior import Posterior, Progress
from steelyard.inertia import BODY_PARAMETERS, TEN, body_jacobian
from steelyard.motion.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class MotionEvaluation:
    """A planned experiment."""

    experiment: Experiment
    """With its runs, as they would be recorded without noise and errors."""
    trajectories: Mapping[str, Trajectory]
    estimate: Estimate
    """What maximum likelihood would say of all runs together; the values are those of the nominal
    body."""
    each: Mapping[str, Array]
    """Run -> 1-sigma of the ten parameters from it alone; NaN: not identifiable; shape (10,)."""
    standard_deviation: Array
    """Of the ten, of all runs with earlier information; NaN: not identifiable; shape (10,)."""
    verified: Mapping[str, Verified]
    """Run -> which limits it uses."""
    information_shares: Mapping[str, InformationShares]
    """Run -> which part of it contributes to which parameter."""
    natural_frequencies: Array
    """Of the platform on its cables where the first run begins, ascending [Hz]; empty where the
    stiffness is not known."""
    highest_frequency: float
    """Below which 99 % of the power of the accelerations lies [Hz]."""
    target: Target
    margin: Margin
    level: float
    """Tension near which the cables are held [N]."""

    @property
    def worst(self) -> tuple[str, float]:
        """The parameter that is known worst, and its 1-sigma in units of the target; infinite where
        it is not identifiable.
        """
        ratio = self.standard_deviation / self.target.each
        ratio = np.where(np.isnan(self.standard_deviation), np.inf, ratio)
        return BODY_PARAMETERS[int(ratio.argmax())], float(ratio.max())

    @property
    def feasible(self) -> bool:
        """Whether the robot can do all of it."""
        return not any(each.violations for each in self.verified.values())


@dataclass(frozen=True, eq=False)
class InformationShares:
    """Which part of a run contributes to which parameter."""

    time: Array
    """[s], shape (n,)."""
    share: Array
    """Part of the information on each of the ten that comes from around each instant [1/s], shape
    (n, 10); over all runs its integral is 1, less the part of the priors."""


def evaluate_motions(
    experiment: Experiment,
    trajectories: Mapping[str, Trajectory],
    *,
    target: Target,
    margin: Margin,
    level: float,
    before: Array | float = 0.0,
    verified: Mapping[str, Verified] | None = None,
    progress: Progress = None,
    settings: DesignSettings = DEFAULT,
) -> MotionEvaluation:
    """Predict what motions will identify, and check them against the limits of the robot.

    Args:
        experiment: Robot, with its nominal platform, and instruments.
        trajectories: Run -> motion.
        target: 1-sigma that is wanted.
        margin: How far the body may be from the nominal one.
        level: Tension near which the cables are held [N].
        before: Information that there is on the ten linear parameters, shape (10, 10).
        verified: Runs that have been checked already.
        progress: Is given what is being done.
        settings: Of the design.

    Raises:
        InputError: The instruments cannot identify anything, or lack a rate or a noise.
    """
    robot = experiment.robot
    joint = fit_noise_free(experiment, trajectories, level, progress, settings=settings)
    alone = dict.fromkeys(trajectories, joint)
    if len(trajectories) > 1:
        for name, each in trajectories.items():
            alone[name] = fit_noise_free(
                experiment, {name: each}, level, progress, settings=settings
            )
    method = MaximumLikelihood()
    estimate = method.of(joint)
    if progress:
        progress("design: checking the limits", 0.9)
    checked = dict(verified or {})
    for name, trajectory in trajectories.items():
        if name not in checked:
            checked[name] = verify(
                robot, experiment.instruments, trajectory, margin, level, settings=settings
            )
    first = next(iter(trajectories.values()))
    start = first.derivative(np.zeros(1), 0)[0]
    return MotionEvaluation(
        experiment=joint.experiment,
        trajectories=dict(trajectories),
        estimate=estimate,
        each={name: method.of(found).standard_deviation for name, found in alone.items()},
        standard_deviation=_combined_standard_deviation(joint, estimate, before),
        verified=checked,
        information_shares=_information_shares(joint, trajectories, level, before, settings),
        natural_frequencies=natural_frequencies(robot, start, level),
        highest_frequency=max(highest_frequency(each, settings) for each in trajectories.values()),
        target=target,
        margin=margin,
        level=level,
    )


def _combined_standard_deviation(
    joint: Posterior, estimate: Estimate, before: Array | float
) -> Array:
    """1-sigma of the ten with earlier information, shape (10,)."""
    if not np.any(before):
        return estimate.standard_deviation
    J = np.linalg.inv(body_jacobian(joint.parameters))
    earlier = J.T @ before @ J
    information = np.linalg.inv(joint.body_covariance) + earlier
    found = np.sqrt(np.diag(np.linalg.inv(information)))
    # What neither identifies is as uncertain as the plausible size of it, and no number.
    known_earlier = np.diag(earlier) > 0
    unknown = np.isnan(estimate.standard_deviation) & ~known_earlier
    return np.where(unknown, np.nan, found)


def information_before(joint: Posterior, before: Array | float) -> Array:
    """Information before the first run: priors, known parameters, earlier estimates, shape (b,
    b).

    Args:
        joint: Of a noise-free recording.
        before: Information on the ten from earlier recordings, shape (10, 10).
    """
    information = prior_information(joint.fit.state.calibration.calibration_parameters)
    known = known_information(joint.experiment.known, body_jacobian(joint.parameters))
    information[:TEN, :TEN] += before
    information[:TEN, :TEN] += known
    return information


def _information_shares(
    joint: Posterior,
    trajectories: Mapping[str, Trajectory],
    level: float,
    before: Array | float,
    settings: DesignSettings,
) -> dict[str, InformationShares]:
    """What the instants of each run contribute to the information on each of the ten."""
    J = body_jacobian(joint.parameters)
    evaluated: dict[str, tuple[PredictedInformation, Array, InformationTerms]] = {}
    for run in joint.experiment.runs:
        segment = next(each for each in joint.fit.state.segments if each.run == run.name)
        trajectory = trajectories[run.name]
        point = LinearisationPoint.of(joint, run, level)
        own = PredictedInformation(point, segment, trajectory.duration, settings)
        commands = np.hstack([trajectory.derivative(own.times, order) for order in range(4)])
        evaluated[run.name] = own, *own.information(commands)
    total = information_before(joint, before) + sum(each for _, each, _ in evaluated.values())
    directions = np.linalg.pinv(total, hermitian=True)[:, :TEN] @ J.T
    variance = np.einsum("ij,ji->i", J, directions[:TEN])
    found = {}
    for name, (own, _, terms) in evaluated.items():
        step = own.duration / len(own.times)
        share = own.shares(terms, directions) / variance / step
        found[name] = InformationShares(own.times, share)
    return found


def highest_frequency(trajectory: Trajectory, settings: DesignSettings = DEFAULT) -> float:
    """Below which 99 % (a setting) of the power of the commanded accelerations lies [Hz]."""
    times = times_of(trajectory, settings.checks_per_second)
    acceleration = trajectory.derivative(times, 2)
    power = np.abs(np.fft.rfft(acceleration, axis=0)) ** 2
    power = power / np.maximum(power.sum(axis=0), 1e-300)
    frequencies = np.fft.rfftfreq(len(times), times[1])
    moving = np.abs(acceleration).max(axis=0) > 0
    if not moving.any():
        return 0.0
    below = np.cumsum(power[:, moving], axis=0)
    last = [int(np.searchsorted(each, settings.power_share)) for each in below.T]
    return float(max(frequencies[i] for i in last))
