"""The robot and its motion in 3-D, and the body that was found: centre of gravity, principal axes,
the box of the same inertia.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from steelyard.arrays import Array
from steelyard.digits import alike, figures, fixed
from steelyard.inertia import Inertia
from steelyard.report.blocks.document import (
    Block,
    Figure,
    Grid,
    Replay,
    Scene,
    Section,
    Statement,
    Statements,
)
from steelyard.report.blocks.robot_scene import (
    edges_of,
    equal_scales,
    hull_edges,
    marks,
    robot_scene,
)
from steelyard.report.blocks.shown import deviations_of
from steelyard.report.evidence.summary import Summary
from steelyard.report.evidence.values import EstimatedBody, MotionTrack, Shape, Ten

_WITHIN = float(np.sqrt(7.815))
"""Of three normal variables: 95 % within an ellipsoid of so many 1-sigma."""
_SEEN = 0.05
"""Part of the platform below which a region is drawn larger than it is."""
_MOST_ENLARGED = 1000
"""A region that is smaller still is a point."""
_BEYOND_BOX = 1.15
"""Length of the drawn axes over that of the box: their ends stand out."""
_ROUND = 24
"""Points of a circle that looks round."""
_EDGES = tuple((i, i | bit) for bit in (1, 2, 4) for i in range(8) if not i & bit)
"""Of a box: between corners, counted in binary by the signs of x, y, z, that differ in one sign."""
_BARE = 0.1
"""Radius of what is drawn where there are no cables, at least [m]."""


def platform(summary: Summary) -> Section | None:
    """The section; None where neither robot nor body is there to draw."""
    blocks: list[Block] = []
    shape, centre = summary.evidence.shape, _centre(summary.best.value)
    if shape is not None:
        courses = [_course(each) for each in summary.evidence.motions if len(each.time) > 1]
        blocks.append(robot_scene(shape, courses, centre))
    if centre is not None:
        blocks.append(Scene(_body(summary, shape, centre)))
        blocks += list(_numbers(summary.best))
    return Section("platform", "The platform", tuple(blocks)) if blocks else None


def _centre(ten: Ten) -> Array | None:
    """Centre of gravity of ten body parameters [m], shape (3,); None where it is not known."""
    return None if None in ten[1:4] else np.array(ten[1:4], dtype=np.float64)


def _whole(body: EstimatedBody) -> Inertia | None:
    """The body, where all ten are known and it can exist."""
    if None in body.value:
        return None
    found = Inertia.from_body_parameters(np.array(body.value, dtype=np.float64))
    return found if found.is_physical else None


def _course(motion: MotionTrack) -> Replay:
    name = f"{motion.run} (poses at rest)" if motion.static else motion.run
    return Replay(name, np.array(motion.time), np.array(motion.position), np.array(motion.rotation))


def _body(summary: Summary, shape: Shape | None, centre: Array) -> Figure:
    """In the platform frame: what of the body is known."""
    data: list[dict[str, Any]] = []
    size = _BARE
    if shape is not None:
        attachments = np.array(shape.attachments)
        size = max(_BARE, float(np.abs(attachments).max()))
        style = {"line": {"width": 2}, "opacity": 0.6}
        data.append(edges_of("attachments", attachments, hull_edges(attachments), style))
    body = _whole(summary.best)
    if body is not None:
        data += _box_and_axes(body)
    data.append(marks("centre of gravity", centre[None], size=5, symbol="diamond"))
    title = "The body in the platform frame"
    region = _region(summary.best)
    if region is not None:
        factor = _enlargement(float(np.linalg.norm(region, axis=0).max(initial=0.0)), size)
        name = "95 % region of the centre"
        if factor > 1:
            name += f", drawn {factor} times as large"
            title += f" (region of the centre {factor} times as large)"
        data.append(_ellipsoid(name, centre, region * factor))
    for name, given in (("nominal", summary.nominal), ("truth", summary.truth)):
        place = None if given is None else _centre(given)
        if place is not None:
            data.append(marks(f"centre of gravity, {name}", place[None], size=4, symbol="cross"))
    data.append(marks("platform origin", np.zeros((1, 3)), size=4, symbol="circle-open"))
    text = "The centre of gravity in the platform frame with its 95 % region"
    if body is None:
        text += "; the inertia is not known well enough to draw a body."
    else:
        text += ", the principal axes and a homogeneous box of the same mass and inertia."
    return Figure("body", title, text, tuple(data), equal_scales(data), height=520)


def _enlargement(largest: float, size: float) -> int:
    """By which round factor a region is drawn larger, so that it is seen.

    Args:
        largest: Its largest semi-axis [m].
        size: Of the platform [m].
    """
    factor = 1
    while 0 < largest * factor < _SEEN * size and factor < _MOST_ENLARGED:
        factor *= 10 if largest * factor * 10 < _SEEN * size * 4 else 2
    return factor


def _box_and_axes(body: Inertia) -> list[dict[str, Any]]:
    """A homogeneous box of the same mass, centre and inertia, and its axes."""
    half, axes = box_of(body)
    corners = np.array([[(i >> 2) & 1, (i >> 1) & 1, i & 1] for i in range(8)]) * 2.0 - 1.0
    corners = body.center_of_gravity + (corners * half) @ axes.T
    ends = (half * axes).T * _BEYOND_BOX
    ends = body.center_of_gravity + np.concatenate([-ends, ends])
    dashed = {"line": {"width": 3, "dash": "dash"}}
    return [
        edges_of("box of the same inertia", corners, _EDGES, {"line": {"width": 4}}),
        edges_of("principal axes", ends, ((0, 3), (1, 4), (2, 5)), dashed),
    ]


def box_of(body: Inertia) -> tuple[Array, Array]:
    """Half edges [m], shape (3,), and directions as columns, shape (3, 3), of a homogeneous box of
    the same inertia about the centre of gravity.
    """
    moments, axes = np.linalg.eigh(body.inertia)
    # The second moments about the planes: I1 = Sy + Sz and so on; of a box S = m a^2 / 12.
    second = moments.sum() / 2 - moments
    return np.sqrt(3 * np.maximum(second, 0.0) / body.mass), axes


def _region(body: EstimatedBody) -> Array | None:
    """Semi-axes of the 95 % region of the centre of gravity [m], columns of shape (3, 3); None
    where its covariance is not known.
    """
    block = [row[1:4] for row in body.covariance[1:4]]
    if any(v is None for row in block for v in row):
        return None
    values, vectors = np.linalg.eigh(np.array(block, dtype=np.float64))
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)) * _WITHIN)


def _ellipsoid(name: str, centre: Array, axes: Array) -> dict[str, Any]:
    """A surface of triangles; axes are columns, shape (3, 3)."""
    n, rows = _ROUND, _ROUND // 2
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, n), np.linspace(0, np.pi, rows))
    sphere = np.stack([np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)], axis=-1)
    x, y, z = (centre + sphere.reshape(-1, 3) @ axes.T).T
    first = (np.arange(rows - 1)[:, None] * n + np.arange(n - 1)).ravel()
    upper = np.stack([first, first + 1, first + n], axis=1)
    lower = np.stack([first + 1, first + n + 1, first + n], axis=1)
    faces = np.concatenate([upper, lower])
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


def _numbers(best: EstimatedBody) -> Iterator[Block]:
    """Principal axes as a table, and how well the mass is known."""
    body = _whole(best)
    if body is not None:
        yield _principal_axes(body)
        sigma = deviations_of(best)[0]
        if sigma is not None:
            text = (
                f"The mass is known to {figures(100 * sigma / body.mass, 2)} %. The box is"
                " homogeneous, a picture of the inertia, not of the platform."
            )
            yield Statements((Statement(text),))
    elif all(value is not None for value in best.value):
        text = "No body has these ten parameters together, so none is drawn."
        yield Statements((Statement(text, "bad"),))


def _principal_axes(body: Inertia) -> Grid:
    """Principal moments, their axes, and the box of the same inertia."""
    half, axes = box_of(body)
    rows = []
    moments = alike(body.principal_moments.tolist(), 4)
    for k, moment in enumerate(body.principal_moments):
        axis = axes[:, k]
        # The largest component is positive.
        axis = axis * (np.sign(axis[np.argmax(np.abs(axis))]) or 1.0)
        direction = ", ".join(fixed(component, 3) for component in axis)
        radius = np.sqrt(moment / body.mass)
        cells = (moments[k], f"({direction})", fixed(2 * half[k], 3), fixed(radius, 3))
        rows.append((f"axis {k + 1}", *cells))
    head = (
        "",
        "moment [kg m²]",
        "direction in the platform frame",
        "edge of the box [m]",
        "radius of gyration [m]",
    )
    return Grid("Principal axes", head, tuple(rows), frozenset({1, 3, 4}))
