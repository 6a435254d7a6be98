"""steelyard finds what a cable robot carries: mass, centre of gravity and inertia, and how well
each is known.

    >>> import steelyard
    >>> experiment = steelyard.read_experiment("experiment.yaml")
    >>> steelyard.identify(experiment).estimate

The names below are the public face; they load when they are first used, so that the command line
answers at once.
"""

from __future__ import annotations

from importlib import import_module
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from steelyard.bodies.mass_region import Box as Box
    from steelyard.bodies.mass_region import Ellipsoid as Ellipsoid
    from steelyard.bodies.nearest_body import nearest_body as nearest_body
    from steelyard.calibration.calibrate import calibrate as calibrate
    from steelyard.calibration.geometry_calibration import (
        GeometryCalibration as GeometryCalibration,
    )
    from steelyard.campaigns.run import Campaign as Campaign
    from steelyard.campaigns.run import campaign as campaign
    from steelyard.campaigns.study.result import Study as Study
    from steelyard.campaigns.study.run import study as study
    from steelyard.drafts.first_file import init as init
    from steelyard.dynamics import platform_regressor as platform_regressor
    from steelyard.dynamics import platform_wrench as platform_wrench
    from steelyard.errors import InfeasibleError as InfeasibleError
    from steelyard.errors import InputError as InputError
    from steelyard.errors import SteelyardError as SteelyardError
    from steelyard.estimates.comparison import Comparison as Comparison
    from steelyard.estimates.comparison import compare as compare
    from steelyard.estimates.estimate import Estimate as Estimate
    from steelyard.estimates.estimate import LoadEstimates as LoadEstimates
    from steelyard.estimates.estimate import Verdict as Verdict
    from steelyard.estimates.file.places import read_estimates as read_estimates
    from steelyard.estimates.joint_covariance import JointCovariance as JointCovariance
    from steelyard.estimates.named_estimate import NamedEstimate as NamedEstimate
    from steelyard.estimates.payload import Payload as Payload
    from steelyard.estimates.payload import payload as payload
    from steelyard.excitation.design import Design as Design
    from steelyard.excitation.design import design as design
    from steelyard.excitation.design_file import write_design as write_design
    from steelyard.excitation.poses.pose_design import PoseDesign as PoseDesign
    from steelyard.excitation.poses.pose_design import design_poses as design_poses
    from steelyard.excitation.references.reference_design import (
        ReferenceDesign as ReferenceDesign,
    )
    from steelyard.excitation.references.reference_design import (
        design_references as design_references,
    )
    from steelyard.excitation.swings.swing_design import SwingDesign as SwingDesign
    from steelyard.excitation.swings.swing_design import design_swings as design_swings
    from steelyard.experiment.memory.from_frames import RecordedFrame as RecordedFrame
    from steelyard.experiment.model import Experiment as Experiment
    from steelyard.experiment.model import Load as Load
    from steelyard.experiment.read import read_experiment as read_experiment
    from steelyard.experiment.recording import Run as Run
    from steelyard.experiment.recording import Stream as Stream
    from steelyard.experiment.write import write_experiment as write_experiment
    from steelyard.exports.exported import Exported as Exported
    from steelyard.exports.formats import export as export
    from steelyard.identification.conversion import convert as convert
    from steelyard.identification.identification import Identification as Identification
    from steelyard.identification.methods.consistent import Consistent as Consistent
    from steelyard.identification.methods.force_free import ForceFree as ForceFree
    from steelyard.identification.methods.instrumental_variables import (
        InstrumentalVariables as InstrumentalVariables,
    )
    from steelyard.identification.methods.least_squares import LeastSquares as LeastSquares
    from steelyard.identification.methods.maximum_likelihood import (
        MaximumLikelihood as MaximumLikelihood,
    )
    from steelyard.identification.methods.recursive import Recursive as Recursive
    from steelyard.identification.methods.two_step import TwoStep as TwoStep
    from steelyard.identification.model.fitted_motion import FittedMotion as FittedMotion
    from steelyard.identification.solve.bound import cramer_rao as cramer_rao
    from steelyard.identification.verdict.prediction import predict_held_out as predict_held_out
    from steelyard.imports.formats import import_robot as import_robot
    from steelyard.inertia import Inertia as Inertia
    from steelyard.inspection.identify import identify as identify
    from steelyard.inspection.inspect import Inspection as Inspection
    from steelyard.inspection.inspect import inspect as inspect
    from steelyard.instruments.attitude import Attitude as Attitude
    from steelyard.instruments.command import Command as Command
    from steelyard.instruments.distance import Distance as Distance
    from steelyard.instruments.imu import Imu as Imu
    from steelyard.instruments.length import Length as Length
    from steelyard.instruments.pose import Pose as Pose
    from steelyard.instruments.position import Position as Position
    from steelyard.instruments.swing_frequencies import SwingFrequencies as SwingFrequencies
    from steelyard.instruments.tension import Tension as Tension
    from steelyard.instruments.weight import Weight as Weight
    from steelyard.instruments.wrench import Wrench as Wrench
    from steelyard.live.watching import watch as watch
    from steelyard.natural_frequencies.frequencies import Frequencies as Frequencies
    from steelyard.natural_frequencies.frequencies import frequencies as frequencies
    from steelyard.report.figures import figure as figure
    from steelyard.report.figures import figures as figures
    from steelyard.report.progress_bar import progress_bar as progress_bar
    from steelyard.report.write import write_results as write_results
    from steelyard.report.write_calibration import write_calibration as write_calibration
    from steelyard.robot.file import read_robot as read_robot
    from steelyard.robot.model import CableProperties as CableProperties
    from steelyard.robot.model import Limits as Limits
    from steelyard.robot.model import Robot as Robot
    from steelyard.simulation.sensors import read_sensors as read_sensors
    from steelyard.simulation.simulate import VirtualExperiment as VirtualExperiment
    from steelyard.simulation.simulate import simulate as simulate
    from steelyard.simulation.trajectories import trajectories as trajectories

_WHERE = {
    "Attitude": "instruments.attitude",
    "Box": "bodies.mass_region",
    "CableProperties": "robot.model",
    "Campaign": "campaigns.run",
    "Command": "instruments.command",
    "Comparison": "estimates.comparison",
    "Consistent": "identification.methods.consistent",
    "Design": "excitation.design",
    "Distance": "instruments.distance",
    "Ellipsoid": "bodies.mass_region",
    "Estimate": "estimates.estimate",
    "Experiment": "experiment.model",
    "Exported": "exports.exported",
    "FittedMotion": "identification.model.fitted_motion",
    "ForceFree": "identification.methods.force_free",
    "Frequencies": "natural_frequencies.frequencies",
    "GeometryCalibration": "calibration.geometry_calibration",
    "Identification": "identification.identification",
    "Imu": "instruments.imu",
    "Inertia": "inertia",
    "InfeasibleError": "errors",
    "InputError": "errors",
    "Inspection": "inspection.inspect",
    "InstrumentalVariables": "identification.methods.instrumental_variables",
    "JointCovariance": "estimates.joint_covariance",
    "LeastSquares": "identification.methods.least_squares",
    "Length": "instruments.length",
    "Limits": "robot.model",
    "Load": "experiment.model",
    "LoadEstimates": "estimates.estimate",
    "MaximumLikelihood": "identification.methods.maximum_likelihood",
    "NamedEstimate": "estimates.named_estimate",
    "Payload": "estimates.payload",
    "Pose": "instruments.pose",
    "PoseDesign": "excitation.poses.pose_design",
    "Position": "instruments.position",
    "RecordedFrame": "experiment.memory.from_frames",
    "Recursive": "identification.methods.recursive",
    "ReferenceDesign": "excitation.references.reference_design",
    "Robot": "robot.model",
    "Run": "experiment.recording",
    "SteelyardError": "errors",
    "Stream": "experiment.recording",
    "Study": "campaigns.study.result",
    "SwingDesign": "excitation.swings.swing_design",
    "SwingFrequencies": "instruments.swing_frequencies",
    "Tension": "instruments.tension",
    "TwoStep": "identification.methods.two_step",
    "Verdict": "estimates.estimate",
    "VirtualExperiment": "simulation.simulate",
    "Weight": "instruments.weight",
    "Wrench": "instruments.wrench",
    "calibrate": "calibration.calibrate",
    "campaign": "campaigns.run",
    "compare": "estimates.comparison",
    "convert": "identification.conversion",
    "cramer_rao": "identification.solve.bound",
    "design": "excitation.design",
    "design_poses": "excitation.poses.pose_design",
    "design_references": "excitation.references.reference_design",
    "design_swings": "excitation.swings.swing_design",
    "export": "exports.formats",
    "figure": "report.figures",
    "figures": "report.figures",
    "frequencies": "natural_frequencies.frequencies",
    "identify": "inspection.identify",
    "import_robot": "imports.formats",
    "init": "drafts.first_file",
    "inspect": "inspection.inspect",
    "nearest_body": "bodies.nearest_body",
    "payload": "estimates.payload",
    "platform_regressor": "dynamics",
    "platform_wrench": "dynamics",
    "predict_held_out": "identification.verdict.prediction",
    "progress_bar": "report.progress_bar",
    "read_estimates": "estimates.file.places",
    "read_experiment": "experiment.read",
    "read_robot": "robot.file",
    "read_sensors": "simulation.sensors",
    "simulate": "simulation.simulate",
    "study": "campaigns.study.run",
    "trajectories": "simulation.trajectories",
    "watch": "live.watching",
    "write_calibration": "report.write_calibration",
    "write_design": "excitation.design_file",
    "write_experiment": "experiment.write",
    "write_results": "report.write",
}

__all__ = sorted(_WHERE)

__version__: str
"""Of this package."""


def __getattr__(name: str) -> Any:
    if name == "__version__":
        return version("steelyard")
    if name not in _WHERE:
        raise AttributeError(f"module 'steelyard' has no attribute '{name}'")
    return getattr(import_module(f"steelyard.{_WHERE[name]}"), name)


def __dir__() -> list[str]:
    return list(__all__)
