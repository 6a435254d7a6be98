"""A planned experiment as a document with pictures: the motion, its use of the robot's limits, and
when each parameter is excited.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from steelyard.arrays import Array
from steelyard.digits import LABELS, figures
from steelyard.excitation.design_file import motion_columns
from steelyard.excitation.evaluation import MotionEvaluation
from steelyard.inertia import BODY_PARAMETERS
from steelyard.report.blocks.document import (
    Block,
    Document,
    Figure,
    Replay,
    Section,
    Statement,
    Statements,
)
from steelyard.report.blocks.plot import NAMES_DOWNWARDS, axes, line
from steelyard.report.blocks.robot_scene import robot_scene
from steelyard.report.blocks.shown import line_colour, slug
from steelyard.report.documents.design import grids, statements
from steelyard.report.evidence.gather import shape_of
from steelyard.report.evidence.thinning import THINNING, evenly

_MOST_POINTS = 1000
"""Of a line: about one for each column of pixels."""


def design_document(evaluation: MotionEvaluation) -> Document:
    """Everything that there is to say and to see of a planned experiment."""
    said = tuple(statements(evaluation))
    precision, *uses = grids(evaluation)
    columns = {run: _thinned(motion_columns(evaluation, run)) for run in evaluation.trajectories}
    information = [_information(run, each) for run, each in columns.items()]
    robot = evaluation.experiment.robot
    blocks: list[Block] = []
    if (shape := shape_of(robot)) is not None:
        centre = None if robot.platform is None else np.array(robot.platform.center_of_gravity)
        blocks.append(
            robot_scene(shape, [_course(run, each) for run, each in columns.items()], centre)
        )
    for run, each in columns.items():
        blocks += list(_motion(run, each, evaluation))
    return Document(
        f"{evaluation.experiment.name}: a planned experiment",
        _lead(evaluation),
        (
            Section(
                "precision", "Expected uncertainty", (precision, Statements(said), *information)
            ),
            Section("motion", "The motion", tuple(blocks)),
            Section("limits", "Use of the robot's limits", tuple(uses)),
        ),
    )


def _lead(evaluation: MotionEvaluation) -> Statement:
    """Whether the motion keeps the limits and reaches the targets."""
    parameter, ratio = evaluation.worst
    label, *_ = LABELS[BODY_PARAMETERS.index(parameter)]
    if not evaluation.feasible:
        return Statement(
            "The robot cannot do this motion within its limits; see those named below.", "bad"
        )
    if not np.isfinite(ratio):
        return Statement(
            f"The motion keeps all limits, but not all parameters are identifiable: {label} least.",
            "note",
        )
    if ratio <= 1:
        return Statement("The motion keeps all limits and reaches all targets.", "good")
    return Statement(
        f"The motion keeps all limits; the 1-sigma of {label} is {figures(ratio, 2)} times its"
        " target.",
        "note",
    )


def _thinned(columns: Mapping[str, Array]) -> dict[str, Array]:
    few = evenly(len(columns["t"]), _MOST_POINTS)
    return {name: values[few] for name, values in columns.items()}


def _course(run: str, columns: Mapping[str, Array]) -> Replay:
    time = columns["t"]
    few = evenly(len(time), max(2, int((time[-1] - time[0]) * THINNING.instants_per_second)))
    angles = np.stack([columns[name][few] for name in ("yaw", "pitch", "roll")], axis=1)
    rotation = Rotation.from_euler("ZYX", angles).as_quat(scalar_first=True, canonical=True)
    return Replay(
        run, time[few], np.stack([columns[axis][few] for axis in "xyz"], axis=1), rotation
    )


def _information(run: str, columns: Mapping[str, Array]) -> Figure:
    """Information on each parameter from the parts of a run, each against its own largest."""
    shares = np.array([columns[f"told_{name}"] for name in BODY_PARAMETERS])
    largest = np.nanmax(np.where(np.isfinite(shares), shares, 0.0), axis=1, keepdims=True)
    data = (
        {
            "type": "heatmap",
            "x": columns["t"],
            "y": [label for label, *_ in LABELS],
            "z": shares / np.maximum(largest, 1e-300),
            "zmin": 0,
            "zmax": 1,
            "colorscale": "Viridis",
            "colorbar": {"title": {"text": "of the most"}},
        },
    )
    layout = {
        "xaxis": {"title": {"text": "time [s]"}},
        "yaxis": NAMES_DOWNWARDS,
    }
    text = (
        "For each of the ten parameters the information from the parts of the motion, from none"
        " (dark) to the most (bright)."
    )
    return Figure(
        slug("information", run),
        f"Run {run}: information on the parameters over time",
        text,
        data,
        layout,
        height=340,
    )


def _motion(
    run: str, columns: Mapping[str, Array], evaluation: MotionEvaluation
) -> Iterator[Figure]:
    """Position, attitude, velocities and tensions of a run over time."""
    robot = evaluation.experiment.robot
    limits = robot.limits
    yield _lines(run, "place", "position [m]", columns, "xyz")
    yield _lines(
        run, "attitude", "angle [°]", columns, ("roll", "pitch", "yaw"), factor=np.degrees(1.0)
    )
    yield _lines(run, "speed", "speed [m/s]", columns, ("vx", "vy", "vz"), limit=limits.speed)
    yield _lines(
        run,
        "turning",
        "angular velocity [rad/s]",
        columns,
        ("wx", "wy", "wz"),
        limit=limits.angular_speed,
    )
    if robot.m:
        names = [f"f{i + 1}" for i in range(robot.m)]
        low, high = robot.tension_limits
        shown = [
            value
            for value in (low, high)
            if np.isfinite(value) and value <= 2 * max(np.max(columns[n]) for n in names)
        ]
        yield _lines(
            run, "tensions of the nominal platform", "tension [N]", columns, names, levels=shown
        )


def _lines(
    run: str,
    what: str,
    axis: str,
    columns: Mapping[str, Array],
    names: Sequence[str],
    *,
    factor: float = 1.0,
    limit: float | None = None,
    levels: Sequence[float] = (),
) -> Figure:
    """Columns over time; ``limit``: of their length, ``levels``: where lines are drawn across."""
    time = columns["t"]
    data: list[dict[str, Any]] = []
    for i, name in enumerate(names):
        style = {"color": line_colour(i), "width": 1.5}
        data.append(line(name, time, columns[name] * factor, style))
    if limit is not None:
        length = np.sqrt(sum(columns[name] ** 2 for name in names))
        data.append(line("length", time, length, {"color": "var(--muted)", "width": 1}))
        levels = [limit]
    dashed = {"color": "var(--bad)", "width": 1.5, "dash": "dash"}
    for i, level in enumerate(levels):
        data.append(line("limit", time[[0, -1]], [level, level], dashed, showlegend=i == 0))
    layout = axes("time [s]", axis)
    text = f"{what} over time: {', '.join(names)}" + (
        ", with the allowed limit." if len(levels) else "."
    )
    return Figure(
        slug("motion", run, what), f"Run {run}: {what}", text, tuple(data), layout, height=320
    )
