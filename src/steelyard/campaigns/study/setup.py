"""What is simulated in a study, as files that workers read: robot, sensors, motions."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from steelyard.errors import InputError
from steelyard.experiment.model import Experiment
from steelyard.experiment.read import read_experiment
from steelyard.experiment.write import write_yaml
from steelyard.files.yaml_file import read_yaml
from steelyard.identification.identify import identify
from steelyard.identification.methods.maximum_likelihood import MaximumLikelihood
from steelyard.identification.model.fitted_motion import RATE, FittedMotion
from steelyard.motion.trajectory import Trajectory
from steelyard.output import results_folder
from steelyard.robot.file import bundled_names, read_robot, robot_file
from steelyard.robot.model import Robot
from steelyard.simulation.sensors import read_sensors
from steelyard.simulation.trajectories import trajectories
from steelyard.smoothing import Samples1D, fit

BASIS = "basis"
"""Folder with the description of an experiment that is simulated."""
_CLOCKS = 0.05
"""1-sigma of clocks of which the experiment states nothing [s]: the default of the contract."""
_THINNED = 5
"""One of so many instants of the fitted motion is kept: 20 Hz, several for each of its knots."""
_SMOOTH = 0.4
"""Between knots of what is commanded [s]: up to 1 Hz, as far as such platforms are driven."""
_HELD = 1.0
"""The platform rests before and after the motion [s]: a start with a jolt would make it swing."""


@dataclass(frozen=True)
class Setup:
    """What is simulated, by names of files; the motion and the sensors as in `simulate`."""

    robot: str
    """Bundled name, or path; its platform is the true body."""
    sensors: str
    motions: tuple[str, ...]
    duration: float | None = None
    """[s]"""
    uncertainty: tuple[tuple[str, float], ...] = ()
    """1-sigma of anchors and attachments [m] and of gravity [m/s^2], drawn anew each time."""

    def robot_of(self) -> Robot:
        """As it is described."""
        return read_robot(self.robot)

    def trajectories(self, robot: Robot) -> Mapping[str, Trajectory]:
        """Run -> motion."""
        found: dict[str, Trajectory] = {}
        for motion in self.motions:
            # What was recorded has been possible, whatever the limits say.
            is_recorded = Path(motion).parent.name == BASIS
            found |= trajectories(robot, motion, self.duration, check=not is_recorded)
        return found

    @property
    def sha256(self) -> str:
        """Of all that it says, files included."""
        total = hashlib.sha256(repr((self.duration, self.uncertainty)).encode())
        for name in (self.robot, self.sensors, *self.motions):
            path = Path(name)
            content = path.read_bytes() if path.is_file() else name.encode()
            total.update(hashlib.sha256(content).digest())
        return total.hexdigest()


def is_experiment(what: str) -> bool:
    """Whether a path is that of an experiment file, rather than of a robot."""
    if what in bundled_names() or not what.endswith((".yaml", ".yml")):
        return False
    data = read_yaml(Path(what)).data
    return isinstance(data, dict) and "instruments" in data


def setup_of_robot(robot: str, sensors: str, motion: str, duration: float | None) -> Setup:
    """A study of a robot, with all paths absolute.

    Raises:
        InputError: There is no such robot, sensors or motion, or the robot has no platform.
    """
    described = read_robot(robot)
    if described.platform is None:
        raise InputError(
            f"robot '{described.name}': expected a nominal platform to simulate, found none; add"
            " 'platform' to its file"
        )
    read_sensors(sensors, described)
    setup = Setup(_absolute(robot), _absolute(sensors), (_absolute(motion),), duration)
    setup.trajectories(described)
    return setup


def _absolute(name: str) -> str:
    return str(Path(name).resolve()) if Path(name).is_file() else name


def setup_of_experiment(
    path: str | Path, folder: Path, progress: Callable[[str, float], None] | None = None
) -> Setup:
    """A study of an experiment as it was recorded: the motion that `identify` finds in it, the body
    that it finds, the sensors as they are described.

    Args:
        path: Of the experiment file.
        folder: Where the description for the workers is written, as folder ``basis``.
        progress: See :func:`steelyard.identify`.

    Raises:
        InputError: The experiment has what a simulation does not know, or states too little.
    """
    experiment = read_experiment(path)
    _check(experiment, str(path))
    found = identify(experiment, MaximumLikelihood.name, progress)
    body = found.estimate.body if found.estimate.physical else experiment.robot.platform
    if body is None or not found.motion:
        raise InputError(
            f"{path}: expected an experiment whose body and motion can be found, found"
            f" '{found.estimate.verdict}'; let inspect look at it"
        )
    robot = replace(experiment.robot, platform=body)
    place = folder / BASIS
    motions = []
    with results_folder(place, force=True) as fresh:
        write_yaml(robot_file(robot), fresh / "robot.yaml")
        write_yaml({"sync": _CLOCKS, "instruments": _described(experiment)}, fresh / "sensors.yaml")
        for i, motion in enumerate(found.motion):
            name = f"run-{i + 1}.csv"
            # Where it swings, it begins in the midst of that.
            _write_motion(motion, fresh / name, _HELD if robot.holds_any_pose else 0.0)
            motions.append(str(place / name))
    uncertainty = tuple((key, float(v)) for key, v in sorted(experiment.uncertainty.items()))
    setup = Setup(
        str(place / "robot.yaml"), str(place / "sensors.yaml"), tuple(motions), None, uncertainty
    )
    read_sensors(setup.sensors, robot)
    return setup


def _check(experiment: Experiment, path: str) -> None:
    """Refuse what would be simulated as something else."""
    for wrong, what in (
        (len(experiment.loads) > 1, "several loads"),
        (any(run.static for run in experiment.runs), "poses at rest"),
        (any(run.locked for run in experiment.runs), "locked winches"),
        (experiment.robot.covariance is not None, "a calibrated geometry with its covariance"),
    ):
        if wrong:
            raise InputError(
                f"{path}: expected an experiment that can be simulated, found one with {what};"
                " study its robot with --sensors instead"
            )
    for name, instrument in experiment.instruments.items():
        if instrument.commanded:
            continue
        if any(not each.noise for each in instrument.quantities(experiment.robot.m)):
            raise InputError(
                f"{path}: instruments.{name}: expected the key 'noise' to simulate it, found none;"
                " state the 1-sigma per sample"
            )


def _described(experiment: Experiment) -> dict[str, Any]:
    """Instruments with their rates, as they were recorded where they are not stated."""
    found = {}
    for name, instrument in experiment.instruments.items():
        streams = [run.streams[name] for run in experiment.runs if name in run.streams]
        if not streams or instrument.commanded:
            continue
        keys = instrument.model_dump(exclude_unset=True, mode="json")
        if instrument.rate is None:
            steps = np.concatenate([np.diff(stream.time) for stream in streams])
            keys["rate"] = float(np.round(1 / np.median(steps[steps > 0]), 3))
        found[name] = keys
    return found


def _write_motion(motion: FittedMotion, path: Path, rest: float) -> None:
    """Write a fitted motion as one that is commanded: smooth, for the vibrations of the platform on
    its cables (and noise) are no part of the command; the simulation has its own.

    Args:
        motion: As it was fitted.
        path: Of the file.
        rest: Before and after it [s].

    Raises:
        InputError: It is too short.
    """
    quaternion = Rotation.from_quat(motion.rotation, scalar_first=True)
    rpy = np.unwrap(quaternion.as_euler("ZYX")[:, ::-1], axis=0)
    held = round(rest * RATE)
    poses = np.pad(np.hstack([motion.values["position"], rpy]), ((held, held), (0, 0)), mode="edge")
    time = np.arange(len(poses)) / RATE
    samples = Samples1D(time, poses)
    smooth = fit(samples, 0.0, float(time[-1]), _SMOOTH)
    if smooth is None:
        raise InputError(
            f"run '{motion.run}': expected a motion of some seconds to simulate, found one of"
            f" {time[-1]:.2f} s; leave this run out"
        )
    rows = np.column_stack([time, smooth.at(time)])[::_THINNED]
    header = "t,x,y,z,roll,pitch,yaw"
    np.savetxt(path, rows, delimiter=",", header=header, comments="", fmt="%.12g")
