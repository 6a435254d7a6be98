"""Long recordings, such as an hour with forces and IMU at 100 Hz and a tracker at 238 Hz, made without
integrating the dynamics."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from steelyard.arrays import Array
from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run
from steelyard.experiment.write import write_experiment
from steelyard.motion.limits import commanded_tensions
from steelyard.motion.state import State
from steelyard.motion.trajectory import Trajectory
from steelyard.robot.file import read_robot
from steelyard.robot.model import Robot
from steelyard.simulation.recording import draw_errors, record
from steelyard.simulation.response import ExactMotion
from steelyard.simulation.sensors import paper_sensors
from steelyard.simulation.trajectories import feasible_multisine

DURATION = 3600.0
"""[s]"""
RATES = {"cables": 100.0, "imu": 100.0, "tracker": 238.0}
"""[Hz]"""


@dataclass(frozen=True)
class Repeated:
    """A trajectory over and over; it begins and ends at rest in the same pose."""

    once: Trajectory
    duration: float

    def derivative(self, t: Array, order: int) -> Array:
        return self.once.derivative(np.mod(t, self.once.duration), order)


@dataclass(frozen=True, eq=False)
class ExactMotionOnCables:
    """A platform that follows its command exactly, with tensions that do that."""

    robot: Robot
    motion: ExactMotion

    @property
    def duration(self) -> float:
        return self.motion.duration

    def at(self, times: Array) -> State:
        tension = commanded_tensions(self.robot, self.motion.trajectory, times)
        return replace(self.motion.at(times), tension=tension)


def write_long(folder: Path, duration: float, rates: Mapping[str, float] = RATES) -> Path:
    """Write a recording of a motion of 20 s again and again, followed exactly; returns its
    experiment file."""
    robot = read_robot("cogiro").with_straight_cables()
    suite = paper_sensors(robot).instruments
    instruments = {
        name: suite[name].model_copy(update={"rate": rate}) for name, rate in rates.items()
    }
    rng = np.random.default_rng(1)
    errors = draw_errors(instruments, robot.m, ["run"], rng)["run"]
    motion = ExactMotion(robot, robot.platform, Repeated(feasible_multisine(robot, 20.0), duration))
    response = ExactMotionOnCables(robot, motion)
    streams, sync = record(response, instruments, errors, robot, motion, rng)
    folder.mkdir(parents=True)
    # Under a name of its own: the bundled robot has sagging cables.
    robot = replace(robot, name="cogiro-straight")
    run = Run("run", streams, sync)
    write_experiment(Experiment(f"{duration:g} s", robot, instruments, (run,)), folder)
    return folder / "experiment.yaml"


if __name__ == "__main__":
    print(write_long(Path(sys.argv[1]), DURATION))
