"""Mistakes of how an instrument is mounted and what its readings are stated to be: rotation, place,
frame, gravity.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from itertools import product

import numpy as np

from steelyard.arrays import Array
from steelyard.dynamics import specific_force_at
from steelyard.identification.model.sources import Source
from steelyard.inspection.agreements.excerpt import Excerpt
from steelyard.inspection.agreements.frames import (
    attitude_motion,
    attitude_source,
    mounting,
    origin_motion,
    point_of,
    rpy_deg_of,
    specific_force_of_origin,
    specific_force_there,
    tracker_frame,
)
from steelyard.inspection.agreements.motion import specific_force
from steelyard.inspection.mistakes.amendment import (
    AXES,
    RARE,
    ROBOT,
    SIMPLE,
    USUAL,
    Amendment,
    Change,
    Subject,
    edited,
    with_gravity,
    with_keys,
)
from steelyard.inspection.mistakes.axes import axis_changes, rotations_by_right_angles
from steelyard.inspection.mistakes.settings import PLACES, PlaceSettings
from steelyard.instruments.equations import needed_for


def of_choices(excerpt: Excerpt, name: str) -> Iterator[Amendment]:
    """Keys of two values that say the opposite of what is."""
    for choice in excerpt.instruments[name].choices:
        if all((name, quantity) in excerpt.observations for quantity in choice.quantities):
            change = with_keys(name, **{choice.key: choice.other})
            yield Subject(name, ", ".join(choice.quantities)).amendment(
                choice.kind, choice.what, f"{choice.key}: {choice.other}", change, SIMPLE
            )


def of_accelerometer(excerpt: Excerpt, name: str) -> Iterator[Amendment]:
    """Gravity that is added with the wrong sign."""
    source = (name, "specific_force")
    instrument, robot = excerpt.instruments[name], excerpt.experiment.robot
    orientation = attitude_source(excerpt)
    takes_gravity_out = "gravity" in needed_for("specific_force", instrument, robot, (source[1],))
    if orientation is not None and not takes_gravity_out:
        yield Subject(*source).amendment(
            "gravity in the accelerometer",
            "feels gravity upside down (a + g instead of a - g)",
            "turn the sign of the gravity in the log, or state gravity: removed once it is"
            " taken out",
            _gravity_turned(source, orientation),
            USUAL,
            beside=(orientation[0],),
        )


def of_gyro(excerpt: Excerpt, name: str) -> Iterator[Amendment]:
    """Angular velocity in other axes than those of its instrument."""
    source = (name, "angular_velocity")
    orientation = attitude_source(excerpt)
    if orientation is not None:
        yield Subject(*source).amendment(
            "frame",
            "reads angular velocity in world axes",
            "turn it into the axes of the IMU in the log",
            _from_world_axes(source, orientation),
            RARE,
            beside=(orientation[0],),
        )


def _instrument_rotation(excerpt: Excerpt, name: str, orientation: Source) -> Array:
    """R_world_instrument by an orientation, shape (n, 3, 3)."""
    return attitude_motion(excerpt, orientation).rotation @ mounting(excerpt, name)


def _gravity_turned(source: Source, orientation: Source) -> Change:
    def change(excerpt: Excerpt) -> Excerpt:
        R = _instrument_rotation(excerpt, source[0], orientation)
        gravity = R.swapaxes(1, 2) @ excerpt.robot.gravity
        turned = edited(source, lambda read: replace(read, value=read.value - 2 * gravity))
        return turned(excerpt)

    return change


def _from_world_axes(source: Source, orientation: Source) -> Change:
    def change(excerpt: Excerpt) -> Excerpt:
        R = _instrument_rotation(excerpt, source[0], orientation)
        into_instrument = partial(np.einsum, "nji,nj->ni", R)
        return edited(source, lambda read: read.through(into_instrument))(excerpt)

    return change


def of_mounting(excerpt: Excerpt, name: str) -> Iterator[Amendment]:
    """Instruments turned by right angles, or stated the wrong way round."""
    R = mounting(excerpt, name)

    def turned(R: Array, what: str, cost: float) -> Amendment:
        rpy = rpy_deg_of(R)
        change = with_keys(name, rpy_deg=tuple(rpy))
        return Subject(name, "").amendment("mounting", what, f"rpy_deg: {rpy}", change, cost)

    for turn in rotations_by_right_angles():
        what = f"is mounted otherwise than stated, turned by {turn.angle} degrees"
        yield turned(R @ turn.matrix, what, SIMPLE + 0.2)
    if not np.allclose(R, R.T):
        what = "has its mounting stated the wrong way round (platform to instrument)"
        yield turned(R.T, what, SIMPLE)


def of_frame(excerpt: Excerpt, source: Source) -> Iterator[Amendment]:
    """Where a tracker stands."""
    name = source[0]
    frame = excerpt.instruments[name].mounting.frame
    origin, R = tracker_frame(excerpt, name)
    if frame is None or (np.allclose(R, np.eye(3)) and not origin.any()):
        return
    place, rpy = -R.T @ origin, rpy_deg_of(R.T)
    turned = {"position": tuple(map(float, place)), "rpy_deg": tuple(rpy)}
    shown = [round(float(v), 6) for v in place]
    yield Subject(*source).amendment(
        "tracker frame",
        "has its frame stated the wrong way round (world in the tracker)",
        f"frame: {{position: {shown}, rpy_deg: {rpy}}}",
        with_keys(name, frame=frame.model_copy(update=turned)),
        SIMPLE,
    )


def of_point(
    excerpt: Excerpt, source: Source, settings: PlaceSettings = PLACES
) -> Iterator[Amendment]:
    """Another place on the platform: where the instrument seems to be, or that which is stated with
    another sign.
    """
    name = source[0]
    key = excerpt.instruments[name].mounting.point_key
    origin = excerpt.experiment.origin
    point = point_of(excerpt, name) - origin
    farthest = settings.farthest * max(excerpt.robot.size, settings.least_radius)

    def moved(place: Array, what: str, cost: float) -> Amendment:
        stated = place.tolist()
        change = with_keys(name, **{key: tuple((place + origin).tolist())})
        kind = "place on the platform"
        # By smoothed motions a place is known to some centimetres; the fit finds it better.
        keys = [f"{key}: {stated}", f"calibration: {{{key}: {settings.least:g}}}"]
        proposal = ", ".join(keys)
        return Subject(name, key).amendment(kind, what, proposal, change, cost, keys=keys)

    for wanted in (each - origin for each in _wanted_points(excerpt, source, settings)):
        off = float(np.linalg.norm(wanted - point))
        if not settings.least < off < farthest:
            continue
        what = f"sits elsewhere on the platform than stated, by {off:.2g} m"
        yield moved(np.round(wanted, 3), what, RARE)
        for turn in axis_changes():
            other = turn.matrix @ point
            is_closer = np.linalg.norm(other - wanted) < settings.closer * off
            if turn.keeps_order and is_closer:
                yield moved(other + 0.0, f"has {key} stated with a wrong sign", SIMPLE)


def _wanted_points(excerpt: Excerpt, source: Source, settings: PlaceSettings) -> Iterator[Array]:
    """Where on the platform an instrument would have to sit [m], by every other one that it can be
    compared with.
    """
    orientation = attitude_source(excerpt)
    if orientation is None or excerpt.static or excerpt.instruments[source[0]].commanded:
        return
    turned = attitude_motion(excerpt, orientation)
    n = len(turned.omega)
    free = np.broadcast_to(np.eye(3), (n, 3, 3))
    _, by_point = specific_force_at(np.zeros((n, 3)), turned.omega, turned.alpha, np.zeros(3))
    accelerated = np.concatenate([by_point, free], axis=2)
    placed = np.concatenate([turned.rotation, free], axis=2)
    others = [other for other in excerpt.quantity("position") if other != source]
    if source[1] == "position":
        origin, R = tracker_frame(excerpt, source[0])
        read = excerpt.observations[source].mapped(R)
        for other in others:
            difference = read.value + origin - origin_motion(excerpt, other, turned).position
            yield _solved(placed, difference, settings)
        tracked = np.einsum("nji,nj->ni", turned.rotation, read.bend - excerpt.robot.gravity)
        for of_force in excerpt.quantity("specific_force"):
            own = specific_force_of_origin(
                excerpt, of_force, turned.rotation, turned.omega, turned.alpha
            )
            yield _solved(accelerated, tracked - own, settings)
    else:
        there = specific_force_there(excerpt, source, turned)
        for other in others:
            force = specific_force(excerpt, turned, origin_motion(excerpt, other, turned))
            yield _solved(accelerated, there.value - force, settings)


def _solved(columns: Array, target: Array, settings: PlaceSettings) -> Array:
    """The point, shape (3,), of which columns, shape (n, 3, 6), with a constant beside make a
    target.
    """
    A = columns.reshape(-1, 6)
    held = settings.free * np.linalg.norm(A, axis=0).max() * np.eye(6)
    wanted = np.concatenate([target.ravel(), np.zeros(6)])
    value, *_ = np.linalg.lstsq(np.vstack([A, held]), wanted, rcond=None)
    return np.asarray(value[:3])


def of_gravity(excerpt: Excerpt) -> Iterator[Amendment]:
    """Gravity in the robot file."""
    g = excerpt.robot.gravity
    size = float(np.linalg.norm(g))
    for axis, sign in product((2, 1, 0), (-1, 1)):
        other = sign * size * np.eye(3)[axis]
        if np.allclose(other, g, atol=0.2 * size):
            continue
        along = f"{'+' if sign > 0 else '-'}{AXES[axis]}"
        down = ": the world of the robot file has z down" if axis == 2 and sign > 0 else ""
        yield Subject(ROBOT, "gravity").amendment(
            "gravity in the robot file",
            f"gravity points along {along} in the robot's world{down}",
            f"gravity: {(other + 0.0).tolist()} in the robot file",
            with_gravity(other + 0.0),
            SIMPLE + (0.0 if axis == 2 else 0.4),
        )
