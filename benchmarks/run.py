"""Prints how long things take and how accurate they are: `make bench`, or `python benchmarks/run.py [NAME ...]`.

Every time is that of a whole process, the median of three, beside that of a bare import of the same libraries in the same run:
machines differ and are noisy, ratios less so.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from recordings import recordings

from steelyard.experiment.model import Experiment, Run
from steelyard.experiment.read import read_experiment
from steelyard.identification.two_step import TwoStep
from steelyard.inertia import BODY_PARAMETERS
from steelyard.robot.file import read_robot
from steelyard.simulation.forward_dynamics import CablePlatform, ExactMotion
from steelyard.simulation.sensors import draw_errors, paper_sensors, record
from steelyard.simulation.trajectories import feasible_multisine

STEELYARD = [sys.executable, "-m", "steelyard"]
REFERENCE = [sys.executable, "-c", "import casadi, numpy, polars, pydantic, scipy.interpolate, scipy.integrate"]


def process(command: list[str]) -> tuple[float, float]:
    """Wall time [s] and peak memory [MiB] of a whole process."""
    start = time.perf_counter()
    child = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(child.pid, 0)
    child.returncode = os.waitstatus_to_exitcode(status)
    if child.returncode:
        raise RuntimeError(f"{' '.join(command)} ended with {child.returncode}")
    return time.perf_counter() - start, usage.ru_maxrss / 1024


def measured(command: list[str], repeat: int = 3) -> float:
    """Median wall time of a whole process [s]."""
    return statistics.median(process(command)[0] for _ in range(repeat))


def show(what: str, seconds: float, limit: float, reference: float) -> None:
    print(f"{what:58} {seconds:7.2f} s   limit {limit:5.1f} s   {seconds / reference:6.1f} x bare import")


def speed(folder: Path) -> None:
    """Whole-process times of the verbs."""
    reference = measured(REFERENCE)
    print(f"{'bare import of the libraries':58} {reference:7.2f} s")
    out = folder / "experiment"
    simulate = [
        *STEELYARD,
        "simulate",
        "cogiro",
        "--trajectory",
        "multisine",
        "--duration",
        "20",
        "--force",
        "--out",
        str(out),
    ]
    show("steelyard --help", measured([*STEELYARD, "--help"]), 0.3, reference)
    show("simulate cogiro, 20 s, sensors of the paper", measured(simulate), 5.0, reference)
    show("simulate cogiro, 20 s, ideal sensors", measured([*simulate, "--sensors", "ideal"]), 5.0, reference)
    show(
        "identify 20 s (250 Hz), two-step",
        measured([*STEELYARD, "identify", str(out / "experiment.yaml")]),
        2.5,
        reference,
    )
    measured(simulate, 1)
    show(
        "identify 20 s (sensors of the paper), two-step",
        measured([*STEELYARD, "identify", str(out / "experiment.yaml")]),
        2.5,
        reference,
    )
    demo = [*STEELYARD, "demo", "--force", "--out", str(folder / "demo")]
    show("demo", measured(demo, 1), 60.0, reference)


def hour(folder: Path) -> None:
    """One hour of recording."""
    reference = measured(REFERENCE)
    # In a process of its own: what this one holds would count as the memory of its children.
    process([sys.executable, str(Path(__file__).parent / "hour.py"), str(folder / "hour")])
    seconds, peak = process([*STEELYARD, "identify", str(folder / "hour" / "experiment.yaml")])
    show("identify 1 h (forces, IMU 100 Hz, tracker 238 Hz), two-step", seconds, 30.0, reference)
    print(f"{'  its peak memory':58} {peak:7.0f} MiB limit  1024 MiB")


def accuracy(_: Path) -> None:
    """Errors of the two steps on recordings of another simulator."""
    print(
        f"{'recording':16}{'a_P from':>9}"
        + "".join(f"{name:>9}" for name in BODY_PARAMETERS)
        + "   [kg], [mm], [kg m^2]"
    )
    for acceleration in ("imu", "tracker"):
        errors = []
        for name, path, truth in recordings():
            estimate = TwoStep(acceleration=acceleration)(read_experiment(path))
            error = (estimate.value - truth.body_parameters) * np.array([1, 1e3, 1e3, 1e3, 1, 1, 1, 1, 1, 1])
            print(
                f"{name:16}{acceleration:>9}"
                + "".join(f"{e:9.3f}" if np.isfinite(e) else f"{'null':>9}" for e in error)
            )
            if name.startswith("points"):
                errors.append(error)
        rmse = np.sqrt(np.mean(np.square(errors), axis=0))
        print(f"{'rmse of points-*':16}{acceleration:>9}" + "".join(f"{e:9.3f}" for e in rmse))


def honesty(_: Path) -> None:
    """How the errors of the two steps compare with the 1-sigma that they state, over forty draws of the paper's sensors."""
    robot = read_robot("cogiro").with_straight_cables()
    trajectory = feasible_multisine(robot, 20.0)
    response = CablePlatform(robot, robot.platform).move(trajectory)
    command = ExactMotion(robot, robot.platform, trajectory)
    instruments = paper_sensors(robot).instruments
    errors, in_sigmas = [], []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        drawn = draw_errors(instruments, robot.m, ["run"], rng)["run"]
        streams, sync = record(response, instruments, drawn, robot, command, rng)
        estimate = TwoStep()(Experiment("draw", robot, instruments, (Run("run", streams, sync),)))
        errors.append(estimate.value - robot.platform.body_parameters)
        in_sigmas.append(errors[-1] / estimate.standard_deviation)
    print(f"{'':28}" + "".join(f"{name:>9}" for name in BODY_PARAMETERS))
    for what, values in (("rmse [kg], [m], [kg m^2]", errors), ("rms error in stated sigmas", in_sigmas)):
        print(f"{what:28}" + "".join(f"{v:9.3f}" for v in np.sqrt(np.mean(np.square(values), axis=0))))


BENCHMARKS = {"speed": speed, "hour": hour, "accuracy": accuracy, "honesty": honesty}

if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as temporary:
        for chosen in sys.argv[1:] or BENCHMARKS:
            print(f"\n== {chosen}")
            BENCHMARKS[chosen](Path(temporary))
