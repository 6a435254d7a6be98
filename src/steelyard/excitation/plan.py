"""What a motion is designed for: a robot and its instruments, before there is any recording."""

from __future__ import annotations

import os
from pathlib import Path

from steelyard.experiment.model import Experiment
from steelyard.experiment.read import read_plan
from steelyard.files.yaml_file import read_yaml
from steelyard.robot.file import bundled_names, read_robot
from steelyard.robot.model import Robot
from steelyard.simulation.sensors import Sensors, read_sensors


def planned(
    subject: Experiment | Robot | str | Path, sensors: Sensors | str = "paper"
) -> Experiment:
    """An experiment that is to be made.

    Args:
        subject: An experiment, whose recordings are not needed; a robot; or the path or bundled
            name of one of them.
        sensors: Instruments of a robot that comes alone: ``paper``, ``ideal``, or the path of a
            YAML file.

    Raises:
        InputError: There is nothing of that name, or a file is wrong.
    """
    if isinstance(subject, Experiment):
        return subject
    if not isinstance(subject, Robot) and is_experiment(subject):
        return read_plan(subject)
    robot = subject if isinstance(subject, Robot) else read_robot(subject)
    suite = sensors if isinstance(sensors, Sensors) else read_sensors(sensors, robot)
    return Experiment(
        name=robot.name,
        robot=robot,
        instruments=suite.instruments,
        runs=(),
        uncertainty={"anchor": 0.0, "attachment": 0.0, "gravity": 0.0},
        source=robot.name if isinstance(subject, Robot) else str(subject),
    )


def is_experiment(place: str | Path) -> bool:
    """Whether a path leads to an experiment and not to a robot."""
    if not isinstance(place, str | os.PathLike):
        return False
    path = Path(place)
    if str(place) in bundled_names() or not path.is_file():
        return False
    data = read_yaml(path).data
    return isinstance(data, dict) and ("format" in data or "instruments" in data)
