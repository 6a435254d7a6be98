"""Further robots, drawn only where they are asked for: none of them was looked at while the estimators
were written."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .shared import public

_CORNERS = np.array([(-1, -1), (-1, 1), (1, 1), (1, -1)], dtype=float)
_COGIRO, _FOUR, _TIGHT = public.COGIRO, public.FOUR_CABLES, public.EIGHT_TIGHT


def _at(half: tuple[float, float], *heights: float) -> np.ndarray:
    """Corners of a rectangle, one height after the other, shape (4 h, 3)."""
    return np.array([[*(each * half), z] for z in heights for each in _CORNERS])


FURTHER = {
    "two": replace(
        _FOUR,
        name="two",
        words="9 kg suspended on two cables in a hall of 3 m: a pendulum across them",
        anchors=np.array([[-1.5, 0.0, 2.8], [1.5, 0.0, 2.8]]),
        attachments=np.array([[-0.2, 0.0, 0.15], [0.2, 0.0, 0.15]]),
        reach=np.array([0.15, 0.0, 0.12, 0.0, 0.0, 0.0]),
        mass=9.0,
        tension=60.0,
    ),
    "stadium": replace(
        _FOUR,
        name="stadium",
        words="a camera of 38 kg on four cables above a field of 60 m",
        anchors=_at((30.0, 20.0), 22.0),
        attachments=_at((0.5, 0.4), 0.6),
        axial_stiffness=6e5,
        mass=38.0,
        center_of_gravity=np.array([0.02, 0.03, 0.1]),
        inertia=np.diag([5.0, 5.5, 4.0]),
        center=np.array([2.0, -1.0, 8.0]),
        reach=np.array([1.2, 1.0, 0.6, 0.0, 0.0, 0.0]),
        frequency=0.25,
        tension=170.0,
        imu=np.array([0.05, 0.02, 0.3]),
        target=np.array([0.1, 0.2, 0.7]),
    ),
    "seventight": replace(
        _TIGHT,
        name="seventight",
        words="12 kg held by seven cables, four from above and three from below",
        anchors=np.array(
            [
                [2.0, 1.5, 2.0],
                [-2.0, 1.5, 2.0],
                [-2.0, -1.5, 2.0],
                [2.0, -1.5, 2.0],
                [2.0, 0.0, 0.0],
                [-1.5, 1.5, 0.0],
                [-1.5, -1.5, 0.0],
            ]
        ),
        attachments=np.array(
            [
                [0.25, 0.25, -0.2],
                [-0.25, 0.25, -0.2],
                [-0.25, -0.25, -0.2],
                [0.25, -0.25, -0.2],
                [0.25, 0.0, 0.2],
                [-0.2, 0.25, 0.2],
                [-0.2, -0.25, 0.2],
            ]
        ),
        mass=12.0,
        tension=150.0,
        reach=0.7 * _TIGHT.reach,
        frequency=0.8,
    ),
    "ipanema": replace(
        _TIGHT,
        name="ipanema",
        words="62 kg held by eight cables in a hall of 15 m; some go slack",
        anchors=_at((7.5, 5.5), 6.0, 0.3),
        attachments=_at((0.55, 0.45), -0.35, 0.35),
        axial_stiffness=1e6,
        mass=62.0,
        center_of_gravity=np.array([0.03, -0.02, 0.04]),
        inertia=np.diag([7.5, 8.3, 10.9]),
        center=np.array([0.3, -0.2, 2.8]),
        reach=np.array([0.7, 0.6, 0.35, 0.03, 0.03, 0.04]),
        frequency=0.6,
        tension=1500.0,
        imu=np.array([0.1, 0.1, 0.2]),
        target=np.array([0.2, 0.3, 0.5]),
    ),
    "facade": replace(
        _COGIRO,
        name="facade",
        words="1.9 t suspended on eight cables in front of a building",
        anchors=_COGIRO.anchors * [1.8, 1.5, 3.0],
        attachments=_COGIRO.attachments * 2.2,
        axial_stiffness=3e6,
        mass=1900.0,
        center_of_gravity=np.array([0.05, -0.1, 0.7]),
        inertia=_COGIRO.inertia * 12 * 4.0,
        center=np.array([0.0, 0.0, 6.0]),
        reach=_COGIRO.reach * [1.5, 1.5, 1.5, 0.6, 0.6, 0.6],
        frequency=0.3,
        tension=6500.0,
        imu=2 * _COGIRO.imu,
        target=2 * _COGIRO.target,
    ),
    "mini": replace(
        public.DESK,
        name="mini",
        words=".3 kg suspended on eight cables on a desk",
        mass=0.3,
        inertia=public.DESK.inertia * 0.3,
        tension=public.DESK.tension * 0.3,
    ),
    "ten": replace(
        _COGIRO,
        name="ten",
        words="220 kg suspended on ten cables in a hall of 15 m",
        anchors=np.concatenate([_COGIRO.anchors, [[0.0, -5.6, 5.4], [0.0, 5.6, 5.4]]]),
        attachments=np.concatenate([_COGIRO.attachments, [[0.0, -0.45, 0.5], [0.0, 0.45, 0.5]]]),
        mass=220.0,
        tension=600.0,
    ),
}
"""Of a name."""
