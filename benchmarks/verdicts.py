"""Wrong descriptions and disturbed recordings, and whether the verdict rejects them; sound ones,
and whether it accepts them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from multiprocessing import get_context

import numpy as np

from steelyard.arrays import Array
from steelyard.experiment.model import Experiment, Run, Stream
from steelyard.identification.methods.least_squares import LeastSquares
from steelyard.motion.state import State
from steelyard.motion.trajectory import Trajectory
from steelyard.robot.file import read_robot
from steelyard.robot.kinematics import cables_at
from steelyard.robot.model import Robot
from steelyard.simulation.forward_dynamics import CablePlatform
from steelyard.simulation.recording import draw_errors, record
from steelyard.simulation.response import ExactMotion, Response
from steelyard.simulation.sensors import paper_sensors
from steelyard.simulation.trajectories import feasible_multisine


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

    def __call__(
        self, seed: int, disturb: Callable[[State, Array], Array] | None = None
    ) -> Experiment:
        """An experiment; ``disturb`` gives the wrench of a hand at states and times."""
        rng = np.random.default_rng(seed)
        drawn = draw_errors(self.instruments, self.robot.m, ["run"], rng)["run"]
        response: Response = (
            self.response if disturb is None else Touched(self.robot, self.response, disturb)
        )
        streams, sync = record(response, self.instruments, drawn, self.robot, self.command, rng)
        exact = {"anchor": 0.0, "attachment": 0.0, "gravity": 0.0}
        return Experiment(
            "draw", self.robot, self.instruments, (Run("run", streams, sync),), uncertainty=exact
        )


class Touched:
    """The same motion with a hand on the platform, which the cables feel."""

    def __init__(
        self, robot: Robot, response: Response, wrench: Callable[[State, Array], Array]
    ) -> None:
        self.robot, self.response, self.wrench = robot, response, wrench

    @property
    def duration(self) -> float:
        return self.response.duration

    def at(self, times: Array) -> State:
        state = self.response.at(times)
        W = cables_at(self.robot, state.position, state.rotation, state.tension).structure
        extra = np.einsum("nmk,nk->nm", np.linalg.pinv(W), self.wrench(state, times))
        return replace(state, tension=state.tension - extra)


def hand(state: State, times: Array) -> Array:
    """A hand that pushes with 40 N for two seconds, .5 m beside the origin."""
    force = np.zeros((len(times), 6))
    push = np.where((times > 8) & (times < 10), 40.0, 0.0)
    force[:, 1], force[:, 5] = push, 0.5 * push
    return force


def with_stream(
    experiment: Experiment, name: str, change: Callable[[Mapping[str, Array]], dict[str, Array]]
) -> Experiment:
    """The experiment with other readings of one instrument."""
    runs = []
    for run in experiment.runs:
        stream = run.streams[name]
        changed = Stream(stream.time, {**stream.values, **change(stream.values)}, stream.source)
        runs.append(replace(run, streams={**run.streams, name: changed}))
    return replace(experiment, runs=tuple(runs))


def moved_attachment(experiment: Experiment, cable: int, axis: int) -> Experiment:
    attachments = np.array(experiment.robot.attachments)
    attachments[cable, axis] += 0.05
    return replace(experiment, robot=replace(experiment.robot, attachments=attachments))


def swapped(experiment: Experiment, i: int, j: int) -> Experiment:
    def change(values: Mapping[str, Array]) -> dict[str, Array]:
        order = np.arange(experiment.robot.m)
        order[[i, j]] = order[[j, i]]
        return {"tension": values["tension"][:, order]}

    return with_stream(experiment, "cables", change)


def clipped(experiment: Experiment) -> Experiment:
    return with_stream(
        experiment,
        "cables",
        lambda v: {"tension": np.minimum(v["tension"], np.quantile(v["tension"], 0.8, axis=0))},
    )


def upside_down(experiment: Experiment) -> Experiment:
    return replace(experiment, robot=replace(experiment.robot, gravity=-experiment.robot.gravity))


def wrong(seed: int, recorder: Recorder) -> dict[str, Experiment]:
    """Name -> experiment that must be rejected."""
    sound = recorder(seed)
    cable, axis = seed % 8, (seed // 8) % 3
    other = (cable + 1 + seed % 6) % 8
    return {
        "gravity upside down": upside_down(sound),
        "two cables swapped": swapped(sound, cable, other),
        "an attachment wrong by 5 cm": moved_attachment(sound, cable, axis),
        "a hand on the platform": recorder(seed, hand),
        "forces clipped at their 80 % quantile": clipped(sound),
        "forces in daN": with_stream(sound, "cables", lambda v: {"tension": v["tension"] / 10}),
        "forces of one sensor in kgf": with_stream(
            sound,
            "cables",
            lambda v: {"tension": v["tension"] * np.where(np.arange(8) == cable, 1 / 9.80665, 1.0)},
        ),
        "gyro about y with the wrong sign": with_stream(
            sound,
            "imu",
            lambda v: {"angular_velocity": v["angular_velocity"] * np.array([1.0, -1.0, 1.0])},
        ),
        "accelerometer in g": with_stream(
            sound, "imu", lambda v: {"specific_force": v["specific_force"] / 9.80665}
        ),
        "forces late by 50 ms": with_late_forces(sound),
    }


def with_late_forces(experiment: Experiment) -> Experiment:
    runs = []
    for run in experiment.runs:
        stream = run.streams["cables"]
        runs.append(
            replace(
                run, streams={**run.streams, "cables": replace(stream, time=stream.time + 0.05)}
            )
        )
    return replace(experiment, runs=tuple(runs))


_recorder: Recorder | None = None


def _judged(seed: int, *, with_wrong: bool) -> list[tuple[str, bool, str]]:
    """Name, whether accepted, and the first reason."""
    global _recorder
    _recorder = _recorder or Recorder()
    cases = {"sound": _recorder(seed), **(wrong(seed, _recorder) if with_wrong else {})}
    estimates = {name: LeastSquares()(experiment) for name, experiment in cases.items()}
    return [
        (name, e.verdict.accepted, next(iter(e.verdict.reasons), ""))
        for name, e in estimates.items()
    ]


def table(sound: int, wrong_each: int, processes: int) -> None:
    """Print how often sound and wrong experiments are rejected."""
    with get_context("spawn").Pool(processes) as pool:
        jobs = [
            pool.apply_async(_judged, (FIRST_SEED + i,), {"with_wrong": i < wrong_each})
            for i in range(sound)
        ]
        judged = [line for job in jobs for line in job.get()]
    print(f"{'experiment':40}{'rejected':>12}   first reason of the first one")
    for name in dict.fromkeys(line[0] for line in judged):
        own = [line for line in judged if line[0] == name]
        rejected = [line for line in own if not line[1]]
        print(
            f"{name:40}{f'{len(rejected)} of {len(own)}':>12}  "
            f" {rejected[0][2][:150] if rejected else ''}",
            flush=True,
        )


FIRST_SEED = 200_000
