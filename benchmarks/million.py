"""A million samples: forces and IMU at 250 Hz and a tracker at 100 Hz over 4000 s, on cables that
sag; one motion of 20 s again and again."""

from __future__ import annotations

import sys
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np

from steelyard.arrays import Array
from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run
from steelyard.experiment.write import write_experiment
from steelyard.motion.state import State
from steelyard.robot.file import read_robot
from steelyard.simulation.forward_dynamics import CablePlatform
from steelyard.simulation.recording import draw_errors, record
from steelyard.simulation.response import ExactMotion, Response
from steelyard.simulation.sensors import paper_sensors
from steelyard.simulation.trajectories import feasible_multisine

PERIOD = 20.0
RATES = {"cables": 250.0, "imu": 250.0, "tracker": 100.0}


@dataclass(frozen=True, eq=False)
class Again:
    """A response over and over; it begins and ends at rest in the same pose."""

    once: Response
    duration: float

    def at(self, times: Array) -> State:
        # Every instant of the period that is asked for is evaluated once.
        within, back = np.unique(np.round(np.mod(times, PERIOD), 6), return_inverse=True)
        state = self.once.at(within)
        arrays = {f.name: getattr(state, f.name) for f in fields(State)}
        return replace(
            state,
            **{
                k: v[back]
                for k, v in arrays.items()
                if isinstance(v, np.ndarray) and len(v) == len(within)
            },
        )


def write_million(folder: Path, samples: int = 1_000_000) -> Path:
    """Write the recording; returns its experiment file."""
    robot = read_robot("cogiro")
    assert robot.platform is not None
    suite = paper_sensors(robot).instruments
    instruments = {
        name: suite[name].model_copy(update={"rate": rate}) for name, rate in RATES.items()
    }
    rng = np.random.default_rng(1)
    errors = draw_errors(instruments, robot.m, ["long"], rng)
    trajectory = feasible_multisine(robot, PERIOD)
    response = Again(
        CablePlatform(robot, robot.platform).move(trajectory), samples / RATES["cables"]
    )
    command = ExactMotion(robot, robot.platform, trajectory)
    streams, sync = record(response, instruments, errors["long"], robot, command, rng)
    folder.mkdir(parents=True)
    write_experiment(
        Experiment("a million samples", robot, instruments, (Run("long", streams, sync),)), folder
    )
    return folder / "experiment.yaml"


if __name__ == "__main__":
    print(write_million(Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 1_000_000))
