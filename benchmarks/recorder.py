"""One motion that is simulated once and recorded as often as one likes: for benchmarks that need many
recordings of one kind.
"""

from __future__ import annotations

import numpy as np

from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run
from steelyard.motion.trajectory import Trajectory
from steelyard.robot.file import read_robot
from steelyard.simulation.forward_dynamics import CablePlatform
from steelyard.simulation.recording import draw_errors, record
from steelyard.simulation.response import ExactMotion, Response
from steelyard.simulation.sensors import paper_sensors
from steelyard.simulation.trajectories import feasible_multisine

FIRST_SEED = 100_000
"""Apart from the seeds of all tests."""
METHODS = (
    "two-step",
    "least-squares",
    "instrumental-variables",
    "consistent",
    "maximum-likelihood",
)


class Recorder:
    """One motion of CoGiRo with straight cables, recorded with sensors of the paper as often as one
    likes."""

    def __init__(self, duration: float = 20.0, trajectory: Trajectory | None = None) -> None:
        self.robot = read_robot("cogiro").with_straight_cables()
        assert self.robot.platform is not None
        trajectory = trajectory or feasible_multisine(self.robot, duration)
        self.response = CablePlatform(self.robot, self.robot.platform).move(trajectory)
        self.command = ExactMotion(self.robot, self.robot.platform, trajectory)
        self.instruments = paper_sensors(self.robot).instruments

    def __call__(self, seed: int, response: Response | None = None) -> Experiment:
        """With errors and noise of a seed; of another response than that of the platform alone."""
        rng = np.random.default_rng(seed)
        drawn = draw_errors(self.instruments, self.robot.m, ["run"], rng)["run"]
        streams, sync = record(
            response or self.response, self.instruments, drawn, self.robot, self.command, rng
        )
        exact = {"anchor": 0.0, "attachment": 0.0, "gravity": 0.0}
        return Experiment(
            "draw", self.robot, self.instruments, (Run("run", streams, sync),), uncertainty=exact
        )
