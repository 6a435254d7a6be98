"""A planned experiment as a document with pictures: the motion, what it takes of the robot, and
when it tells what.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from steelyard.arrays import Array
from steelyard.digits import LABELS
from steelyard.excitation.design_file import motion_columns
from steelyard.excitation.evaluation import MotionEvaluation
from steelyard.inertia import BODY_PARAMETERS
from steelyard.report.design import grids, statements
from steelyard.report.document import (
    Block,
    Course,
    Document,
    Figure,
    Section,
    Statement,
    Statements,
)
from steelyard.report.gather import shape_of
from steelyard.report.sections.platform import robot_scene
from steelyard.report.sections.shown import line_colour, slug

_MOST_POINTS = 1000
"""Of a line."""
_INSTANTS_A_SECOND = 20.0


def design_document(evaluation: MotionEvaluation) -> Document:
    """Everything that there is to say and to see of a planned experiment."""
    said = tuple(
        Statement(text, "bad" if "cannot" in text else "") for text in statements(evaluation)
    )
    precision, *uses = grids(evaluation)
    columns = {run: _thinned(motion_columns(evaluation, run)) for run in evaluation.trajectories}
    told = [_told(run, each) for run, each in columns.items()]
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
            Section("precision", "What it will tell", (precision, Statements(said), *told)),
            Section("motion", "The motion", tuple(blocks)),
            Section("limits", "What it takes of the robot", tuple(uses)),
        ),
    )


def _lead(evaluation: MotionEvaluation) -> Statement:
    parameter, ratio = evaluation.worst
    label = dict(zip(BODY_PARAMETERS, (label for label, *_ in LABELS), strict=True))[parameter]
    if not evaluation.feasible:
        return Statement(
            "The robot cannot do this motion within its limits; below stands what it exceeds.",
            "bad",
        )
    if not np.isfinite(ratio):
        return Statement(
            f"The motion keeps all limits, but does not tell all of the body: {label} least.",
            "note",
        )
    wanted = (
        "all that is wanted"
        if ratio <= 1
        else f"all but {ratio:.2g} times the 1-sigma that is wanted of {label}"
    )
    return Statement(
        f"The motion keeps all limits and reaches {wanted}.", "good" if ratio <= 1 else "note"
    )


def _thinned(columns: Mapping[str, Array]) -> dict[str, Array]:
    n = len(columns["t"])
    few = np.unique(np.linspace(0, n - 1, min(n, _MOST_POINTS)).astype(int))
    return {name: values[few] for name, values in columns.items()}


def _course(run: str, columns: Mapping[str, Array]) -> Course:
    time = columns["t"]
    count = max(2, min(len(time), int((time[-1] - time[0]) * _INSTANTS_A_SECOND)))
    few = np.unique(np.linspace(0, len(time) - 1, count).astype(int))
    angles = np.stack([columns[name][few] for name in ("yaw", "pitch", "roll")], axis=1)
    rotation = Rotation.from_euler("ZYX", angles).as_quat(scalar_first=True, canonical=True)
    return Course(
        run, time[few], np.stack([columns[axis][few] for axis in "xyz"], axis=1), rotation
    )


def _told(run: str, columns: Mapping[str, Array]) -> Figure:
    """Which part of a run tells which parameter, each against its own largest."""
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
        "yaxis": {"autorange": "reversed", "automargin": True, "type": "category"},
    }
    text = (
        "For each of the ten parameters how much the parts of the motion tell of it, from nothing"
        " (dark) to the most (bright)."
    )
    return Figure(
        slug("told", run),
        f"Run {run}: which part tells which parameter",
        text,
        data,
        layout,
        height=340,
    )


def _motion(
    run: str, columns: Mapping[str, Array], evaluation: MotionEvaluation
) -> Iterator[Figure]:
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
    data: list[dict[str, Any]] = [
        {
            "type": "scatter",
            "mode": "lines",
            "name": name,
            "x": columns["t"],
            "y": columns[name] * factor,
            "line": {"color": line_colour(i), "width": 1.5},
        }
        for i, name in enumerate(names)
    ]
    if limit is not None:
        length = np.sqrt(sum(columns[name] ** 2 for name in names))
        data.append(
            {
                "type": "scatter",
                "mode": "lines",
                "name": "length",
                "x": columns["t"],
                "y": length,
                "line": {"color": "var(--muted)", "width": 1},
            }
        )
        levels = [limit]
    ends = columns["t"][[0, -1]]
    for i, level in enumerate(levels):
        data.append(
            {
                "type": "scatter",
                "mode": "lines",
                "name": "limit",
                "showlegend": i == 0,
                "x": ends,
                "y": [level, level],
                "line": {"color": "var(--bad)", "width": 1.5, "dash": "dash"},
            }
        )
    layout = {"xaxis": {"title": {"text": "time [s]"}}, "yaxis": {"title": {"text": axis}}}
    text = f"{what} over time: {', '.join(names)}" + (
        ", with the allowed limit." if len(levels) else "."
    )
    return Figure(
        slug("motion", run, what), f"Run {run}: {what}", text, tuple(data), layout, height=320
    )
