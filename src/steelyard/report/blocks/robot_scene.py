"""The robot and its motion in 3-D, and what such views are drawn of."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from steelyard.arrays import Array
from steelyard.report.blocks.document import Figure, Replay, Scene
from steelyard.report.evidence.values import Shape

_UPRIGHT = 1.35
"""Weight of the height in how far away a picture is seen from."""


def robot_scene(
    shape: Shape, courses: Sequence[Replay], centre: Array | None, place: Array | None = None
) -> Scene:
    """A robot in 3-D with the motions of its platform.

    Args:
        shape: The robot.
        courses: To replay; none: the platform stands at the origin.
        centre: Of gravity, in the platform frame [m], shape (3,); None: not known.
        place: Of the platform, level, where there are no motions [m], shape (3,).
    """
    anchors, attachments = np.array(shape.anchors), np.array(shape.attachments)
    if place is not None and not courses:
        attachments = attachments + place
        centre = None if centre is None else centre + place
    hull = hull_edges(attachments)
    data = [
        marks("anchors", anchors, size=4),
        _cables(anchors, attachments),
        edges_of("platform", attachments, hull, {"line": {"width": 4}}, moves=True),
    ]
    if centre is not None:
        data.append(marks("centre of gravity", centre[None], size=5, symbol="diamond", moves=True))
    text = f"The {len(anchors)} cables of robot {shape.name} from their anchors to the platform"
    title = f"Robot {shape.name}"
    if courses:
        style = {"mode": "lines", "line": {"width": 2}, "opacity": 0.6}
        path = courses[0].position
        data.append(_trace("path of the origin", path, [False] * len(path), style))
        text += ", replayed over the motion."
        title += " and its motion"
    else:
        text += ", the platform at the origin." if place is None else ", the platform level."
    figure = Figure("robot", title, text, tuple(data), equal_scales(data), height=560)
    return Scene(figure, tuple(courses))


def equal_scales(data: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Equal scales on all axes, seen from so far that everything is in the picture."""
    points = np.concatenate([np.stack([each[axis] for axis in "xyz"], axis=1) for each in data])
    extent = np.maximum(np.nanmax(points, axis=0) - np.nanmin(points, axis=0), 1e-3)
    # Plotly scales the axes so that their product is one. Pictures are wide: what is high is seen
    # whole from farther away.
    seen = extent / np.prod(extent) ** (1 / 3) * np.array([1.0, 1.0, _UPRIGHT])
    away = float(np.clip(0.72 * np.linalg.norm(seen), 1.2, 4.0))
    axes = {f"{axis}axis": {"title": {"text": f"{axis} [m]"}} for axis in "xyz"}
    eye = {"x": round(away, 2), "y": round(-away, 2), "z": round(0.6 * away, 2)}
    return {
        "scene": {"aspectmode": "data", "camera": {"eye": eye}, **axes},
        "legend": {"orientation": "h"},
    }


def marks(
    name: str, points: Array, *, size: int, symbol: str = "circle", moves: bool = False
) -> dict[str, Any]:
    """A mark at each of n points.

    Args:
        name: In the legend.
        points: In the platform frame where they move, else in the world frame [m], shape (n, 3).
        size: Of a mark [px].
        symbol: As Plotly names it.
        moves: Whether they move with the platform.
    """
    style = {"mode": "markers", "marker": {"size": size, "symbol": symbol}}
    return _trace(name, points, [moves] * len(points), style)


def edges_of(
    name: str,
    points: Array,
    edges: Sequence[tuple[int, int]],
    style: dict[str, Any],
    *,
    moves: bool = False,
) -> dict[str, Any]:
    """Lines between some of n points, as one line with gaps.

    Args:
        name: In the legend.
        points: In the platform frame where they move, else in the world frame [m], shape (n, 3).
        edges: Places of their ends.
        style: As Plotly has it.
        moves: Whether they move with the platform.
    """
    gap = np.full(3, np.nan)
    corners: list[Array] = []
    for i, j in edges:
        corners += [points[i], points[j], gap]
    line = np.array(corners).reshape(-1, 3)
    return _trace(name, line, [moves] * len(line), {"mode": "lines", **style})


def _cables(anchors: Array, attachments: Array) -> dict[str, Any]:
    """A line a cable: one end stays, the other moves; shapes (m, 3)."""
    gap = np.full_like(anchors, np.nan)
    points = np.stack([anchors, attachments, gap], axis=1).reshape(-1, 3)
    moves = [False, True, False] * len(anchors)
    return _trace("cables", points, moves, {"mode": "lines", "line": {"width": 2}})


def _trace(
    name: str, points: Array, moves: Sequence[bool], style: dict[str, Any]
) -> dict[str, Any]:
    """A trace of Plotly; see :class:`Scene` for points that move."""
    x, y, z = points.T
    meta = {"moves": list(moves)}
    return {"type": "scatter3d", "name": name, "x": x, "y": y, "z": z, "meta": meta, **style}


def hull_edges(points: Array) -> list[tuple[int, int]]:
    """Edges of the convex hull of n points, shape (n, 3); of points in a plane all pairs of
    neighbours about their middle.
    """
    try:
        found = ConvexHull(points)
    except (QhullError, ValueError):
        about = points - points.mean(axis=0)
        flat = np.zeros((len(points), 2))
        if len(points) > 1:
            flat = about @ np.linalg.svd(about)[2][:2].T
        order = np.argsort(np.arctan2(flat[:, 1], flat[:, 0]), kind="stable")
        return [(int(i), int(j)) for i, j in zip(order, np.roll(order, -1), strict=True)]
    # A face that is no triangle is split into some, with an edge inside that is none of the body's.
    edges: dict[tuple[int, int], list[Array]] = {}
    for face, plane in zip(found.simplices, found.equations, strict=True):
        for i, j in ((face[0], face[1]), (face[1], face[2]), (face[0], face[2])):
            edges.setdefault((min(int(i), int(j)), max(int(i), int(j))), []).append(plane[:3])
    return [
        edge
        for edge, normals in edges.items()
        if len(normals) < 2 or not np.allclose(normals[0], normals[1], atol=1e-6)
    ]
