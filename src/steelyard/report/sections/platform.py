"""The robot and its motion in 3-D, and the body that was found: centre of gravity, principal axes,
the box of the same inertia.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from steelyard.arrays import Array
from steelyard.inertia import Inertia
from steelyard.report.document import (
    Block,
    Course,
    Figure,
    Grid,
    Scene,
    Section,
    Statement,
    Statements,
)
from steelyard.report.evidence import Body, Motion, Number, Shape
from steelyard.report.sections.result import deviations_of
from steelyard.report.summary import Summary

_WITHIN = float(np.sqrt(7.815))
"""Of three normal variables: 95 % within an ellipsoid of so many 1-sigma."""
_SEEN = 0.05
"""Part of the platform below which a region is drawn larger than it is."""
_ROUND = 24
_EDGES = (
    (0, 1),
    (0, 2),
    (0, 4),
    (1, 3),
    (1, 5),
    (2, 3),
    (2, 6),
    (3, 7),
    (4, 5),
    (4, 6),
    (5, 7),
    (6, 7),
)
_BARE = 0.1
"""Radius of what is drawn where there are no cables, at least [m]."""


def platform(summary: Summary) -> Section | None:
    """The section; None where neither robot nor body is there to draw."""
    blocks: list[Block] = []
    shape = summary.evidence.shape
    if shape is not None:
        courses = [_course(each) for each in summary.evidence.motions if len(each.time) > 1]
        blocks.append(robot_scene(shape, courses, _centre(summary.best)))
    centre = _centre(summary.best)
    if centre is not None:
        blocks.append(Scene(_body(summary, shape, centre)))
        blocks += list(_numbers(summary.best))
    return Section("platform", "The platform", tuple(blocks)) if blocks else None


def _centre(body: Body) -> Array | None:
    found = [value for value in body.value[1:4] if value is not None]
    return np.array(found) if len(found) == 3 else None


def _whole(body: Body) -> Inertia | None:
    """The body, where all ten are known and it can exist."""
    known = [value for value in body.value if value is not None]
    if len(known) < len(body.value):
        return None
    found = Inertia.from_body_parameters(np.array(known))
    return found if found.is_physical else None


# The robot


def robot_scene(shape: Shape, courses: Sequence[Course], centre: Array | None) -> Scene:
    """A robot in 3-D with the motions of its platform.

    Args:
        shape: The robot.
        courses: To replay; none: the platform stands at the origin.
        centre: Of gravity, in the platform frame [m], shape (3,); None: not known.
    """
    anchors, attachments = np.array(shape.anchors), np.array(shape.attachments)
    m = len(anchors)
    data = [
        _points("anchors", anchors, [False] * m, {"mode": "markers", "marker": {"size": 4}}),
        _between("cables", anchors, attachments),
        _points(
            "platform",
            *_broken(attachments, _hull(attachments), moves=True),
            {"mode": "lines", "line": {"width": 4}},
        ),
    ]
    if centre is not None:
        mark = {"mode": "markers", "marker": {"size": 5, "symbol": "diamond"}}
        data.append(_points("centre of gravity", centre[None], [True], mark))
    if courses:
        line = {"mode": "lines", "line": {"width": 2}, "opacity": 0.6}
        data.append(
            _points("path of the origin", courses[0].position, [False] * len(courses[0].time), line)
        )
    text = f"The {m} cables of robot {shape.name} from their anchors to the platform" + (
        ", replayed over the motion." if courses else ", the platform at the origin."
    )
    title = f"Robot {shape.name}" + (" and its motion" if courses else "")
    return Scene(Figure("robot", title, text, tuple(data), _cube(data), height=560), tuple(courses))


def _course(motion: Motion) -> Course:
    name = f"{motion.run} (poses at rest)" if motion.static else motion.run
    return Course(name, np.array(motion.time), np.array(motion.position), np.array(motion.rotation))


def _cube(data: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Equal scales on all axes, seen from so far that everything is in the picture."""
    points = np.concatenate([np.stack([each[axis] for axis in "xyz"], axis=1) for each in data])
    extent = np.maximum(np.nanmax(points, axis=0) - np.nanmin(points, axis=0), 1e-3)
    # Plotly scales the axes so that their product is one; a cube is seen well from 2.1.
    away = float(np.clip(0.72 * np.linalg.norm(extent / np.prod(extent) ** (1 / 3)), 1.2, 4.0))
    axes = {f"{axis}axis": {"title": {"text": f"{axis} [m]"}} for axis in "xyz"}
    eye = {"x": round(away, 2), "y": round(-away, 2), "z": round(0.6 * away, 2)}
    return {
        "scene": {"aspectmode": "data", "camera": {"eye": eye}, **axes},
        "legend": {"orientation": "h"},
    }


def _points(
    name: str, points: Array, moves: Sequence[bool], further: dict[str, Any]
) -> dict[str, Any]:
    x, y, z = points.T
    return {
        "type": "scatter3d",
        "name": name,
        "x": x,
        "y": y,
        "z": z,
        "meta": {"moves": list(moves)},
        **further,
    }


def _between(name: str, anchors: Array, attachments: Array) -> dict[str, Any]:
    """A line a cable: one end stays, the other moves."""
    gap = np.full_like(anchors, np.nan)
    points = np.stack([anchors, attachments, gap], axis=1).reshape(-1, 3)
    return _points(
        name, points, [False, True, False] * len(anchors), {"mode": "lines", "line": {"width": 2}}
    )


def _broken(
    points: Array, edges: Sequence[tuple[int, int]], *, moves: bool
) -> tuple[Array, list[bool]]:
    """Edges as one line with gaps."""
    gap = np.full(3, np.nan)
    line = np.array([row for i, j in edges for row in (points[i], points[j], gap)]).reshape(-1, 3)
    return line, [moves] * len(line)


def _hull(points: Array) -> list[tuple[int, int]]:
    """Edges of what the attachments span; of those in a plane all pairs of neighbours about their
    middle.
    """
    try:
        found = ConvexHull(points)
    except (QhullError, ValueError):
        about = points - points.mean(axis=0)
        flat = (
            about @ np.linalg.svd(about)[2][:2].T if len(points) > 1 else np.zeros((len(points), 2))
        )
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


# The body


def _body(summary: Summary, shape: Shape | None, centre: Array) -> Figure:
    """In the platform frame: what of the body is known."""
    best, data = summary.best, list[dict[str, Any]]()
    size = _BARE if shape is None else max(_BARE, float(np.abs(np.array(shape.attachments)).max()))
    if shape is not None:
        attachments = np.array(shape.attachments)
        data.append(
            _points(
                "attachments",
                *_broken(attachments, _hull(attachments), moves=False),
                {"mode": "lines", "line": {"width": 2}, "opacity": 0.6},
            )
        )
    body = _whole(best)
    if body is not None:
        data.append(
            _points("box of the same inertia", *_box(body), {"mode": "lines", "line": {"width": 4}})
        )
        data.append(
            _points(
                "principal axes",
                *_principal(body),
                {"mode": "lines", "line": {"width": 3, "dash": "dash"}},
            )
        )
    data.append(
        _points(
            "centre of gravity",
            centre[None],
            [False],
            {"mode": "markers", "marker": {"size": 5, "symbol": "diamond"}},
        )
    )
    region = _region(best)
    larger = 1
    if region is not None:
        values, vectors = region
        largest = float(_WITHIN * np.sqrt(values.max(initial=0.0)))
        while largest * larger < _SEEN * size and larger < 1000 and largest > 0:
            larger *= 10 if larger * 10 * largest < _SEEN * size * 4 else 2
        name = "95 % region of the centre" + (
            f", drawn {larger} times as large" if larger > 1 else ""
        )
        data.append(_ellipsoid(name, centre, vectors * np.sqrt(values) * _WITHIN * larger))
    for name, given in (("nominal", summary.nominal), ("truth", summary.truth)):
        place = None if given is None else [v for v in given[1:4] if v is not None]
        if place is not None and len(place) == 3:
            data.append(
                _points(
                    f"centre of gravity, {name}",
                    np.array([place]),
                    [False],
                    {"mode": "markers", "marker": {"size": 4, "symbol": "cross"}},
                )
            )
    data.append(
        _points(
            "platform origin",
            np.zeros((1, 3)),
            [False],
            {"mode": "markers", "marker": {"size": 4, "symbol": "circle-open"}},
        )
    )
    text = "The centre of gravity in the platform frame with its 95 % region" + (
        ", the principal axes and a homogeneous box of the same mass and inertia."
        if body is not None
        else "; the inertia is not known well enough to draw a body."
    )
    return Figure(
        "body",
        "The body in the platform frame"
        + (f" (region of the centre {larger} times as large)" if larger > 1 else ""),
        text,
        tuple(data),
        _cube(data),
        height=520,
    )


def _box(body: Inertia) -> tuple[Array, list[bool]]:
    """Edges of a homogeneous box of the same mass, centre and inertia."""
    half, axes = box_of(body)
    corners = np.array([[(i >> 2) & 1, (i >> 1) & 1, i & 1] for i in range(8)]) * 2.0 - 1.0
    return _broken(body.center_of_gravity + (corners * half) @ axes.T, _EDGES, moves=False)


def box_of(body: Inertia) -> tuple[Array, Array]:
    """Half edges [m], shape (3,), and directions as columns, shape (3, 3), of a homogeneous box of
    the same inertia about the centre of gravity.
    """
    moments, axes = np.linalg.eigh(body.inertia)
    # The second moments about the planes: I1 = Sy + Sz and so on; of a box S = m a^2 / 12.
    second = moments.sum() / 2 - moments
    return np.sqrt(3 * np.maximum(second, 0.0) / body.mass), axes


def _principal(body: Inertia) -> tuple[Array, list[bool]]:
    half, axes = box_of(body)
    ends = body.center_of_gravity + np.concatenate([-(half * axes).T, (half * axes).T]) * 1.15
    return _broken(ends, ((0, 3), (1, 4), (2, 5)), moves=False)


def _region(body: Body) -> tuple[Array, Array] | None:
    """Variances of the centre of gravity along their axes [m^2], and these as columns."""
    block = [[row[j] for j in range(1, 4)] for row in body.covariance[1:4]]
    if any(v is None for row in block for v in row):
        return None
    values, vectors = np.linalg.eigh(np.array(block, dtype=np.float64))
    return np.maximum(values, 0.0), vectors


def _ellipsoid(name: str, centre: Array, axes: Array) -> dict[str, Any]:
    """A surface of triangles."""
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, _ROUND), np.linspace(0, np.pi, _ROUND // 2))
    sphere = np.stack([np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)], axis=-1).reshape(
        -1, 3
    )
    x, y, z = (centre + sphere @ axes.T).T
    n, rows = _ROUND, _ROUND // 2
    corners = np.array(
        [
            [r * n + c, r * n + c + 1, (r + 1) * n + c, (r + 1) * n + c + 1]
            for r in range(rows - 1)
            for c in range(n - 1)
        ]
    )
    faces = np.concatenate([corners[:, [0, 1, 2]], corners[:, [1, 3, 2]]])
    return {
        "type": "mesh3d",
        "name": name,
        "x": x,
        "y": y,
        "z": z,
        "i": faces[:, 0].tolist(),
        "j": faces[:, 1].tolist(),
        "k": faces[:, 2].tolist(),
        "opacity": 0.35,
        "showlegend": True,
        "hoverinfo": "name",
        "meta": {"moves": [False] * len(x)},
    }


def _numbers(best: Body) -> Iterator[Block]:
    body = _whole(best)
    if body is None:
        if all(value is not None for value in best.value):
            yield Statements(
                (Statement("No body has these ten parameters together, so none is drawn.", "bad"),)
            )
        return
    half, axes = box_of(body)
    rows = []
    for k, moment in enumerate(body.principal_moments):
        axis = axes[:, k] * (np.sign(axes[np.argmax(np.abs(axes[:, k])), k]) or 1.0)
        rows.append(
            (
                f"axis {k + 1}",
                f"{moment:.4g}",
                f"({axis[0]:.3f}, {axis[1]:.3f}, {axis[2]:.3f})",
                f"{2 * half[k]:.3f}",
                f"{np.sqrt(moment / body.mass):.3f}",
            )
        )
    yield Grid(
        "Principal axes",
        (
            "",
            "moment [kg m²]",
            "direction in the platform frame",
            "edge of the box [m]",
            "radius of gyration [m]",
        ),
        tuple(rows),
        frozenset({1, 3, 4}),
    )
    sigma: list[Number] = deviations_of(best)
    share = sigma[0] / best.value[0] if sigma[0] is not None and best.value[0] else None
    if share is not None:
        yield Statements(
            (
                Statement(
                    f"The mass is known to {100 * share:.2g} %. The box is homogeneous, a picture"
                    " of the inertia, not of the platform."
                ),
            )
        )
