"""Which motions a virtual experiment runs: the paper's, a multisine made for the robot, or a
file.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from steelyard.arrays import Array
from steelyard.errors import InfeasibleError, InputError
from steelyard.experiment.streams.place import StreamPlace
from steelyard.experiment.streams.read_stream import read_stream
from steelyard.instruments import Command
from steelyard.motion.limits import check_times, motion_extremes, winch_tensions
from steelyard.motion.trajectory import Repeated, RestToRest, Sampled, Trajectory, multisine
from steelyard.robot.model import Robot

PAPER_MOVE = 3.0
"""Duration of one move of the paper [s]; not printed there, and kept within its tracker's 4 m/s and
(about) 2 m/s^2."""
PAPER_PAUSE = 0.5
"""Rest before and after it [s]."""
MULTISINE_DURATION = 20.0
"""[s]"""
SHORTEST, LONGEST = 0.5, 7200.0
"""Durations that are simulated [s]."""


@dataclass(frozen=True)
class MultisineSettings:
    """How large and how fast a multisine for a robot is."""

    highest_frequency: float = 0.5
    """[Hz]: an octave and more below the lowest natural frequency of such platforms."""
    fewest_harmonics: int = 3
    """Of a short one, so that the axes do not move alike."""
    tension_margin: float = 1.5
    """Factor from the robot's lowest tension to that of the command, and from its highest: for what
    the elastic cables add."""
    tension_share: float = 0.3
    """Least tension of the command as a part of the mean: what is left when the platform vibrates
    on its cables."""
    shrink: float = 0.9
    """Factor from one size that is tried to the next."""
    shrinks: int = 30
    """Sizes that are tried: the last one is 4 % of the first."""
    motion_shrinks: int = 40
    """The same against the limits of motion alone: the last one is 1 %."""


@dataclass(frozen=True)
class WorkspaceSettings:
    """Where a robot may go if its file has no limits on the pose."""

    tilt: float = 15.0
    """Roll, pitch and yaw to either side [deg]."""
    frame_parts: float = 6.0
    """Size of the frame over the reach to each side of its middle."""
    hanging_share: float = 0.5
    """Height of that frame below anchors that are all at one height, in parts of its width: the
    middle is then a quarter of the width below."""
    without_cables: float = 0.5
    """To each side for a body without cables [m]."""


MULTISINE = MultisineSettings()
WORKSPACE = WorkspaceSettings()

# Start and end pose: x, y, z [m], roll, pitch, yaw [deg]. The first is the paper's, section IV-A;
# it does not print the others.
_PAPER_MOVES = {
    "t1": ((0.01, -0.01, 1.55, -18.80, 24.87, -30.74), (1.01, 1.49, 2.55, 21.20, -10.13, 29.26)),
    "t2": ((0.80, -0.90, 1.70, 15.00, -20.00, 25.00), (-0.70, 0.60, 2.40, -20.00, 18.00, -25.00)),
    "t3": ((-0.90, 0.70, 1.60, -22.00, -12.00, 28.00), (0.60, -0.80, 2.30, 18.00, 20.00, -28.00)),
    "t4": ((0.50, 0.90, 2.40, 20.00, 18.00, -20.00), (-0.60, -0.70, 1.60, -20.00, -18.00, 30.00)),
}


def trajectories(
    robot: Robot, which: str, duration: float | None, *, check: bool = True
) -> dict[str, Trajectory]:
    """Runs of a virtual experiment and the trajectory of each.

    Args:
        robot: With its limits and nominal platform.
        which: ``paper`` (four moves, each forward and backward), ``multisine``, or the path of a
            CSV file of kind ``command``.
        duration: Of a move of the paper, or of the multisine [s]; None: its default.
        check: Whether to refuse what the robot cannot do.

    Raises:
        InputError: The robot cannot do it, or the file is wrong.
    """
    if duration is not None and not SHORTEST <= duration <= LONGEST:
        raise InputError(
            f"--duration: expected {SHORTEST:g} to {LONGEST:g} s, found {duration:g}; choose"
            " another"
        )
    if which == "paper":
        runs = _paper(duration or PAPER_MOVE)
    elif which == "multisine":
        return {"multisine": feasible_multisine(robot, duration or MULTISINE_DURATION)}
    else:
        if duration is not None:
            raise InputError(
                "--duration: expected none with a trajectory from a file, found one; the file has"
                " its own duration"
            )
        path = Path(which)
        if not path.suffix and not path.exists():
            raise InputError(
                "--trajectory: expected 'paper', 'multisine' or the path of a CSV file, found"
                f" '{which}'; correct it"
            )
        runs = {"trajectory" if path.stem.startswith(".") else path.stem: from_file(path, robot)}
    for name, trajectory in runs.items() if check else ():
        extremes = motion_extremes(robot, trajectory)
        if extremes.fraction > 1 + 1e-9:
            raise InputError(
                f"trajectory '{name}': expected a motion within the limits of robot '{robot.name}',"
                f" found {extremes.worst}; choose a longer --duration or another trajectory"
            )
        if robot.m and robot.platform:
            winch_tensions(robot, trajectory, check_times(trajectory))
    return runs


def repeated_move(duration: float | None) -> Repeated:
    """The paper's own move, there and back without a pause, as often as a duration has room for;
    None: once.

    Raises:
        InputError: There is no room for one.
    """
    length = PAPER_MOVE if duration is None else duration
    if not PAPER_MOVE <= length <= LONGEST:
        raise InputError(
            f"--duration: expected {PAPER_MOVE:g} to {LONGEST:g} s for the paper's move, found"
            f" {length:g}; choose another"
        )
    return Repeated(_paper_move("t1", PAPER_MOVE, 0.0), int(length / PAPER_MOVE + 1e-9))


def _paper_move(name: str, move: float, pause: float) -> RestToRest:
    """A move of the paper with its times [s]."""
    start, end = (np.concatenate([pose[:3], np.radians(pose[3:])]) for pose in _PAPER_MOVES[name])
    return RestToRest(start, end, move, pause)


def _paper(move: float) -> dict[str, Trajectory]:
    runs: dict[str, Trajectory] = {}
    for name in _PAPER_MOVES:
        forward = _paper_move(name, move, PAPER_PAUSE)
        runs[f"{name}-forward"] = forward
        runs[f"{name}-backward"] = forward.reversed()
    return runs


def feasible_multisine(
    robot: Robot, duration: float, settings: MultisineSettings = MULTISINE
) -> Sampled:
    """A multisine about the middle of the workspace, as large as the robot's limits and tensions
    allow.

    Raises:
        InputError: Not even a small one is feasible.
    """
    center, reach = workspace_of(robot)
    if robot.m and not robot.holds_any_pose:
        # How it turns is not for the winches to say: it swings while they move it.
        reach = reach * np.repeat([1.0, 0.0], 3)
    harmonics = max(settings.fewest_harmonics, round(settings.highest_frequency * duration))

    def trial(of_position: float, of_angles: float) -> Sampled:
        amplitude = reach * np.repeat([of_position, of_angles], 3)
        return multisine(list(center), list(amplitude), duration, harmonics)

    # Room for what the elastic cables add to the commanded tensions.
    low, high = robot.tension_limits
    factor = settings.tension_margin
    careful = replace(robot, tension_limits=(factor * low, high / factor))
    # Each kind of motion alone against its own limits, then both together against the tensions.
    translation = _largest(robot, lambda scale: trial(scale, 0.0), settings)
    rotation = _largest(robot, lambda scale: trial(0.0, scale), settings)
    for scale in settings.shrink ** np.arange(settings.shrinks):
        trajectory = trial(translation * scale, rotation * scale)
        if motion_extremes(robot, trajectory).fraction > 1:
            continue
        if not (robot.m and robot.platform):
            return trajectory
        try:
            times = check_times(trajectory)
            moving = winch_tensions(careful, trajectory, times)
            at_rest = winch_tensions(careful, trajectory, times, still=True)
            tensions = np.concatenate([moving, at_rest])
        except InfeasibleError:
            continue
        # Where a limit binds, tensions have kinks, and kinks make the platform vibrate.
        least = settings.tension_share * float(tensions.mean())
        least = max(careful.tension_limits[0] * (1 + 1e-6), least)
        if tensions.min() <= least:
            continue
        return trajectory
    raise InputError(
        f"robot '{robot.name}': expected a pose in the middle of its limits that its cables can"
        " hold, found none; check 'limits', 'tension' and 'platform' in the robot file"
    )


def _largest(
    robot: Robot, trial: Callable[[float], Trajectory], settings: MultisineSettings
) -> float:
    """Largest scale, at most 1, at which a family of trajectories keeps the limits of motion."""
    scale = 1.0
    for _ in range(settings.motion_shrinks):
        if motion_extremes(robot, trial(scale)).fraction <= 1:
            break
        scale *= settings.shrink
    return scale


def workspace_of(robot: Robot, settings: WorkspaceSettings = WORKSPACE) -> tuple[Array, Array]:
    """Pose in the middle of the workspace, and how far from it a motion may reach in x, y, z [m],
    roll, pitch, yaw [rad].
    """
    limits = robot.limits
    box = np.array(limits.position) if limits.position else _default_box(robot, settings)
    tilt = np.radians([[-settings.tilt] * 3, [settings.tilt] * 3])
    angles = np.array(limits.rpy) if limits.rpy else tilt
    low, high = np.hstack([box, angles])
    return (low + high) / 2, (high - low) / 2


def _default_box(robot: Robot, settings: WorkspaceSettings) -> Array:
    """A part of the frame about its middle; about the origin for a body without cables, shape (2,
    3).
    """
    if not robot.m:
        half = settings.without_cables
        return np.array([[-half] * 3, [half] * 3])
    low, high = robot.anchors.min(axis=0), robot.anchors.max(axis=0)
    platform = robot.attachments.mean(axis=0)
    if high[2] - low[2] < robot.size:
        # All anchors at one height: the platform hangs below them.
        across = high[:2] - low[:2]
        # Two anchors, or a row of them, span a plane.
        width = float(np.min(across[across > robot.size], initial=np.max(across)))
        low = np.array([low[0], low[1], high[2] - settings.hanging_share * width])
    middle = (low + high) / 2 - platform
    reach = (high - low) / settings.frame_parts
    return np.array([middle - reach, middle + reach])


def from_file(path: Path, robot: Robot) -> Sampled:
    """Trajectory through the poses of a CSV file of kind ``command``; it starts with its first row.

    Raises:
        InputError: The file is wrong.
    """
    stream = read_stream(StreamPlace(path), Command(kind="command"), robot.m, static=False)
    time, first = np.unique(stream.time, return_index=True)
    if len(time) < 4:
        raise InputError(
            f"{path}: expected at least 4 rows with different times, found {len(time)}; a motion"
            " needs more"
        )
    position, orientation = (stream.values[key][first] for key in ("position", "orientation"))
    whole = np.isfinite(position).all(axis=1) & np.isfinite(orientation).all(axis=(1, 2))
    if not whole.all():
        raise InputError(
            f"{path}:{first[int(np.argmin(whole))] + 2}: expected a pose in every row, found an"
            " empty cell; fill it"
        )
    rpy = Rotation.from_matrix(orientation).as_euler("ZYX")[:, ::-1]
    poses = np.hstack([position, np.unwrap(rpy, axis=0)])
    if not SHORTEST <= time[-1] - time[0] <= LONGEST:
        raise InputError(
            f"{path}: expected a motion of {SHORTEST:g} to {LONGEST:g} s, found one of"
            f" {time[-1] - time[0]:g} s; check the unit of column 't'"
        )
    return Sampled.through(time - time[0], poses)
