"""From a robot and its instruments to the problem of a search: constraints, motion spline,
vibration, predicted information and random starts.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import InputError
from steelyard.excitation.command.motion_spline import COORDINATES, MotionSpline
from steelyard.excitation.information.linearisation_point import (
    LinearisationPoint,
    border_columns,
    prior_information,
)
from steelyard.excitation.information.noise_free_recording import fit_noise_free
from steelyard.excitation.information.predicted_information import PredictedInformation
from steelyard.excitation.limits.cable_vibration import (
    CableVibration,
    dunkerley_sum_at,
    natural_frequencies,
)
from steelyard.excitation.limits.motion_constraints import Margin, MotionConstraints
from steelyard.excitation.limits.rest_poses import (
    checked_pose,
    default_start_pose,
    with_tension_level,
)
from steelyard.excitation.limits.verification import verify
from steelyard.excitation.settings import DesignSettings
from steelyard.experiment.model import Experiment
from steelyard.identification.model.calibration_parameters import CalibrationParameters
from steelyard.identification.model.motion_segment import Segment, jerk_matrices
from steelyard.identification.samples.first_poses.spline_through_poses import resampled
from steelyard.identification.solve.posterior import Posterior
from steelyard.inertia import Inertia
from steelyard.motion.trajectory import multisine
from steelyard.robot.model import Robot
from steelyard.simulation.trajectories import workspace_of
from steelyard.smoothing import knots


@dataclass(frozen=True, eq=False)
class MotionFamily:
    """The motions among which a search chooses, and what they must keep to."""

    spline: MotionSpline
    constraints: MotionConstraints
    vibration: CableVibration | None
    """None: the stiffness of the cables is not known, or there are none."""


def designed_body(robot: Robot) -> Inertia:
    """The nominal platform, for which motions are designed.

    Raises:
        InputError: There is none, or none that can exist.
    """
    if robot.platform is None:
        raise InputError(
            f"robot '{robot.name}': expected a nominal platform to design for, found none; add"
            " 'platform' to its file, or give --body ESTIMATE"
        )
    if not robot.platform.is_physical:
        raise InputError(
            f"robot '{robot.name}': expected a platform that can exist, found one whose inertia no"
            " body has; correct 'platform.inertia', or give --body ESTIMATE"
        )
    return robot.platform


def motion_family(
    experiment: Experiment,
    duration: float,
    start: Array | None,
    end: Array | None,
    margin: Margin,
    settings: DesignSettings,
) -> MotionFamily:
    """Motions of a duration between two poses.

    Raises:
        InputError: There are none.
    """
    robot = experiment.robot
    if not 0 < duration <= settings.longest_duration:
        raise InputError(
            f"--duration: expected more than 0 and at most {settings.longest_duration:g} s, found"
            f" {duration:g}; choose another, and --runs for several motions"
        )
    elastic = robot.m > 0 and bool(robot.cable.axial_stiffness)
    fraction = settings.limit_fraction_elastic if elastic else settings.limit_fraction_stiff
    constraints = MotionConstraints(robot, experiment.instruments, margin, 0.0, fraction)
    constraints = with_tension_level(constraints, settings)
    begin = default_start_pose(constraints, settings)
    if start is not None:
        begin = checked_pose(constraints, start, "start")
    finish = begin if end is None else checked_pose(constraints, end, "end")
    frequencies = natural_frequencies(robot, begin, constraints.level)
    lowest = float(frequencies[frequencies > 0].min()) if (frequencies > 0).any() else None
    if elastic and lowest is not None:
        # Elsewhere the natural frequencies may be lower, but not by much.
        at_ends = max(dunkerley_sum_at(robot, begin), dunkerley_sum_at(robot, finish))
        largest = settings.dunkerley_ratio * at_ends
        constraints = replace(constraints, largest_dunkerley_sum=largest)
        lowest = lowest / float(np.sqrt(settings.dunkerley_ratio))
    intervals = _intervals(duration, lowest, settings)
    _, reach = workspace_of(robot)
    spline = MotionSpline(begin, finish, duration, intervals, reach)
    vibration = None
    if elastic and lowest:
        times = spline.midpoints(settings.vibration_instants)
        vibration = CableVibration(robot, times, lowest, settings)
    return MotionFamily(spline, constraints, vibration)


def _intervals(duration: float, lowest: float | None, settings: DesignSettings) -> int:
    """Intervals between the knots of a motion, which set its highest frequency.

    Args:
        duration: [s].
        lowest: Natural frequency on the way [Hz]; None: not known.
        settings: Of the design.

    Raises:
        InputError: The duration is too short.
    """
    usual, quick = settings.usual_frequency, settings.largest_usual_frequency
    if lowest is not None:
        usual = min(lowest / settings.frequency_ratio, settings.highest_frequency)
        quick = lowest / settings.least_frequency_ratio
    wanted = min(settings.enough_intervals, int(2 * quick * duration))
    intervals = max(settings.fewest_intervals, round(2 * usual * duration), wanted)
    if intervals > 2 * quick * duration:
        needed = np.ceil(10 * settings.fewest_intervals / (2 * quick)) / 10
        why = f"{quick:g} Hz"
        if lowest:
            part = 1 / settings.least_frequency_ratio
            why = f"{part:g} of its lowest natural frequency on the way, {lowest:.2g} Hz,"
        raise InputError(
            f"--duration: expected at least {needed:g} s, found {duration:g} s; from rest to rest a"
            f" platform that moves below {why} needs that long"
        )
    return intervals


def check_direct_move(family: MotionFamily, settings: DesignSettings) -> None:
    """The direct move from start to end must be possible, or nothing is.

    Raises:
        InputError: It is not.
    """
    spline, constraints = family.spline, family.constraints
    found = verify(
        constraints.robot,
        constraints.instruments,
        spline.trajectory(np.zeros(spline.size)),
        constraints.margin,
        constraints.level,
        elastic=False,
        settings=settings,
    )
    if found.violations:
        raise InputError(
            f"robot '{constraints.robot.name}': expected that it can go from start to end in"
            f" {spline.duration:g} s, found {found.violations[0]}; choose a longer --duration,"
            " other poses or a smaller --margin"
        )


def random_start(spline: MotionSpline, seed: int, settings: DesignSettings) -> Array:
    """Free coefficients of a random motion, shape (6 f,)."""
    harmonics = max(2, spline.intervals // 2)
    amplitude = list(settings.start_amplitude * spline.reach)
    motion = multisine([0.0] * COORDINATES, amplitude, spline.duration, harmonics, seed)
    about_zero = replace(spline, start=np.zeros(COORDINATES), end=np.zeros(COORDINATES))
    return about_zero.fitted_to(motion)


def predicted_information(
    experiment: Experiment, spline: MotionSpline, x: Array, level: float, settings: DesignSettings
) -> tuple[PredictedInformation, Posterior]:
    """The information of a run, and the noise-free fit that it is linearised about: instruments,
    clocks and smoothness as the estimator has them.

    Args:
        experiment: Robot and instruments.
        spline: Of the motion.
        x: Free coefficients of one motion, shape (6 f,).
        level: Tension near which the cables are held [N].
        settings: Of the design.
    """
    joint = fit_noise_free(experiment, {"design": spline.trajectory(x)}, level, settings=settings)
    run = joint.experiment.runs[0]
    segment = next(each for each in joint.fit.state.segments if each.run == run.name)
    spacing = spline.duration / spline.intervals / settings.knots_per_interval
    grid = knots(float(segment.knots[0]), float(segment.knots[-1]), spacing)
    coarse: Segment = resampled(
        segment, replace(segment, knots=grid, jerks=jerk_matrices(grid), readings=())
    )
    point = LinearisationPoint.of(joint, run, level)
    return PredictedInformation(point, coarse, spline.duration, settings), joint


def shared_information(information: Array, calibration_parameters: CalibrationParameters) -> Array:
    """What a run leaves to the next, shape (b, b): the information on body and errors that are the
    same in all runs; errors of single runs begin with their prior again.
    """
    column_of = border_columns(calibration_parameters)
    components = calibration_parameters.components()
    own = column_of[[place for place, parameter, _ in components if parameter.run is not None]]
    own = own[own >= 0]
    if not len(own):
        return information
    rest = np.setdiff1d(np.arange(len(information)), own)
    found = np.zeros_like(information)
    cross = information[np.ix_(rest, own)]
    eliminated = cross @ np.linalg.solve(information[np.ix_(own, own)], cross.T)
    found[np.ix_(rest, rest)] = information[np.ix_(rest, rest)] - eliminated
    found[own, own] = prior_information(calibration_parameters)[own, own]
    return found
