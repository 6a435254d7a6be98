"""What the streams of one run show of each other's units, signs and mounting."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from steelyard.arrays import Array
from steelyard.drafts.settings import COMPARE
from steelyard.drafts.survey import DraftStream, read_again
from steelyard.errors import InputError

_DEGREES = 180 / np.pi
"""In a radian."""
_UNSURE = {"that the gyro reads deg/s", "that roll, pitch, yaw are radians"}
"""Checks that are done where a gyro turns as fast as an orientation."""


def compared(streams: tuple[DraftStream, ...], m: int, *, agree: bool) -> tuple[DraftStream, ...]:
    """The streams of a run with what they show of each other.

    Args:
        streams: Of one run.
        m: Number of cables of the robot.
        agree: Whether their clocks do, or they are poses at rest.
    """
    streams = tuple(_gyro_checked(found, streams, m) for found in streams)
    if not agree:
        return streams
    return tuple(_mounted(_sign_checked(found, streams), streams) for found in streams)


def _turning(found: DraftStream) -> float | None:
    """How fast the orientation of a stream turns when it turns fast [rad/s]."""
    if found.static or "orientation" not in found.stream.values or found.rate is None:
        return None
    stride = max(1, round(COMPARE.step * found.rate))
    matrices = found.stream.values["orientation"][::stride]
    time = found.stream.time[::stride]
    valid = np.isfinite(matrices).all(axis=(1, 2))
    turned = Rotation.from_matrix(matrices[valid])
    steps = np.diff(time[valid])
    if len(turned) < 5 or not (steps > 0).any():
        return None
    angles = (turned[:-1].inv() * turned[1:]).magnitude()
    return float(np.percentile(angles[steps > 0] / steps[steps > 0], 90))


def _gyro_checked(found: DraftStream, streams: tuple[DraftStream, ...], m: int) -> DraftStream:
    """A gyro with the unit in which it turns as fast as an orientation does."""
    rates = found.stream.values.get("angular_velocity")
    if found.kind != "imu" or rates is None:
        return found
    own_first = sorted(streams, key=lambda other: other is not found)
    speeds = [_turning(other) for other in own_first]
    fast = [speed for speed in speeds if speed is not None and speed > COMPARE.least_speed]
    rates = rates[np.isfinite(rates).all(axis=1)]
    if not fast or found.static or not len(rates):
        return found
    ratio = float(np.percentile(np.linalg.norm(rates, axis=1), 90)) / fast[0]
    named = {found.place.columns.get(f"w{axis}", f"w{axis}") for axis in "xyz"}
    is_stated = bool(named & (found.stated.keys() | found.place.units.keys()))
    beside = f"the gyro turns {ratio:.3g} times as fast as the orientation"
    if not is_stated and _DEGREES / COMPARE.near < ratio < _DEGREES * COMPARE.near:
        units = {**found.place.units, **dict.fromkeys(sorted(_gyro_columns(found)), "deg/s")}
        place = replace(found.place, units=units)
        try:
            return read_again(found.because(f"{beside}: deg/s"), m, place=place)
        except InputError:
            return found
    if not 1 / COMPARE.near < ratio < COMPARE.near:
        return found.to_check(f"the unit of gyro or angles: {beside}")
    sure = tuple(check for check in found.checks if check not in _UNSURE)
    return replace(found, checks=sure).because("the gyro turns as fast as the orientation")


def _gyro_columns(found: DraftStream) -> set[str]:
    """Columns of the log that hold the rates; fields of messages have names of their own."""
    rates = {"wx", "wy", "wz"}
    named = {column for name, column in found.place.columns.items() if name in rates}
    fields = {column for column in found.used if column.startswith("angular_velocity.")}
    return named or fields | rates.intersection(found.used)


def _sign_checked(found: DraftStream, streams: tuple[DraftStream, ...]) -> DraftStream:
    """A wrench sensor with the sign that gravity gives it: up is the force on a body that hangs or
    stands.
    """
    if found.kind != "wrench" or "acts_on" in found.settings:
        return found
    pairs = _verticals(found, streams, "force")
    if pairs is None:
        return found
    up, force = pairs
    # F = weight x up + offset, about the mean: offsets of such sensors are larger than the weights
    # that they hold.
    spread, against = up - up.mean(axis=0), force - force.mean(axis=0)
    if len(up) < 3 or not (spread**2).sum() > COMPARE.least_tilt * len(up):
        return found.to_check("acts_on: sensor, where the log has what the body does to the sensor")
    weight = float((spread * against).sum() / (spread**2).sum())
    left = float(((against - weight * spread) ** 2).sum())
    followed = 1 - left / max(float((against**2).sum()), 1e-300)
    text = f"the force follows gravity with {weight:.3g} N along the vertical"
    if followed < COMPARE.upright:
        return found.to_check(
            f"rpy_deg, and whether something touches the body: {text}, which is"
            f" {followed:.0%} of its variance"
        )
    if weight < 0:
        return found.because(f"{text}: the body pulls at the sensor", acts_on="sensor")
    return found.because(f"{text}: the sensor carries the body", acts_on="body")


def _mounted(found: DraftStream, streams: tuple[DraftStream, ...]) -> DraftStream:
    """An accelerometer with the rotation that brings its gravity to where an attitude beside it
    says that up is.
    """
    if found.kind != "imu" or found.settings.get("gravity") != "included":
        return found
    pairs = _verticals(found, streams, "specific_force")
    if pairs is None or len(pairs[0]) < 3:
        return found
    up, force = pairs
    typical = float(np.median(np.linalg.norm(force, axis=1)))
    U, S, Vt = np.linalg.svd(up.T @ force / typical / len(up))
    if S[1] < COMPARE.spread:
        return found.to_check(
            "rpy_deg: the direction of gravity hardly changes, which is not enough to determine it"
        )
    # The rotation that fits best [Wahba1965]: R_platform_instrument.
    R = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    misfit = force / np.linalg.norm(force, axis=1, keepdims=True) @ R.T - up
    off = float(np.degrees(np.sqrt(np.mean(np.sum(misfit**2, axis=1)))))
    turned = Rotation.from_matrix(R)
    if turned.magnitude() < np.radians(COMPARE.turned):
        return found.because("gravity and attitude agree: the axes are those of the platform")
    if off > COMPARE.fits:
        return found.to_check(
            f"rpy_deg: gravity and attitude are {off:.0f} deg apart however it is mounted"
        )
    rpy = _rounded(turned)
    stated = found.because(
        f"with that rpy_deg gravity is where the attitude says up is, within {off:.1f} deg",
        rpy_deg=rpy,
    )
    return stated.to_check(f"rpy_deg: {list(rpy)} brings gravity to where the attitude says up is")


def _rounded(turned: Rotation) -> tuple[float, ...]:
    """Roll, pitch, yaw of a mounting in whole degrees, of right angles where it is close to
    them.
    """
    square = min(Rotation.create_group("O"), key=lambda each: (each.inv() * turned).magnitude())
    is_near = (square.inv() * turned).magnitude() < np.radians(COMPARE.square)
    angles = (square if is_near else turned).as_euler("ZYX", degrees=True, suppress_warnings=True)
    return tuple(float(round(angle)) + 0.0 for angle in angles[::-1])


def _verticals(
    found: DraftStream, streams: tuple[DraftStream, ...], quantity: str
) -> tuple[Array, Array] | None:
    """Directions of the vertical in platform axes as an attitude of the run has them, and readings
    of a stream at the same times, shape (n, 3) each; None: there is no attitude or no such reading.
    """
    arm = next((other for other in streams if other.kind in {"attitude", "pose"}), None)
    values = found.stream.values.get(quantity)
    if arm is None or values is None:
        return None
    matrices = arm.stream.values["orientation"]
    if not arm.static:
        places = np.searchsorted(arm.stream.time, found.stream.time)
        matrices = matrices[places.clip(0, len(matrices) - 1)]
    rows = slice(None, None, max(1, len(values) // COMPARE.most))
    up, values = matrices[rows, 2, :], values[rows]
    valid = np.isfinite(up).all(axis=1) & np.isfinite(values).all(axis=1)
    return up[valid], values[valid]
