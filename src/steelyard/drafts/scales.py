"""From the values of columns to their units: what a platform can do distinguishes milliseconds
from seconds, and g from m/s^2.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from steelyard.arrays import Array
from steelyard.drafts.settings import SCALES
from steelyard.robot.model import Robot

_SINCE_1970 = (("ns", 1e17, 1e-9), ("us", 1e14, 1e-6), ("ms", 1e11, 1e-3), ("s", 1e8, 1.0))
"""Unit, the least that a time since 1970 is in it (1973), and its factor."""


@dataclass(frozen=True)
class Scale:
    """Units that the values of an instrument's columns seem to have, and what else they show."""

    units: Mapping[str, str] = field(default_factory=dict)
    """Column of the contract -> unit, where it is not SI."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """Keys of the instrument."""
    why: tuple[str, ...] = ()
    checks: tuple[str, ...] = ()


def time_unit(time: Array) -> tuple[str, str]:
    """Unit of times by their steps and size, and why."""
    steps = np.diff(time)
    steps = steps[steps > 0]
    if not len(steps):
        return "s", ""
    step, size = float(np.median(steps)), abs(float(time[0]))
    for unit, least, factor in _SINCE_1970:
        is_step = SCALES.shortest_step <= step * factor <= SCALES.longest_step
        if size >= least and is_step:
            return unit, f"times since 1970 in {unit}"
    whole = bool(np.all(time == np.round(time)))
    if step < 2 and not (whole and len(time) > 100):
        return "s", ""
    # Rates down to 2 Hz.
    unit = next((unit for unit, longest in (("ms", 500), ("us", 5e5)) if step < longest), "ns")
    return unit, f"steps of {step:.4g} are likeliest {unit}"


def scale_of(kind: str, values: Mapping[str, Array], robot: Robot) -> Scale:
    """Guess the units of an instrument.

    Args:
        kind: Of the instrument.
        values: Column of the contract -> values as they stand in the log, in units that nobody
            states, shape (n,).
        robot: What it is on.
    """
    parts = []
    for kinds, names, guess in _guesses(robot.m):
        if (kinds is None or kind in kinds) and names and values.keys() >= set(names):
            rows = np.column_stack([values[name] for name in names])
            rows = rows[np.isfinite(rows).all(axis=1)]
            if len(rows):
                parts.append(guess(rows, names, robot))
    return Scale(
        {name: unit for part in parts for name, unit in part.units.items()},
        {key: value for part in parts for key, value in part.settings.items()},
        tuple(text for part in parts for text in part.why),
        tuple(text for part in parts for text in part.checks),
    )


def _acceleration(rows: Array, names: Sequence[str], robot: Robot) -> Scale:
    """Unit of an accelerometer by the gravity in its readings, and whether it is in them."""
    norms = np.linalg.norm(rows, axis=1)
    typical = float(np.median(norms))
    is_constant = float(np.std(norms)) < SCALES.steady * typical
    one_way = float(np.linalg.norm(rows.mean(axis=0))) > SCALES.one_way * float(norms.mean())
    steady = is_constant or one_way
    for unit, low, high in SCALES.gravity if steady else ():
        if low <= typical <= high:
            units = {} if unit == "m/s^2" else dict.fromkeys(names, unit)
            text = f"readings of {typical:.4g} at rest are gravity in {unit}"
            return Scale(units, {"gravity": "included"}, (text,))
    if typical < (SCALES.no_gravity_steady if steady else SCALES.no_gravity):
        text = f"readings of {typical:.2g} in the middle hold no gravity"
        check = "gravity: removed, and whether the unit is m/s^2"
        return Scale({}, {"gravity": "removed"}, (text,), (check,))
    check = f"the unit of the accelerometer: its readings are {typical:.3g} in the middle"
    return Scale(checks=(check,))


def _gyro(rows: Array, names: Sequence[str], robot: Robot) -> Scale:
    """Degrees where rates are too fast for radians."""
    fastest = float(np.percentile(np.linalg.norm(rows, axis=1), 99))
    limit = robot.limits.angular_speed or SCALES.fast
    if fastest > SCALES.too_fast * limit:
        text, check = (
            f"rates up to {fastest:.3g} are too fast for rad/s",
            "that the gyro reads deg/s",
        )
        return Scale(dict.fromkeys(names, "deg/s"), {}, (text,), (check,))
    return Scale()


def _angles(rows: Array, names: Sequence[str], robot: Robot) -> Scale:
    """Degrees where angles are too large for radians."""
    largest = float(np.abs(rows).max())
    tilt = float(np.percentile(np.abs(rows[:, :2]), 99))
    limit = SCALES.tilt * float(np.abs(robot.limits.rpy).max()) if robot.limits.rpy else np.inf
    if largest > 2 * np.pi * 1.01 or tilt > limit:
        return Scale(dict.fromkeys(names, "deg"), why=(f"angles up to {largest:.3g} are degrees",))
    return Scale(checks=("that roll, pitch, yaw are radians",) if largest > 1 else ())


def _position(rows: Array, names: Sequence[str], robot: Robot) -> Scale:
    """Millimetres where a position is too far away for metres."""
    largest = float(np.abs(rows).max())
    if largest > SCALES.largest_position:
        return Scale(dict.fromkeys(names, "mm"), why=(f"positions up to {largest:.4g} are mm",))
    return Scale()


def _tension(rows: Array, names: Sequence[str], robot: Robot) -> Scale:
    """Unit of tensions by the weight they hold, and their sign."""
    settings: dict[str, Any] = {}
    checks: list[str] = []
    why: list[str] = []
    if float(np.median(rows)) < 0:
        settings["scale"] = -1.0
        why.append("readings are negative: a scale of -1 makes tensions that pull positive")
        checks.append("that the sensors read negative when the cables pull")
    total = float(np.median(np.abs(rows.sum(axis=1))))
    weight = robot.platform.mass * float(np.linalg.norm(robot.gravity)) if robot.platform else None
    highest = robot.tension_limits[1] * robot.m if np.isfinite(robot.tension_limits[1]) else None
    unit, text = _force_unit(total, weight, highest)
    if text:
        why.append(text)
        checks.append("the unit of the forces")
    units = dict.fromkeys(names, unit) if unit != "N" else {}
    return Scale(units, settings, tuple(why), tuple(checks))


def _force_unit(total: float, weight: float | None, highest: float | None) -> tuple[str, str]:
    """Unit of tensions by their sum, which is at least the weight of the platform and at most what
    the cables may bear.
    """
    if weight:
        beside = f"together they are {total:.3g}, the platform weighs {weight:.3g} N"
        if total < SCALES.kilonewtons * weight:
            return "kN", f"{beside}: kN"
        if total < SCALES.kilograms * weight:
            return "kgf", f"{beside}: kgf"
        return ("mN", f"{beside}: mN") if total > SCALES.millinewtons * weight else ("N", "")
    if highest and total < SCALES.kilonewtons_of_limit * highest:
        return "kN", f"together they are {total:.3g}, the cables may bear {highest:.3g} N: kN"
    return "N", ""


def _length(rows: Array, names: Sequence[str], robot: Robot) -> Scale:
    """Millimetres where lengths are too long for the frame."""
    reach = float(np.mean(np.linalg.norm(robot.anchors - robot.anchors.mean(axis=0), axis=1)))
    typical = max(float(np.median(np.abs(rows))), float(np.ptp(rows, axis=0).max()))
    check = (
        "that these are lengths fed out, growing as the cable gets longer, and no angles or counts"
        " of the winches"
    )
    if typical > SCALES.millimetres * reach:
        text = f"lengths of {typical:.3g} on a frame of {reach:.3g} m are mm"
        return Scale(dict.fromkeys(names, "mm"), {}, (text,), (check,))
    return Scale(checks=(check,))


def _wrench(rows: Array, names: Sequence[str], robot: Robot) -> Scale:
    """Millimetres where torques are too large for the forces."""
    force, torque = (np.median(np.linalg.norm(rows[:, part], axis=1)) for part in _FORCE_TORQUE)
    lever = float(torque / max(force, 1e-12))
    if lever > SCALES.lever:
        text = f"torques {lever:.3g} times as large as forces are N mm"
        return Scale(dict.fromkeys(names[3:], "N mm"), why=(text,))
    return Scale()


_Guess = Callable[[Array, Sequence[str], Robot], Scale]
"""Of rows without gaps, shape (n, k), and their k columns of the contract."""
_FORCE_TORQUE = (slice(0, 3), slice(3, 6))


def _guesses(m: int) -> Iterator[tuple[frozenset[str] | None, Sequence[str], _Guess]]:
    """Kinds (None: any), columns that belong together, and what to make of their values."""
    yield frozenset({"imu"}), ("ax", "ay", "az"), _acceleration
    yield frozenset({"imu"}), ("wx", "wy", "wz"), _gyro
    yield None, ("roll", "pitch", "yaw"), _angles
    yield frozenset({"position", "pose", "command"}), ("x", "y", "z"), _position
    yield frozenset({"tension"}), [f"f{i + 1}" for i in range(m)], _tension
    yield frozenset({"length"}), [f"l{i + 1}" for i in range(m)], _length
    yield frozenset({"wrench"}), ("fx", "fy", "fz", "tx", "ty", "tz"), _wrench
