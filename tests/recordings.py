"""A small experiment to read, to copy and to corrupt."""

import tempfile
from dataclasses import replace
from functools import cache
from pathlib import Path

from steelyard.experiment.model import Experiment
from steelyard.experiment.write import write_stream, write_yaml
from steelyard.robot.file import read_robot, robot_file
from steelyard.simulation.sensors import paper_sensors
from steelyard.simulation.simulate import simulate
from steelyard.simulation.trajectories import trajectories

RUN = "moving"
DURATION = 4.0  # [s]

EXPERIMENT = """\
format: steelyard/1
name: small
robot: robot.yaml
uncertainty: {anchor: 0.0, attachment: 0.0, gravity: 0.0}
instruments:
  cables:
    kind: tension
    clock: recorder
    noise: 5.0
    calibration: {offset: 5.0, gain: 0.0, common_gain: 0.0}
  imu:
    kind: imu
    clock: recorder
    position: [0.047, -0.039, 0.299]
    noise: {angular_velocity: 0.0017, specific_force: 0.03, orientation: 0.0035}
    calibration: {gyro_bias: 0.005, accelerometer_bias: 0.05, misalignment: 0.01}
  tracker:
    kind: position
    target: [0.098, 0.197, 1.1]
    noise: 0.0005
runs:
  - name: moving
    cables: moving/cables.csv
    imu: moving/imu.csv
    tracker: moving/tracker.csv
    sync: {cables: %r, imu: %r, tracker: %r}
"""


@cache
def simulated() -> Experiment:
    """Cogiro on straight cables with the sensors of the paper, one short motion; under a name that
    is not bundled."""
    robot = replace(read_robot("cogiro").with_straight_cables(), name="straight")
    motion = trajectories(robot, "multisine", DURATION)
    return simulate(robot, {RUN: motion["multisine"]}, paper_sensors(robot), seed=3).experiment


@cache
def _files() -> dict[str, bytes]:
    experiment = simulated()
    run = experiment.runs[0]
    names = ("cables", "imu", "tracker")
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        (folder / RUN).mkdir()
        write_yaml(robot_file(experiment.robot), folder / "robot.yaml")
        for name in names:
            path = folder / RUN / f"{name}.csv"
            write_stream(run.streams[name], experiment.instruments[name], experiment.robot.m, path)
        (folder / "experiment.yaml").write_text(
            EXPERIMENT % tuple(run.sync[name] for name in names)
        )
        return {
            str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()
        }


def write_small(folder: Path) -> Path:
    """Write the small experiment into a folder that may exist; gives the path of its experiment
    file."""
    for name, content in _files().items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    return folder / "experiment.yaml"


def table(path: Path) -> list[list[str]]:
    """Cells of a CSV file; row 0 is the header, so that row i stands in line i + 1."""
    return [line.split(",") for line in path.read_text().splitlines()]


def save(path: Path, rows: list[list[str]]) -> None:
    """Write cells back."""
    path.write_text("".join(",".join(row) + "\n" for row in rows))
