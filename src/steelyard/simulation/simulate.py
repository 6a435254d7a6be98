"""A whole virtual experiment: motions, sensors, and the truth behind them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from steelyard.arrays import number_given, whole_given
from steelyard.errors import InputError, WrongValueError
from steelyard.experiment.model import Experiment, Load
from steelyard.experiment.recording import Run
from steelyard.experiment.write import write_experiment
from steelyard.inertia import Inertia
from steelyard.motion.trajectory import Trajectory
from steelyard.output import results_folder, write_json
from steelyard.robot.file import read_robot
from steelyard.robot.model import Robot
from steelyard.simulation.forward_dynamics import (
    DEFAULT,
    CablePlatform,
    ForwardDynamicsSettings,
)
from steelyard.simulation.loads import Loads, read_loads, recordings, stated_bodies
from steelyard.simulation.recording import Errors, draw_errors, record
from steelyard.simulation.response import ExactMotion, Progress, Response
from steelyard.simulation.sensors import Sensors, put_nested, read_sensors
from steelyard.simulation.trajectories import trajectories as motions

FORMAT = "steelyard-truth/1"
_OF_BODIES = 1
"""Stream of random numbers of what is known of loads, beside that of everything else."""


@dataclass(frozen=True, eq=False)
class VirtualExperiment:
    """An experiment whose truth is known."""

    experiment: Experiment
    body: Inertia
    """What the platform really is."""
    errors: Mapping[str, Mapping[str, Errors]]
    """Run -> instrument -> the systematic errors drawn."""
    loads: Mapping[str, Inertia] = field(default_factory=dict)
    """Name -> what the platform really is with it, where there are several; the body is the
    first."""

    def truth(self) -> dict[str, Any]:
        """Body and calibration as plain values, in the shape of ``truth.json``."""
        calibration: dict[str, Any] = {}
        runs = list(self.errors)
        m = self.experiment.robot.m
        for name, instrument in self.experiment.instruments.items():
            entry: dict[str, Any] = {}
            for term in instrument.terms(m):
                drawn = {run: self.errors[run][name].calibration[term.key].tolist() for run in runs}
                put_nested(entry, term.key, drawn if term.prior.per == "run" else drawn[runs[0]])
            entry["delay"] = {run: self.errors[run][name].delay for run in runs}
            calibration[name] = entry
        loads = {name: body.to_dict() for name, body in self.loads.items()}
        return {
            "format": FORMAT,
            **self.body.to_dict(),
            **({"loads": loads} if loads else {}),
            "calibration": calibration,
        }

    def write(self, folder: str | Path, *, force: bool = False) -> None:
        """Write ``experiment.yaml`` with its streams, and ``truth.json`` beside it; all or nothing.

        Args:
            folder: A new one, or an empty one.
            force: Whether to replace files of the same names.

        Raises:
            InputError: Something is there already.
        """
        with results_folder(Path(folder), force=force) as fresh:
            write_virtual(self, fresh)

    def __repr__(self) -> str:
        return f"{self.experiment!r}\n  truth: {self.body!r}"


def write_virtual(virtual: VirtualExperiment, folder: Path) -> None:
    """Write an experiment and its truth into an empty folder that exists."""
    write_experiment(virtual.experiment, folder)
    write_json(virtual.truth(), folder / "truth.json")


def simulate(
    robot: Robot | str | Path,
    trajectories: Mapping[str, Trajectory] | str = "multisine",
    sensors: Sensors | str = "paper",
    *,
    duration: float | None = None,
    seed: int = 0,
    name: str | None = None,
    loads: Mapping[str, Inertia] | Loads | str | Path | None = None,
    progress: Callable[[str, float], None] | None = None,
    settings: ForwardDynamicsSettings = DEFAULT,
) -> VirtualExperiment:
    """Record a virtual experiment.

    Args:
        robot: With a nominal platform, which is the true one here; or a bundled name, or the path
            of a robot file.
        trajectories: Run -> commanded motion; or ``paper``, ``multisine``, or the path of a CSV
            file of kind ``command``.
        sensors: Instruments; their errors are drawn with the sigmas that they state. Or ``paper``,
            ``ideal``, or the path of a YAML file.
        duration: Of a motion that is named: of a move of the paper, or of the multisine [s]; None:
            its default.
        seed: Of all that is drawn; the same seed gives the same numbers.
        name: Of the experiment.
        loads: Name -> body that the platform is with it: every motion is recorded with every load,
            as run ``MOTION LOAD``. Or the path of a YAML file with ``loads`` as in an experiment
            file and the ``order`` of the recordings; what is ``known`` there with a 1-sigma lies
            off by a draw of it. None: that of the robot alone.
        progress: Is given the run and the fraction of it that is done.
        settings: Of the forward dynamics.

    Raises:
        InputError: The robot file lacks what a simulation needs, or there is nothing of a name.
        InfeasibleError: The robot cannot follow a trajectory.
    """
    seed = whole_given(seed, "--seed")
    if duration is not None:
        duration = number_given(duration, "--duration", above=0, unit="s")
    robot = robot if isinstance(robot, Robot) else read_robot(robot)
    sensors = sensors if isinstance(sensors, Sensors) else read_sensors(sensors, robot)
    if not isinstance(trajectories, str | Mapping):
        raise WrongValueError(
            "trajectories: expected a mapping of names to motions, a name or the path of a file,"
            f" found {type(trajectories).__name__}; correct it"
        )
    stated, order, bodies = _carried(loads, robot, seed)
    if stated:
        robot = replace(robot, platform=stated[0].nominal or bodies[stated[0].name])
    if isinstance(trajectories, str):
        trajectories = motions(robot, trajectories, duration)
    elif duration is not None:
        raise InputError(
            "duration: expected none with trajectories, found one; they have their own durations"
        )
    carrying: dict[str | None, Robot] = {
        name: replace(robot, platform=body) for name, body in bodies.items()
    } or {None: robot}
    carried: Mapping[str, tuple[str | None, str]] = (
        recordings(order, trajectories) if order else {each: (None, each) for each in trajectories}
    )
    responders = {load: _responder(each, settings) for load, each in carrying.items()}
    # Errors, noise and clocks come from streams of their own, so that one more run changes nothing
    # in the others.
    draw, *per_run = np.random.default_rng(seed).spawn(1 + len(carried))
    errors = draw_errors(sensors.instruments, robot.m, list(carried), draw)
    runs = []
    for (run, (load, motion)), rng in zip(carried.items(), per_run, strict=True):
        response = responders[load](trajectories[motion], _of_run(progress, run))
        body = carrying[load].platform
        assert body is not None  # _responder() has checked
        command = ExactMotion(robot, body, trajectories[motion])
        streams, sync = record(response, sensors.instruments, errors[run], robot, command, rng)
        runs.append(Run(name=run, streams=streams, sync=sync, load=load))
    first = next(iter(carrying.values()))
    assert first.platform is not None
    experiment = Experiment(
        name=name or f"virtual {robot.name}",
        robot=replace(robot, platform=stated[0].nominal) if stated else robot,
        instruments=sensors.instruments,
        runs=tuple(runs),
        known=stated[0].known if stated else {},
        uncertainty={"anchor": 0.0, "attachment": 0.0, "gravity": 0.0},
        loads=stated,
    )
    return VirtualExperiment(experiment, first.platform, errors, bodies)


def _carried(
    loads: Mapping[str, Inertia] | Loads | str | Path | None, robot: Robot, seed: int
) -> tuple[tuple[Load, ...], tuple[str, ...], Mapping[str, Inertia]]:
    """Loads as they are stated, their names in the order of the recordings, and what they are.

    Raises:
        InputError: A file is wrong.
    """
    if isinstance(loads, str | Path):
        loads = read_loads(loads, robot)
    if isinstance(loads, Loads):
        drawn = loads.drawn(np.random.default_rng([seed, _OF_BODIES]))
        return loads.stated, loads.order, drawn
    if loads is not None and not isinstance(loads, Mapping):
        raise WrongValueError(
            "loads: expected a mapping of names to bodies, or the path of a file, found"
            f" {type(loads).__name__}; correct it"
        )
    bodies = loads or {}
    return stated_bodies(bodies, robot.platform), tuple(bodies), bodies


def _responder(
    robot: Robot, settings: ForwardDynamicsSettings
) -> Callable[[Trajectory, Progress | None], Response]:
    """How the nominal platform of a robot answers a command.

    Raises:
        InputError: The robot file lacks what a simulation needs.
    """
    if robot.platform is None:
        raise InputError(
            f"robot '{robot.name}': expected a nominal platform to simulate, found none; add"
            " 'platform' to its file"
        )
    body = robot.platform
    if not robot.m:
        return lambda trajectory, progress: ExactMotion(robot, body, trajectory)
    return CablePlatform(robot, body, settings).move


def _of_run(progress: Callable[[str, float], None] | None, run: str) -> Progress | None:
    """Progress of one run as that of the whole."""
    return None if progress is None else lambda fraction: progress(run, fraction)
