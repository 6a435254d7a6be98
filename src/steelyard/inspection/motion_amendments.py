"""Simple mistakes of motion instruments: signs, axes, units, frames, orders and clocks."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import permutations

import numpy as np
from scipy.spatial.transform import Rotation

from steelyard.arrays import Array
from steelyard.identification.model.sources import Source
from steelyard.inspection.amendment import (
    AXES,
    RARE,
    ROBOT,
    SIMPLE,
    USUAL,
    Amendment,
    Turn,
    columns_of,
    mapped,
    other_units,
    turns,
    units_key,
)
from steelyard.inspection.excerpt import Excerpt, Observation
from steelyard.inspection.frames import (
    attitude_source,
    lever_of,
    mounting,
    rpy_deg_of,
    tracker_frame,
    turning,
)
from steelyard.units import FACTORS

_LIKELY = {
    "rad/s": ("deg/s", "rpm", "mrad/s"),
    "m/s^2": ("g", "mg", "mm/s^2", "cm/s^2"),
    "m": ("mm", "cm", "in", "ft"),
}
"""Unit of a quantity -> units that logs have instead."""
_HEADINGS = tuple(range(-170, 180, 10))
_FARTHEST = 4.0
"""Radii of the platform beyond which nothing sits on it."""
_LEAST_TARGET = 0.05
"""By which a place on the platform must be wrong to be named [m]."""


def of_vectors(excerpt: Excerpt, source: Source) -> Iterator[Amendment]:
    """Signs, axes and units of a vector."""
    name, quantity = source
    touches = frozenset({name})
    stated = excerpt.instruments[name].quantity(quantity, excerpt.robot.m)
    names = stated.forms[0]
    for turn in turns(len(names)):
        words, key = columns_of(names, turn)
        kind = "sign of an axis" if turn.keeps_order else "order of axes"
        yield Amendment(
            kind, name, quantity, words, key, mapped(source, turn.matrix), turn.cost, touches
        )
    si = stated.unit
    for unit, words, factor in other_units({u: FACTORS[si][u] for u in (si, *_LIKELY[si])}):
        key = units_key(names, unit)
        matrix = factor * np.eye(len(names))
        yield Amendment("unit", name, quantity, words, key, mapped(source, matrix), SIMPLE, touches)


def of_imu(excerpt: Excerpt, name: str) -> Iterator[Amendment]:
    """What an IMU does with gravity, and how it is mounted."""
    touches = frozenset({name})
    source = (name, "specific_force")
    if source in excerpt.observations:
        removed = getattr(excerpt.instruments[name], "gravity", "included") == "removed"
        other = "included" if removed else "removed"
        words = "still contains gravity" if removed else "has gravity taken out"
        yield Amendment(
            "gravity in the accelerometer",
            name,
            "specific_force",
            words,
            f"gravity: {other}",
            _with(name, gravity=other),
            SIMPLE,
            touches,
        )
        orientation = attitude_source(excerpt)
        if orientation is not None and not removed:
            yield Amendment(
                "gravity in the accelerometer",
                name,
                "specific_force",
                "feels gravity upside down (a + g instead of a - g)",
                "turn the sign of the gravity in the log, or state gravity: removed once it is"
                " taken out",
                _gravity_turned(source, orientation),
                USUAL,
                touches | {orientation[0]},
            )
    own = [s for s in excerpt.observations if s[0] == name]
    if "angular_velocity" in {q for _, q in own}:
        orientation = attitude_source(excerpt)
        if orientation is not None:
            yield Amendment(
                "frame",
                name,
                "angular_velocity",
                "reads angular velocity in world axes",
                "turn it into the axes of the IMU in the log",
                _world_gyro((name, "angular_velocity"), orientation),
                RARE,
                touches | {orientation[0]},
            )
    if len(own) > 1 or own == [source]:
        yield from of_mounting(excerpt, name)


def of_mounting(excerpt: Excerpt, name: str) -> Iterator[Amendment]:
    """Instruments turned by right angles."""
    R = mounting(excerpt, name)
    for turn in turns():
        if not turn.proper:
            continue
        rpy = rpy_deg_of(R @ turn.matrix)
        angle = round(float(np.degrees(np.arccos(np.clip((np.trace(turn.matrix) - 1) / 2, -1, 1)))))
        yield Amendment(
            "mounting",
            name,
            "",
            f"is mounted otherwise than stated, turned by {angle} degrees",
            f"rpy_deg: {rpy}",
            _with(name, rpy_deg=tuple(rpy)),
            SIMPLE + 0.2,
            frozenset({name}),
        )
    if not np.allclose(R, R.T):
        rpy = rpy_deg_of(R.T)
        yield Amendment(
            "mounting",
            name,
            "",
            "has its mounting stated the wrong way round (platform to instrument)",
            f"rpy_deg: {rpy}",
            _with(name, rpy_deg=tuple(rpy)),
            SIMPLE,
            frozenset({name}),
        )


def _with(name: str, **keys: object) -> Callable[[Excerpt], Excerpt]:
    return lambda excerpt: excerpt.with_instrument(name, **keys)


def _gravity_turned(source: Source, orientation: Source) -> Callable[[Excerpt], Excerpt]:
    def change(excerpt: Excerpt) -> Excerpt:
        R = turning(excerpt, orientation).rotation @ mounting(excerpt, source[0])
        return excerpt.with_observations(
            {
                source: excerpt.observations[source].plus(
                    -2 * R.swapaxes(1, 2) @ excerpt.robot.gravity
                )
            }
        )

    return change


def _world_gyro(source: Source, orientation: Source) -> Callable[[Excerpt], Excerpt]:
    def change(excerpt: Excerpt) -> Excerpt:
        R = turning(excerpt, orientation).rotation @ mounting(excerpt, source[0])
        seen = excerpt.observations[source]
        value, rate = (np.einsum("nji,nj->ni", R, each) for each in (seen.value, seen.rate))
        return excerpt.with_observations({source: replace(seen, value=value, rate=rate)})

    return change


def of_orientation(excerpt: Excerpt, source: Source) -> Iterator[Amendment]:
    """Ways to write an orientation."""
    name = source[0]
    touches = frozenset({name})

    def amendment(
        kind: str,
        what: str,
        proposal: str,
        change: Callable[[Observation], Observation],
        cost: float,
    ) -> Amendment:
        return Amendment(
            kind,
            name,
            "orientation",
            what,
            proposal,
            lambda p: p.with_observations({source: change(p.observations[source])}),
            cost,
            touches,
        )

    def resampled(
        kind: str, what: str, proposal: str, change: Callable[[Array], Array], cost: float
    ) -> Amendment:
        def changed(p: Excerpt) -> Excerpt:
            return p.with_observations(
                {
                    source: p.refitted(
                        source, _sound(change, excerpt.run.streams[name].values["orientation"])
                    )
                }
            )

        return Amendment(kind, name, "orientation", what, proposal, changed, cost, touches)

    yield amendment(
        "orientation the other way round",
        "is that of the world in the instrument: transposed, or the conjugate quaternion",
        "turn it around in the log: the transposed matrix (r12: r21, …), or qx, qy, qz with the"
        " other sign",
        Observation.transposed,
        SIMPLE,
    )
    stream = excerpt.run.streams[name]
    angles = stream.angles.get("orientation")
    if angles is not None:
        yield from _of_angles(excerpt, source, angles)
    else:
        for order in permutations(range(4)):
            if order == (0, 1, 2, 3):
                continue
            # Columns are w, x, y, z as the description has them; what they hold is another.
            columns = {
                f"q{a}": f"q{'wxyz'[k]}"
                for a, k in zip("wxyz", order, strict=True)
                if a != "wxyz"[k]
            }
            cyclic = order in {(1, 2, 3, 0), (3, 0, 1, 2)}
            key = "columns: {" + ", ".join(f"{a}: {b}" for a, b in columns.items()) + "}"
            yield resampled(
                "order of the quaternion",
                (
                    "has its quaternion in another order (x y z w against w x y z)"
                    if cyclic
                    else "has parts of its quaternion exchanged"
                ),
                key,
                _reordered(order),
                SIMPLE if cyclic else USUAL + 0.2,
            )
        for i, axis in enumerate(AXES):
            yield resampled(
                "sign of the quaternion",
                f"has q{axis} with the wrong sign",
                f"turn the sign of q{axis} in the log",
                _quaternion_sign(i + 1),
                USUAL,
            )
    for turn in turns():
        if turn.proper:
            yield amendment(
                "frame",
                f"stands in a world turned by right angles ({turn_words(turn)})",
                "turn the world of the orientation: multiply it on the left by the rotation rpy"
                f" {rpy_deg_of(turn.matrix)}",
                _left(turn.matrix),
                USUAL,
            )
            if excerpt.instruments[name].kind != "imu":
                continue
            yield amendment(
                "mounting",
                f"is that of a frame turned against the rest of the IMU ({turn_words(turn)})",
                "give the orientation an instrument of its own of kind attitude with rpy_deg:"
                f" {rpy_deg_of(mounting(excerpt, name) @ turn.matrix)}",
                _right(turn.matrix.T),
                USUAL + 0.2,
            )
    for i in range(3):
        D = -np.eye(3)
        D[i, i] = 1.0
        down = " (z down: north-east-down against z up)" if i == 0 else ""
        yield amendment(
            "frame",
            f"has world and instrument both turned by 180 degrees about {AXES[i]}{down}",
            f"turn both frames in the log: D R D with D = rpy {rpy_deg_of(D)}",
            _both(D),
            SIMPLE + 0.1,
        )
    for order in permutations(range(3)):
        if order != (0, 1, 2):
            P = np.eye(3)[list(order)]
            yield amendment(
                "order of axes",
                "has its axes exchanged in both frames",
                "exchange the axes of the orientation in the log",
                _both(P),
                USUAL,
            )
    for heading in _HEADINGS:
        if heading % 90:
            turned = np.asarray(
                Rotation.from_rotvec(np.radians(heading) * excerpt.robot.up).as_matrix()
            )
            yield amendment(
                "heading",
                f"has another heading than the world, by about {heading} degrees",
                f"turn it about the vertical by {heading} degrees, or widen calibration:"
                " {reference: …}",
                _left(turned),
                RARE,
            )


def turn_words(turn: Turn) -> str:
    """Where the axes go."""
    return ", ".join(
        f"{AXES[i]} = {'-' if turn.signs[i] < 0 else ''}{AXES[k]}" for i, k in enumerate(turn.order)
    )


def _left(matrix: Array) -> Callable[[Observation], Observation]:
    return lambda seen: seen.between(matrix, np.eye(3))


def _right(matrix: Array) -> Callable[[Observation], Observation]:
    return lambda seen: seen.between(np.eye(3), matrix)


def _both(matrix: Array) -> Callable[[Observation], Observation]:
    return lambda seen: seen.between(matrix, matrix.T)


def _reordered(order: tuple[int, ...]) -> Callable[[Array], Array]:
    def change(rotations: Array) -> Array:
        q = Rotation.from_matrix(rotations).as_quat(scalar_first=True)
        # The sign of a quaternion is lost; without jumps it goes on as it began.
        flips = np.where(np.sum(q[1:] * q[:-1], axis=1) < 0, -1.0, 1.0)
        q *= np.concatenate([[1.0], np.cumprod(flips)])[:, None]
        return np.asarray(Rotation.from_quat(q[:, list(order)], scalar_first=True).as_matrix())

    return change


def _quaternion_sign(i: int) -> Callable[[Array], Array]:
    def change(rotations: Array) -> Array:
        q = Rotation.from_matrix(rotations).as_quat(scalar_first=True)
        q[:, i] *= -1
        return np.asarray(Rotation.from_quat(q, scalar_first=True).as_matrix())

    return change


def _sound(change: Callable[[Array], Array], rotations: Array) -> Array:
    """Change those that are there."""
    values = np.full(rotations.shape, np.nan)
    complete = np.isfinite(rotations).all(axis=(1, 2))
    values[complete] = change(rotations[complete])
    return values


_ORDERS = {
    "XYZ": "roll, pitch, yaw about turned axes (R = Rx Ry Rz)",
    "ZXY": "Rz Rx Ry",
    "YXZ": "Ry Rx Rz",
    "XZY": "Rx Rz Ry",
    "YZX": "Ry Rz Rx",
}


def _of_angles(excerpt: Excerpt, source: Source, angles: Array) -> Iterator[Amendment]:
    name = source[0]
    columns = ["roll", "pitch", "yaw"]

    def amendment(
        kind: str, what: str, proposal: str, rotations: Callable[[Array], Array], cost: float
    ) -> Amendment:
        def change(p: Excerpt) -> Excerpt:
            values = np.full((len(angles), 3, 3), np.nan)
            complete = np.isfinite(angles).all(axis=1)
            values[complete] = rotations(angles[complete])
            return p.with_observations({source: p.refitted(source, values)})

        return Amendment(kind, name, "orientation", what, proposal, change, cost, frozenset({name}))

    def plain(a: Array) -> Array:
        return np.asarray(Rotation.from_euler("ZYX", a[:, ::-1]).as_matrix())

    degrees = np.pi / 180
    yield amendment(
        "unit",
        "is in degrees, not in radians",
        units_key(columns, "deg"),
        lambda a: plain(a * degrees),
        SIMPLE,
    )
    yield amendment(
        "unit",
        "is in radians, not in degrees",
        units_key(columns, "rad"),
        lambda a: plain(a / degrees),
        SIMPLE,
    )

    def flipped(i: int) -> Callable[[Array], Array]:
        return lambda a: plain(a * np.where(np.arange(3) == i, -1.0, 1.0))

    def exchanged(order: tuple[int, ...]) -> Callable[[Array], Array]:
        return lambda a: plain(a[:, list(order)])

    def ordered(axes: str) -> Callable[[Array], Array]:
        return lambda a: np.asarray(
            Rotation.from_euler(axes, a[:, ["XYZ".index(c) for c in axes]]).as_matrix()
        )

    for i, column in enumerate(columns):
        key = f"turn the sign of {column} in the log"
        yield amendment(
            "sign of an angle", f"has {column} with the wrong sign", key, flipped(i), SIMPLE
        )
    for order in permutations(range(3)):
        if order != (0, 1, 2):
            changed = {columns[i]: columns[k] for i, k in enumerate(order) if i != k}
            key = "columns: {" + ", ".join(f"{a}: {b}" for a, b in changed.items()) + "}"
            yield amendment(
                "order of the angles",
                "has its angles exchanged",
                key,
                exchanged(order),
                SIMPLE + 0.1,
            )
    for axes, words in _ORDERS.items():
        what = f"has its angles in another order of rotations: {words}"
        key = "write the orientation as quaternion or matrix, or as R = Rz(yaw) Ry(pitch) Rx(roll)"
        yield amendment("order of the angles", what, key, ordered(axes), USUAL)


def of_frame(excerpt: Excerpt, name: str) -> Iterator[Amendment]:
    """Where a tracker stands."""
    origin, R = tracker_frame(excerpt, name)
    if not np.allclose(R, np.eye(3)) or origin.any():
        yield Amendment(
            "tracker frame",
            name,
            "position",
            "has its frame stated the wrong way round (world in the tracker)",
            f"frame: {{position: {[round(float(v), 6) for v in -R.T @ origin]}, rpy_deg:"
            f" {rpy_deg_of(R.T)}}}",
            lambda p: p.with_instrument(name, frame=_frame(p, name, -R.T @ origin, R.T)),
            SIMPLE,
            frozenset({name}),
        )


def _frame(excerpt: Excerpt, name: str, origin: Array, R: Array) -> object:
    form = excerpt.instruments[name].frame  # type: ignore[attr-defined]
    return form.model_copy(
        update={"position": tuple(map(float, origin)), "rpy_deg": tuple(rpy_deg_of(R))}
    )


def of_target(excerpt: Excerpt, name: str, wanted: Array) -> Iterator[Amendment]:
    """Another place on the platform.

    Args:
        excerpt: What is looked at.
        name: Instrument.
        wanted: Where it seems to be, platform frame [m], shape (3,).
    """
    instrument = excerpt.instruments[name]
    key = "target" if hasattr(instrument, "target") else "position"
    lever = lever_of(excerpt, name)
    if (
        not _LEAST_TARGET
        < float(np.linalg.norm(wanted - lever))
        < _FARTHEST * max(excerpt.robot.size, 0.5)
    ):
        return
    place = tuple(round(float(v), 3) for v in wanted)
    yield Amendment(
        "place on the platform",
        name,
        key,
        f"sits elsewhere on the platform than stated, by {np.linalg.norm(wanted - lever):.2g} m",
        f"{key}: {list(place)}",
        _with(name, **{key: place}),
        RARE,
        frozenset({name}),
    )
    for turn in turns():
        if turn.order == (0, 1, 2) and np.linalg.norm(
            turn.matrix @ lever - wanted
        ) < 0.4 * np.linalg.norm(lever - wanted):
            place = tuple(float(v) + 0.0 for v in turn.matrix @ lever)
            yield Amendment(
                "place on the platform",
                name,
                key,
                f"has {key} stated with a wrong sign",
                f"{key}: {list(place)}",
                _with(name, **{key: place}),
                SIMPLE,
                frozenset({name}),
            )


def of_clock(excerpt: Excerpt, names: tuple[str, ...], delay: float) -> Amendment:
    """A clock that is late."""

    def change(p: Excerpt) -> Excerpt:
        return p.with_observations(
            {s: seen.later(p.time, delay) for s, seen in p.observations.items() if s[0] in names}
        )

    which = " and ".join(names)
    key = (
        "sync: {" + ", ".join(f"{n}: {excerpt.run.sync[n] + delay:.3f}" for n in names) + "}"
        if excerpt.run.sync
        else f"calibration: {{delay: {{value: {delay:.3f}, sigma: 0.02}}}}"
    )
    return Amendment(
        "clock",
        names[0],
        "t",
        f"the clock of {which} is {'late' if delay > 0 else 'early'} by {abs(delay):.2f} s",
        key,
        change,
        USUAL,
        frozenset(names),
    )


def of_gravity(excerpt: Excerpt) -> Iterator[Amendment]:
    """Gravity in the robot file."""
    g = excerpt.robot.gravity
    size = float(np.linalg.norm(g))
    for axis in (2, 1, 0):
        for sign in (-1, 1):
            other = np.zeros(3)
            other[axis] = sign * size
            if np.allclose(other, g, atol=0.2 * size):
                continue
            down = ": the world of the robot file has z down" if axis == 2 and sign > 0 else ""
            yield Amendment(
                "gravity in the robot file",
                ROBOT,
                "gravity",
                f"gravity points along {'+' if sign > 0 else '-'}{AXES[axis]} in the robot's"
                f" world{down}",
                f"gravity: {[float(v) for v in other]} in the robot file",
                _with_gravity(other),
                SIMPLE + (0.0 if axis == 2 else 0.4),
                frozenset({ROBOT}),
            )


def _with_gravity(gravity: Array) -> Callable[[Excerpt], Excerpt]:
    return lambda excerpt: replace(excerpt, robot=replace(excerpt.robot, gravity=gravity))
