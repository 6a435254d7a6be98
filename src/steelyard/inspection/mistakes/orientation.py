"""Ways to write an orientation wrongly: transposed, in other orders, units, signs and frames."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import permutations

import numpy as np
from scipy.spatial.transform import Rotation

from steelyard.arrays import Array
from steelyard.experiment.recording import Stream
from steelyard.identification.model.sources import Source
from steelyard.inspection.agreements.excerpt import Excerpt
from steelyard.inspection.agreements.frames import mounting, rpy_deg_of
from steelyard.inspection.mistakes.amendment import (
    AXES,
    RARE,
    SIMPLE,
    USUAL,
    Amendment,
    Change,
    Subject,
    columns_key,
    edited,
    rotated,
    scale_key,
    single,
    units_key,
)
from steelyard.inspection.mistakes.axes import rotations_by_right_angles

_HEADINGS = tuple(each for each in range(-170, 180, 10) if each % 90)
"""Angles about the vertical that are tried [deg]; right angles are tried with the others."""
_PARTS = "wxyz"
_NO_TURN = np.eye(3)
_ANGLES = ("roll", "pitch", "yaw")
_ANGLE_ORDERS = {
    "XYZ": "roll, pitch, yaw about turned axes (R = Rx Ry Rz)",
    "ZXY": "Rz Rx Ry",
    "YXZ": "Ry Rx Rz",
    "XZY": "Rx Rz Ry",
    "YZX": "Ry Rz Rx",
}
"""Orders of rotations that people use in place of Rz Ry Rx."""

Rotations = Callable[[Array], Array]
"""Rotation matrices of what stands in a log, row by row."""


def of_orientation(excerpt: Excerpt, source: Source) -> Iterator[Amendment]:
    """All of them: those of the way it is written, then those of its frames."""
    subject = Subject(*source)
    stream = excerpt.run.streams[source[0]]
    form = _form(stream)
    yield subject.amendment(
        "orientation the other way round",
        "is that of the world in the instrument: transposed, or the conjugate quaternion",
        "turn it around in the log: the transposed matrix (r12: r21, …), or qx, qy, qz with the"
        " other sign",
        edited(source, lambda read: read.through(lambda R: R.swapaxes(1, 2))),
        SIMPLE,
        keys=_transposed(form),
    )
    angles = stream.angles.get("orientation")
    if angles is not None:
        yield from _of_angles(subject, source, angles)
    else:
        yield from _of_quaternion(subject, source, stream.values["orientation"])
    yield from _of_frames(excerpt, subject, source)
    yield from _of_heading(excerpt, subject, source)


def _form(stream: Stream) -> tuple[str, ...]:
    """Columns of an orientation; what was not read from a log stands as quaternions."""
    otherwise = _ANGLES if "orientation" in stream.angles else tuple(f"q{p}" for p in _PARTS)
    return stream.forms.get("orientation", otherwise)


def _transposed(form: Sequence[str]) -> list[str]:
    """Keys of an instrument that turn its orientation round; none of angles."""
    if form[:1] == ("qw",):
        return [scale_key(dict.fromkeys(("qx", "qy", "qz"), -1.0))]
    if form[:1] == ("r11",):
        return [columns_key({c: f"r{c[2]}{c[1]}" for c in form if c[1] != c[2]})]
    return []


def _both_turned(form: Sequence[str], i: int) -> list[str]:
    """Keys of an instrument that turn both frames of its orientation by 180 degrees about axis
    i.
    """
    others = [axis for k, axis in enumerate(AXES) if k != i]
    if form[:1] == ("qw",):
        turned = [f"q{axis}" for axis in others]
    elif form[:1] == ("r11",):
        turned = [c for c in form if (c[1] == str(i + 1)) != (c[2] == str(i + 1))]
    else:
        turned = [_ANGLES[AXES.index(axis)] for axis in others]
    return [scale_key(dict.fromkeys(turned, -1.0))]


def _rewritten(source: Source, values: Array, rotations: Rotations) -> Change:
    """Samples written otherwise, where there are any, smoothed as the others were.

    Args:
        source: Whose.
        values: What stands in the log, shape (n, …).
        rotations: What it means.
    """

    def change(excerpt: Excerpt) -> Excerpt:
        complete = np.isfinite(values.reshape(len(values), -1)).all(axis=1)
        matrices = np.full((len(values), 3, 3), np.nan)
        matrices[complete] = rotations(values[complete])
        return excerpt.with_observations({source: excerpt.refitted(source, matrices)})

    return change


def _of_quaternion(subject: Subject, source: Source, matrices: Array) -> Iterator[Amendment]:
    """Order and signs of its parts."""
    for order in permutations(range(4)):
        if order == (0, 1, 2, 3):
            continue
        # Columns are w, x, y, z as the description has them; what they hold is another.
        columns = {f"q{_PARTS[i]}": f"q{_PARTS[k]}" for i, k in enumerate(order) if i != k}
        what, cost = "has parts of its quaternion exchanged", USUAL + 0.2
        if order in {(1, 2, 3, 0), (3, 0, 1, 2)}:
            what, cost = "has its quaternion in another order (x y z w against w x y z)", SIMPLE
        change = _rewritten(source, matrices, _by_quaternion(order))
        yield subject.amendment("order of the quaternion", what, columns_key(columns), change, cost)
    for i, axis in enumerate(AXES):
        yield subject.amendment(
            "sign of the quaternion",
            f"has q{axis} with the wrong sign",
            scale_key({f"q{axis}": -1.0}),
            _rewritten(source, matrices, _by_quaternion(signs=single(4, i + 1, -1.0).diagonal())),
            USUAL,
        )


def _by_quaternion(order: tuple[int, ...] = (0, 1, 2, 3), signs: Array | float = 1.0) -> Rotations:
    """Rotations whose quaternion has its parts in another order or with other signs; q and -q stay
    one rotation.
    """

    def rotations(matrices: Array) -> Array:
        parts = Rotation.from_matrix(matrices).as_quat(scalar_first=True)[:, order] * signs
        return np.asarray(Rotation.from_quat(parts, scalar_first=True).as_matrix())

    return rotations


def _of_angles(subject: Subject, source: Source, angles: Array) -> Iterator[Amendment]:
    """Unit, signs, order of columns and order of rotations of roll, pitch, yaw."""
    degree = np.pi / 180
    for unit, other, factor in (("deg", "rad", degree), ("rad", "deg", 1 / degree)):
        names = {"deg": "degrees", "rad": "radians"}
        what = f"is in {names[unit]}, not in {names[other]}"
        change = _rewritten(source, angles, _by_angles(factor=factor))
        keys = [scale_key(dict.fromkeys(_ANGLES, factor))]
        yield subject.amendment("unit", what, units_key(_ANGLES, unit), change, SIMPLE, keys=keys)
    for i, column in enumerate(_ANGLES):
        signs = single(3, i, -1.0).diagonal()
        yield subject.amendment(
            "sign of an angle",
            f"has {column} with the wrong sign",
            scale_key({column: -1.0}),
            _rewritten(source, angles, _by_angles(factor=signs)),
            SIMPLE,
        )
    for order in permutations(range(3)):
        if order == (0, 1, 2):
            continue
        columns = {_ANGLES[i]: _ANGLES[k] for i, k in enumerate(order) if i != k}
        yield subject.amendment(
            "order of the angles",
            "has its angles exchanged",
            columns_key(columns),
            _rewritten(source, angles, _by_angles(order)),
            SIMPLE + 0.1,
        )
    for axes, words in _ANGLE_ORDERS.items():
        yield subject.amendment(
            "order of the angles",
            f"has its angles in another order of rotations: {words}",
            "write the orientation as quaternion or matrix, or as R = Rz(yaw) Ry(pitch) Rx(roll)",
            _rewritten(source, angles, _by_angles(axes=axes)),
            USUAL,
        )


def _by_angles(
    order: tuple[int, ...] = (0, 1, 2), *, factor: Array | float = 1.0, axes: str = "ZYX"
) -> Rotations:
    """Rotations by angles about x, y, z: columns in another order or unit, or with other signs, and
    rotations about turned axes in another order.
    """
    columns = [order["XYZ".index(axis)] for axis in axes]

    def rotations(angles: Array) -> Array:
        turned = (angles * factor)[:, columns]
        return np.asarray(Rotation.from_euler(axes, turned).as_matrix())

    return rotations


def _of_frames(excerpt: Excerpt, subject: Subject, source: Source) -> Iterator[Amendment]:
    """World or instrument turned by right angles, or both."""
    name = source[0]
    form = _form(excerpt.run.streams[name])
    stated = excerpt.instruments[name].quantity(source[1], excerpt.robot.m)
    for turn in rotations_by_right_angles():
        yield subject.amendment(
            "frame",
            f"stands in a world turned by right angles ({turn.words})",
            "turn the world of the orientation: multiply it on the left by the rotation rpy"
            f" {rpy_deg_of(turn.matrix)}",
            rotated(source, turn.matrix, _NO_TURN),
            USUAL,
        )
        if not stated.required:
            # It stands beside other readings of its instrument, which need not share its frame.
            yield subject.amendment(
                "mounting",
                f"is that of a frame turned against the rest of the IMU ({turn.words})",
                "give the orientation an instrument of its own of kind attitude with rpy_deg:"
                f" {rpy_deg_of(mounting(excerpt, name) @ turn.matrix)}",
                rotated(source, _NO_TURN, turn.matrix.T),
                USUAL + 0.2,
            )
    for i, axis in enumerate(AXES):
        D = -np.eye(3)
        D[i, i] = 1.0
        down = " (z down: north-east-down against z up)" if i == 0 else ""
        yield subject.amendment(
            "frame",
            f"has world and instrument both turned by 180 degrees about {axis}{down}",
            f"turn both frames in the log: D R D with D = rpy {rpy_deg_of(D)}",
            rotated(source, D, D.T),
            SIMPLE + 0.1,
            keys=_both_turned(form, i),
        )
    for order in permutations(range(3)):
        P = np.eye(3)[list(order)]
        if order != (0, 1, 2):
            yield subject.amendment(
                "order of axes",
                "has its axes exchanged in both frames",
                "exchange the axes of the orientation in the log",
                rotated(source, P, P.T),
                USUAL,
            )


def _of_heading(excerpt: Excerpt, subject: Subject, source: Source) -> Iterator[Amendment]:
    """A world turned about the vertical."""
    for heading in _HEADINGS:
        turned = Rotation.from_rotvec(np.radians(heading) * excerpt.robot.up).as_matrix()
        yield subject.amendment(
            "heading",
            f"has another heading than the world, by about {heading} degrees",
            f"turn it about the vertical by {heading} degrees, or widen calibration:"
            " {reference: …}",
            rotated(source, np.asarray(turned), _NO_TURN),
            RARE,
        )
