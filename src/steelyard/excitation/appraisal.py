"""What motions will tell of the body, and what they take of the robot."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import InfeasibleError, InputError
from steelyard.estimates.estimate import Estimate
from steelyard.excitation.criterion import Target
from steelyard.excitation.demands import Margin
from steelyard.excitation.information import Outlook
from steelyard.excitation.rehearsal import rehearsed
from steelyard.excitation.sight import View, border_of
from steelyard.excitation.verification import Verified, times_of, verify
from steelyard.experiment.model import Experiment
from steelyard.identification.methods.maximum_likelihood import MaximumLikelihood
from steelyard.identification.solve.bound import known_information
from steelyard.identification.solve.classical import NoBalanceError
from steelyard.identification.solve.joint_study import Joint, joint_study
from steelyard.identification.solve.normal_equations import TEN
from steelyard.identification.solve.study import Progress
from steelyard.inertia import BODY_PARAMETERS, body_jacobian
from steelyard.motion.trajectory import Trajectory
from steelyard.robot.model import Robot
from steelyard.simulation.forward_dynamics import CablePlatform

_MOST = 0.99
"""Part of the power of accelerations that lies below the frequency which is reported."""


@dataclass(frozen=True, eq=False)
class Appraisal:
    """A planned experiment."""

    experiment: Experiment
    """With its runs, as they would be recorded without noise and errors."""
    trajectories: Mapping[str, Trajectory]
    estimate: Estimate
    """What maximum likelihood would say of all runs together; the values are those of the nominal
    body."""
    each: Mapping[str, Array]
    """Run -> 1-sigma of the ten parameters from it alone; NaN where it cannot tell; shape (10,)."""
    standard_deviation: Array
    """Of the ten, of all runs with what was known before; NaN where nothing tells; shape (10,)."""
    verified: Mapping[str, Verified]
    """Run -> what it takes of the robot."""
    told: Mapping[str, Told]
    """Run -> which part of it tells which parameter."""
    natural_frequencies: Array
    """Of the platform on its cables where the first run begins, ascending [Hz]; empty where the
    stiffness is not known."""
    highest_frequency: float
    """Below which 99 % of the power of the accelerations lies [Hz]."""
    target: Target
    margin: Margin
    level: float
    """Tension that the cables are held near to [N]."""

    @property
    def worst(self) -> tuple[str, float]:
        """The parameter that is known worst, and its 1-sigma in units of the target; infinite where
        nothing tells it.
        """
        ratio = np.where(
            np.isnan(self.standard_deviation), np.inf, self.standard_deviation / self.target.each
        )
        return BODY_PARAMETERS[int(ratio.argmax())], float(ratio.max())

    @property
    def feasible(self) -> bool:
        """Whether the robot can do all of it."""
        return not any(each.violations for each in self.verified.values())


@dataclass(frozen=True, eq=False)
class Told:
    """Which part of a run tells which parameter."""

    time: Array
    """[s], shape (n,)."""
    share: Array
    """Part of what is known of each of the ten that comes from around each instant [1/s], shape (n,
    10); over all runs it is 1, less what priors tell."""


def rehearse(
    experiment: Experiment,
    trajectories: Mapping[str, Trajectory],
    level: float,
    progress: Progress = None,
) -> Joint:
    """What maximum likelihood makes of runs that are made in thought.

    Raises:
        InputError: The instruments can tell nothing, or lack a rate or a noise.
    """
    try:
        return joint_study(rehearsed(experiment, trajectories, level), progress)
    except NoBalanceError as error:
        raise InputError(
            f"{experiment.source or experiment.name}: expected instruments and a motion that tell"
            f" something of the body, found that {error}"
        ) from None


def appraise(
    experiment: Experiment,
    trajectories: Mapping[str, Trajectory],
    *,
    target: Target,
    margin: Margin,
    level: float,
    before: Array | float = 0.0,
    verified: Mapping[str, Verified] | None = None,
    progress: Progress = None,
) -> Appraisal:
    """Look at motions before they are made.

    Args:
        experiment: Robot, with its nominal platform, and instruments.
        trajectories: Run -> motion.
        target: 1-sigma that is wanted.
        margin: How far the body may be from the nominal one.
        level: Tension that the cables are held near to [N].
        before: Information that there is on the ten linear parameters, shape (10, 10).
        verified: What has been looked at already.
        progress: Is told what is being done.

    Raises:
        InputError: The instruments can tell nothing, or lack a rate or a noise.
    """
    robot = experiment.robot
    joint = rehearse(experiment, trajectories, level, progress)
    alone = dict.fromkeys(trajectories, joint)
    if len(trajectories) > 1:
        alone = {
            name: rehearse(experiment, {name: each}, level, progress)
            for name, each in trajectories.items()
        }
    estimate = MaximumLikelihood().of(joint)
    if progress:
        progress("design: looking at the limits", 0.9)
    done = dict(verified or {})
    for name, trajectory in trajectories.items():
        if name not in done:
            done[name] = verify(robot, experiment.instruments, trajectory, margin, level)
    first = next(iter(trajectories.values()))
    return Appraisal(
        experiment=joint.study.experiment,
        trajectories=dict(trajectories),
        estimate=estimate,
        each={
            name: MaximumLikelihood().of(found).standard_deviation for name, found in alone.items()
        },
        standard_deviation=_together(joint, estimate, before),
        verified=done,
        told=_told(joint, trajectories, level, before),
        natural_frequencies=natural_frequencies(robot, first.derivative(np.zeros(1), 0)[0], level),
        highest_frequency=max(highest_frequency(each) for each in trajectories.values()),
        target=target,
        margin=margin,
        level=level,
    )


def _together(joint: Joint, estimate: Estimate, before: Array | float) -> Array:
    """1-sigma of the ten with what was known before, shape (10,)."""
    if not np.any(before):
        return estimate.standard_deviation
    J = np.linalg.inv(body_jacobian(joint.study.parameters))
    information = np.linalg.inv(joint.study.body_covariance) + J.T @ before @ J
    found = np.sqrt(np.diag(np.linalg.inv(information)))
    # What neither tells is as uncertain as the plausible size of it, and no number.
    told = np.diag(J.T @ before @ J) > 0
    return np.where(np.isnan(estimate.standard_deviation) & ~told, np.nan, found)


def _told(
    joint: Joint, trajectories: Mapping[str, Trajectory], level: float, before: Array | float
) -> dict[str, Told]:
    J = body_jacobian(joint.study.parameters)
    calibration_parameters = joint.fit.state.calibration.calibration_parameters
    known = border_of(calibration_parameters)
    known[:TEN, :TEN] += before
    known[:TEN, :TEN] += known_information(joint.study.experiment.known, J)
    seen = {}
    for run in joint.study.experiment.runs:
        segment = next(segment for segment in joint.fit.state.segments if segment.run == run.name)
        outlook = Outlook(
            View.of(joint, run, level), segment, trajectories[run.name].duration, len(known)
        )
        commands = np.hstack(
            [trajectories[run.name].derivative(outlook.times, order) for order in range(4)]
        )
        seen[run.name] = outlook, outlook.information(commands)
    total = known + sum(information for _, (information, _) in seen.values())
    by = np.linalg.pinv(total, hermitian=True)[:, :TEN] @ J.T
    variance = np.einsum("ij,ji->i", J, by[:TEN])
    found = {}
    for name, (outlook, (_, each)) in seen.items():
        step = outlook.duration / len(outlook.times)
        found[name] = Told(outlook.times, outlook.shares(each, by) / variance / step)
    return found


def natural_frequencies(robot: Robot, pose: Array, level: float) -> Array:
    """Of the platform on its elastic cables, ascending [Hz], shape (6,); empty where their
    stiffness is not known.
    """
    if not (
        robot.m >= 6
        and robot.cable.axial_stiffness
        and robot.platform
        and robot.platform.is_physical
    ):
        return np.zeros(0)
    try:
        return CablePlatform(robot, robot.platform).natural_frequencies(pose, level)
    except InfeasibleError:
        return np.zeros(0)


def highest_frequency(trajectory: Trajectory) -> float:
    """Below which 99 % of the power of the commanded accelerations lies [Hz]."""
    times = times_of(trajectory)
    acceleration = trajectory.derivative(times, 2)
    power = np.abs(np.fft.rfft(acceleration, axis=0)) ** 2
    power = power / np.maximum(power.sum(axis=0), 1e-300)
    frequencies = np.fft.rfftfreq(len(times), times[1])
    moving = np.abs(acceleration).max(axis=0) > 0
    if not moving.any():
        return 0.0
    return float(
        max(frequencies[int(np.searchsorted(np.cumsum(p), _MOST))] for p in power.T[moving])
    )
