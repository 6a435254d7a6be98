"""Poses at rest that tell the geometry of a robot best, and how well `calibrate` will know it from
them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from scipy.spatial.transform import Rotation

from steelyard.arrays import Array, number_given, whole_given
from steelyard.calibration.first_poses import UPRIGHT
from steelyard.calibration.fit import GeometryFit, fit_geometry
from steelyard.calibration.geometry_calibration import GeometryCalibration
from steelyard.calibration.poses import with_upright
from steelyard.errors import InputError
from steelyard.excitation.information.noise_free_recording import noise_free_poses
from steelyard.excitation.limits.motion_constraints import Margin, MotionConstraints
from steelyard.excitation.limits.rest_poses import with_pose_limits, with_tension_level
from steelyard.excitation.plan import is_experiment, planned
from steelyard.excitation.poses.candidate_poses import candidate_poses, in_sequence, regular_grid
from steelyard.excitation.poses.pose_information import pose_choice
from steelyard.excitation.search.design_set_up import designed_body
from steelyard.excitation.settings import DEFAULT, DesignSettings
from steelyard.experiment.model import Experiment
from steelyard.experiment.read import read_plan
from steelyard.identification.solve.posterior import Progress
from steelyard.robot.covariance import POINTS
from steelyard.robot.model import Robot
from steelyard.simulation.sensors import CALIBRATION_SENSORS, Sensors
from steelyard.simulation.trajectories import workspace_of

USUAL_POSES = 20
"""Of a calibration where nobody says how many."""
_ASSUMED = {"tracker", "lengths"}
"""Names of the sensors of a calibration."""
_RUN = "poses"
"""Name of the run that a design is for."""


@dataclass(frozen=True, eq=False)
class PoseDesign:
    """Poses to record at rest."""

    experiment: Experiment
    """Robot and instruments."""
    poses: Array
    """x, y, z [m], roll, pitch, yaw [rad], in the order in which to go there, shape (n, 6)."""
    predicted: GeometryCalibration
    """What `calibrate` would say of them, without noise and errors: the geometry is that of the
    robot file."""
    grid: GeometryCalibration | None
    """The same of a regular grid of as many poses; None: the robot cannot hold so many, or they
    leave the geometry undetermined."""
    candidates: int
    """Poses that there were to choose from."""
    level: float
    """Tension near which the cables are held [N]."""
    seed: int
    assumed: bool = False
    """Whether nobody has named sensors: those of a calibration are assumed."""

    @property
    def over_grid(self) -> dict[str, float]:
        """Mean 1-sigma of ``anchor`` and ``attachment`` over that of the regular grid; nothing
        where there is no grid, and of points that are known exactly.
        """
        if self.grid is None:
            return {}
        own, other = self.predicted.deviations, self.grid.deviations
        return {
            key: float(own[key].mean() / other[key].mean())
            for key in POINTS
            if other[key].mean() > 0
        }


def design_poses(
    subject: Experiment | Robot | str | Path,
    poses: int = USUAL_POSES,
    *,
    sensors: Sensors | str = CALIBRATION_SENSORS,
    margin: float = 0.2,
    seed: int = 0,
    progress: Progress = None,
    settings: DesignSettings = DEFAULT,
) -> PoseDesign:
    """Find poses at rest that tell anchors and attachments best.

    The choice leaves the least volume of their uncertainty (D-optimal), with everything else that
    is uncertain found beside them.

    Args:
        subject: An experiment, of which robot, instruments and ``uncertainty`` count; a robot; or
            the path or bundled name of one of them.
        poses: How many.
        sensors: Instruments of a robot that comes alone; ``calibration``: a tracker and lengths of
            .5 mm.
        margin: By which share mass and inertia may differ from the nominal ones, so that the cables
            hold the platform all the same.
        seed: Of the poses that there are to choose from.
        progress: Is given what is being done.
        settings: Of the design.

    Raises:
        InputError: No instrument reads cable lengths or one states no noise, the robot cannot hold
            so many poses, or their readings leave the geometry undetermined.
    """
    tell = progress or (lambda what, fraction: None)
    poses, seed = whole_given(poses, "--poses"), whole_given(seed, "--seed")
    margin = number_given(margin, "--margin", least=0)
    if not settings.fewest_poses <= poses <= settings.most_poses:
        raise InputError(
            f"--poses: expected {settings.fewest_poses} to {settings.most_poses}, found {poses};"
            " choose another number"
        )
    experiment = _described(subject, sensors)
    robot = experiment.robot
    constraints = with_tension_level(
        MotionConstraints(robot, experiment.instruments, Margin(margin, robot.size), 0.0, 1.0),
        settings,
    )
    level = constraints.level
    tell("calibration: poses that the cables can hold", 0.1)
    every = candidate_poses(constraints, seed, settings)
    if len(every) < poses:
        raise InputError(
            f"robot '{robot.name}': expected {poses} poses within its limits that the cables can"
            f" hold if the body differs by {margin:.0%}, found {len(every)} of"
            f" {settings.candidate_poses} that were tried; choose fewer --poses or a smaller"
            " --margin"
        )
    tell("calibration: what each of them tells", 0.2)
    choice = pose_choice(predicted_fit(experiment, every, level, settings))
    tell("calibration: choosing", 0.5)
    _, reach = workspace_of(robot)
    chosen = in_sequence(every[choice.best(poses, settings)], reach)
    tell("calibration: what they tell together", 0.8)
    predicted = GeometryCalibration(predicted_fit(experiment, chosen, level, settings))
    grid = _grid(constraints, experiment, poses, settings)
    assumed = sensors == CALIBRATION_SENSORS and set(experiment.instruments) == _ASSUMED
    return PoseDesign(experiment, chosen, predicted, grid, len(every), level, seed, assumed)


def predicted_fit(
    experiment: Experiment, poses: Array, level: float, settings: DesignSettings = DEFAULT
) -> GeometryFit:
    """What the fit of `calibrate` would say of poses at rest: it has read a recording of them
    without noise and errors.

    Args:
        experiment: Robot and instruments.
        poses: Shape (n, 6).
        level: Tension near which the cables are held [N].
        settings: Of the design.

    Raises:
        InputError: An instrument states no noise, or the poses leave the geometry undetermined.
    """
    run = noise_free_poses(experiment, _RUN, poses, level, settings=settings)
    recorded = with_upright(replace(experiment, runs=(run,)))
    (run,) = recorded.runs
    if UPRIGHT in run.streams:
        # What stands in for an orientation is vague, but not off: its pull would look like
        # residuals.
        turned = Rotation.from_euler("ZYX", poses[:, :2:-1]).as_matrix()
        upright = replace(run.streams[UPRIGHT], values={"orientation": turned})
        run = replace(run, streams={**run.streams, UPRIGHT: upright})
    return fit_geometry(replace(recorded, runs=(run,)))


def _described(subject: Experiment | Robot | str | Path, sensors: Sensors | str) -> Experiment:
    """Robot and instruments of a calibration that is to be made.

    Raises:
        InputError: Nothing tells the geometry, or it is known exactly.
    """
    if not isinstance(subject, Experiment | Robot) and is_experiment(subject):
        experiment = read_plan(subject, weighed=False)
    else:
        experiment = planned(subject, sensors)
        if not isinstance(subject, Experiment):
            # Nobody has said how far it may be off: as far as `calibrate` takes it.
            experiment = replace(experiment, uncertainty={})
    source = experiment.source or experiment.name
    if not any(experiment.uncertainty.get(key, 1.0) for key in POINTS):
        raise InputError(
            f"{source}: expected anchors or attachments that may be off, found that they are known"
            " exactly; state 'uncertainty: {anchor: …, attachment: …}' [m]"
        )
    robot = with_pose_limits(experiment.robot)
    if not robot.m:
        raise InputError(
            f"robot '{robot.name}': expected cables, whose anchors and attachments a calibration"
            " finds, found none"
        )
    designed_body(robot)
    instruments = experiment.instruments.values()
    if not any(each.is_cable_motion for each in instruments):
        raise InputError(
            f"{source}: expected an instrument of kind length, which tells where the cables are"
            " fixed, found none; give --sensors a file that has one, or add it to the experiment"
        )
    if not any(each.is_force for each in instruments):
        # Where no force is read, `calibrate` cannot know how far cables sag and stretch.
        robot = replace(
            robot, cable=replace(robot.cable, linear_density=None, axial_stiffness=None)
        )
    return replace(experiment, robot=robot, runs=())


def _grid(
    constraints: MotionConstraints, experiment: Experiment, count: int, settings: DesignSettings
) -> GeometryCalibration | None:
    """What a regular grid would tell; None: there is none, or it leaves the geometry
    undetermined.
    """
    poses = regular_grid(constraints, count, settings)
    if len(poses) < count:
        return None
    try:
        return GeometryCalibration(predicted_fit(experiment, poses, constraints.level, settings))
    except InputError:
        return None
