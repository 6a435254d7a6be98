"""A planned experiment as files: commands for a controller, and the precision that they promise."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from steelyard.arrays import Array
from steelyard.estimates.estimate import named, plain
from steelyard.excitation.design import Design
from steelyard.excitation.evaluation import MotionEvaluation
from steelyard.excitation.information.noise_free_recording import tensions_near_level
from steelyard.excitation.limits.verification import Verified, times_of
from steelyard.experiment.recording import Stream
from steelyard.experiment.write import write_stream
from steelyard.identification.model.fitted_motion import FORMAT as FORMAT_OF_MOTION
from steelyard.inertia import BODY_PARAMETERS
from steelyard.instruments import Command
from steelyard.motion.limits import Use
from steelyard.motion.trajectory import Trajectory
from steelyard.output import write_json, write_table
from steelyard.simulation.response import ExactMotion

FORMAT = "steelyard-design/1"
RESULT = "design.json"
MOTION = "motion.parquet"
RATE = 100.0
"""Of the commands, at least [Hz]."""


def command_names(evaluation: MotionEvaluation) -> Iterator[tuple[str, str]]:
    """Run -> name of its command file; the first one has the name of the contract."""
    for i, run in enumerate(evaluation.trajectories):
        yield run, "command.csv" if i == 0 else f"command-{i + 1}.csv"


def write_design(design: Design, folder: str | Path, rate: float = RATE) -> None:
    """Write the commands, ``design.json`` and the motion with its tensions and with the information
    of every instant.

    Args:
        design: What was found.
        folder: An empty folder that exists.
        rate: Of the commands [Hz].
    """
    folder, evaluation = Path(folder), design.appraisal
    for run, name in command_names(evaluation):
        write_command(evaluation.trajectories[run], folder / name, rate)
    write_json(design_dict(design), folder / RESULT)
    write_table(
        [(run, motion_columns(evaluation, run)) for run in evaluation.trajectories],
        folder / MOTION,
        FORMAT_OF_MOTION,
    )


def motion_columns(evaluation: MotionEvaluation, run: str) -> dict[str, Array]:
    """Motion, tensions of the nominal platform and shares of information, at 100 Hz; named as
    :mod:`.fitted_motion` names them.
    """
    robot, trajectory = evaluation.experiment.robot, evaluation.trajectories[run]
    assert robot.platform is not None
    times = times_of(trajectory)
    pose, rate, acceleration = (trajectory.derivative(times, order) for order in range(3))
    state = ExactMotion(robot, robot.platform, trajectory).at(times)
    groups = {
        ("x", "y", "z", "roll", "pitch", "yaw"): pose,
        ("vx", "vy", "vz"): rate[:, :3],
        ("wx", "wy", "wz"): state.omega,
        ("ax", "ay", "az"): acceleration[:, :3],
        ("alpha_x", "alpha_y", "alpha_z"): state.alpha,
    }
    if robot.m:
        groups[tuple(f"f{i + 1}" for i in range(robot.m))] = tensions_near_level(
            robot, state, evaluation.level
        )
    own = evaluation.information_shares[run]
    shares = np.column_stack([np.interp(times, own.time, share) for share in own.share.T])
    groups[tuple(f"told_{name}" for name in BODY_PARAMETERS)] = shares
    return {
        "t": times,
        **{name: values[:, i] for names, values in groups.items() for i, name in enumerate(names)},
    }


def write_command(trajectory: Trajectory, path: Path, rate: float = RATE) -> None:
    """Write a command as CSV with the columns of its kind."""
    times = times_of(trajectory, rate)
    pose = trajectory.derivative(times, 0)
    orientation = Rotation.from_euler("ZYX", pose[:, :2:-1]).as_matrix()
    stream = Stream(times, {"position": pose[:, :3], "orientation": orientation}, str(path))
    write_stream(stream, Command(kind="command"), 0, path)


def design_dict(design: Design) -> dict[str, Any]:
    """A design in the shape of the contract."""
    return {
        **evaluation_dict(design.appraisal),
        "search": {
            "seed": design.seed,
            "in_time": design.in_time,
            "starts": [
                {"norm": float(np.exp(each.value)), "steps": each.steps} for each in design.starts
            ],
        },
    }


def evaluation_dict(evaluation: MotionEvaluation) -> dict[str, Any]:
    """Planned motions in the shape of the contract."""
    runs = list(evaluation.trajectories)
    first = evaluation.trajectories[runs[0]]
    parameter, ratio = evaluation.worst
    labels = evaluation.estimate.verdict.parameters
    entries: dict[str, Any] = {
        "format": FORMAT,
        "robot": evaluation.experiment.robot.name,
        "experiment": evaluation.experiment.name,
        "duration": first.duration,
        "standard_deviation": named(evaluation.each[runs[0]]),
        "limits": _limits(evaluation.verified[runs[0]]),
        "feasible": evaluation.feasible,
        "violations": [text for run in runs for text in evaluation.verified[run].violations],
        "target": named(evaluation.target.each),
        "worst": {"parameter": parameter, "over_target": ratio if np.isfinite(ratio) else None},
        "unidentifiable": [
            name for name in BODY_PARAMETERS if labels.get(name) == "unidentifiable"
        ],
        "all_runs": {"runs": len(runs), "standard_deviation": named(evaluation.standard_deviation)},
        "margin": {
            "share": evaluation.margin.share,
            "center_of_gravity": evaluation.margin.cog_offset,
        },
        "tension_level": evaluation.level,
        "natural_frequencies": evaluation.natural_frequencies.tolist(),
        "highest_frequency": evaluation.highest_frequency,
        "commands": [],
    }
    for run, name in command_names(evaluation):
        entries["commands"].append({"file": name, **_command_dict(evaluation, run)})
    return entries


def _command_dict(evaluation: MotionEvaluation, run: str) -> dict[str, Any]:
    """One motion in the shape of the contract."""
    verified, shares = evaluation.verified[run], evaluation.information_shares[run]
    trajectory = evaluation.trajectories[run]
    ends = trajectory.derivative(np.array([0.0, trajectory.duration]), 0)
    bodies = verified.bodies
    by_parameter = zip(BODY_PARAMETERS, shares.share.T, strict=True)
    return {
        "duration": trajectory.duration,
        "start": _pose(ends[0]),
        "end": _pose(ends[1]),
        "standard_deviation": named(evaluation.each[run]),
        "limits": _limits(verified),
        "allowed": {_key(use): _extremes(use.limit) for use in verified.commanded if use.limit},
        "on_elastic_cables": {_key(use): _extremes(use.extremes) for use in verified.elastic}
        or None,
        "tension_within_margin": None if bodies is None else _extremes(bodies.extremes),
        "told": {
            "t": plain(shares.time),
            **{parameter: plain(share) for parameter, share in by_parameter},
        },
    }


def _limits(verified: Verified) -> dict[str, Any]:
    """Extremes of the commanded motion."""
    return {_key(use): _extremes(use.extremes) for use in verified.commanded}


def _key(use: Use) -> str:
    name = "rpy_deg" if use.unit == "deg" else use.name
    return name.replace("'", "").replace(" ", "_")


def _extremes(values: tuple[Any, ...] | None) -> Any:
    """Largest size; or lowest and highest value, of each axis where there are several."""
    if values is None:
        return None
    return values[0] if len(values) == 1 else plain(np.array(values, dtype=np.float64))


def _pose(pose: Array) -> dict[str, Any]:
    return {"position": pose[:3].tolist(), "rpy_deg": np.degrees(pose[3:]).tolist()}
