"""What an estimate has found that nobody stated: disturbances along the motion, and errors that
good devices do not have.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from steelyard.arrays import Array
from steelyard.identification.model.balance import UNMODELLED_PARTS
from steelyard.identification.model.calibration_parameters import (
    ROBOT,
    CalibrationParameter,
)
from steelyard.identification.model.motion_segment import Segment
from steelyard.identification.model.processes import Process
from steelyard.identification.solve.posterior import Posterior
from steelyard.instruments.base import LATENCY, TIME_CONSTANT
from steelyard.instruments.noise import Cause
from steelyard.instruments.unread_cables import PER_CABLE

_AXES = "xyz"
_MANY = 12
"""Numbers of one kind that are said one by one, at most: one for each of twelve cables."""
_HERTZ = (2 * np.pi) ** 2
"""What a second derivative makes of an oscillation of 1 Hz [1/s^2]."""
_CAUSES: Mapping[Cause, str] = {
    "colored": "has coloured noise",
    "drift": "drifts",
    "reacquired": "is shifted where the target was lost",
    "filter": "leans as its filter follows the accelerometer",
}
"""What a disturbance does, after what it disturbs."""


def disturbances(found: Posterior) -> list[dict[str, Any]]:
    """Coloured noise and unmodelled wrench, one entry for each run that has it: owner, quantity,
    1-sigma and root mean square per axis, largest value with its time and axis, in SI units.
    """
    return [entry for entry, _, _ in disturbances_along(found)]


def disturbances_along(found: Posterior) -> Iterator[tuple[dict[str, Any], Array, Array]]:
    """The same entries, each with times [s], shape (n,), and values in SI units, shape (n, p)."""
    for segment in found.fit.state.segments:
        for process in segment.processes:
            values, times = _along(segment, process)
            instant, axis = np.unravel_index(int(np.argmax(np.abs(values))), values.shape)
            owner, quantity = process.disturbs
            entry = {
                "run": segment.run,
                **({"moves_within": True} if _is_of_load(found, process, segment.run) else {}),
                "owner": owner,
                "quantity": quantity,
                "cause": process.cause,
                "stated": process.is_stated,
                "unit": _unit(found, process),
                "standard_deviation": process.level * process.sizes,
                "correlation_time": process.time,
                "root_mean_square": np.sqrt(np.mean(values**2, axis=0)),
                "largest": {
                    "value": float(values[instant, axis]),
                    "time": float(times[instant]),
                    "component": int(axis) + 1,
                },
            }
            yield entry, times, values


def found_errors(found: Posterior) -> dict[str, dict[str, Any]]:
    """Errors that were taken as none until the readings asked for them: name -> value, 1-sigma and
    unit.
    """
    parameters = found.calibration.calibration_parameters
    return {
        parameters.names[place]: {
            "value": float(found.calibration.values[place]),
            "standard_deviation": float(found.deviations[place]),
            "unit": parameter.unit,
        }
        for place, parameter in _asked_for(found)
    }


def notes_on_unstated(
    disturbed: Sequence[Mapping[str, Any]], errors: Mapping[str, Mapping[str, Any]]
) -> list[str]:
    """The same in words.

    Args:
        disturbed: See :func:`disturbances`.
        errors: See :func:`found_errors`.
    """
    return [*_on_disturbances(disturbed), *_on_errors(errors)]


def notes_on_jitter(found: Posterior) -> list[str]:
    """Time stamps that scatter though nobody has stated it, in words."""
    return [
        f"time stamps of {name} scatter: late by the absolute value of {jitter * 1e3:.2g} ms"
        " (1-sigma) each; its readings count for less where they change quickly"
        for name, jitter in found.fit.state.jitters.items()
    ]


def _on_disturbances(disturbed: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """Size, correlation time and largest value of every disturbance that is more than nothing."""
    for each in disturbed:
        size, time = float(np.max(each["root_mean_square"])), each["correlation_time"]
        owner, quantity, unit = each["owner"], each["quantity"].replace("_", " "), each["unit"]
        if size < 1e-3 * float(np.max(each["standard_deviation"])):
            continue
        largest = each["largest"]
        when = f"largest {largest['value']:+.2g} {unit} at {largest['time']:.1f} s"
        if each["quantity"] in PER_CABLE:
            when += f" of cable {largest['component']}"
        elif len(each["root_mean_square"]) == len(_AXES):
            when += f" along {_AXES[largest['component'] - 1]}"
        if each.get("moves_within"):
            yield (
                f"run '{each['run']}': what moves in the load pulls beside what follows the"
                f" platform: {size:.2g} {unit} rms, {when}"
            )
            continue
        what = (
            f"an {quantity} acts on the platform that nothing explains"
            if owner == ROBOT
            else f"{quantity} of {owner} {_CAUSES[each['cause']]}"
        )
        yield (
            f"run '{each['run']}': {what}: {size:.2g} {unit} rms, correlation time {time:.2g} s,"
            f" {when}"
        )


def _on_errors(errors: Mapping[str, Mapping[str, Any]]) -> Iterator[str]:
    """A hose and what bends in a sentence each, other errors one by one."""
    stiffness = errors.get(f"{ROBOT}.attached.stiffness")
    if stiffness is not None:
        force = [
            each["value"]
            for name, each in errors.items()
            if name.startswith(f"{ROBOT}.attached.force")
        ]
        pulls = ", ".join(f"{value:.2g}" for value in force)
        yield (
            f"something pulls at the platform like a hose: about ({pulls}) N, and"
            f" {stiffness['value']:.2g} ± {stiffness['standard_deviation']:.1g} N/m; it was"
            " estimated beside the body"
        )
    yield from _on_bending(errors)
    alike: dict[str, list[str]] = {}
    for name in errors:
        if not name.startswith((f"{ROBOT}.attached", f"{ROBOT}.bending")):
            alike.setdefault(name.split()[0], []).append(name)
    for what, names in alike.items():
        owner, _, key = what.partition(".")
        latency, filtered = (f"{owner}.{each}" for each in (LATENCY, TIME_CONSTANT))
        if key in (LATENCY, TIME_CONSTANT) and latency in errors and filtered in errors:
            if key == LATENCY:
                behind = errors[latency]["value"] + errors[filtered]["value"]
                yield (
                    f"{owner} is {1e3 * behind:.2g} ms behind: these readings do not tell whether"
                    " it is late or filtered, and the uncertainty has both; state 'time_constant'"
                    " or 'delay' where it is known"
                )
            continue
        if key == LATENCY:
            yield (
                f"{owner} reads {_number(errors[what])} later than the clock that it shares with"
                f" others says; check that link or filter, or give {owner} a 'clock' of its own"
            )
            continue
        if len(names) > _MANY:
            most = max(names, key=lambda name: abs(errors[name]["value"]))
            yield (
                f"{what} was not stated, but the residuals ask for it: {len(names)} numbers, the"
                f" largest {_number(errors[most])} ({most.removeprefix(what).strip()})"
            )
            continue
        for name in names:
            yield f"{name} was not stated, but the residuals ask for it: {_number(errors[name])}"


def _on_bending(errors: Mapping[str, Mapping[str, Any]]) -> Iterator[str]:
    """What parts of the platform that bend do at a hertz, in one sentence."""
    sizes = []
    for part, unit in (("force", "kg"), ("torque", "kg m^2")):
        own = {axis: errors.get(f"{ROBOT}.bending.{part} {axis}{axis}") for axis in _AXES}
        most = max(
            (
                (each["value"], each["standard_deviation"], axis)
                for axis, each in own.items()
                if each
            ),
            default=None,
        )
        if most is not None:
            value, sigma = _HERTZ * most[0], _HERTZ * most[1]
            along = "along" if part == "force" else "about"
            sizes.append(f"{value:.2g} ± {sigma:.1g} {unit} {along} {most[2]}")
    if sizes:
        yield (
            "parts of the platform bend: at 1 Hz it answers like a body that has"
            f" {' and '.join(sizes)} more than it has; this was estimated beside the body, which"
            " stands for a platform that does not bend"
        )


def _number(error: Mapping[str, Any]) -> str:
    """With its 1-sigma and unit."""
    unit = "" if error["unit"] == "1" else f" {error['unit']}"
    return f"{error['value']:.3g} ± {error['standard_deviation']:.1g}{unit}"


def _asked_for(found: Posterior) -> Iterator[tuple[int, CalibrationParameter]]:
    """Places in the vector, and the parameters."""
    for place, parameter, _ in found.calibration.calibration_parameters.components():
        if parameter.full_key in found.asked_for:
            yield place, parameter


def _along(segment: Segment, process: Process) -> tuple[Array, Array]:
    """Values of a process at the middles between knots, and these times [s], shapes (n, p) and
    (n,).
    """
    start, end = segment.span
    inside = segment.knots[(segment.knots >= start) & (segment.knots <= end)]
    times = (inside[:-1] + inside[1:]) / 2
    return segment.disturbance(process, segment.basis(times)), times


def _is_of_load(found: Posterior, process: Process, run: str) -> bool:
    """Whether a disturbance is what moves in a load."""
    return process.source in UNMODELLED_PARTS and found.experiment.moves_within(run)


def _unit(found: Posterior, process: Process) -> str:
    owner, quantity = process.disturbs
    if process.source in UNMODELLED_PARTS:
        return "N" if quantity.endswith("force") else "N m"
    instrument = found.experiment.instruments[owner]
    return instrument.quantity(quantity, found.experiment.robot.m).unit
