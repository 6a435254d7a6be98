"""Clocks found from the data: offsets on own simulations, whose clocks are known, and the two steps
on recordings with ``sync: auto``.

Usage: python benchmarks/clocks.py [offsets [N] | recordings]
"""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
from recordings import recordings

from steelyard.errors import InputError
from steelyard.experiment.model import Experiment
from steelyard.experiment.read import read_experiment
from steelyard.identification.methods.two_step import TwoStep
from steelyard.identification.synchronisation import offsets_of, synchronise
from steelyard.robot.file import read_robot
from steelyard.simulation.sensors import read_sensors
from steelyard.simulation.simulate import simulate
from steelyard.simulation.trajectories import trajectories


def unsynchronised(experiment: Experiment) -> Experiment:
    """The same recording without anything said of its clocks."""
    return replace(
        experiment,
        runs=tuple(replace(run, sync={}, unsynchronised=not run.static) for run in experiment.runs),
    )


def offsets(count: int) -> None:
    """Errors of the offsets over own simulations with the sensors of the paper."""
    robot = read_robot("cogiro")
    sensors = read_sensors("paper", robot)
    motion = trajectories(robot, "multisine", 20.0)
    errors: dict[tuple[str, str], list[tuple[float, float]]] = {}
    for seed in range(count):
        virtual = simulate(robot, motion, sensors, seed=seed)
        experiment = virtual.experiment
        run = experiment.runs[0]
        force = experiment.force_instrument(run)
        delay = {name: virtual.errors[run.name][name].delay for name in run.streams}
        true = {
            name: run.sync[name] + delay[name] - run.sync[force] - delay[force]
            for name in run.streams
        }
        auto = unsynchronised(experiment)
        for what, found in (
            ("pairs", offsets_of(auto, auto.runs[0])),
            ("all at once", synchronise(auto).offsets[run.name]),
        ):
            for offset in found[1:]:
                for name in offset.instruments:
                    errors.setdefault((what, name), []).append(
                        (offset.value - true[name], offset.sigma)
                    )
    print(
        f"{count} simulations of CoGiRo, 20 s, sensors of the paper: offsets against the clock of"
        " the forces [ms]"
    )
    print(f"{'':24} {'rms error':>10} {'worst':>8} {'stated':>8}")
    for (what, name), each in errors.items():
        error, sigma = 1e3 * np.array(each).T
        print(
            f"{what:12} {name:11} {np.sqrt(np.mean(error**2)):10.2f} {np.abs(error).max():8.2f}"
            f" {np.sqrt(np.mean(sigma**2)):8.2f}"
        )


def on_recordings() -> None:
    """The two steps with the clocks as given and as found."""
    print(
        f"{'recording':14} {'clocks moved by [ms]':34} {'mass error [kg]':>18} {'centre [mm]':>16}"
        f" {'moments [kg m^2]':>18}"
    )
    for name, path, truth in recordings():
        experiment = read_experiment(path)
        given = TwoStep()(experiment)
        try:
            found = synchronise(unsynchronised(experiment))
        except InputError as error:
            print(f"{name:14} {error}")
            continue
        auto = TwoStep()(found.experiment)
        moved = []
        for run, each in zip(experiment.runs, found.experiment.runs, strict=True):
            force = experiment.force_instrument(run)
            for instrument in run.streams:
                if instrument != force and run.sync:
                    change = (
                        each.sync[instrument]
                        - each.sync[force]
                        - run.sync[instrument]
                        + run.sync[force]
                    )
                    moved.append(f"{1e3 * change:+.1f}")
        cells = []
        for estimate in (given, auto):
            error = estimate.value - truth.body_parameters
            cells.append((error[0], np.linalg.norm(error[1:4]) * 1e3, np.linalg.norm(error[4:7])))
        shown = " ".join(f"{a:8.2f} {b:8.2f}" for a, b in zip(*cells, strict=True))
        print(f"{name:14} {' '.join(moved[:6]):34} {shown}")


if __name__ == "__main__":
    what = sys.argv[1] if len(sys.argv) > 1 else "all"
    if what in {"all", "offsets"}:
        offsets(int(sys.argv[2]) if len(sys.argv) > 2 else 10)
    if what in {"all", "recordings"}:
        on_recordings()
