"""What the streams of one run tell about each other's units, signs and mounting."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from steelyard.arrays import Array
from steelyard.drafts.survey import DraftStream, read_again
from steelyard.errors import InputError

_DEGREES = 180 / np.pi
_NEAR = 2.0
"""Factor within which a ratio of 57 is that of degrees to radians."""
_STEP = 0.1
"""Over which an orientation is differenced [s]."""
_MOST = 4000
"""Samples that are compared."""
_SPREAD = 0.02
"""Second singular value of directions of gravity that tell a rotation."""
_TURNED, _SQUARE = np.radians(20.0), np.radians(10.0)
"""A mounting is named where it is farther from none, and rounded to right angles where it is closer
to them [rad]."""
_FITS = 10.0
"""How far gravity may be from where it should be [deg]."""
_UPRIGHT = 0.9
"""Part of the force that has to follow gravity before its sign is believed."""


def compared(streams: tuple[DraftStream, ...], m: int, *, agree: bool) -> tuple[DraftStream, ...]:
    """The streams of a run with what they tell about each other.

    Args:
        streams: Of one run.
        m: Number of cables of the robot.
        agree: Whether their clocks do, or they are poses at rest.
    """
    streams = tuple(_gyro_checked(found, streams, m) for found in streams)
    if not agree:
        return streams
    checked = {"wrench": _sign_checked, "imu": _mounted}
    return tuple(
        checked[found.kind](found, streams) if found.kind in checked else found for found in streams
    )


def _turning(found: DraftStream) -> float | None:
    """How fast the orientation of a stream turns when it turns fast [rad/s]."""
    if found.static or "orientation" not in found.stream.values or found.rate is None:
        return None
    stride = max(1, round(_STEP * found.rate))
    matrices = found.stream.values["orientation"][::stride]
    time = found.stream.time[::stride]
    valid = np.isfinite(matrices).all(axis=(1, 2))
    turned = Rotation.from_matrix(matrices[valid])
    steps = np.diff(time[valid])
    if len(turned) < 5 or not (steps > 0).any():
        return None
    speeds = (turned[:-1].inv() * turned[1:]).magnitude()[steps > 0] / steps[steps > 0]
    return float(np.percentile(speeds, 90))


def _gyro_checked(found: DraftStream, streams: tuple[DraftStream, ...], m: int) -> DraftStream:
    """A gyro with the unit in which it turns as fast as an orientation does."""
    rates = found.stream.values.get("angular_velocity")
    if found.kind != "imu" or rates is None:
        return found
    told = [_turning(other) for other in sorted(streams, key=lambda other: other is not found)]
    speeds = [speed for speed in told if speed is not None and speed > 0.02]
    rates = rates[np.isfinite(rates).all(axis=1)]
    if not speeds or found.static or not len(rates):
        return found
    ratio = float(np.percentile(np.linalg.norm(rates, axis=1), 90)) / speeds[0]
    named = {found.place.columns.get(f"w{axis}", f"w{axis}") for axis in "xyz"}
    stated = named & set(found.stated)
    if (
        not stated
        and not named & set(found.place.units)
        and _DEGREES / _NEAR < ratio < _DEGREES * _NEAR
    ):
        units = {**found.place.units, **dict.fromkeys(sorted(_gyro_columns(found)), "deg/s")}
        why = (*found.why, f"the gyro turns {ratio:.3g} times as fast as the orientation: deg/s")
        try:
            return read_again(found, m, place=replace(found.place, units=units), why=why)
        except InputError:
            return found
    if not 1 / _NEAR < ratio < _NEAR:
        return replace(
            found,
            checks=(
                *found.checks,
                (
                    f"the unit of gyro or angles: the gyro turns {ratio:.3g} times as fast as the"
                    " orientation"
                ),
            ),
        )
    sure = tuple(
        check
        for check in found.checks
        if check not in {"that the gyro reads deg/s", "that roll, pitch, yaw are radians"}
    )
    return replace(
        found, checks=sure, why=(*found.why, "the gyro turns as fast as the orientation")
    )


def _gyro_columns(found: DraftStream) -> set[str]:
    """Columns of the log that hold the rates; fields of messages have names of their own."""
    named = {found.place.columns[f"w{axis}"] for axis in "xyz" if f"w{axis}" in found.place.columns}
    return named or {
        column
        for column in found.used
        if column in {"wx", "wy", "wz"} or column.startswith("angular_velocity.")
    }


def _sign_checked(found: DraftStream, streams: tuple[DraftStream, ...]) -> DraftStream:
    """A wrench sensor with the sign that gravity gives it: up is the force on a body that hangs or
    stands.
    """
    arm = next((other for other in streams if other.kind in {"attitude", "pose"}), None)
    if arm is None or "acts_on" in found.settings:
        return found
    up = _nearest(arm, found)[:, 2, :]
    force = found.stream.values["force"]
    rows = _thinned(len(force))
    up, force = up[rows], force[rows]
    valid = np.isfinite(up).all(axis=1) & np.isfinite(force).all(axis=1)
    up, force = up[valid], force[valid]
    # F = weight x up + offset, about the mean: offsets of such sensors are larger than what they
    # carry.
    spread, against = up - up.mean(axis=0), force - force.mean(axis=0)
    if len(up) < 3 or not (spread**2).sum() > 0.05 * len(up):
        return replace(
            found,
            checks=(
                *found.checks,
                "acts_on: sensor, where the log has what the body does to the sensor",
            ),
        )
    weight = float((spread * against).sum() / (spread**2).sum())
    followed = 1 - float(((against - weight * spread) ** 2).sum() / max((against**2).sum(), 1e-300))
    text = f"the force follows gravity with {weight:.3g} N along the vertical"
    if followed < _UPRIGHT:
        return replace(
            found,
            checks=(
                *found.checks,
                (
                    f"rpy_deg, and whether something touches the body: {text}, which explains"
                    f" {followed:.0%} of it"
                ),
            ),
        )
    side, words = (
        ("sensor", "the body pulls at the sensor")
        if weight < 0
        else ("body", "the sensor carries the body")
    )
    return replace(
        found, settings={**found.settings, "acts_on": side}, why=(*found.why, f"{text}: {words}")
    )


def _mounted(found: DraftStream, streams: tuple[DraftStream, ...]) -> DraftStream:
    """An accelerometer with the rotation that brings its gravity to where an attitude beside it
    says that up is.
    """
    arm = next((other for other in streams if other.kind in {"attitude", "pose"}), None)
    force = found.stream.values.get("specific_force")
    if arm is None or force is None or found.settings.get("gravity") != "included":
        return found
    rows = _thinned(len(force))
    up, force = _nearest(arm, found)[rows, 2, :], force[rows]
    valid = np.isfinite(up).all(axis=1) & np.isfinite(force).all(axis=1)
    up, force = up[valid], force[valid]
    if len(up) < 3:
        return found
    U, S, Vt = np.linalg.svd(
        up.T @ force / float(np.median(np.linalg.norm(force, axis=1))) / len(up)
    )
    if S[1] < _SPREAD:
        return replace(
            found,
            checks=(*found.checks, "rpy_deg: gravity points too much the same way to tell it"),
        )
    # The rotation that fits best [Wahba1965]: R_platform_instrument.
    R = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    off = float(
        np.degrees(
            np.sqrt(
                np.mean(
                    np.sum(
                        (force / np.linalg.norm(force, axis=1, keepdims=True) @ R.T - up) ** 2,
                        axis=1,
                    )
                )
            )
        )
    )
    turned = Rotation.from_matrix(R)
    if turned.magnitude() < _TURNED:
        return replace(
            found,
            why=(*found.why, "gravity and attitude agree: the axes are those of the platform"),
        )
    if off > _FITS:
        return replace(
            found,
            checks=(
                *found.checks,
                f"rpy_deg: gravity and attitude are {off:.0f} deg apart however it is mounted",
            ),
        )
    square = min(Rotation.create_group("O"), key=lambda each: (each.inv() * turned).magnitude())
    near = (square.inv() * turned).magnitude() < _SQUARE
    angles = (square if near else turned).as_euler("ZYX", degrees=True, suppress_warnings=True)[
        ::-1
    ]
    rpy = tuple(float(round(angle)) + 0.0 for angle in angles)
    text = f"rpy_deg: {list(rpy)} brings gravity to where the attitude says up is"
    return replace(
        found,
        settings={**found.settings, "rpy_deg": rpy},
        why=(
            *found.why,
            f"with that rpy_deg gravity is where the attitude says up is, within {off:.1f} deg",
        ),
        checks=(*found.checks, text),
    )


def _thinned(n: int) -> slice:
    return slice(None, None, max(1, n // _MOST))


def _nearest(source: DraftStream, onto: DraftStream) -> Array:
    """Orientations of one stream at the times of another, shape (n, 3, 3)."""
    matrices = source.stream.values["orientation"]
    if source.static:
        return matrices
    places = np.searchsorted(source.stream.time, onto.stream.time).clip(0, len(matrices) - 1)
    return np.asarray(matrices[places])
