"""Two loads in one fit: what was picked up, against two recordings that know nothing of each other.

`python benchmarks/loads.py [PAIRS PROCESSES [KILOGRAMS ...]]`: CoGiRo, 20 s on six axes, sensors of
the paper with gains of 1 % (.5 % common), offsets of 5 N, geometry within 2 mm; one run without and
one with the payload. `mujoco` in place of kilograms: ten pairs of 16 kg whose motion is MuJoCo's.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from steelyard.arrays import Array
from steelyard.estimates.payload import payload
from steelyard.experiment.model import Experiment, Load
from steelyard.experiment.recording import Run
from steelyard.identification.identify import identify
from steelyard.inertia import BODY_PARAMETERS, Inertia
from steelyard.robot.file import read_robot
from steelyard.robot.model import Robot
from steelyard.simulation.recording import draw_errors, record
from steelyard.simulation.response import ExactMotion
from steelyard.simulation.sensors import Sensors, paper_sensors
from steelyard.simulation.simulate import simulate
from steelyard.simulation.trajectories import feasible_multisine

sys.path.append(str(Path(__file__).parents[1] / "tests"))
from mujoco_cables import hung, point_robot

FIRST_SEED = 700_000
"""Apart from the seeds of every test and of the other benchmarks."""
GEOMETRY = 0.002
"""1-sigma of every coordinate of anchors and attachments [m]."""
DURATION = 20.0
"""[s]"""
MUJOCO = 16.0
"""Payload of the pairs in MuJoCo [kg]."""
LEVEL = 600.0
"""Mean tension that its winches hold [N]."""


@dataclass(frozen=True)
class Pair:
    """What one pair of runs told of the payload."""

    off: Array
    """Error over 1-sigma of the ten of what was added, in one fit, shape (10,)."""
    chi_square: float
    sigma: float
    """Of its mass, in one fit [kg]."""
    apart: float
    """The same of two recordings that know nothing of each other [kg]."""
    accepted: bool


def sensors(robot: Robot) -> Sensors:
    """Those of the paper, with gains."""
    own = dict(paper_sensors(robot).instruments)
    cables = own["cables"].model_dump(exclude_unset=True)
    cables["calibration"] |= {"gain": 0.01, "common_gain": 0.005}
    own["cables"] = type(own["cables"]).model_validate(cables)
    return Sensors(own)


def off_by(robot: Robot, rng: np.random.Generator) -> Robot:
    """The robot as it is, where it is described as it was drawn."""
    anchors, attachments = (
        points + GEOMETRY * rng.standard_normal(points.shape)
        for points in (robot.anchors, robot.attachments)
    )
    return replace(robot, anchors=anchors, attachments=attachments)


def box(mass: float, rng: np.random.Generator) -> Inertia:
    """A payload somewhere on the platform."""
    size = rng.uniform(0.2, 0.5, 3)
    square = size**2
    moments = mass / 12 * (square.sum() - square)
    return Inertia(mass, rng.uniform([-0.3, -0.3, -0.5], [0.3, 0.3, 0.3]), np.diag(moments))


def simulated(seed: int, mass: float) -> tuple[Experiment, Inertia]:
    """A pair of the project's own simulator."""
    rng = np.random.default_rng(seed)
    robot = read_robot("cogiro")
    assert robot.platform is not None
    added = box(mass, rng)
    loaded = Inertia.from_parameters(robot.platform.parameters + added.parameters)
    motion = {"move": feasible_multisine(robot, DURATION)}
    loads = {"empty": robot.platform, "loaded": loaded}
    virtual = simulate(off_by(robot, rng), motion, sensors(robot), seed=seed, loads=loads)
    return described(virtual.experiment, robot), added


def in_mujoco(seed: int, mass: float) -> tuple[Experiment, Inertia]:
    """A pair whose motion and tensions are MuJoCo's."""
    rng = np.random.default_rng(seed)
    robot = point_robot()
    assert robot.platform is not None
    added = box(mass, rng)
    loaded = Inertia.from_parameters(robot.platform.parameters + added.parameters)
    motion, true = feasible_multisine(robot, DURATION), off_by(robot, rng)
    instruments = sensors(robot).instruments
    errors = draw_errors(instruments, robot.m, ["empty", "loaded"], rng)
    runs = []
    for name, body in (("empty", robot.platform), ("loaded", loaded)):
        own = replace(true, platform=body)
        command = ExactMotion(robot, body, motion)
        hanging = hung(own, motion, LEVEL)
        streams, sync = record(hanging, instruments, errors[name], own, command, rng)
        runs.append(Run(name, streams, sync, load=name))
    loads = (Load("empty", nominal=robot.platform), Load("loaded"))
    found = Experiment("MuJoCo", robot, instruments, tuple(runs), loads=loads)
    return described(found, robot), added


def described(experiment: Experiment, robot: Robot) -> Experiment:
    """As the file would say it: the robot as drawn, and how well that is known."""
    uncertainty = {"anchor": GEOMETRY, "attachment": GEOMETRY, "gravity": 0.005}
    return replace(experiment, robot=robot, uncertainty=uncertainty)


def told(seed: int, mass: float, *, mujoco: bool = False) -> Pair:
    """What one pair tells."""
    experiment, added = (in_mujoco if mujoco else simulated)(seed, mass)
    together = identify(experiment, "maximum-likelihood").estimate.loads
    assert together is not None
    (difference,) = together.differences.values()
    apart = payload(
        *(
            identify(experiment.alone(load), "maximum-likelihood").estimate
            for load in experiment.loads
        )
    ).estimate
    error = difference.value - added.body_parameters
    return Pair(
        error / difference.standard_deviation,
        float(error @ np.linalg.solve(difference.covariance, error)),
        float(difference.standard_deviation[0]),
        float(apart.standard_deviation[0]),
        all(bool(each.verdict.accepted) for each in together.estimates.values()),
    )


def show(title: str, pairs: list[Pair]) -> None:
    """Coverage, chi-square, and what one fit is worth."""
    off = np.array([each.off for each in pairs])
    chi = np.array([each.chi_square for each in pairs])
    sigma, apart = (np.array([getattr(each, key) for each in pairs]) for key in ("sigma", "apart"))
    # A payload that weighs nothing that is told has a mass alone.
    whole = np.isfinite(off).all(axis=1)
    print(f"\n{title}: {len(pairs)} pairs, {sum(each.accepted for each in pairs)} accepted")
    print("  95 % intervals cover   " + "".join(f"{name:>7}" for name in BODY_PARAMETERS))
    cover = np.nanmean(np.where(np.isfinite(off), np.abs(off) < 1.96, np.nan), axis=0)
    print(" " * 25 + "".join(f"{value:7.1%}" for value in cover))
    print(f"  of all numbers {np.nanmean(np.abs(off[np.isfinite(off)]) < 1.96):.1%}")
    print(f"  chi-square per parameter {np.mean(chi[whole]) / 10:.2f} over {whole.sum()} pairs")
    print(
        f"  1-sigma of its mass {np.median(sigma):.4f} kg; of two recordings apart"
        f" {np.median(apart):.3f} kg: 1/{np.median(apart / sigma):.0f}",
        flush=True,
    )


def main(count: int, processes: int, masses: list[str]) -> None:
    with get_context("spawn").Pool(processes) as pool:
        for i, mass in enumerate(masses):
            first = FIRST_SEED + 1000 * i
            if mass == "mujoco":
                one = partial(told, mass=MUJOCO, mujoco=True)
                show(f"MuJoCo, {MUJOCO:g} kg", list(pool.imap(one, range(first, first + 10))))
            else:
                one = partial(told, mass=float(mass))
                show(f"{float(mass):g} kg", list(pool.imap(one, range(first, first + count))))


if __name__ == "__main__":
    pairs, processes, *masses = [*sys.argv[1:], *("60", "2")[len(sys.argv) - 1 :]]
    main(int(pairs), int(processes), masses or ["16", "5", "1", "mujoco"])
